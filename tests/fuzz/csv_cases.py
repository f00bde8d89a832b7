"""Tables: measurements, targets, covariances and paths with cells, heads, rows and columns that should not be."""

from __future__ import annotations

import random
from collections.abc import Callable

from tests.fuzz.bases import problem_file
from tests.fuzz.case import Case
from tests.fuzz.measured_tables import Table, planar, with_columns
from tests.fuzz.text_faults import spoil
from tests.fuzz.values import number_text, word

FILE = "d.csv"
_UNITS = (
    "mm", "m", "deg", "rad", "um", "in", "cm", "kg", "degC", "K", "s", "", "9**9", "mm mm", "deg/s", "µm", "°", "[",
    "x" * 60,
)  # fmt: skip
_CELLS = (
    "", " ", "nan", "NaN", "inf", "-inf", "1e999", "1e16", "-1e14", "1e-320", "1_0", "1,5", "1.5.2", "0x1f", "True",
    "None", "-", "+", "1e", "1 mm", '"1"', '"1', "''", "'5", "1;2", "1\t2", "٣", "１", "½", "∞", "#", "# 1", "=1+1",
    "\x00", "é" * 50, "9" * 400, "-0", "+5", ".5", "5.", "1.000,5", "1'000", "1 000",
)  # fmt: skip
_TASK = "task: {{kind: trace, path: {0}}}\n"
_PROBLEM = (
    "name: p\nrobot:\n  kind: dh\n  joints:\n"
    "    - {name: joint1, type: revolute, a: 1 m, alpha: 0 deg, d: 0 m, theta: 0 deg, limits: [-180 deg, 180 deg]}\n"
    "    - {name: joint2, type: revolute, a: 1 m, alpha: 0 deg, d: 0 m, theta: 0 deg, limits: [-180 deg, 180 deg]}\n"
)


def csv_case(rng: random.Random, number: int) -> Case:
    """One call with a random table."""
    words, table, problem = rng.choice(_USES)(rng)
    for _ in range(rng.choice((0, 1, 1, 1, 2, 4))):
        rng.choice(_CHANGES)(rng, table)
    separator = rng.choice((", ", ",", ",", ";", "\t", " ", "|"))
    end = rng.choice(("\n", "\n", "\n", "\r\n", "\r"))
    text = _preamble(rng) + table.text(separator, end)
    if separator == ";" and rng.random() < 0.5:
        text = text.replace(".", ",")
    content = text.encode("utf-8", "surrogatepass")
    if rng.random() < 0.15:
        content = spoil(rng, content)
    files = {FILE: content} | ({"p.yaml": problem.encode()} if problem else {})
    out = ("o",) if "--out" in words else ()
    return Case("csv", number, words, files, out)


Use = tuple[tuple[str, ...], Table, str]


def _manner(rng: random.Random) -> tuple[str, ...]:
    return rng.choice(((), (), ("--json",), ("--full",), ("--quiet",)))


def _calibrate(rng: random.Random) -> Use:
    """Mostly of so few rows that the answer is quick."""
    table = planar(rng, rng.choice((0, 1, 2, 3, 4, 5, 6)))
    with_columns(rng, table)
    command = rng.choice(("calibrate", "calibrate", "calibrate", "diagnose"))
    plan = ("--no-plan",) if rng.random() < 0.9 else ()
    by = rng.choice(((), (), ("--by", "pose"), ("--by", "block"), ("--by", "place")))
    column = (
        ("--column", rng.choice(("x=x", "x=3", "y=x [mm]", "joint1=2", "q=1", word(rng)))) if rng.random() < 0.1 else ()
    )
    return (
        (command, FILE, "--problem", "insert_planar_2r_measured", "--folds", "2", *plan, *by, *column, *_manner(rng)),
        table,
        "",
    )


def _compensate(rng: random.Random) -> Use:
    table = planar(rng, rng.choice((0, 1, 2, 3)))
    if rng.random() < 0.5:
        for row in [table.heads, *table.rows]:
            del row[:2]
    elif rng.random() < 0.5:
        for row in [table.heads, *table.rows]:
            del row[2:]
    if rng.random() < 0.3:
        with_columns(rng, table)
    problem = rng.choice(("insert_planar_2r_measured", "insert_planar_2r_calibrated", "insert_planar_2r"))
    program = ("--program", rng.choice(("krl", "rapid", "urscript", "jointstate"))) if rng.random() < 0.3 else ()
    return ("compensate", FILE, "--problem", problem, *program, "--out", "o", "--no-plots", *_manner(rng)), table, ""


def _covariance(rng: random.Random) -> Use:
    table = _shipped("planar_2r_calibrated.csv", 9)
    problem = _PROBLEM + f"uncertainty: {{covariance: {FILE}}}\n"
    return ("uncertainty", "--problem", "p.yaml", "--posture", "20 deg, 40 deg", *_manner(rng)), table, problem


def _path(rng: random.Random) -> Use:
    table = _shipped(rng.choice(("scara_bead.csv", "panda_bead.csv", "ur10_seam.csv")), rng.choice((0, 1, 2, 3, 9)))
    words: tuple[str, ...] = ("uncertainty", "--problem", "p.yaml", "--posture", "20 deg, 40 deg")
    if rng.random() < 0.03:
        words = ("--problem", "p.yaml")
    return (*words, *_manner(rng)), table, _PROBLEM + _TASK.format(FILE)


def _given(rng: random.Random) -> Use:
    table = planar(rng, rng.choice((0, 1, 3, 8)))
    with_columns(rng, table)
    words = ("plan-measurements", "--problem", "insert_planar_2r_measured", "--given", FILE, "--count", "2")
    return (*words, "--candidates", "10", *_manner(rng)), table, ""


