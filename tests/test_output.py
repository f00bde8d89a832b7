"""Folders and files appear whole or not at all, also when the program is killed, and nobody else's file is touched."""

from __future__ import annotations

import hashlib
import os
import random
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import posture_opt as po
from posture_opt import output
from posture_opt.output import MANIFEST, PREFIX, writable_folder, write_file, write_folder
from tests.helpers.folders import names

ROOT = Path(__file__).parents[1]
REPLACED = frozenset({f"{name}{k}" for name in "ab" for k in range(30)} | {"both"})
REPORTS = """
from posture_opt.output import write_folder
def report(tag, size):
    return {f"{tag}{k}": tag.encode() * size for k in range(size)} | {"both": tag.encode() * 20_000}
replaced = frozenset([f"{name}{k}" for name in "ab" for k in range(30)] + ["both"])
"""
ENDLESS = f"""
import itertools, sys
from pathlib import Path
{REPORTS}
print("begun", flush=True)
for tag, size in itertools.cycle([("a", 12), ("b", 7)]):
    write_folder(Path(sys.argv[1]), report(tag, size), replaces=replaced)
    print("written", flush=True)
"""
posix = pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
linux = pytest.mark.skipif(sys.platform != "linux", reason="folders are exchanged on Linux")


def killed(out: Path, rng: random.Random) -> None:
    """Writes one report after another, and is killed in the middle of one."""
    with subprocess.Popen(
        [sys.executable, "-c", ENDLESS, str(out)], stdout=subprocess.PIPE, cwd=ROOT, env={**os.environ}
    ) as process:
        for _ in range(rng.randint(2, 4)):
            begun = time.monotonic()
            process.stdout.readline()
        time.sleep(rng.uniform(0.0, 1.1) * (time.monotonic() - begun))
        process.kill()


def tags(out: Path) -> set[str]:
    """Which reports the files of a folder belong to."""
    return {(out / name).read_text()[0] for name in names(out) if name in REPLACED}


@linux
@pytest.mark.parametrize("times", [3, pytest.param(12, marks=pytest.mark.interrupts)])
def test_killed_at_any_moment_there_is_one_whole_report(times: int, tmp_path: Path) -> None:
    rng, out = random.Random(4), tmp_path / "out"
    write_folder(out, {"a0": b"a"}, replaces=REPLACED)
    (out / "mine.txt").write_text("precious")
    seen = set()
    for _ in range(times):
        killed(out, rng)
        (tag,) = tags(out)
        size = {"a": 12, "b": 7}[tag]
        assert names(out) == sorted([*(f"{tag}{k}" for k in range(size)), "both", "mine.txt"])
        subprocess.run(["sha256sum", "--check", "--quiet", MANIFEST], cwd=out, check=True)
        assert (out / "mine.txt").read_text() == "precious"
        seen.add(tag)
    assert seen == {"a", "b"} or times == 3
    write_folder(out, {"a0": b"a"}, replaces=REPLACED)
    assert names(out) == ["a0", "mine.txt"]
    assert os.listdir(tmp_path) == ["out"], "what the killed ones prepared is cleared"


@posix
@pytest.mark.parametrize("times", [2, pytest.param(8, marks=pytest.mark.interrupts)])
def test_a_folder_that_must_stay_never_mixes_two_reports(times: int, tmp_path: Path) -> None:
    rng, out = random.Random(5), tmp_path / "out"
    (out / "notes").mkdir(parents=True)
    (out / "notes" / "today").write_text("precious")
    for _ in range(times):
        killed(out, rng)
        assert len(tags(out)) <= 1
        write_folder(out, {"a0": b"a"}, replaces=REPLACED)
        assert names(out) == ["a0", "notes"]
    assert (out / "notes" / "today").read_text() == "precious"
    assert os.listdir(tmp_path) == ["out"]


@linux
@pytest.mark.interrupts
def test_two_that_write_into_one_folder_leave_one_whole_report(tmp_path: Path) -> None:
    out = tmp_path / "out"
    write_folder(out, {"a0": b"a"}, replaces=REPLACED)
    command = [sys.executable, "-c", ENDLESS, str(out)]
    writers = [
        subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, cwd=ROOT, env={**os.environ})
        for _ in range(2)
    ]
    time.sleep(3)
    for writer in writers:
        writer.kill()
        writer.wait()
    (tag,) = tags(out)
    assert names(out) == sorted([*(f"{tag}{k}" for k in range({"a": 12, "b": 7}[tag])), "both"])
    subprocess.run(["sha256sum", "--check", "--quiet", MANIFEST], cwd=out, check=True)


