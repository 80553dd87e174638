"""Who gets in: the token, its cookie, other sites, other programs, and how much may be sent."""

import asyncio
from concurrent.futures import ThreadPoolExecutor
from urllib.parse import quote

import pytest

pytest.importorskip("nicegui", reason="the extra workbench is not installed")

from cruise.workbench.guard import Guard, cookie_of

PORT = 8080


def asked(token: str, host: str, query: str = "", cookie: str = "", kind: str = "http", method="GET", length="0"):
    """What a request gets, and whether it came through."""
    sent, through = [], []

    async def app(scope, receive, send):
        through.append(scope)
        if scope["type"] == "http":
            await send({"type": "http.response.start", "status": 200, "headers": []})

    async def receive():
        return {}

    async def send(message):
        sent.append(message)

    headers = [(b"host", host.encode()), (b"cookie", cookie.encode()), (b"content-length", length.encode())]
    scope = {"type": kind, "method": method, "headers": headers, "query_string": query.encode()}
    with ThreadPoolExecutor(1) as aside:  # a browser that other tests drive has its loop in this thread
        aside.submit(lambda: asyncio.run(Guard(app, token, PORT, 1000)(scope, receive, send))).result()
    return sent, bool(through)


MINE = cookie_of("secret", PORT)


def test_from_outside_only_the_token_opens():
    assert asked("secret", "10.0.0.7:8080")[0][0]["status"] == 401
    assert not asked("secret", "10.0.0.7:8080", "token=guess")[1]
    sent, through = asked("secret", "10.0.0.7:8080", "token=secret")
    assert through
    assert dict(sent[0]["headers"])[b"set-cookie"] == f"{MINE}; HttpOnly; SameSite=Strict; Path=/".encode()
    assert asked("secret", "10.0.0.7:8080", cookie=MINE)[1]
    assert not asked("secret", "10.0.0.7:8080", cookie=f"{MINE[:-1]}x", kind="websocket")[1]


@pytest.mark.parametrize("token", ["a+b/c=", "x&y", "schl\u00fcssel", "geheim wort", "a;b", 'a"b', "\u20ac1", "100%"])
def test_any_token_opens_by_the_address_and_by_the_cookie_after_it(token):
    sent, through = asked(token, "10.0.0.7:8080", f"token={quote(token, safe='')}")
    assert through
    cookie = dict(sent[0]["headers"])[b"set-cookie"].decode("ascii").partition("; HttpOnly")[0]
    assert asked(token, "10.0.0.7:8080", cookie=cookie)[1]


def test_cookies_of_other_programs_and_ports_are_in_nobodys_way():
    assert asked("secret", "10.0.0.7:8080", cookie=f'prefs={{"a":1}}; {MINE}; x')[1]
    assert not asked("secret", "10.0.0.7:8080", cookie=cookie_of("secret", PORT + 1))[1]


def test_on_this_machine_no_page_of_another_site_gets_in():
    assert asked("", "127.0.0.1:8080")[1]
    assert asked("", "[::1]:8080")[1]
    assert not asked("", "evil.example:8080")[1]
    assert asked("", "evil.example", kind="websocket")[0] == [{"type": "websocket.close", "code": 1008}]


@pytest.mark.parametrize(("length", "status"), [("1000", None), ("1001", 413), ("", 411), ("-1", 411)])
def test_more_than_the_page_takes_is_refused_before_it_is_read(length, status):
    sent, through = asked("", "127.0.0.1", method="POST", length=length)
    assert through == (status is None)
    assert status is None or sent[0]["status"] == status
