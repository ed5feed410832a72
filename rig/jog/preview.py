"""A read-only page with the live picture, for a browser on this computer. No request changes anything.

Loopback only, exact Host and Origin, a secret per start, a strict content-security policy, the newest picture only and
only when the browser has taken the last one, a bound on connections and on time (decision 0055).
"""

from __future__ import annotations

import hmac
import json
import secrets
import socket
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import urlsplit

from rig.devices import Picture
from rig.errors import InputError
from rig.jog.page import PAGE, SCRIPT, STYLE

LOOPBACK = "127.0.0.1"
MOST_CONNECTIONS = 16
CLIENT_TIMEOUT_S = 5.0
TOKEN_HEADER = "X-Rig-Token"
_LARGEST_PX, _QUALITY = 1280, 80
_MOST_TARGET = 200

HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}


@dataclass(frozen=True, slots=True)
class Answer:
    """What is sent back."""

    status: HTTPStatus
    kind: str = "text/plain; charset=utf-8"
    body: bytes = b""
    headers: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, slots=True)
class Route:
    """A page that can be asked for. ``public``: it says nothing of the bench; for all others the secret is needed."""

    answer: Callable[[Preview, Mapping[str, str]], Answer]
    public: bool = False


class Preview:
    """The page's server. A context manager: entering serves, leaving ends it.

    Args:
        latest: the newest picture; any thread.
        status: what is told beside the picture, as a JSON object; any thread.
        host: there is no choice but 127.0.0.1.
        port: 0: any that is free.

    Raises:
        InputError: another address than loopback, or the port is taken.
    """

    def __init__(
        self,
        latest: Callable[[], Picture | None],
        status: Callable[[], Mapping[str, Any]],
        *,
        host: str = LOOPBACK,
        port: int = 0,
    ) -> None:
        if host != LOOPBACK:
            raise InputError(
                f"the preview is for this computer only, not for {host}", where="--preview", remedy=f"Use {LOOPBACK}"
            )
        self.token = secrets.token_urlsafe(32)
        self._latest, self._status = latest, status
        self._encoding = threading.Lock()
        self._encoded: tuple[int, bytes] | None = None
        try:
            self._server = _Server((LOOPBACK, port), _handler_of(self))
        except (OSError, OverflowError) as failure:
            why = getattr(failure, "strerror", None) or failure
            raise InputError(
                f"port {port} cannot be used ({why})", where="--preview-port", remedy="Name another, or none"
            ) from failure
        self.port = int(self._server.server_address[1])
        self._thread = threading.Thread(
            target=self._server.serve_forever, args=(0.05,), name="jog preview", daemon=True
        )

    @property
    def url(self) -> str:
        """For the browser; the secret is in the fragment, which browsers do not send or log."""
        return f"http://{LOOPBACK}:{self.port}/#{self.token}"

    @property
    def cookie(self) -> str:
        """The cookie's name; cookies are common to all ports of a host."""
        return f"rig_preview_{self.port}"

    def __enter__(self) -> Preview:
        self._thread.start()
        return self

    def __exit__(self, *exc: Any) -> None:
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    def respond(self, target: str, headers: Mapping[str, str]) -> Answer:
        """The answer to a GET."""
        refused = self._refused(headers)
        if refused:
            return Answer(HTTPStatus.FORBIDDEN, body=refused.encode())
        route = ROUTES.get(urlsplit(target).path) if len(target) <= _MOST_TARGET else None
        if route is None:
            return Answer(HTTPStatus.NOT_FOUND, body=b"There is no such page")
        if not route.public and not self._knows_secret(headers):
            return Answer(HTTPStatus.FORBIDDEN, body=b"Open the address that rig jog shows, with all that follows #")
        return route.answer(self, headers)

    def picture(self, headers: Mapping[str, str]) -> Answer:
        """The newest picture as JPEG; each is encoded once, whoever asks."""
        picture = self._latest()
        if picture is None:
            return Answer(HTTPStatus.SERVICE_UNAVAILABLE, body=b"No picture has come")
        with self._encoding:
            if self._encoded is None or self._encoded[0] != picture.sequence:
                self._encoded = (picture.sequence, _jpeg(picture))
            body = self._encoded[1]
        return Answer(HTTPStatus.OK, "image/jpeg", body)

    def told(self, headers: Mapping[str, str]) -> Answer:
        """The status as JSON."""
        return Answer(HTTPStatus.OK, "application/json", json.dumps(self._status(), allow_nan=False).encode())

    def session(self, headers: Mapping[str, str]) -> Answer:
        """Hands the cookie to a page that knows the secret; the server keeps nothing."""
        if not hmac.compare_digest(headers.get(TOKEN_HEADER.lower(), "").encode(), self.token.encode()):
            return Answer(HTTPStatus.FORBIDDEN, body=b"Open the address that rig jog shows, with all that follows #")
        cookie = f"{self.cookie}={self.token}; HttpOnly; SameSite=Strict; Path=/"
        return Answer(HTTPStatus.OK, body=b"good", headers=(("Set-Cookie", cookie),))

    def _refused(self, headers: Mapping[str, str]) -> str:
        names = (f"{LOOPBACK}:{self.port}", f"localhost:{self.port}")
        if headers.get("host", "") not in names:
            return "This page is for this computer only"
        origin = headers.get("origin")
        if origin is not None and origin not in {f"http://{name}" for name in names}:
            return "Another page asks for this one"
        return ""

    def _knows_secret(self, headers: Mapping[str, str]) -> bool:
        told = (pair.partition("=") for pair in headers.get("cookie", "").split(";"))
        values = [value.strip() for name, _, value in told if name.strip() == self.cookie]
        return any(hmac.compare_digest(value.encode(), self.token.encode()) for value in values)


