"""What the diagnosis makes of real arms, as Markdown: ``python -m benchmarks.real_arms FOLDER [SET ...]``.

FOLDER holds measurements that are not part of the project, one subfolder an origin; sets that are missing are skipped.
The KUKA iiwa of ``problems`` is always there. Every set has a process of its own: its CPU seconds and its peak memory
are of itself alone, imports included.
"""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np

import posture_opt as po
from posture_opt.diagnosis.diagnosis import Diagnosis
from posture_opt.files import problems_folder
from posture_opt.model.effects import CyclicError, Effect

HEADERS = ("data", "rows", "before", "calibrated", "with effects", "delivered", "delivered, held out", "by block",
           "causes", "CPU s", "GB", "named")  # fmt: skip


@dataclass(frozen=True)
class RealSet:
    """Measurements of a real arm, its problem file, and perhaps those of another session; or points were touched."""

    name: str
    data: Path
    problem: Path
    test: Path | None = None
    touches: bool = False

    @property
    def there(self) -> bool:
        """Whether its files are."""
        return all(path.is_file() for path in (self.data, self.problem, self.test) if path is not None)


def real_sets(folder: Path) -> Iterator[RealSet]:
    """The sets of the table, the one that takes longest last."""
    ur5, wam, ipa, mukca = (folder / name for name in ("jacobi_ur5", "jacobi_wam", "ipa_ur10", "mukca_sockets"))
    iiwa = problems_folder() / "kuka_iiwa14_sockets"
    yield RealSet("KUKA iiwa 14, sockets", iiwa.with_suffix(".csv"), iiwa.with_suffix(".yaml"), touches=True)
    yield RealSet("Panda 3, sockets", mukca / "panda_3.csv", mukca / "problem_panda.yaml", touches=True)
    yield RealSet("Panda 4, sockets 50 mm apart", mukca / "panda_4.csv", mukca / "problem_panda_4.yaml", touches=True)
    yield RealSet("UR5, grid", ur5 / "grid.csv", ur5 / "problem.yaml", ur5 / "random.csv")
    yield RealSet("Barrett WAM, grid", wam / "grid.csv", wam / "problem.yaml", wam / "test.csv")
    for series in "dba":
        yield RealSet(f"UR10, series {series.upper()}", ipa / f"series_{series}.csv", ipa / "problem.yaml")


def rows_of(asked: RealSet) -> list[tuple[str, ...]]:
    """The row of a set, and one for its other session; millimetres."""
    problem = po.load_problem(asked.problem)
    data = po.read_measurements(asked.data, problem)
    other = po.read_measurements(asked.test, problem) if asked.test else None
    found = po.diagnose(problem, data, test=other, plan=False)
    rms = found.findings_json()["residual_rms"]
    seconds = time.process_time()
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6  # kB on Linux
    models = [f"{1e3 * rms[m]:.3f}" for m in ("nominal", "calibrated", "extended", "delivered", "delivered_heldout")]
    effects = found.model.effects
    end = (_by_block(found), _count(effects), f"{seconds:.0f}", f"{memory:.2f}", _names(effects))
    rows = [(asked.name, str(len(data)), *models, *end)]
    if other is not None and found.test is not None:
        mean = {name: f"{1e3 * statistics.mean:.3f}" for name, statistics in found.test.models.items()}
        elsewhere = (mean["nominal"], mean["calibrated"], "", "", mean["extended"])
        rows.append(("– its other session, mean", str(len(other)), *elsewhere, "", "", "", "", ""))
    return rows


def _by_block(found: Diagnosis) -> str:
    """The errors of blocks left out, calibrated and with effects chosen without them; nothing for touched points."""
    if found.by == "place":
        return ""
    search = found.search.names or found.search
    blocks = search.nested.each[-1]
    size = min(search.nested.size, len(blocks.totals) - 1)
    before, after = (1e3 * np.sqrt(blocks.totals[k].sum() / len(blocks.groups)) for k in (0, size))
    return f"{before:.3f} → {after:.3f}"


def _count(effects: Sequence[Effect]) -> str:
    """How many effects there are, and how many with every line of a joint counted."""
    lines = sum(len(effect.lines) if isinstance(effect, CyclicError) else 1 for effect in effects)
    return str(len(effects)) if lines == len(effects) else f"{len(effects)} ({lines} with every line)"


def _names(effects: Sequence[Effect]) -> str:
    """What was named, by kind."""
    targets: dict[str, list[str]] = {}
    for effect in effects:
        targets.setdefault(effect.kind.replace("_", " "), []).append(effect.target)
    return "; ".join(f"{kind} ({', '.join(dict.fromkeys(of))})" for kind, of in targets.items()) or "none"


def markdown_row(cells: Sequence[str]) -> str:
    """A row of a Markdown table."""
    return f"| {' | '.join(cells)} |"


def main(folder: Path, names: Sequence[str]) -> None:
    """Every set by itself, of those that are there; ``names`` are parts of the names of those that are asked for."""
    print(markdown_row(HEADERS))
    print(markdown_row(["---", *["--:"] * (len(HEADERS) - 2), "---"]), flush=True)
    for asked in real_sets(folder):
        if asked.there and (not names or any(name in asked.name for name in names)):
            with ProcessPoolExecutor(1, get_context("spawn")) as alone:
                for cells in alone.submit(rows_of, asked).result():
                    print(markdown_row(cells), flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
