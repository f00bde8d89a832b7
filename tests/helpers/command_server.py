"""The real command line, many times a second: a process that has everything loaded forks one child for each call.

A child is what ``python -m posture_opt WORDS`` is once its imports are done: own memory, own limits of processor time,
memory and time, its own streams and exit. ``python -m tests.helpers.command_server`` is the other side.
"""

from __future__ import annotations

import atexit
import gc
import json
import os
import resource
import signal
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages

ROOT = Path(__file__).parents[2]
PRELOADED = (
    "casadi", "matplotlib.backends.backend_agg", "matplotlib.backends.backend_svg", "matplotlib.figure", "numpy",
    "pint", "scipy.optimize", "scipy.sparse.csgraph", "scipy.special", "yaml",
)  # fmt: skip
EXTRA = ("posture_opt.explore", "posture_opt.__main__")  # the second runs the command line
CPU = 20  # s, of a call
SECONDS = 60  # on the wall: what waits for ever uses no processor
ADDRESS_SPACE = 6 << 30  # bytes; mapped, not used
MEMORY = 1 << 30  # bytes in use


@dataclass(frozen=True)
class Answer:
    """What a call did: exit code (minus the signal that ended it), streams, processor time [s], memory [bytes]."""

    words: tuple[str, ...]
    code: int
    out: str
    err: str
    cpu: float
    memory: int

    def defects(self, folder: Path) -> list[str]:
        """What no call may do, whatever its input was; ``folder`` is where it ran, with ``--out`` in ``out``."""
        found = []
        if self.code not in (0, 2, 3, 4):
            found.append(f"exit code {self.code}")
        if self.code and not self.err.strip():
            found.append("it failed without a message")
        found += [f"standard error has {word}" for word in ("Traceback", "Warning:") if word in self.err]
        if self.cpu > CPU:
            found.append(f"{self.cpu:.1f} s of processor time")
        if self.memory > MEMORY:
            found.append(f"{self.memory / 1e6:.0f} MB of memory")
        documents = {path.name: path.read_text(encoding="utf-8") for path in sorted(folder.rglob("out/*.json"))}
        if self.code == 0 and "--json" in self.words and "completion" not in self.words:
            documents["standard output"] = self.out
        found += [f"{name}: {fault}" for name, text in documents.items() if (fault := _no_document(text))]
        left = [path.name for path in folder.rglob(".posture_opt-*")]
        if self.code in (1, 2) and (folder / "out").exists():
            left.append("out")
        return found + [f"{name} was left behind" for name in left]


def _no_document(text: str) -> str:
    """What is wrong with a JSON document; NaN and Infinity are not JSON."""
    try:
        json.loads(text, parse_constant=_refused)
    except ValueError as error:
        return str(error)
    return ""


def _refused(constant: str) -> None:
    raise ValueError(f"it holds {constant}")


class CommandServer:
    """Calls the command line; a context manager."""

    def __enter__(self) -> CommandServer:
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "100", "OPENBLAS_NUM_THREADS": "1"}
        self.process = subprocess.Popen(
            [sys.executable, "-m", "tests.helpers.command_server"],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT, env=environment,
        )  # fmt: skip
        return self

    def __exit__(self, *_: object) -> None:
        self.process.communicate()

    def call(self, words: Sequence[object], folder: Path, cpu: int = CPU, seconds: int = SECONDS) -> Answer:
        """What ``optimize-posture WORDS`` answers in ``folder``; its streams stand beside that."""
        given = tuple(map(str, words))
        streams = [folder.parent / f"{folder.name}.{name}" for name in ("stdout", "stderr")]
        request = {"words": given, "folder": str(folder), "streams": list(map(str, streams))}
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(json.dumps({**request, "cpu": cpu, "seconds": seconds}) + "\n")
        self.process.stdin.flush()
        code, used, memory = json.loads(self.process.stdout.readline())
        out, err = (path.read_text(encoding="utf-8", errors="replace") for path in streams)
        return Answer(given, code, out, err, used, memory)


def preload() -> None:
    """Loads all that a command may need, but what extras bring."""
    package = import_module("posture_opt")
    own = [found.name for found in walk_packages(package.__path__, "posture_opt.")]
    for module in (*PRELOADED, *(name for name in own if not name.startswith(EXTRA))):
        import_module(module)
    load = import_module("posture_opt.problem.load").load_builtin
    for name in ("insert_planar_2r", "insert_ur10_extended"):  # pydantic builds its schema, also that of effects
        load(name)


def serve() -> None:
    """Forks a child for every request, and returns in the child."""
    preload()
    gc.collect()
    gc.freeze()  # or every child would copy what it never touches
    before = 0.0
    while line := sys.stdin.readline():
        request = json.loads(line)
        child = os.fork()
        if child == 0:
            return become(request)
        _, status, usage = os.wait4(child, 0)
        every = resource.getrusage(resource.RUSAGE_CHILDREN)  # with the children of the child
        cpu, before = every.ru_utime + every.ru_stime - before, every.ru_utime + every.ru_stime
        print(json.dumps([os.waitstatus_to_exitcode(status), cpu, usage.ru_maxrss * 1024]), flush=True)
    sys.exit()


def become(request: dict) -> None:
    """Streams, folder and limits of one call."""
    out, err = request["streams"]
    for descriptor, path, flags in (
        (0, os.devnull, os.O_RDONLY),
        (1, out, os.O_WRONLY | os.O_CREAT | os.O_TRUNC),
        (2, err, os.O_WRONLY | os.O_CREAT | os.O_TRUNC),
    ):
        opened = os.open(path, flags, 0o600)
        os.dup2(opened, descriptor)
        os.close(opened)
    os.chdir(request["folder"])
    resource.setrlimit(resource.RLIMIT_CPU, (request["cpu"], request["cpu"] + 1))
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE, ADDRESS_SPACE))
    signal.alarm(request["seconds"])
    sys.argv = ["optimize-posture", *request["words"]]


def end(code: int) -> None:
    """Leaves as ``sys.exit`` does, without taking the interpreter apart: that takes longer than most calls."""
    try:
        sys.stdout.flush()
        sys.stderr.flush()
    except OSError:
        code = 120  # as Python has it
    atexit._run_exitfuncs()
    os._exit(code)


if __name__ == "__main__":
    serve()
    try:
        import_module("posture_opt.cli.main").main()
    except SystemExit as done:
        end(done.code if isinstance(done.code, int) else 1)