def _map(rng: random.Random) -> Use:
    table = planar(rng, rng.choice((0, 1, 3, 8)))
    words = ("map", "--problem", "insert_planar_2r_calibrated", "--quantity", "accuracy", "--data", FILE)
    return (*words, "--grid", "2x2", *_manner(rng)), table, ""


def _unknown_robot(rng: random.Random) -> Use:
    """A robot without a problem file: its frames are free."""
    table = _shipped("ur10_measured.csv", rng.choice((0, 1, 3, 6)))
    return ("calibrate", FILE, "--robot", "ur10", "--folds", "2", "--no-plan", "--json"), table, ""


def _points(rng: random.Random) -> Use:
    table = _shipped("kuka_iiwa14_sockets.csv", rng.choice((0, 1, 4, 8)))
    return (
        ("calibrate", FILE, "--problem", "kuka_iiwa14_sockets", "--folds", "2", "--no-plan", *_manner(rng)),
        table,
        "",
    )


def _batch(rng: random.Random) -> Use:
    table = _shipped("planar_2r_batch.csv", rng.choice((0, 1, 4, 8)))
    command = rng.choice(("calibrate", "diagnose"))
    return (command, FILE, "--problem", "insert_planar_2r_measured", "--folds", "2", *_manner(rng)), table, ""


_USES: tuple[Callable[[random.Random], Use], ...] = (
    _calibrate, _calibrate, _compensate, _compensate, _compensate, _covariance, _covariance, _covariance, _covariance,
    _path, _path, _path, _path, _given, _map, _unknown_robot, _points, _batch,
)  # fmt: skip


def _shipped(name: str, rows: int) -> Table:
    lines = [[cell.strip() for cell in line.split(",")] for line in problem_file(name).read_text("utf-8").splitlines()]
    return Table(lines[0], lines[1 : rows + 1])


def _preamble(rng: random.Random) -> str:
    if rng.random() > 0.1:
        return ""
    return rng.choice(
        ("# a comment\n", "\n\n", "sep=;\n", "Report 3\n1, 2\n", "# joint1 [deg], x [mm]\n", "%\n", '"\n', "joint1\n")
    )


def _cell(rng: random.Random, table: Table) -> None:
    if table.rows:
        row = rng.choice(table.rows)
        if row:
            row[rng.randrange(len(row))] = rng.choice(_CELLS) if rng.random() < 0.6 else number_text(rng)


def _head(rng: random.Random, table: Table) -> None:
    if not table.heads:
        return
    at = rng.randrange(len(table.heads))
    name = table.heads[at].split(" [")[0]
    table.heads[at] = rng.choice(
        (f"{name} [{rng.choice(_UNITS)}]", f"{name} ({rng.choice(_UNITS)})", name, name[:-1], name.upper(), word(rng),
         f"{name} [", f"[{name}]", "", f"{name} [mm] [mm]", rng.choice(table.heads), f'"{table.heads[at]}"')
    )  # fmt: skip


def _drop_column(rng: random.Random, table: Table) -> None:
    at = rng.randrange(len(table.heads)) if table.heads else 0
    for row in [table.heads, *table.rows]:
        del row[at : at + 1]


def _double_column(rng: random.Random, table: Table) -> None:
    at = rng.randrange(len(table.heads)) if table.heads else 0
    for row in [table.heads, *table.rows]:
        row[at:at] = row[at : at + 1]


def _swap_columns(rng: random.Random, table: Table) -> None:
    if len(table.heads) > 1:
        a, b = rng.sample(range(len(table.heads)), 2)
        table.heads[a], table.heads[b] = table.heads[b], table.heads[a]


def _row(rng: random.Random, table: Table) -> None:
    """A row too long, too short, empty, doubled, or of another table."""
    if not table.rows:
        return
    at = rng.randrange(len(table.rows))
    row = table.rows[at]
    table.rows[at : at + 1] = rng.choice(
        (
            [row[:-1]], [[*row, "1"]], [[]], [[""] * len(row)], [row, list(row)], [list(table.heads), row],
            [[word(rng)]], [],
        )
    )  # fmt: skip


def _constant(rng: random.Random, table: Table) -> None:
    at, cell = rng.randrange(max(1, len(table.heads))), number_text(rng)
    for row in table.rows:
        row[at : at + 1] = [cell]


def _factor(rng: random.Random, table: Table) -> None:
    """A column in another unit than its head says, or far away."""
    at, factor = rng.randrange(max(1, len(table.heads))), rng.choice((0, 1e-3, 1e3, 57.3, -1, 1e9, 1e-12))
    for row in table.rows:
        for k, cell in enumerate(row[at : at + 1]):
            try:
                row[at + k] = f"{float(cell) * factor:g}"
            except ValueError:
                continue


def _noise(rng: random.Random, table: Table) -> None:
    """Every number changed by a little or much."""
    scale = rng.choice((1e-9, 1e-3, 1.0, 1e3))
    for row in table.rows:
        for at, cell in enumerate(row):
            try:
                row[at] = repr(float(cell) * (1 + scale * rng.gauss(0, 1)))
            except ValueError:
                continue


def _no_rows(rng: random.Random, table: Table) -> None:
    del table.rows[rng.choice((0, 1, 2)) :]


def _columns(rng: random.Random, table: Table) -> None:
    if all(len(row) == len(table.heads) for row in table.rows):
        with_columns(rng, table)


_CHANGES: tuple[Callable[[random.Random, Table], None], ...] = (
    _cell, _cell, _cell, _head, _head, _drop_column, _double_column, _swap_columns, _row, _row, _constant, _factor,
    _factor, _noise, _no_rows, _columns,
)  # fmt: skip
