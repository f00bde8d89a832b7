"""A computation that is killed at any moment goes on where it was, and ends with the same bytes."""

from __future__ import annotations

import hmac
import json
import multiprocessing
import random
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

import posture_opt as po
from posture_opt import __version__
from posture_opt.problem.load import load_builtin
from posture_opt.workers import Part, Serial, Workers
from posture_opt.workers.checkpoint import Checkpoint
from tests.helpers.command_line import invoke
from tests.workers.parts import squared

GRID: dict[str, Any] = {"counts": (14, 14), "low": (-0.35, -0.35, -0.08), "high": (0.35, 0.35, -0.08)}


class Counted(Workers):
    """This process, and a file with a byte for every part that it began."""

    def __init__(self, log: Path) -> None:
        self.log = log

    def run(self, part: Part, shared: Any, items: Sequence[Any]) -> Iterator[tuple[int, Any]]:
        with self.log.open("ab", buffering=0) as log:
            for k in range(len(items)):
                log.write(b".")
                yield from ((k, result) for _, result in Serial().run(part, shared, [items[k]]))


def mapped(folder: Path) -> None:
    with Checkpoint(folder / "kept", {"grid": GRID["counts"]}, Counted(folder / "log")) as workers:
        found = po.map_targets(load_builtin("insert_scara"), executor=workers, **GRID)
    document = json.dumps(found.to_json() | {"seconds": 0.0})
    (folder / "answer.new").write_text(document)
    (folder / "answer.new").rename(folder / "answer")


@pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="a run is a fork of this process")
@pytest.mark.parametrize("times", [3, pytest.param(20, marks=pytest.mark.interrupts)])
def test_a_map_killed_at_some_moments_ends_with_the_same_bytes(times: int, tmp_path: Path) -> None:
    whole = tmp_path / "whole"
    whole.mkdir()
    mapped(whole)
    parts = (whole / "log").stat().st_size
    assert parts > 20
    context, rng, kills, most = multiprocessing.get_context("fork"), random.Random(5), 0, 0
    while kills < times:
        folder = tmp_path / f"killed{kills}"
        folder.mkdir()
        lost = 0
        while not (folder / "answer").exists():
            run = context.Process(target=mapped, args=(folder,))
            run.start()
            run.join(rng.uniform(0.0, 0.2) if kills < times else None)
            run.kill()
            run.join()
            lost += run.exitcode != 0
            kills += run.exitcode != 0
        assert (folder / "answer").read_bytes() == (whole / "answer").read_bytes()
        assert sorted((folder / "kept").read_bytes().splitlines()) == sorted((whole / "kept").read_bytes().splitlines())
        # Each run that was killed lost the part that it was at, and no other.
        assert parts <= (folder / "log").stat().st_size <= parts + lost
        most = max(most, lost)
    assert most > 1 or times == 3


def worked(path: Path, asked: dict[str, Any], count: int = 12) -> tuple[list[Any], int]:
    """All results, and how many of them were worked out now."""
    log = path.with_name("log")
    log.write_bytes(b"")
    with Checkpoint(path, asked, Counted(log)) as workers:
        results = [workers.in_order(squared, shared, range(count)) for shared in (2, 3)]
    return results, log.stat().st_size


def test_any_beginning_of_the_file_is_gone_on_from(tmp_path: Path) -> None:
    file = tmp_path / "kept"
    whole, count = worked(file, {"grid": "3x3"})
    assert count == 24
    assert worked(file, {"grid": "3x3"}) == (whole, 0)
    content = file.read_bytes()
    head = content.index(b"\n") + 1
    for length in (0, 5, head - 1, head, head + 1, *range(head, len(content), 37)):
        file.write_bytes(content[:length])
        lines = max(content[:length].count(b"\n") - 1, 0)
        assert worked(file, {"grid": "3x3"}) == (whole, 24 - lines)
        assert file.read_bytes() == content


def test_what_follows_a_broken_line_is_done_again(tmp_path: Path) -> None:
    file = tmp_path / "kept"
    whole, _ = worked(file, {})
    lines = file.read_bytes().splitlines(keepends=True)
    lines[5] = lines[5].replace(b"[", b"{", 1)
    file.write_bytes(b"".join(lines))
    assert worked(file, {}) == (whole, 24 - 4)


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        ({"grid": "4x3", "seed": 1}, r"another grid \(3x3 there, 4x3 here\)"),
        ({"grid": "3x3"}, r"another seed \(1 there, none here\)"),
    ],
)
def test_another_question_is_refused(tmp_path: Path, asked: dict[str, Any], told: str) -> None:
    file = tmp_path / "kept"
    worked(file, {"grid": "3x3", "seed": 1})
    content = file.read_bytes()
    with pytest.raises(po.errors.InputError, match=told):
        worked(file, asked)
    assert file.read_bytes() == content


def test_another_version_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    worked(tmp_path / "kept", {})
    monkeypatch.setattr("posture_opt.workers.checkpoint.__version__", "99")
    with pytest.raises(po.errors.InputError, match="another version"):
        worked(tmp_path / "kept", {})


