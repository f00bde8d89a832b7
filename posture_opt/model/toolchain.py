"""The C compiler of this machine and the user's cache of what it compiled.

A library is executed only from a folder that the user alone can write, and only if its content has the digest that
its name states: half a library would end the program as soon as it is called.
"""

from __future__ import annotations

import atexit
import contextlib
import ctypes
import functools
import hashlib
import os
import platform
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from pathlib import Path
from typing import NamedTuple

from posture_opt.interrupts import undisturbed
from posture_opt.output import settle, staging

# Straight-line code with few calls gains nothing from -O3 or -march=native (measured within 10 %, compile time
# +40 %), and without fused multiply-add every machine, compiled or interpreted, gives the same digits.
FLAGS = ("-std=c99", "-fPIC", "-shared", "-fno-math-errno", "-ffp-contract=off", "-w")
# Length of a C text above which -O0 is taken: 3 s a megabyte instead of 10, and runs 4 times slower
MAX_OPTIMISED_CHARACTERS = 1_000_000
KEPT_LIBRARIES = 256  # in the cache; of more, those that were not used for longest are removed
COMPILE_SECONDS = 300.0  # Time after which a compiler is ended [s]
SUFFIX = ".dll" if sys.platform == "win32" else ".so"  # Ending of a shared library on this system


class BuildError(Exception):
    """Nothing could be compiled; the text says why, and the caller interprets instead."""


class NotCompiledError(Exception):
    """The cache has no such library, and nothing may be compiled: see `compiled_before`."""


class Library(NamedTuple):
    """A loaded shared library and the file that it came from."""

    path: Path
    handle: ctypes.CDLL


def find_compiler() -> tuple[str, ...]:
    """The words of the C compiler's command: the environment's CC, else cc, gcc or clang; empty if there is none."""
    return _compiler(os.environ.get("CC", ""), os.environ.get("PATH"))


@functools.cache  # every solve asks; to look through the folders of PATH takes a fifth of a millisecond
def _compiler(stated: str, folders: str | None) -> tuple[str, ...]:
    for candidate in (stated, "cc", "gcc", "clang"):
        with contextlib.suppress(ValueError):  # unbalanced quotes in CC
            command = shlex.split(candidate, posix=os.name != "nt")
            if command and (path := shutil.which(command[0], path=folders)):
                return (path, *command[1:])
    return ()


_only_kept: ContextVar[bool] = ContextVar("posture_opt_only_kept", default=False)


@contextlib.contextmanager
def compiled_before() -> Iterator[None]:
    """Load inside only libraries compiled before; others raise `NotCompiledError` instead of taking seconds."""
    token = _only_kept.set(True)
    try:
        yield
    finally:
        _only_kept.reset(token)


def shared_library(identity: str, source: Callable[[], str], level: str = "-O1") -> Library:
    """The shared library of a C text, from the cache or compiled into it; ``source`` is called only if it is needed."""
    compiler = find_compiler()
    if not compiler:
        raise BuildError("no C compiler found (looked for the environment's CC, then cc, gcc, clang)")
    machine = (sys.platform, platform.machine(), _compiler_version(compiler))
    key = "\0".join((identity, str(MAX_OPTIMISED_CHARACTERS), level, *FLAGS, *compiler, *machine))
    name = hashlib.sha256(key.encode()).hexdigest()
    reason = ""
    for folder in _cache_folders():
        try:
            kept = _kept_library(folder, name)
            if kept is not None:
                return kept
            if not _only_kept.get():
                return _compiled_library(folder, name, compiler, source, level)
        except OSError as error:  # full, read-only or mounted noexec: the next folder may do
            reason = str(error)
    if _only_kept.get():
        raise NotCompiledError(name)
    raise BuildError(f"no folder to compile in: {reason}")


def _kept_library(folder: Path, name: str) -> Library | None:
    for path in folder.glob(f"{name}.*{SUFFIX}"):
        with contextlib.suppress(OSError):  # of another machine, or just pruned by another process
            if _is_private(path) and path.name.split(".")[1] == _sha256_of(path):
                handle = ctypes.CDLL(str(path))
                os.utime(path)
                return Library(path, handle)
        path.unlink(missing_ok=True)
    return None


