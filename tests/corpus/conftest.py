"""One server of commands for all files of a worker: its imports take as long as ten calls."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.helpers.command_server import CommandServer


@pytest.fixture(scope="session")
def server() -> Iterator[CommandServer]:
    with CommandServer() as found:
        yield found
