"""Functions over rows: compiled, interpreted and NumPy agree; the cache is reused and never trusted blindly."""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import textwrap
import threading
import time
from pathlib import Path

import casadi
import numpy as np
import pytest

import posture_opt as po
from posture_opt.model import toolchain
from posture_opt.model.compiled import BatchFunction
from tests.helpers.variants import needs_compiler

# The same operations in the same order and no fused multiply-add: only sin and cos of another mathematics library
# may differ, by one unit in the last place each. Compared with NumPy, whose sums run in another order, a dozen
# roundings of 1.1e-16 add up.
DIGITS = 2e-15


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("POSTURE_OPT_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def compilations(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, ...]]:
    """The compiler calls so far, the version queries left out."""
    calls: list[tuple[str, ...]] = []
    run = toolchain._run_command

    def counting(*command: str, **environment: str) -> subprocess.CompletedProcess[str]:
        if "--version" not in command:
            calls.append(command)
        return run(*command, **environment)

    monkeypatch.setattr(toolchain, "_run_command", counting)
    return calls


def planar() -> casadi.Function:
    """Two links: point (2,), Jacobian (2, 2) with its column-major order visible, and the determinant."""
    q, a = casadi.SX.sym("q", 2), casadi.SX.sym("a", 2)
    angle = q[0] + q[1]
    x = a[0] * casadi.cos(q[0]) + a[1] * casadi.cos(angle)
    y = a[0] * casadi.sin(q[0]) + a[1] * casadi.sin(angle)
    J = casadi.jacobian(casadi.vertcat(x, y), q)
    return casadi.Function("planar", [q, a], [casadi.vertcat(x, y), J, casadi.det(J)], ["q", "a"], ["x", "J", "d"])


def planar_in_numpy(q: np.ndarray, a: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    s1, c1, s12, c12 = np.sin(q[:, 0]), np.cos(q[:, 0]), np.sin(q.sum(1)), np.cos(q.sum(1))
    x = np.stack([a[:, 0] * c1 + a[:, 1] * c12, a[:, 0] * s1 + a[:, 1] * s12], 1)
    J = np.empty((len(q), 2, 2))
    J[:, 0, 0], J[:, 0, 1] = -x[:, 1], -a[:, 1] * s12
    J[:, 1, 0], J[:, 1, 1] = x[:, 0], a[:, 1] * c12
    return x, J, (a[:, 0] * a[:, 1] * np.sin(q[:, 1]))[:, None]


def rows(n: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.uniform(-3, 3, (n, 2)), rng.uniform(0.5, 1.5, (n, 2))


both_ways = pytest.mark.parametrize("compiled", [False, pytest.param(True, marks=needs_compiler)])


@both_ways
def test_rows_agree_with_numpy(compiled: bool) -> None:
    batch = BatchFunction(planar(), compiled=compiled)
    assert batch.compiled is compiled
    for n in (0, 1, 3, 255, 256, 700):  # below, at and across the interpreter's chunk
        for result, expected in zip(batch(*rows(n)), planar_in_numpy(*rows(n)), strict=True):
            assert result.shape == expected.shape
            np.testing.assert_allclose(result, expected, rtol=0, atol=2 * DIGITS)  # values up to 3, products up to 9


@both_ways
def test_every_operation_is_rounded_on_its_own(compiled: bool) -> None:
    x, y, z = (casadi.SX.sym(name) for name in "xyz")
    # The first output loads all inputs, so that nothing separates the operations of the others.
    outputs = [x + z + y, x * y - z, (x + y) - z]
    batch = BatchFunction(casadi.Function("f", [x, y, z], outputs), compiled=compiled)
    a, b = (value[:, :1] for value in rows(50))
    # IEEE 754: zero, where a fused multiply-add would leave the rounding error of the product.
    np.testing.assert_array_equal(batch(a, b, a * b)[1], 0)
    # 1e16 + 1 rounds to 1e16; an optimiser that rearranges sums (-ffast-math) may return 1.
    np.testing.assert_array_equal(batch([[1e16]], [[1.0]], [[1e16]])[2], 0)


@both_ways
@pytest.mark.parametrize("kind", [casadi.SX, casadi.MX])
def test_matrices_sparse_and_empty(compiled: bool, kind: type) -> None:
    A, z = kind.sym("A", 2, 3), kind.sym("z", 0)
    sparse = kind.sym("s", casadi.Sparsity.lower(2))
    outputs = [A.T, 2 * A, sparse @ A, kind(2, 2), A[0, :]]
    batch = BatchFunction(casadi.Function("f", [A, z, sparse], outputs), compiled=compiled)
    rng = np.random.default_rng(1)
    A_rows, s_rows = rng.normal(size=(5, 2, 3)), rng.normal(size=(5, 2, 2))
    columns = [value.transpose(0, 2, 1).reshape(5, -1) for value in (A_rows, s_rows)]
    AT, A2, product, zero, first = batch(columns[0], np.zeros((5, 0)), columns[1])
    np.testing.assert_array_equal(AT, A_rows.transpose(0, 2, 1))
    np.testing.assert_array_equal(A2, 2 * A_rows)
    np.testing.assert_allclose(product, np.tril(s_rows) @ A_rows, rtol=0, atol=DIGITS)
    np.testing.assert_array_equal(zero, np.zeros((5, 2, 2)))
    np.testing.assert_array_equal(first, A_rows[:, :1])


@both_ways
def test_one_row(compiled: bool) -> None:
    batch = BatchFunction(planar(), compiled=compiled)
    q, a = rows(3)
    kept = batch.one(q[0], a[0])
    for k in (1, 2):
        for single, many in zip(batch.one(q[k], a[k : k + 1]), batch(q, a), strict=True):
            np.testing.assert_array_equal(single, many[k])
    np.testing.assert_array_equal(kept[1], batch(q, a)[1][0])  # results do not share the kept buffer
    for wrong in ((q[0], 1.0), (q[0], [1.0]), (q, a), (q[:2], a[:2]), (q[0],)):
        with pytest.raises(po.errors.InputError):
            batch.one(*wrong)


@both_ways
def test_pickles(compiled: bool) -> None:
    batch = BatchFunction(planar(), compiled=compiled)
    batch.one(*(value[0] for value in rows(1)))
    again = pickle.loads(pickle.dumps(batch))
    assert again.compiled is compiled
    np.testing.assert_array_equal(again(*rows(5))[1], batch(*rows(5))[1])


@needs_compiler
def test_second_construction_compiles_nothing(compilations: list[tuple[str, ...]], cache: Path) -> None:
    first = BatchFunction(planar())
    assert len(compilations) == 1
    second = BatchFunction(planar())
    assert len(compilations) == 1
    np.testing.assert_array_equal(first(*rows(5))[0], second(*rows(5))[0])
    q = casadi.SX.sym("q")
    BatchFunction(casadi.Function("other", [q], [q + 1]))
    assert len(compilations) == 2
    assert [path.suffix for path in cache.iterdir()] == [".so" if sys.platform != "win32" else ".dll"] * 2


@pytest.fixture
def no_compiler(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CC", raising=False)


@pytest.mark.usefixtures("no_compiler")
def test_interprets_without_a_compiler() -> None:
    batch = BatchFunction(planar())
    assert not batch.compiled
    assert "no C compiler" in batch.reason
    np.testing.assert_allclose(batch(*rows(9))[0], planar_in_numpy(*rows(9))[0], rtol=0, atol=2 * DIGITS)
    with pytest.raises(po.errors.InputError, match="no C compiler"):
        BatchFunction(planar(), compiled=True)


@pytest.mark.skipif(sys.platform == "win32", reason="shell scripts as compilers")
@pytest.mark.parametrize(
    ("script", "reason"),
    [
        ('[ "$1" = --version ] && exit 0; echo out of cheese >&2; exit 1', "out of cheese"),
        ("exit 0", "failed"),  # claims success, writes nothing
    ],
)
def test_failing_compiler_is_a_reason(
    script: str, reason: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    compiler = tmp_path / "broken cc"
    compiler.write_text(f"#!/bin/sh\n{script}\n")
    compiler.chmod(0o755)
    monkeypatch.setenv("CC", f"'{compiler}' -pipe")
    batch = BatchFunction(planar())
    assert not batch.compiled
    assert reason in batch.reason
    assert batch(*rows(3))[0].shape == (3, 2)


@needs_compiler
def test_what_was_not_compiled_before_can_be_refused(compilations: list[tuple[str, ...]]) -> None:
    with toolchain.compiled_before(), pytest.raises(toolchain.NotCompiledError):
        BatchFunction(planar())
    assert not compilations
    BatchFunction(planar())
    with toolchain.compiled_before():
        assert BatchFunction(planar()).compiled
    assert len(compilations) == 1


@needs_compiler
@pytest.mark.skipif(sys.platform == "win32", reason="POSIX permissions")
def test_cache_that_others_can_write_is_not_executed(cache: Path, compilations: list[tuple[str, ...]]) -> None:
    BatchFunction(planar())
    assert cache.stat().st_mode & 0o777 == 0o700
    cache.chmod(0o777)
    BatchFunction(planar())  # from a folder of this process
    cache.chmod(0o700)
    (library,) = cache.iterdir()
    library.chmod(0o722)
    count = len(compilations)
    assert BatchFunction(planar()).compiled
    assert len(compilations) == count + 1
    assert library.stat().st_mode & 0o777 == 0o700


@needs_compiler
@pytest.mark.skipif(sys.platform == "win32" or os.geteuid() != 0, reason="only root can give files away")
def test_cache_of_another_user_is_not_executed(cache: Path, compilations: list[tuple[str, ...]]) -> None:
    cache.mkdir(mode=0o700)
    os.chown(cache, 12345, 12345)
    assert BatchFunction(planar()).compiled
    assert list(cache.iterdir()) == []


@pytest.mark.interrupts
@needs_compiler
def test_two_processes_share_an_empty_cache(cache: Path) -> None:
    code = textwrap.dedent("""
        from tests.model.test_compiled import *
        for k in range(6):
            q = casadi.SX.sym("q")
            batch = BatchFunction(casadi.Function("f", [q], [casadi.sin(q) + k]))
            assert batch.compiled, batch.reason
            assert abs(batch([0.5])[0, 0] - np.sin(0.5) - k) < 1e-14
    """)
    command = [sys.executable, "-c", code]
    runs = [subprocess.Popen(command, stderr=subprocess.PIPE, cwd=Path(__file__).parents[2]) for _ in range(2)]
    for run in runs:
        assert run.communicate()[1] == b""
        assert run.returncode == 0
    assert len(list(cache.iterdir())) == 6  # and no half-built leftovers


@needs_compiler
def test_cache_keeps_the_libraries_used_last(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(toolchain, "KEPT_LIBRARIES", 2)
    q = casadi.SX.sym("q")
    functions = [casadi.Function("f", [q], [q + k]) for k in range(3)]
    libraries: list[Path] = []
    for age, function in ((300, functions[0]), (200, functions[1])):
        BatchFunction(function)
        (new,) = set(cache.iterdir()) - set(libraries)
        os.utime(new, (new.stat().st_atime - age, new.stat().st_mtime - age))
        libraries.append(new)
    BatchFunction(functions[0])  # used again: now the second one is the oldest
    BatchFunction(functions[2])
    assert len(list(cache.iterdir())) == 2
    assert libraries[0].exists()
    assert not libraries[1].exists()


CHECKED = (
    "from tests.model.test_compiled import *; b = BatchFunction(planar()); print(b.compiled, b(*rows(3))[0].shape)"
)


def in_another_process(**environment: str) -> str:
    """Whether it compiles there, and the shape of an answer: this process must not have the library mapped."""
    done = subprocess.run(
        [sys.executable, "-c", CHECKED], capture_output=True, text=True, cwd=Path(__file__).parents[2],
        env={**os.environ, **environment},
    )  # fmt: skip
    assert done.returncode == 0, (done.returncode, done.stderr)
    return done.stdout


@needs_compiler
def test_half_a_library_is_compiled_again(cache: Path) -> None:
    assert in_another_process() == "True (3, 2)\n"
    (library,) = cache.iterdir()
    whole = library.read_bytes()
    os.truncate(library, 2 * len(whole) // 3)  # the loader takes it, and its first call is a bus error
    assert in_another_process() == "True (3, 2)\n"
    (library,) = cache.iterdir()
    assert library.read_bytes() == whole


@needs_compiler
@pytest.mark.skipif(sys.platform == "win32", reason="POSIX")
def test_there_is_an_answer_without_any_folder(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    nowhere = str(tmp_path / "file")
    (tmp_path / "full").mkdir()
    code = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))\n" + CHECKED
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=Path(__file__).parents[2],
        env={**os.environ, "POSTURE_OPT_CACHE": str(tmp_path / "full"), "TMPDIR": str(tmp_path)},
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (0, "False (3, 2)\n"), done.stderr
    assert os.listdir(tmp_path / "full") == []
    code = f"import tempfile; tempfile._candidate_tempdir_list = lambda: [{nowhere!r}]\n{CHECKED}"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=Path(__file__).parents[2],
        env={**os.environ, "POSTURE_OPT_CACHE": nowhere},
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (0, "False (3, 2)\n"), done.stderr


@pytest.mark.skipif(sys.platform == "win32", reason="shell scripts as compilers")
def test_an_interrupt_ends_the_compiler_and_all_it_started(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    compiler, begun = tmp_path / "slow", tmp_path / "begun"
    script = f'touch "$TMPDIR/part.s"; sleep 50 &\necho $! > "{begun}.new"; mv "{begun}.new" "{begun}"\nwait\n'
    compiler.write_text(f'#!/bin/sh\n[ "$1" = --version ] && exit 0\n{script}')
    compiler.chmod(0o755)
    monkeypatch.setenv("CC", str(compiler))
    (tmp_path / "tmp").mkdir()
    monkeypatch.setenv("TMPDIR", str(tmp_path / "tmp"))

    def interrupt() -> None:
        while not begun.exists():
            time.sleep(0.01)
        os.kill(os.getpid(), signal.SIGINT)

    threading.Thread(target=interrupt).start()
    before = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        BatchFunction(planar())
    assert time.monotonic() - before < 10
    started = int(begun.read_text())
    for _ in range(100):  # until the system has buried it
        try:
            if Path(f"/proc/{started}/stat").read_text().split()[2] == "Z":
                break
        except FileNotFoundError:
            break
        time.sleep(0.02)
    else:
        pytest.fail("a part of the compiler lives")
    assert list(cache.iterdir()) == list((tmp_path / "tmp").iterdir()) == []


@both_ways
def test_threads_share_what_is_evaluated_once(compiled: bool) -> None:
    batch = BatchFunction(planar(), compiled=compiled)
    (q, a), wrong = rows(400, seed=3), []
    wanted = batch(q, a)[0]

    def work() -> None:
        wrong.extend(k for k in range(400) if not np.array_equal(batch.one(q[k], a[k])[0], wanted[k]))

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == []


@needs_compiler
def test_damaged_library_is_compiled_again(cache: Path, compilations: list[tuple[str, ...]]) -> None:
    code = "from tests.model.test_compiled import *; print(BatchFunction(planar()).compiled)"
    for _ in range(2):  # in another process: this one must not have the library mapped when it is overwritten
        result = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, cwd=Path(__file__).parents[2]
        )
        assert result.stdout == "True\n", result.stderr
        (library,) = cache.iterdir()
        library.write_bytes(b"no library")
        library.chmod(0o700)
    assert BatchFunction(planar()).compiled
    assert len(compilations) == 1
