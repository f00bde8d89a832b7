"""The server of the page: viser, behind a gate that says who may open it."""

from __future__ import annotations

import gzip
import io
import ipaddress
import secrets
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass
from html import escape
from http import HTTPStatus
from importlib import import_module
from threading import Lock
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from posture_opt.errors import InputError, Issue

if TYPE_CHECKING:
    import viser

Answer = Callable[[Any, Any], Any]  # A connection and its request -> a response; None where the web socket is opened

_SCRIPT = """<script>
addEventListener("DOMContentLoaded", () => {
  const say = (text) => {
    if (document.getElementById("posture-opt-says")) return;
    const bar = document.createElement("p");
    bar.id = "posture-opt-says"; bar.setAttribute("role", "alert"); bar.textContent = text;
    bar.style.cssText = "position:fixed;z-index:10000;left:0;right:0;top:0;margin:0;padding:12px;" +
      "font:16px sans-serif;background:#D55E00;color:white;text-align:center";
    document.body.append(bar);
  };
  if (!document.createElement("canvas").getContext("webgl2"))
    say("This browser has no WebGL 2, so the arm cannot be drawn: " +
        "switch on hardware acceleration, or use another browser.");
  const ask = () => fetch(location.href.split("?")[0].replace(/\\/?$/, "/alive")).then(() => {
    const bar = document.getElementById("posture-opt-says");
    if (bar && bar.dataset.ended) location.reload();
  }, () => {
    say("The program that serves this page has ended: nothing is computed any more.");
    document.getElementById("posture-opt-says").dataset.ended = "true";
  });
  setInterval(ask, 2000);
});
</script></head>"""
_serving = Lock()


class Gate:
    """Lets requests through that come from the page itself and, where there is a token, know it."""

    def __init__(self, token: str, title: str) -> None:
        self.token: str = token
        self._title = title
        self.closed: bool = False
        self._page: bytes | None = None

    @contextmanager
    def before(self) -> Iterator[None]:
        """Stand before the server that is started meanwhile; ``closed`` says whether it does.

        viser has no hook for it. Its server is one of the library websockets, which asks ``process_request`` first.
        """
        with _serving:
            library = import_module("websockets.asyncio.server")
            serve = library.serve

            def gated(*given: Any, process_request: Answer, **named: Any) -> Any:
                self.closed = True
                return serve(*given, process_request=self._around(process_request), **named)

            library.serve = gated  # type: ignore[attr-defined]
            try:
                yield
            finally:
                library.serve = serve  # type: ignore[attr-defined]

    def _around(self, answer: Answer) -> Answer:
        messages = import_module("websockets.http11")
        headers = import_module("websockets.datastructures").Headers

        def respond(status: HTTPStatus, body: bytes, **named: str) -> Any:
            found = headers(**{"Content-Length": str(len(body)), "Content-Type": "text/plain; charset=utf-8"})
            for name, value in named.items():
                found[name.replace("_", "-")] = value
            return messages.Response(status.value, status.phrase, found, body)

        def asked(connection: Any, request: Any) -> Any:
            path = self._path(request.path.partition("?")[0])
            if path is None or not self._from_here(request.headers):
                return respond(HTTPStatus.FORBIDDEN, b"Open the page at the whole address that the program printed.")
            if path == "/alive":
                return respond(HTTPStatus.OK, b"alive")
            found = answer(connection, messages.Request(path, request.headers))
            if found is None or path != "/" or found.status_code != HTTPStatus.OK:
                return found
            return respond(HTTPStatus.OK, self._with_script(found), Content_Type="text/html; charset=utf-8",
                           Content_Encoding="gzip", Referrer_Policy="no-referrer")  # fmt: skip

        return asked

    def _path(self, path: str) -> str | None:
        if not self.token:
            return path
        first, _, rest = path.removeprefix("/").partition("/")
        return f"/{rest}" if secrets.compare_digest(first.encode(), self.token.encode()) else None

    def _from_here(self, headers: Any) -> bool:
        """Whether a request comes from the page that is served here, or from no page (RFC 6455, section 10.2)."""
        host, origin = headers.get("Host", ""), headers.get("Origin")
        if origin is not None and urlsplit(origin).netloc != host:
            return False
        return bool(self.token) or is_this_machine(urlsplit(f"//{host}").hostname or "")

    def _with_script(self, found: Any) -> bytes:
        """The page with its title, and what it says where it is not drawn or nobody answers; compressed once."""
        if self._page is None:
            zipped = found.headers.get("Content-Encoding") == "gzip"
            page = gzip.decompress(found.body) if zipped else found.body
            page = page.replace(b"<title>Viser</title>", f"<title>{escape(self._title)}</title>".encode(), 1)
            self._page = gzip.compress(page.replace(b"</head>", _SCRIPT.encode(), 1))
        return self._page


def is_this_machine(host: str) -> bool:
    """Whether an address is reached from this machine alone."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


INSTALL = "pip install 'posture_opt[explore]'"  # What brings the live page


@dataclass(frozen=True)
class Served:
    """A server that listens."""

    viser: viser.ViserServer
    url: str
    reach: str


def served(host: str, port: int, title: str) -> Served:
    """A server that listens at ``host``, at ``port`` or the next one that is free."""
    if not 0 < port < 65536:
        raise InputError(Issue(f"{port} is no port", ("--port",), port, "name one between 1024 and 65535"))
    try:
        module = import_module("viser")
    except ImportError:
        raise InputError(Issue("the live page needs the library viser", hint=f"install it: {INSTALL}")) from None
    _check_address(host)
    private = is_this_machine(host)
    gate = Gate("" if private else secrets.token_urlsafe(18), title)
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
    found.on_client_connect(_closed_where_narrow)
    return _addressed(found, host, gate.token)


_PANEL, _NARROW = 388, 700  # px: the large panel of viser, and windows in which it would hide the arm


def _closed_where_narrow(browser: viser.ClientHandle) -> None:
    """Starts with a closed panel in a narrow window; whoever opens it there keeps it open."""
    closed: list[bool] = []

    def drawn(camera: viser.CameraHandle) -> None:
        if not closed and 0 < camera.image_width < _NARROW - _PANEL:
            closed.append(True)
            browser.gui.main_panel.minimize()

    browser.camera.on_update(drawn)
    drawn(browser.camera)


def _addressed(found: viser.ViserServer, host: str, token: str) -> Served:
    """The address of a server, and who can reach it."""
    shown = f"[{host}]" if ":" in host else host
    if not token:
        return Served(found, f"http://{shown}:{found.get_port()}", "")
    everywhere = ipaddress.ip_address(socket.gethostbyname(host)).is_unspecified if ":" not in host else host == "::"
    name = socket.gethostname() if everywhere else shown
    url = f"http://{name}:{found.get_port()}/{token}/"
    reach = "every machine that reaches this one" if everywhere else f"every machine that reaches {host}"
    return Served(found, url, f"Whoever has this address can open the page from {reach}; nothing is encrypted.")


def _check_address(host: str) -> None:
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind, protocol) as tried:
            tried.bind(address)
    except OSError as error:
        hint = "name an address of this machine: 127.0.0.1, or 0.0.0.0 for all of them"
        text = f"no page can be served at '{host}': {error.strerror}"
        raise InputError(Issue(text, ("--host",), host, hint)) from None


def stop(running: viser.ViserServer) -> None:
    """End a server, its browsers and its threads."""
    with redirect_stdout(io.StringIO()):
        running.stop()
