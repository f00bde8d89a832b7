"""Whole calibrations and diagnoses of small simulated data sets, many of them badly designed."""

from __future__ import annotations

import random

from tests.fuzz.case import Case
from tests.fuzz.measured_tables import planar, with_columns

_ROWS = (1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12, 15, 20, 30, 40)


def calibrate_case(rng: random.Random, number: int) -> Case:
    """One ``calibrate``."""
    extra = (("--no-priors",) if rng.random() < 0.2 else ()) + _by(rng)
    return _case("calibrate", rng, number, extra)


def diagnose_case(rng: random.Random, number: int) -> Case:
    """One ``diagnose``."""
    extra = (("--with-time",) if rng.random() < 0.1 else ()) + _by(rng)
    return _case("diagnose", rng, number, extra)


def _by(rng: random.Random) -> tuple[str, ...]:
    by = rng.choice(((), (), (), ("--by", "pose"), ("--by", "block"), ("--by", "place")))
    return (*by, *rng.choice(((), (), ("--folds", "2"), ("--folds", "3"), ("--folds", "50"))))


def _case(command: str, rng: random.Random, number: int, extra: tuple[str, ...]) -> Case:
    table = planar(rng, rng.choice(_ROWS))
    if rng.random() < 0.5:
        with_columns(rng, table)
    files: dict[str, bytes] = {"d.csv": table.text().encode()}
    words = [command, "d.csv", "--problem", "insert_planar_2r_measured", *extra]
    if rng.random() < 0.15:
        words[2:4] = ["--robot", "planar_2r"]
    if rng.random() < 0.2:
        other = planar(rng, rng.choice(_ROWS))
        files["t.csv"] = other.text().encode()
        words += ["--test", "t.csv", *rng.choice(((), ("--refit-frames",)))]
    words += rng.choice(((), ("--json",), ("--full",)))
    words += ["--no-plan"] if rng.random() < 0.7 else []
    out = ("d_problem.yaml",)  # of a robot without a problem file
    if rng.random() < 0.1:
        words += ["--out", "o", *rng.choice(((), ("--no-plots",), ("--no-plots",)))]
        out = (*out, "o")
    return Case(command, number, tuple(words), files, out)
