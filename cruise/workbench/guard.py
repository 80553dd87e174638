"""Who may see the page: on this machine everybody who is on it, from outside only who knows the token."""

import hashlib
import hmac
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any, Final
from urllib.parse import parse_qs

HERE: Final = ("127.0.0.1", "localhost", "::1")

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]


class Guard:
    """Lets through whoever shows the token, in the address once and in a cookie from then on; else 401.

    Without a token only requests to this machine's own names pass, so that no page of another site reaches in. What is
    longer than `most_bytes`, or does not say how long it is, is refused: 413, 411.
    """

    def __init__(self, app: App, token: str, port: int, most_bytes: int) -> None:
        self.app, self.token, self.port, self.most_bytes = app, token, port, most_bytes

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        headers = {name.decode("latin-1"): value.decode("latin-1") for name, value in scope["headers"]}
        if scope.get("method") in ("POST", "PUT"):
            length = headers.get("content-length", "")
            if not length.isdigit() or int(length) > self.most_bytes:
                await _answer(send, 413 if length.isdigit() else 411, b"This is more than the page takes.")
                return
        if not self.token:
            host = headers.get("host", "").rsplit(":", 1)[0].strip("[]")
            await (self.app if host in HERE else _refuse)(scope, receive, send)
            return
        shown = parse_qs(scope.get("query_string", b"").decode("latin-1")).get("token", [""])[0]
        cookie = cookie_of(self.token, self.port)
        kept = [one.strip() for one in headers.get("cookie", "").split(";")]
        if hmac.compare_digest(shown.encode(), self.token.encode()):

            async def remember(message: MutableMapping[str, Any]) -> None:
                if message["type"] == "http.response.start":
                    value = f"{cookie}; HttpOnly; SameSite=Strict; Path=/"
                    message["headers"] = [*message.get("headers", []), (b"set-cookie", value.encode())]
                await send(message)

            await self.app(scope, receive, remember)
        elif any(hmac.compare_digest(one.encode(), cookie.encode()) for one in kept):
            await self.app(scope, receive, send)
        else:
            await _refuse(scope, receive, send)


def cookie_of(token: str, port: int) -> str:
    """Name and value of the cookie: any token fits in as its hash, and another port's is another one."""
    return f"cruise_workbench_{port}={hashlib.sha256(token.encode()).hexdigest()}"


async def _refuse(scope: Scope, receive: Receive, send: Send) -> None:
    if scope["type"] == "websocket":
        await send({"type": "websocket.close", "code": 1008})
        return
    await _answer(send, 401, b"This page needs the address that cruise workbench printed.")


async def _answer(send: Send, status: int, words: bytes) -> None:
    await send({"type": "http.response.start", "status": status, "headers": [(b"content-type", b"text/plain")]})
    await send({"type": "http.response.body", "body": words})
