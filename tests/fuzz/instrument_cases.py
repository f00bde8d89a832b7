"""Tables of every listed kind of measurement, alone and mixed, through every command that reads measurements."""

from __future__ import annotations

import math
import random

import yaml

from posture_opt.measurements.kinds import KINDS
from posture_opt.measurements.kinds.kind import Kind
from posture_opt.measurements.kinds.pose import QUATERNION
from tests.fuzz.bases import problem_file
from tests.fuzz.case import Case
from tests.fuzz.measured_tables import Table, planar, with_columns
from tests.fuzz.sections import section

_ROWS = (1, 3, 5, 8, 12, 20, 30)
_UNITS = {"length": ("mm", 1e3), "angle": ("deg", 57.3), "pixel": ("px", 2e3)}
_PROBLEM = "insert_planar_2r_measured"


def instrument_case(rng: random.Random, number: int) -> Case:
    """One call with a table of a kind of measurement; the problem file states what the schema knows of instruments."""
    table = planar(rng, rng.choice(_ROWS))
    kinds = rng.sample(KINDS, 1 if rng.random() < 0.8 else 2)
    if rng.random() < 0.85:
        for row in [table.heads, *table.rows]:
            del row[2:]
    for kind in kinds:
        _add(rng, table, kind)
    if len(kinds) > 1 and rng.random() < 0.8:
        table.add("instrument", [rng.choice(kinds).kind for _ in table.rows])
    if rng.random() < 0.2:
        with_columns(rng, table)
    data = yaml.safe_load(problem_file(f"{_PROBLEM}.yaml").read_text("utf-8"))
    if rng.random() < 0.6:
        data["data"] = section(rng, "data", ("joint1", "joint2"))
    if rng.random() < 0.3:
        data["robot"] |= {name: "free" for name in ("base", "tool") if rng.random() < 0.5}
    if rng.random() < 0.4:
        sigma = "0.1 mm"
        data["uncertainty"]["measurement"] = {kind.sigma_key: sigma for kind in kinds} | {"position": sigma}
        data["uncertainty"]["measurement"] |= {one.key: "0.1 mrad" for kind in kinds for one in kind.further}
    files: dict[str, bytes] = {"d.csv": table.text().encode(), "p.yaml": yaml.safe_dump(data).encode()}
    words = rng.choice(_COMMANDS) + rng.choice(((), ("--json",), ("--full",)))
    return Case("instrument", number, words, files, ("o",))  # type: ignore[arg-type]


def _add(rng: random.Random, table: Table, kind: type[Kind]) -> None:
    """The columns of a kind: numbers that follow the joints, with scatter, and names of places."""
    rows = len(table.rows)
    if not {*kind.columns, kind.label} - {"", *table.heads} and len(table.heads) < 4:
        for head in ("x [mm]", "y [mm]"):
            table.add(head, [f"{rng.gauss(0, 900):.3f}" for _ in range(rows)])
    for name, dimension in kind.columns.items():
        unit, size = _UNITS.get(dimension, ("mm", 1e3))
        wave = [0.5 * size * (1 + 0.3 * math.sin(0.05 * float(row[0]) + 0.03 * float(row[1]))) for row in table.rows]
        table.add(f"{name} [{unit}]", [f"{value + rng.gauss(0, 1e-4 * size):.4f}" for value in wave])
    if kind.oriented:
        turns = [0.4 * float(row[0]) / 57.3 for row in table.rows]
        parts = ([math.cos(turn) for turn in turns], [0.0] * rows, [0.0] * rows, [math.sin(turn) for turn in turns])
        for name, values in zip(QUATERNION, parts, strict=True):
            table.add(name, [f"{value:.4f}" for value in values])
    groups = rng.choice((1, 2, 3, max(rows, 1)))
    for label in (kind.label, kind.second_label):
        if label and label not in table.heads and rng.random() < 0.95:
            table.add(label, [f"{label[0]}{k % groups}" for k in range(rows)])


_FILES = ("--problem", "p.yaml")
_FITTED = ("--folds", "2", "--no-plan")
_COMMANDS: tuple[tuple[str, ...], ...] = (
    *[("calibrate", "d.csv", *_FILES, *_FITTED)] * 4,
    *[("recheck", "d.csv", *_FILES)] * 2,
    ("diagnose", "d.csv", *_FILES, *_FITTED),
    ("plan-measurements", *_FILES, "--given", "d.csv", "--count", "2", "--candidates", "10"),
    ("plan-measurements", *_FILES, "--for", "recheck", "--count", "2", "--candidates", "10"),
    ("map", *_FILES, "--quantity", "accuracy", "--data", "d.csv", "--grid", "2x2"),
    ("compensate", "d.csv", *_FILES, "--out", "o", "--no-plots"),
    ("recheck", "d.csv", *_FILES, "--update", "--out", "o", "--no-plots"),
)
