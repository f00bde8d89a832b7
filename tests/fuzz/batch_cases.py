"""Several files at once, with checkpoints of any content; two arms compared; programs of planned postures."""

from __future__ import annotations

import random

from posture_opt.export import EXPORTS
from tests.fuzz.bases import Base, bases
from tests.fuzz.case import Case
from tests.fuzz.text_faults import spoil
from tests.fuzz.yaml_cases import change, text_of

_CHECKPOINTS = (b"", b"\n", b"{}", b'{"a": 1}\n', b"\x00" * 40, b"[" * 2000, b"posture_opt\n{}\n")


def batch_case(rng: random.Random, number: int) -> Case:
    """One call with some problem files, most of them sound."""
    chosen = [_quick(rng) for _ in range(rng.choice((1, 2, 2, 3)))]
    files: dict[str, bytes] = {}
    for k, base in enumerate(chosen):
        data = base.copy()
        for _ in range(rng.choice((0, 0, 1))):
            change(rng, data)
        text = text_of(data)
        files |= {f"{k}.yaml": spoil(rng, text) if rng.random() < 0.05 else text, **base.files}
    words, kept = _words(rng, [f"{k}.yaml" for k in range(len(chosen))])
    if kept and rng.random() < 0.4:
        files["c"] = rng.choice(_CHECKPOINTS)
    return Case("batch", number, words, files, ("o",), kept)  # type: ignore[arg-type]


def _quick(rng: random.Random) -> Base:
    return rng.choice([base for base in bases() if base.is_quick and len(base.joints) < 4 and base.data.get("task")])


def _words(rng: random.Random, names: list[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    choice = rng.random()
    manner = rng.choice(((), ("--json",), ("--full",), ("--quiet", "--out", "o", "--no-plots")))
    if choice < 0.5:
        kept = ("c",) if rng.random() < 0.5 else ()
        return ("batch", *names, *(("--checkpoint", "c") if kept else ()), *manner), kept
    if choice < 0.7:
        return ("compare", names[0], names[-1] if len(names) > 1 else "insert_planar_2r", *manner), ()
    if choice < 0.8:
        kept = ("c",) if rng.random() < 0.5 else ()
        return ("map", "--problem", names[0], "--grid", "2x2", *(("--checkpoint", "c") if kept else ()), *manner), kept
    to = rng.choice([one.model_fields["kind"].default for one in EXPORTS])
    return ("export", "--problem", names[0], "--to", to, "--out", "o"), ()
