"""The server of the page: viser, behind a gate."""

from __future__ import annotations

import io
import ipaddress
import secrets
import socket
from contextlib import redirect_stdout
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING

from posture_opt.errors import InputError, Issue
from posture_opt.explore.gate import Gate, is_this_machine

if TYPE_CHECKING:
    import viser

INSTALL = "pip install 'posture_opt[explore]'"
"""What brings the live page."""
_TOKEN_BYTES = 18  # random ones: 24 characters


@dataclass(frozen=True)
class Served:
    """A server that listens.

    Args:
        viser: the server itself.
        url: the address to open, with the token where there is one.
        reach: who can open it; empty where that is this machine alone.
    """

    viser: viser.ViserServer
    url: str
    reach: str


def served(host: str, port: int, title: str) -> Served:
    """A server that listens at ``host``, at ``port`` or the next one that is free.

    Where other machines can reach it, the address has a token that is made anew each time.

    Raises:
        InputError: viser is not installed, or nothing can be served there.
    """
    if not 0 < port < 65536:
        raise InputError(Issue(f"{port} is no port", ("--port",), port, "name one between 1024 and 65535"))
    try:
        module = import_module("viser")
    except ImportError:
        raise InputError(Issue("the live page needs the library viser", hint=f"install it: {INSTALL}")) from None
    _check_address(host)
    private = is_this_machine(host)
    gate = Gate("" if private else secrets.token_urlsafe(_TOKEN_BYTES), title)
    try:
        with redirect_stdout(io.StringIO()), gate.before():  # a banner, whatever `verbose` says
            found: viser.ViserServer = module.ViserServer(host=host, port=port, label=title, verbose=False)
    except (OSError, RuntimeError) as error:
        raise InputError(Issue(f"no page can be served at port {port}: {error}", ("--port",), port)) from None
    if not gate.closed:
        stop(found)
        raise InputError(Issue("this version of viser lets nobody check who opens the page", hint=INSTALL))
    found.gui.configure_theme(control_width="large", show_logo=False, show_share_button=False)
    found.gui.main_panel.dock_right()
    return _addressed(found, host, gate.token)


def _addressed(found: viser.ViserServer, host: str, token: str) -> Served:
    """The address of a server, and who can reach it."""
    if not token:
        return Served(found, f"http://{_in_address(host)}:{found.get_port()}", "")
    everywhere = ipaddress.ip_address(socket.gethostbyname(host)).is_unspecified if ":" not in host else host == "::"
    name = socket.gethostname() if everywhere else _in_address(host)
    url = f"http://{name}:{found.get_port()}/{token}/"
    reach = "every machine that reaches this one" if everywhere else f"every machine that reaches {host}"
    return Served(found, url, f"Whoever has this address can open the page from {reach}; nothing is encrypted.")


def _check_address(host: str) -> None:
    """That this machine can listen at an address.

    Raises:
        InputError: it cannot.
    """
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind, protocol) as tried:
            tried.bind(address)
    except OSError as error:
        hint = "name an address of this machine: 127.0.0.1, or 0.0.0.0 for all of them"
        raise InputError(
            Issue(f"no page can be served at '{host}': {error.strerror}", ("--host",), host, hint)
        ) from None


def _in_address(host: str) -> str:
    return f"[{host}]" if ":" in host else host


def stop(running: viser.ViserServer) -> None:
    """End a server, its browsers and its threads."""
    with redirect_stdout(io.StringIO()):
        running.stop()