@pytest.mark.parametrize("exchange", [True, False])
def test_a_report_replaces_the_one_before(exchange: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if not exchange:
        monkeypatch.setattr(output, "exchanged", lambda one, other: False)
    out = tmp_path / "deep" / "out"
    write_folder(out, {"a0": b"1", "both": b"1"}, replaces=REPLACED)
    mode = out.stat().st_mode
    (out / "mine").touch()
    write_folder(out, {"b0": b"2", "both": b"2"}, replaces=REPLACED)
    assert names(out) == ["b0", "both", "mine"]
    assert (out / "both").read_bytes() == b"2"
    assert out.stat().st_mode == mode
    write_folder(out, {"c": b"3"})
    assert names(out) == ["b0", "both", "c", "mine"], "what is no report replaces none"
    lines = set((out / MANIFEST).read_text().splitlines())
    assert lines == {
        f"{hashlib.sha256(text).hexdigest()}  {name}" for name, text in [("b0", b"2"), ("both", b"2"), ("c", b"3")]
    }


@pytest.mark.parametrize("way", ["put there by hand", "changed since", "a folder", "a link"])
def test_files_of_others_are_never_overwritten(way: str, tmp_path: Path) -> None:
    out = tmp_path / "out"
    write_folder(out, {"a0": b"1", "a1": b"1"})
    (out / "a0").unlink()
    if way == "a folder":
        (out / "a0").mkdir()
    elif way == "a link":
        (tmp_path / "elsewhere").write_text("1")
        (out / "a0").symlink_to(tmp_path / "elsewhere")
    else:
        (out / "a0").write_text("precious")
        if way == "put there by hand":
            (out / MANIFEST).unlink()
    before = names(out)
    for attempt in (lambda: write_folder(out, {"a0": b"2", "b": b"2"}, ("--out",)), lambda: enter(out)):
        with pytest.raises(
            po.errors.InputError, match=r"--out: cannot write to .*out: a0 .*move away what you want to keep"
        ):
            attempt()
    assert names(out) == before
    assert os.listdir(tmp_path / "out") == os.listdir(out)


def enter(out: Path) -> None:
    with writable_folder(out, ("--out",), {"a0"}):
        pytest.fail("it computes")


@posix
def test_what_the_living_prepare_is_left_alone(tmp_path: Path) -> None:
    with output.staging(tmp_path) as mine:
        (tmp_path / f"{PREFIX}dead").mkdir()
        write_folder(tmp_path / "out", {"a": b""})
        assert mine.is_dir()
        assert sorted(os.listdir(tmp_path)) == sorted([mine.name, "out"])
    assert os.listdir(tmp_path) == ["out"]


@posix
@pytest.mark.parametrize(
    "number",
    [*(pytest.param(n, marks=pytest.mark.interrupts) for n in (signal.SIGHUP, signal.SIGTERM)), signal.SIGINT],
)
def test_a_request_to_end_leaves_nothing_behind(number: int, tmp_path: Path) -> None:
    words = ["simulate", "--problem", "insert_planar_2r", "--posture", "0.1 rad, 0.2 rad", "-n", "100000000"]
    process = subprocess.Popen(
        [sys.executable, "-m", "posture_opt", *words, "--out", "a/b"], cwd=tmp_path, stderr=subprocess.PIPE, text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    time.sleep(1.2)
    process.send_signal(number)
    assert process.communicate(timeout=20)[1] in ("interrupted\n", "")
    assert process.returncode in (128 + number, -number)  # by the system, before the first of our lines
    assert os.listdir(tmp_path) == []


@posix
def test_a_disk_that_is_full_leaves_what_was_there(tmp_path: Path) -> None:
    out = tmp_path / "out"
    write_folder(out, {"a": b"1"})
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, limits[1]))
    try:
        for write in (
            lambda: write_folder(out, {"a": b"2", "b": b"2" * 20_000}),
            lambda: write_file(tmp_path / "f", b"2" * 20_000),
        ):
            with pytest.raises(po.errors.InputError, match=r"cannot write to .*: file too large"):
                write()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert names(out) == ["a"]
    assert (out / "a").read_text() == "1"
    assert os.listdir(tmp_path) == ["out"]


def test_one_file_is_replaced_whole(tmp_path: Path) -> None:
    path = tmp_path / "f"
    for text in (b"1", b"2"):
        write_file(path, text)
        assert path.read_bytes() == text
    assert os.listdir(tmp_path) == ["f"]
    for wrong in (tmp_path, path / "below"):
        with pytest.raises(po.errors.InputError, match="cannot write to"):
            write_file(wrong, b"3")
    assert os.listdir(tmp_path) == ["f"]
