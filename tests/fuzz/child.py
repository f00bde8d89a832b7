"""Runs cases in forked children: the imports are done once; CPU, memory and what is left behind are told by case.

A child runs some cases one after another, which is ten times as quick as a child for each. ``Server.run`` runs one
alone. The parent has to stay single-threaded: a lock that another thread holds would stay locked in the child.
"""

from __future__ import annotations

import atexit
import contextlib
import ctypes
import gc
import importlib
import os
import pickle
import pkgutil
import resource
import select
import shutil
import signal
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from tests.fuzz.case import Case
from tests.fuzz.run import CPU, Run, allowed

_ADDRESSES = 2_000_000_000  # bytes
_FILE = 200_000_000  # bytes
_PATIENCE = 240  # s by the clock, on a busy machine
_ESCAPED = 99  # an exception left the program
_PR_SET_CHILD_SUBREAPER = 36


class Server:
    """A parent that has imported everything; use it in ``with``: it has a folder of its own."""

    def __init__(self) -> None:
        from posture_opt.cli.main import main

        self._main = main
        self.folder = Path(tempfile.mkdtemp(prefix="fuzz-"))
        os.environ |= {name: str(self.folder) for name in ("HOME", "XDG_CACHE_HOME", "MPLCONFIGDIR")}
        os.environ["COLUMNS"] = "100"
        ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
        _import_everything()
        self._warm_up()

    def __enter__(self) -> Server:
        return self

    def __exit__(self, *_: Any) -> None:
        shutil.rmtree(self.folder, ignore_errors=True)

    def _warm_up(self) -> None:
        """Builds what is built once a process, the schema say, so that children find it."""
        posture = ["--posture", "10 deg, 20 deg"]
        for words in (
            ["uncertainty", "--problem", "insert_planar_2r_measured", *posture],
            ["list"],
            ["--problem", "insert_planar_2r", "--json"],
            ["--problem", "insert_planar_2r", "--out", str(self.folder / "warm")],
            ["uncertainty", "--robot", "planar_2r", "--sigma", "5 µrad/(N m)", *posture],
        ):
            with _captured():
                _exit_code(lambda words=words: self._main(words))
        gc.collect()
        gc.freeze()  # a collection would write to every page that children share

    def run(self, case: Case) -> Run:
        """Runs a case in a child of its own, whose end is watched too: processes and files that outlive it."""
        with self._folder() as folder:
            found, status, seconds, usage = self._forked([case], folder, alone=True)
            left = _processes_left()
            left += [f"left {path.relative_to(folder)}" for path in folder.glob("*/*/tmp/*")]
        cpu, memory = usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024
        if not found:
            return Run(status, cpu=cpu, memory=memory, seconds=seconds, left=tuple(left))
        return found[0].with_end(cpu, memory, seconds, (*left, *([f"exit {status} in the end"] if status else [])))

    def run_all(self, cases: Sequence[Case]) -> Iterator[Run]:
        """Runs cases one after another in one child, and goes on in another one where it dies."""
        rest = list(cases)
        while rest:
            with self._folder() as folder:
                found, *_ = self._forked(rest, folder, alone=False)
            _processes_left()
            yield from found
            rest = rest[len(found) :]
            if rest:
                yield self.run(rest.pop(0))

    @contextlib.contextmanager
    def _folder(self) -> Iterator[Path]:
        folder = Path(tempfile.mkdtemp(prefix="case-", dir=self.folder))
        try:
            yield folder
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def _forked(self, cases: Sequence[Case], folder: Path, alone: bool) -> tuple[list[Run], int, float, Any]:
        """The runs that a child reports, its status, seconds by the clock, and its usage."""
        report = folder / "report"
        sys.stdout.flush(), sys.stderr.flush()
        start = time.perf_counter()
        child = os.fork()
        if child == 0:
            self._child(cases, folder, report, alone)
        _wait(child, len(cases))
        _, status, usage = os.wait4(child, 0)
        seconds = time.perf_counter() - start
        found = []
        if report.exists():
            with report.open("rb") as stream, contextlib.suppress(EOFError, pickle.UnpicklingError):
                while True:
                    found.append(pickle.load(stream))
        return found, os.waitstatus_to_exitcode(status), seconds, usage

    def _child(self, cases: Sequence[Case], folder: Path, report: Path, alone: bool) -> None:
        code = _ESCAPED
        try:
            os.setpgid(0, 0)
            os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
            resource.setrlimit(resource.RLIMIT_AS, (_ADDRESSES, _ADDRESSES))
            resource.setrlimit(resource.RLIMIT_FSIZE, (_FILE, _FILE))
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            with report.open("wb") as stream:
                for case in cases:
                    pickle.dump(self._run(case, folder), stream)
                    stream.flush()
                    os.chdir("/")
                    shutil.rmtree(folder / case.kind / str(case.number) / "work", ignore_errors=True)
            threading._shutdown()  # type: ignore[attr-defined] # as the interpreter does it at its end
            if alone:
                atexit._run_exitfuncs()
            code = 0
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(code)

    def _run(self, case: Case, folder: Path) -> Run:
        work, temporary = folder / case.kind / str(case.number) / "work", folder / case.kind / str(case.number) / "tmp"
        work.mkdir(parents=True), temporary.mkdir()
        case.write(work)
        os.environ["TMPDIR"] = tempfile.tempdir = str(temporary)
        os.chdir(work)
        before = _cpu()
        resource.setrlimit(resource.RLIMIT_CPU, (int(before) + CPU + 1, resource.RLIM_INFINITY))
        Path("/proc/self/clear_refs").write_text("5")  # the peak of memory begins anew
        start = time.perf_counter()
        with _captured() as texts:
            code = _exit_code(lambda: self._main(list(case.words)))
        cpu, seconds = _cpu() - before, time.perf_counter() - start
        made = _made(case, work)
        left = [f"left {name}" for name in made if not allowed(name, case)]
        # A checkpoint that was there is gone on with, but by a call that is refused: that has no report.
        went = bool(texts[0]) or "--quiet" in case.words
        still = [name for name in case.files if not went or not allowed(name, case)]
        left += [f"changed {name}" for name in still if not _same(work / name, case.files[name])]
        out, err = (text.replace(str(work), "/work") for text in texts)  # the same in every run
        return Run(code, out, err, cpu, _peak(), seconds, tuple(left), made)


