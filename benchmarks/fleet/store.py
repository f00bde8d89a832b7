"""The best known answers on disk: one JSON file a case, lowered by every better answer."""

from __future__ import annotations

import json
import zlib
from dataclasses import asdict, dataclass
from pathlib import Path

from benchmarks.fleet.brute import Best
from benchmarks.fleet.cases import Case


@dataclass(frozen=True)
class Store:
    """The folder that `--cache` names."""

    folder: Path

    def _path(self, case: Case) -> Path:
        arm, *rest = case.key.split("/")
        return self.folder / arm / f"{'-'.join(rest)}.json"

    def read(self, case: Case) -> Best | None:
        """The best known answer, or None where there is none for exactly this problem."""
        path = self._path(case)
        if not path.exists():
            return None
        stored = json.loads(path.read_text(encoding="utf-8"))
        if stored.pop("problem") != _fingerprint(case):
            return None
        return Best(stored["value"], tuple(stored["q"]), stored["rounds"], stored["hits"])

    def write(self, case: Case, best: Best) -> None:
        """Keep an answer; the file appears whole."""
        path = self._path(case)
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_suffix(".part")
        part.write_text(json.dumps(asdict(best) | {"problem": _fingerprint(case)}), encoding="utf-8")
        part.replace(path)


def _fingerprint(case: Case) -> int:
    """Of the problem to nine digits, without the folder that the robot's file lies in."""
    robot = {k: v for k, v in case.document["robot"].items() if k != "file"}
    numbers = [[round(v, 9) for v in side] for side in (case.position, case.direction, (case.clearance,))]
    rest = {k: v for k, v in case.setup.base.items() if k != "robot"}
    return zlib.crc32(json.dumps([robot, numbers, rest], sort_keys=True).encode())
