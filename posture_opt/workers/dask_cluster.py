"""``scheduled``: the workers of a Dask scheduler, on this machine or on others."""

from __future__ import annotations

import logging
import socket
from collections.abc import Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import ExitStack, suppress
from importlib import import_module
from itertools import islice
from tempfile import TemporaryDirectory
from typing import Any
from urllib.parse import urlsplit

from posture_opt import __version__
from posture_opt.errors import InputError, Issue
from posture_opt.workers import MAX_SUBMITTED_PARTS, Part, R, S, T, Workers, worked

# Time [s] to wait for a scheduler that has taken a connection, for the first worker, and for the end of both.
_SCHEDULER_TIMEOUT_S = 10
_OPTION = ("--scheduler",)
DaskObject = Any  # A client, a cluster or a future of Dask, which states no types
DaskFuture = DaskObject


class DaskWorkers(Workers):
    """Works on parts wherever a Dask scheduler sends them; ``own`` was opened for this and is closed with it.

    Not by ``client.get_executor()``: its futures fail where a worker is lost just after it has answered.
    """

    def __init__(self, client: DaskObject, own: ExitStack | None = None) -> None:
        self._client, self._own = client, own or ExitStack()

    def run(self, part: Part[S, T, R], shared: S, items: Sequence[T]) -> Iterator[tuple[int, R]]:
        """As of `Workers`."""
        dask = import_module("distributed")
        numbers, running = iter(range(len(items))), dict[DaskFuture, int]()
        done = dask.as_completed(loop=self._client.loop)

        def submit(most: int) -> None:
            for k in islice(numbers, most):
                future = self._client.submit(worked, part, shared, items[k], pure=False)
                running[future] = k
                done.add(future)

        try:
            submit(MAX_SUBMITTED_PARTS)
            for future in done:
                yield running.pop(future), future.result()
                submit(1)
        except (dask.scheduler.KilledWorker, dask.comm.CommClosedError, CancelledError) as error:
            hint = "start it again; what a --checkpoint holds is not lost"
            raise InputError(Issue(f"the workers were lost ({type(error).__name__})", _OPTION, hint=hint)) from error
        finally:
            with suppress(dask.client.ClosedClientError):  # a scheduler that is gone has nothing to cancel
                self._client.cancel(list(running))

    def close(self) -> None:
        """Close the connection, and end the workers that were started for it."""
        with suppress(TimeoutError):  # workers that are slow to end do so with this process
            self._own.close()


def scheduled(address: str, workers: int = 1) -> DaskWorkers:
    """The workers of the scheduler at ``tcp://HOST:PORT``; or of one started for this, ``local``."""
    try:
        dask = import_module("distributed")
    except ImportError:
        hint = "install it: pip install 'posture_opt[cluster]'; on one machine --workers does as well"
        raise InputError(Issue("this needs the library Dask distributed", _OPTION, address, hint)) from None
    # Whether there is an answer says what has become of the workers. Dask gives its parts levels of their own.
    for name in [name for name in logging.root.manager.loggerDict if name.startswith("distributed")]:
        logging.getLogger(name).setLevel(logging.CRITICAL)
    if address == "local":
        return _local_workers(dask, workers)
    _check_answer(address)
    try:
        client = dask.Client(address, timeout=_SCHEDULER_TIMEOUT_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        hint = "is it a scheduler of Dask, of a like version? start one: dask scheduler"
        raise InputError(Issue(f"what answers is no scheduler ({error})", _OPTION, address, hint)) from error
    with ExitStack() as begun:
        begun.callback(client.close, timeout=_SCHEDULER_TIMEOUT_S)
        _check_workers(client, address)
        return DaskWorkers(client, begun.pop_all())


def _local_workers(dask: DaskObject, workers: int) -> DaskWorkers:
    """A scheduler and workers of this machine, whose files are in a folder that goes with them."""
    with ExitStack() as begun:
        folder = begun.enter_context(TemporaryDirectory(prefix="posture_opt-", ignore_cleanup_errors=True))
        try:
            with import_module("dask").config.set({"temporary-directory": folder}):
                cluster = dask.LocalCluster(
                    n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=None,
                    silence_logs=logging.CRITICAL, local_directory=folder,
                )  # fmt: skip
            begun.callback(cluster.close, timeout=_SCHEDULER_TIMEOUT_S)
            client = dask.Client(cluster, set_as_default=False)
        except (OSError, RuntimeError, TimeoutError, ValueError) as error:
            hint = "start it again with fewer --workers; without --scheduler it needs no Dask"
            what = f"the workers did not start ({type(error).__name__})"
            raise InputError(Issue(what, _OPTION, "local", hint)) from error
        begun.callback(client.close, timeout=_SCHEDULER_TIMEOUT_S)
        return DaskWorkers(client, begun.pop_all())


def _check_answer(address: str) -> None:
    hint = "start one, dask scheduler --port 8786, or take --scheduler local"
    try:
        host, port = urlsplit(address).hostname, urlsplit(address).port
    except ValueError:
        host = port = None
    if not host or not port or urlsplit(address).scheme not in ("tcp", "tls"):
        raise InputError(Issue(f"'{address}' is no address of a scheduler", _OPTION, address, "write tcp://HOST:PORT"))
    try:
        socket.create_connection((host, port), 3).close()  # within 3 s; Dask would go on trying
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InputError(Issue(f"no scheduler answers ({reason})", _OPTION, address, hint)) from error


def _check_workers(client: DaskObject, address: str) -> None:
    try:
        client.wait_for_workers(1, timeout=_SCHEDULER_TIMEOUT_S)
    except TimeoutError as error:
        hint = f"start one: dask worker {address} --nworkers 2 --nthreads 1"
        raise InputError(Issue("the scheduler has no workers", _OPTION, address, hint)) from error
    try:
        versions = client.run(version)
    except ImportError as error:
        hint = "install the same version on every machine"
        raise InputError(Issue("a worker lacks posture_opt", _OPTION, address, hint)) from error
    other = {worker: found for worker, found in versions.items() if found != __version__}
    if other:
        worker, found = next(iter(other.items()))
        hint = "install the same version on every machine"
        text = f"the worker {worker} has version {found}, here is {__version__}"
        raise InputError(Issue(text, _OPTION, address, hint))


def version() -> str:
    """Version of the package where this is called: in a worker that of the worker."""
    return __version__
