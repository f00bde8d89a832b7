"""``scheduled``: the workers of a Dask scheduler, on this machine or on others."""

from __future__ import annotations

import logging
import os
import signal
import socket
from contextlib import suppress
from importlib import import_module
from types import TracebackType
from typing import Any
from urllib.parse import urlsplit

from posture_opt import __version__
from posture_opt.errors import InputError, Issue
from posture_opt.workers.executors import ExecutorWorkers

LOCAL = "local"
"""In place of an address: a scheduler and workers of this machine, for as long as they are needed."""

_SECONDS = 10  # to wait for a scheduler that has taken a connection, and for the first worker
_HASTE = 0.5  # s to close it all when the work was given up
_ANSWER = 3  # s to wait for a connection
_OPTION = ("--scheduler",)


class DaskWorkers(ExecutorWorkers):
    """Works on parts wherever a Dask scheduler sends them; connection and own cluster are closed at the end."""

    def __init__(self, client: Any, cluster: Any = None) -> None:
        super().__init__(client.get_executor(pure=False))
        self._client, self._cluster = client, cluster

    def close(self) -> None:
        """Close the connection, and end the workers that were started for it."""
        self._close(_SECONDS)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is not None and self._cluster is not None:
            # Nobody waits for what they do.
            for nanny in self._cluster.workers.values():
                nanny.auto_restart = False
                with suppress(OSError, TypeError):
                    os.kill(nanny.pid, signal.SIGKILL)
        self._close(_SECONDS if error is None else _HASTE)

    def _close(self, seconds: float) -> None:
        for each in (self._client, self._cluster):
            # Workers that are slow to end do so with this process.
            with suppress(TimeoutError):
                if each is not None:
                    each.close(timeout=seconds)


def scheduled(address: str, workers: int = 1) -> DaskWorkers:
    """The workers of the scheduler at ``tcp://HOST:PORT``; or of one started for this, ``local``.

    Args:
        workers: processes of a local one.

    Raises:
        InputError: Dask is not installed, the address is none, nobody answers, or it has no or other workers.
    """
    try:
        dask = import_module("distributed")
    except ImportError:
        mend = "install it: pip install 'posture_opt[cluster]'; on one machine --workers does as well"
        raise InputError(Issue("this needs the library Dask distributed", _OPTION, address, mend)) from None
    # What befalls workers is told by whether there is an answer.
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    if address == LOCAL:
        cluster = dask.LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            dashboard_address=None,
            silence_logs=logging.CRITICAL,
        )
        return DaskWorkers(dask.Client(cluster, set_as_default=False), cluster)
    _check_answer(address)
    try:
        client = dask.Client(address, timeout=_SECONDS, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        mend = "is it a scheduler of Dask, of a like version? start one: dask scheduler"
        raise InputError(Issue(f"what answers is no scheduler ({error})", _OPTION, address, mend)) from error
    found = DaskWorkers(client)
    try:
        _check_workers(client, address)
    except BaseException:
        found.close()
        raise
    return found


def _check_answer(address: str) -> None:
    """An address that nobody answers at is told at once; Dask would go on trying."""
    mend = "start one, dask scheduler --port 8786, or take --scheduler local"
    try:
        host, port = urlsplit(address).hostname, urlsplit(address).port
    except ValueError:
        host = port = None
    if not host or not port or urlsplit(address).scheme not in ("tcp", "tls"):
        raise InputError(Issue(f"'{address}' is no address of a scheduler", _OPTION, address, "write tcp://HOST:PORT"))
    try:
        socket.create_connection((host, port), _ANSWER).close()
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InputError(Issue(f"no scheduler answers ({reason})", _OPTION, address, mend)) from error


def _check_workers(client: Any, address: str) -> None:
    try:
        client.wait_for_workers(1, timeout=_SECONDS)
    except TimeoutError as error:
        mend = f"start one: dask worker {address} --nworkers 2 --nthreads 1"
        raise InputError(Issue("the scheduler has no workers", _OPTION, address, mend)) from error
    try:
        versions = client.run(version)
    except ImportError as error:
        mend = "install the same version on every machine"
        raise InputError(Issue("a worker lacks posture_opt", _OPTION, address, mend)) from error
    other = {worker: found for worker, found in versions.items() if found != __version__}
    if other:
        worker, found = next(iter(other.items()))
        mend = "install the same version on every machine"
        raise InputError(
            Issue(f"the worker {worker} has version {found}, here is {__version__}", _OPTION, address, mend)
        )


def version() -> str:
    """Of the package where this is called."""
    return __version__