def _compiled_library(
    folder: Path, name: str, compiler: tuple[str, ...], source: Callable[[], str], level: str
) -> Library:
    with staging(folder) as build:
        compiled = _compile_text(build, compiler, source(), level)
        path = folder / f"{name}.{_sha256_of(compiled)}{SUFFIX}"
        os.chmod(compiled, 0o700)
        settle(compiled)
        os.replace(compiled, path)  # atomic: another process sees the whole library or none
    with contextlib.suppress(OSError):
        _prune_cache(folder)
    return Library(path, ctypes.CDLL(str(path)))


def _sha256_of(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _compile_text(folder: Path, compiler: tuple[str, ...], text: str, level: str) -> Path:
    code, library = folder / "code.c", folder / "code.so"
    code.write_text(text, encoding="utf-8")
    level = level if len(text) <= MAX_OPTIMISED_CHARACTERS else "-O0"
    # What the compiler puts down for the time being goes with the folder, also where it is killed.
    result = _run_command(*compiler, level, *FLAGS, str(code), "-o", str(library), "-lm", TMPDIR=str(folder))
    if result.returncode or not library.is_file():
        raise BuildError(f"{' '.join(compiler)} failed: {result.stderr.strip()[:500]}")
    return library


@functools.lru_cache
def _compiler_version(compiler: tuple[str, ...]) -> str:
    """What ``--version`` prints; it is in the key of the cache, so that a new compiler compiles anew."""
    result = _run_command(*compiler, "--version")
    if result.returncode:
        raise BuildError(f"{' '.join(compiler)} --version failed: {result.stderr.strip()[:500]}")
    return result.stdout


def _run_command(*command: str, **environment: str) -> subprocess.CompletedProcess[str]:
    pipe, none, process = subprocess.PIPE, subprocess.DEVNULL, None
    try:
        with undisturbed():  # nothing started is forgotten: an interrupt is raised at its end
            process = subprocess.Popen(
                command, stdout=pipe, stderr=pipe, stdin=none, text=True, errors="replace",
                env={**os.environ, **environment}, start_new_session=True,
            )  # fmt: skip
        out, errors = process.communicate(timeout=COMPILE_SECONDS)
        return subprocess.CompletedProcess(command, process.returncode, out, errors)
    except subprocess.TimeoutExpired as error:
        raise BuildError(f"{command[0]} did not end within {COMPILE_SECONDS:g} s") from error
    except (OSError, ValueError) as error:
        raise BuildError(f"{command[0]} did not run: {error}") from error
    finally:
        if process is not None:
            if process.returncode is None:
                _kill_group(process)
            with process:  # closes its pipes
                pass


def _kill_group(process: subprocess.Popen[str]) -> None:
    if sys.platform == "win32":
        process.kill()
    else:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)  # the compiler is a chain of programs
    process.wait()


def _cache_folders() -> Iterator[Path]:
    folder = cache_folder()
    if folder is not None:
        with contextlib.suppress(OSError):
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            if _is_private(folder) and os.access(folder, os.W_OK | os.X_OK):
                yield folder
    with contextlib.suppress(OSError):
        yield _process_folder()


@functools.lru_cache
def _process_folder() -> Path:
    kept = contextlib.ExitStack()
    folder = kept.enter_context(staging(Path(tempfile.gettempdir())))
    atexit.register(kept.close)
    return folder


def cache_folder() -> Path | None:
    """Where compiled libraries are kept: POSTURE_OPT_CACHE, else the platform's cache folder; None without a home."""
    if named := os.environ.get("POSTURE_OPT_CACHE"):
        return Path(named).absolute()
    if base := os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA"):
        return Path(base).absolute() / "posture_opt"
    try:
        home = Path.home()
    except RuntimeError:
        return None
    return home / ("Library/Caches" if sys.platform == "darwin" else ".cache") / "posture_opt"


def _is_private(path: Path) -> bool:
    if sys.platform == "win32":  # below the user's profile
        return True
    status = path.stat()
    return status.st_uid == os.geteuid() and not status.st_mode & 0o022


def _prune_cache(folder: Path) -> None:
    libraries = sorted((path for path in folder.iterdir() if path.suffix == SUFFIX), key=_last_use)
    for path in libraries[:-KEPT_LIBRARIES]:
        with contextlib.suppress(OSError):  # in use (Windows) or already removed
            path.unlink()


def _last_use(path: Path) -> float:
    """Time of the last use of a library [s], which `_kept_library` renews; 0 where it is gone."""
    try:
        return path.stat().st_mtime
    except OSError:
        return 0.0