def _fixed(kind: str, text: str) -> Route:
    return Route(lambda preview, headers: Answer(HTTPStatus.OK, f"{kind}; charset=utf-8", text.encode()), public=True)


ROUTES: dict[str, Route] = {
    "/": _fixed("text/html", PAGE),
    "/page.js": _fixed("text/javascript", SCRIPT),
    "/page.css": _fixed("text/css", STYLE),
    "/session": Route(Preview.session, public=True),
    "/picture.jpg": Route(Preview.picture),
    "/status.json": Route(Preview.told),
}


def _jpeg(picture: Picture) -> bytes:
    import cv2

    from rig.jog.looking import shrunk

    small = shrunk(picture.image, _LARGEST_PX)
    return cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1].tobytes()


class _Server(ThreadingHTTPServer):
    """A thread a connection, and no more than `MOST_CONNECTIONS` of them."""

    daemon_threads = True
    # Leaving does not wait for clients that take nothing.
    block_on_close = False

    def __init__(self, address: tuple[str, int], handler: type[BaseHTTPRequestHandler]) -> None:
        self._free = threading.BoundedSemaphore(MOST_CONNECTIONS)
        super().__init__(address, handler)

    def process_request(self, request: Any, client_address: Any) -> None:
        if self._free.acquire(blocking=False):
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._free.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing: the terminal is the screen."""


def _handler_of(preview: Preview) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        server_version, sys_version = "rig", ""
        timeout = CLIENT_TIMEOUT_S
        disable_nagle_algorithm = True

        def setup(self) -> None:
            # What a client that has stalled would need is not buffered for it without end.
            self.request.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 256 * 1024)
            super().setup()

        def do_GET(self) -> None:
            """Answer."""
            self._send(with_body=True)

        def do_HEAD(self) -> None:
            """Answer with the headers only."""
            self._send(with_body=False)

        def _send(self, *, with_body: bool) -> None:
            repeated = any(len(self.headers.get_all(name, [])) > 1 for name in ("Host", "Origin"))
            headers = {name.lower(): value for name, value in self.headers.items()}
            answer = preview.respond(self.path, {} if repeated else headers)
            try:
                self.send_response(answer.status)
                self._finish(answer)
                if with_body:
                    self.wfile.write(answer.body)
            except OSError:
                self.close_connection = True  # the viewer has gone, or takes nothing any more

        def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:
            """Refuse what is no GET or HEAD, without telling back what was asked."""
            self.close_connection = True
            try:
                self.send_response(code)
                self._finish(Answer(HTTPStatus(code)))
            except OSError:
                return  # the viewer has gone

        def _finish(self, answer: Answer) -> None:
            self.send_header("Content-Type", answer.kind)
            self.send_header("Content-Length", str(len(answer.body)))
            for name, value in (*HEADERS.items(), *answer.headers):
                self.send_header(name, value)
            self.end_headers()

        def log_message(self, format: str, *args: object) -> None:
            """Say nothing: the terminal is the screen."""

    return Handler
