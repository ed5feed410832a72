"""The preview page is read-only, for this computer, and no client can hold up another."""

from __future__ import annotations

import http.client
import json
import re
import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

import cv2
import numpy as np
import pytest

from rig.devices import Picture
from rig.errors import InputError
from rig.hal import Image
from rig.jog import preview as module
from rig.jog.page import PAGE, SCRIPT, STYLE
from rig.jog.preview import HEADERS, MOST_CONNECTIONS, ROUTES, TOKEN_HEADER, Preview

SECRET = sorted(path for path, route in ROUTES.items() if not route.public)
LARGE: Image = np.random.default_rng(0).integers(0, 256, (1200, 1200, 3), np.uint8)
"""Noise: its JPEG is larger than what a socket holds."""


@dataclass
class Reply:
    status: int
    headers: dict[str, str]
    body: bytes


def ask(
    page: Preview,
    path: str,
    method: str = "GET",
    host: str | None = None,
    **headers: str,
) -> Reply:
    connection = http.client.HTTPConnection("127.0.0.1", page.port, timeout=5)
    try:
        connection.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
        for name, value in {"Host": host or f"127.0.0.1:{page.port}", **headers}.items():
            connection.putheader(name, value)
        connection.endheaders()
        answer = connection.getresponse()
        return Reply(answer.status, {name.lower(): value for name, value in answer.getheaders()}, answer.read())
    finally:
        connection.close()


def let_in(page: Preview) -> dict[str, str]:
    """The cookie of a browser that was given the address with its fragment."""
    reply = ask(page, "/session", **{TOKEN_HEADER: page.url.partition("#")[2]})
    assert reply.status == 200
    assert "HttpOnly; SameSite=Strict" in reply.headers["set-cookie"]
    return {"Cookie": reply.headers["set-cookie"].split(";")[0]}


@contextmanager
def serving(image: Image | None = LARGE) -> Iterator[Preview]:
    picture = None if image is None else Picture(image, 7, 0.0)
    with Preview(lambda: picture, lambda: {"state": "idle", "trouble": "<b>"}) as page:
        yield page


@pytest.fixture(scope="module")
def page() -> Iterator[Preview]:
    with serving() as made:
        yield made


@pytest.mark.parametrize("host", ["0.0.0.0", "", "::", "192.168.1.5", "localhost.example"])
def test_only_loopback_is_listened_on(host: str) -> None:
    with pytest.raises(InputError, match="for this computer only"):
        Preview(lambda: None, dict, host=host)
    with serving() as page:
        assert page._server.server_address[0] == "127.0.0.1"


def test_a_port_that_is_taken_is_refused_in_words(page: Preview) -> None:
    with pytest.raises(InputError, match=f"port {page.port} cannot be used"):
        Preview(lambda: None, dict, port=page.port)


def test_a_browser_that_has_the_address_sees_the_newest_picture(page: Preview) -> None:
    cookie = let_in(page)
    reply = ask(page, "/picture.jpg?12", **cookie)
    assert (reply.status, reply.headers["content-type"]) == (200, "image/jpeg")
    seen = cv2.imdecode(np.frombuffer(reply.body, np.uint8), cv2.IMREAD_COLOR)
    assert seen is not None
    assert seen.shape == LARGE.shape
    assert json.loads(ask(page, "/status.json", **cookie).body) == {"state": "idle", "trouble": "<b>"}


def test_before_the_first_picture_the_page_still_opens() -> None:
    with serving(None) as page:
        assert ask(page, "/").status == 200
        assert ask(page, "/picture.jpg", **let_in(page)).status == 503


@pytest.mark.parametrize("path", SECRET)
@pytest.mark.parametrize("cookie", ["", "{name}=", "{name}=wrong", "other={token}", "{name}={token}0"])
def test_without_the_secret_nothing_of_the_bench_is_told(page: Preview, path: str, cookie: str) -> None:
    told = cookie.format(name=page.cookie, token=page.token)
    assert ask(page, path, **({"Cookie": told} if told else {})).status == 403


def test_the_cookie_is_given_for_the_secret_only(page: Preview) -> None:
    for headers in ({}, {TOKEN_HEADER: ""}, {TOKEN_HEADER: page.token[:-1]}):
        reply = ask(page, "/session", **headers)
        assert reply.status == 403
        assert "set-cookie" not in reply.headers


