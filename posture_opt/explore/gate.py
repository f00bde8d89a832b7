"""``Gate``: who may open the page, and what the page says where it cannot be drawn or answered.

Every request, also the one that opens the web socket, passes it before viser answers. A page of another site that the
same browser shows cannot reach it: such a request names its own site as its origin, and a host name that was pointed at
this machine is not the one that the page is served at (RFC 6455, section 10.2).
"""

from __future__ import annotations

import gzip
import ipaddress
import secrets
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from html import escape
from http import HTTPStatus
from importlib import import_module
from threading import Lock
from typing import Any
from urllib.parse import urlsplit

Answer = Callable[[Any, Any], Any]
"""A connection and its request -> a response; None where the web socket is opened."""

_ALIVE = "/alive"
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
    """Lets requests through that come from the page itself and, where there is a token, know it.

    Args:
        token: that the address begins with; empty where only this machine can reach the page.
        title: of the page.
    """

    def __init__(self, token: str, title: str) -> None:
        self.token: str = token
        self._title = title
        self.closed: bool = False
        self._page: bytes | None = None

    @contextmanager
    def before(self) -> Iterator[None]:
        """Stands before the server that is started meanwhile; ``closed`` says whether it does.

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
            if path == _ALIVE:
                return respond(HTTPStatus.OK, b"alive")
            found = answer(connection, messages.Request(path, request.headers))
            if found is None or path != "/" or found.status_code != HTTPStatus.OK:
                return found
            return respond(HTTPStatus.OK, self._with_script(found), Content_Type="text/html; charset=utf-8",
                           Content_Encoding="gzip", Referrer_Policy="no-referrer")  # fmt: skip

        return asked

    def _path(self, path: str) -> str | None:
        """The path behind the token; None where there is another one."""
        if not self.token:
            return path
        first, _, rest = path.removeprefix("/").partition("/")
        return f"/{rest}" if secrets.compare_digest(first.encode(), self.token.encode()) else None

    def _from_here(self, headers: Any) -> bool:
        """Whether a request comes from the page that is served here, or from no page at all."""
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
