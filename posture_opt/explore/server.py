"""The server of the page: viser, on this machine alone."""

from __future__ import annotations

import io
import ipaddress
from contextlib import redirect_stdout
from importlib import import_module
from typing import TYPE_CHECKING

from posture_opt.errors import InputError, Issue

if TYPE_CHECKING:
    import viser

INSTALL = "pip install 'posture_opt[explore]'"
"""What brings the live page."""


def server(host: str, port: int, title: str) -> viser.ViserServer:
    """A server that listens at ``host``, at ``port`` or the next one that is free.

    Raises:
        InputError: viser is not installed, or other machines could reach the page.
    """
    if not _is_this_machine(host):
        hint = "run it there and tunnel: ssh -L 8080:127.0.0.1:8080 MACHINE"
        raise InputError(
            Issue(f"the page has no password, and at {host} other machines could reach it", ("--host",), host, hint)
        )
    if not 0 < port < 65536:
        raise InputError(Issue(f"{port} is no port", ("--port",), port, "name one between 1024 and 65535"))
    try:
        module = import_module("viser")
    except ImportError:
        raise InputError(Issue("the live page needs the library viser", hint=f"install it: {INSTALL}")) from None
    try:
        with redirect_stdout(io.StringIO()):  # a banner, whatever `verbose` says
            found: viser.ViserServer = module.ViserServer(host=host, port=port, label=title, verbose=False)
    except (OSError, RuntimeError) as error:
        raise InputError(Issue(f"no page can be served at port {port}: {error}", ("--port",), port)) from None
    found.gui.configure_theme(control_width="large", show_logo=False, show_share_button=False)
    found.gui.main_panel.dock_right()
    return found


def _is_this_machine(host: str) -> bool:
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def stop(running: viser.ViserServer) -> None:
    """End a server, its browsers and its threads."""
    with redirect_stdout(io.StringIO()):
        running.stop()