@pytest.mark.parametrize("path", sorted(ROUTES))
def test_every_route_refuses_other_hosts_and_origins(page: Preview, path: str) -> None:
    good = {**let_in(page), TOKEN_HEADER: page.token}
    for host in (
        "evil.example",
        f"evil.example:{page.port}",
        "127.0.0.1",
        "127.0.0.1:1",
        f"127.0.0.1.nip.io:{page.port}",
    ):
        assert ask(page, path, host=host, **good).status == 403, host
    for origin in ("null", "http://evil.example", "https://127.0.0.1", f"http://127.0.0.1:{page.port + 1}"):
        assert ask(page, path, Origin=origin, **good).status == 403, origin
    assert ask(page, path, Origin=f"http://127.0.0.1:{page.port}", **good).status == 200


@pytest.mark.parametrize("path", sorted(ROUTES))
def test_every_route_knows_get_and_head_only(page: Preview, path: str) -> None:
    good = {**let_in(page), TOKEN_HEADER: page.token}
    for method in ("POST", "PUT", "DELETE", "PATCH", "OPTIONS", "TRACE", "CONNECT"):
        assert ask(page, path, method, **good).status == 501, method
    whole, head = ask(page, path, **good), ask(page, path, "HEAD", **good)
    assert (head.status, head.body) == (200, b"")
    assert head.headers["content-length"] == str(len(whole.body))


@pytest.mark.parametrize("path", [*sorted(ROUTES), "/nowhere", "/../etc/passwd", "/..%5c", "/" + "a" * 300])
def test_every_answer_has_the_strict_headers(page: Preview, path: str) -> None:
    for method in ("GET", "POST"):
        reply = ask(page, path, method)
        assert reply.status != 200 or ROUTES[path].public
        for name, value in HEADERS.items():
            assert reply.headers[name.lower()] == value
        assert "access-control-allow-origin" not in reply.headers


def test_the_page_has_nothing_from_elsewhere_and_no_inline_code() -> None:
    for text in (PAGE, STYLE, SCRIPT):
        assert not re.search(r"https?:|//[a-z]|@import|url\(", text)
        assert not re.search(r"innerHTML|outerHTML|insertAdjacent|document\.write|eval\(|on\w+=\"|style=", text)
    found = re.findall(r'(?:src|href)="([^"]*)"', PAGE)
    assert set(found) <= set(ROUTES)


def test_a_client_that_stalls_holds_up_nobody(page: Preview) -> None:
    cookie = let_in(page)
    with ExitStack() as stack:
        for _ in range(4):
            stalled = stack.enter_context(socket.create_connection(("127.0.0.1", page.port)))
            stalled.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            asked = f"GET /picture.jpg HTTP/1.1\r\nHost: 127.0.0.1:{page.port}\r\nCookie: {cookie['Cookie']}\r\n\r\n"
            stalled.sendall(asked.encode())
        begun_s = time.monotonic()
        assert ask(page, "/picture.jpg", **cookie).status == 200
        assert time.monotonic() - begun_s < 2.0


def test_there_is_a_bound_on_connections(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "CLIENT_TIMEOUT_S", 0.2)
    with serving() as page, ExitStack() as stack:
        for _ in range(MOST_CONNECTIONS):
            stack.enter_context(socket.create_connection(("127.0.0.1", page.port)))
        with pytest.raises((OSError, http.client.HTTPException)):
            ask(page, "/")
        ends_s = time.monotonic() + 5.0
        # Those who ask nothing are sent away after a while.
        while time.monotonic() < ends_s:
            try:
                assert ask(page, "/").status == 200
                break
            except (OSError, http.client.HTTPException):
                time.sleep(0.02)
        else:
            pytest.fail("silent clients kept the page")


def test_leaving_does_not_wait_for_a_stalled_client() -> None:
    with ExitStack() as stack:
        begun_s = time.monotonic()
        with serving() as page:
            stack.enter_context(socket.create_connection(("127.0.0.1", page.port)))
            assert ask(page, "/").status == 200
        assert time.monotonic() - begun_s < 2.0