@pytest.mark.parametrize("content", [b"q1, q2\n1, 2\n", b"\0" * 100_000, b"{}", b"0123456789abcdef [1,2,3]\n"])
def test_a_foreign_file_is_refused_and_left_alone(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "table.csv"
    file.write_bytes(content)
    with pytest.raises(po.errors.InputError, match="this is no checkpoint"):
        worked(file, {})
    assert file.read_bytes() == content


def test_two_runs_do_not_share_a_file(tmp_path: Path) -> None:
    pytest.importorskip("fcntl", reason="files are not locked on this system")
    with (
        Checkpoint(tmp_path / "kept", {}, Serial()),
        pytest.raises(po.errors.InputError, match="another run uses this file"),
    ):
        Checkpoint(tmp_path / "kept", {}, Serial())


@pytest.mark.parametrize(
    ("name", "told"), [(".", "this is no file"), ("no/such/kept", "cannot be written"), ("x" * 300, "too long")]
)
def test_a_file_that_cannot_be_is_refused(tmp_path: Path, name: str, told: str) -> None:
    with pytest.raises(po.errors.InputError, match=told):
        Checkpoint(tmp_path / name, {}, Serial())


def test_a_full_disk_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(number: int) -> None:
        raise OSError(28, "No space left on device")

    with Checkpoint(tmp_path / "kept", {}, Serial()) as workers:
        monkeypatch.setattr("os.fsync", full)
        with pytest.raises(po.errors.InputError, match=r"cannot be written \(No space left on device\)"):
            workers.in_order(squared, 2, [1])


def test_the_command_goes_on_and_refuses_another_grid(tmp_path: Path) -> None:
    words = ["map", "--problem", "insert_scara", "--checkpoint", tmp_path / "kept", "--json", "--grid"]
    first, again, other = (invoke(*words, grid) for grid in ("5x5", "5x5", "5x6"))
    assert first.exit_code == again.exit_code == 0, first.stderr + again.stderr
    once, twice = (json.loads(result.stdout) | {"seconds": 0} for result in (first, again))
    assert once == twice
    assert other.exit_code == 2
    assert "another counts ([5, 5] there, [5, 6] here)" in other.stderr


FORGED: list[tuple[str, Any]] = [
    ("no list", 5), ("a number more", [1, 2, 3, 4]), ("a text for a round", ["1", 0, []]), ("below zero", [-1, 0, []]),
    ("another part", [1, 10**6, []]), ("nothing", [1, 0, None]), ("no row", [1, 0, []]), ("a text", [1, 0, "x" * 9]),
    ("a row too few", lambda rows: rows[1:]), ("another arm", lambda rows: [cut(row, 2, [0.1]) for row in rows]),
    ("no number", lambda rows: [cut(row, 3, "0.1") for row in rows]), ("NaN", lambda rows: nan(rows)),
    ("unknown status", lambda rows: [cut(row, 0, "best") for row in rows]),
    ("no fields", lambda rows: [[]] * len(rows)),
]  # fmt: skip


def cut(row: list[Any], at: int, value: Any) -> list[Any]:
    """The packed candidate with another entry."""
    return [*row[:at], value, *row[at + 1 :]]


def nan(rows: list[Any]) -> list[Any]:
    return [cut(row, 2, [float("nan")] * 4) for row in rows]


def signed(record: Any, key: bytes) -> bytes:
    """A line of the file, written from its description: a keyed digest, a blank, JSON."""
    text = json.dumps(record, separators=(",", ":")).encode()
    return hmac.new(key, text, "sha256").hexdigest()[:16].encode() + b" " + text + b"\n"


def test_forged_records_are_refused(tmp_path: Path) -> None:
    """With the right digest, as only somebody who knows this program writes them."""
    file, problem = tmp_path / "kept", load_builtin("insert_scara")
    grid: dict[str, Any] = {**GRID, "counts": (3, 3)}

    def run() -> Any:
        with Checkpoint(file, {"grid": "3x3"}, Serial()) as workers:
            return po.map_targets(problem, executor=workers, **grid)

    found = run()
    head, first, *_ = file.read_bytes().splitlines(keepends=True)
    key, (number, part, rows) = head.partition(b" ")[2][:-1], json.loads(first.partition(b" ")[2])
    assert signed([number, part, rows], key) == first
    for what, forged in FORGED:
        record = [number, part, forged(rows)] if callable(forged) else forged
        file.write_bytes(head + signed(record, key))
        with pytest.raises(po.errors.InputError, match="no result of this computation"):
            pytest.fail(f"{what}: {run()}")
    file.write_bytes(head + signed([number, part, rows], b"of another problem"))
    assert run().to_json() | {"seconds": 0} == found.to_json() | {"seconds": 0}, "a foreign line is done again"


def test_forged_answers_of_a_batch_are_refused(tmp_path: Path) -> None:
    file, problems = tmp_path / "kept", {"a": load_builtin("insert_planar_2r")}
    head = signed({"format": "posture_opt checkpoint 2", "version": __version__}, b"")
    key = head.partition(b" ")[2][:-1]
    for forged in ([], [0, [], None], [0, [], {}], ["0", [], None], [2, "why", None], [7, [], None], [2, [1], None]):
        file.write_bytes(head + signed([1, 0, forged], key))
        with (
            Checkpoint(file, {}, Serial()) as workers,
            pytest.raises(po.errors.InputError, match="no result of this computation"),
        ):
            po.select_postures(problems, executor=workers)