def _import_everything() -> None:
    import posture_opt

    for module in pkgutil.walk_packages(posture_opt.__path__, "posture_opt."):
        if not module.name.endswith("__main__"):
            with contextlib.suppress(ImportError):  # what an extra brings, and is not installed
                importlib.import_module(module.name)
    import matplotlib

    matplotlib.use("Agg")
    for name in ("matplotlib.pyplot", "pint", "multiprocessing.util", "concurrent.futures.process"):
        importlib.import_module(name)


def _exit_code(call: Callable[[], Any]) -> int:
    try:
        call()
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else 0 if end.code is None else 1
    except BaseException:
        traceback.print_exc()
        return _ESCAPED
    return 0


def _cpu() -> float:
    """CPU [s] of this process and of those that it waited for."""
    return sum(
        usage.ru_utime + usage.ru_stime
        for usage in (resource.getrusage(resource.RUSAGE_SELF), resource.getrusage(resource.RUSAGE_CHILDREN))
    )


def _peak() -> float:
    """The peak of memory [MB] since it was asked to begin anew."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith("VmHWM"))


@contextlib.contextmanager
def _captured() -> Iterator[list[str]]:
    """Standard output and standard error in memory; their texts stand in the list when all is done."""
    files = [os.memfd_create(name) for name in ("out", "err")]
    sys.stdout.flush(), sys.stderr.flush()
    former = os.dup(1), os.dup(2)
    os.dup2(files[0], 1), os.dup2(files[1], 2)
    texts: list[str] = []
    try:
        yield texts
    finally:
        sys.stdout.flush(), sys.stderr.flush()
        os.dup2(former[0], 1), os.dup2(former[1], 2)
        texts += [os.pread(file, os.lseek(file, 0, os.SEEK_END), 0).decode("utf-8", "replace") for file in files]
        for file in (*former, *files):
            os.close(file)


def _wait(child: int, count: int) -> None:
    """Waits for the end of a child; after too long it is killed."""
    file = os.pidfd_open(child)
    try:
        if not select.select([file], [], [], _PATIENCE + 2 * count)[0]:
            os.killpg(child, signal.SIGKILL)
    finally:
        os.close(file)


def _processes_left() -> list[str]:
    """Children of the child, which became ours when it ended; they have two seconds to see that it did."""
    last = time.perf_counter() + 2
    while True:
        try:
            process, _ = os.waitpid(-1, os.WNOHANG)
        except ChildProcessError:
            return []
        if process:
            continue
        if time.perf_counter() > last:
            break
        time.sleep(0.002)
    found = Path(f"/proc/self/task/{os.getpid()}/children").read_text().split()
    for process in map(int, found):
        os.kill(process, signal.SIGKILL)
        os.waitpid(process, 0)
    return [f"left {len(found)} processes"]


def _made(case: Case, work: Path) -> dict[str, bytes]:
    """Files and folders that were not there before."""
    made = {}
    for path in sorted(work.rglob("*")):
        name = str(path.relative_to(work))
        if name not in case.files:
            made[name] = path.read_bytes() if path.is_file() and not path.is_symlink() else b""
    return made


def _same(path: Path, entry: Any) -> bool:
    if isinstance(entry, bytes):
        return path.is_file() and path.read_bytes() == entry
    return path.is_symlink() or path.exists()
