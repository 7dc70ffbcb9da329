"""Who may ask for what: the first thing that every request meets.

In: ASGI requests. Out: the same, or a refusal in one line. It checks the Host header against the names that
the server goes by (against DNS rebinding), the Origin of what changes something, and the token where there is
one; and gives every answer the headers that keep a browser from loading or framing anything foreign.
"""

from __future__ import annotations

import hmac
from collections.abc import Iterable

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import cookie_parser
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from tpmsd.interfaces.web.settings import WebSettings

COOKIE = "tpmsd_token"
LOGIN = "/login"
SAFE_METHODS = frozenset({"GET", "HEAD"})
LOOPBACK = frozenset({"127.0.0.1", "localhost", "[::1]", "::1"})
HEADERS = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; "
        "base-uri 'none'; form-action 'self'; frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "geolocation=(), camera=(), microphone=()",
    "Cache-Control": "no-store",
}

_CLOSE = {"Connection": "close"}
"""With a refusal whose request has more to come: the rest is not read."""
_TOO_LARGE = PlainTextResponse("too large\n", 413, _CLOSE)
_LENGTH_DIGITS = 18


class Guard:
    """ASGI middleware; refuses before anything else has looked at the request."""

    def __init__(self, app: ASGIApp, settings: WebSettings, names: Iterable[str] = ()) -> None:
        self._app = app
        self._settings = settings
        self._names = {name.lower() for name in names} | {settings.host.lower()}
        if settings.host in LOOPBACK:
            self._names |= LOOPBACK

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request that is refused; pass all others on to the application."""
        if scope["type"] != "http":
            if scope["type"] == "lifespan":
                await self._app(scope, receive, send)
            return  # no WebSocket here

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in HEADERS.items():
                    headers.setdefault(name, value)
            await send(message)

        refusal = self._refusal(scope)
        if refusal is None and scope["method"] not in SAFE_METHODS:
            body = await _read_body(receive, self._settings.max_body_bytes)
            if body is None:
                return  # gone before the whole of it was there
            if len(body) > self._settings.max_body_bytes:
                refusal = _TOO_LARGE
            receive = _with_body(body, receive)
        await (self._app if refusal is None else refusal)(scope, receive, with_headers)

    def _refusal(self, scope: Scope) -> PlainTextResponse | None:
        """Return the refusal of a request by its headers; None if it may pass."""
        headers = Headers(scope=scope)
        host = headers.get("host", "")
        if host_name(host) not in self._names:
            return PlainTextResponse("wrong Host header\n", 421)
        if "websocket" in headers.get("upgrade", "").lower():
            return PlainTextResponse("no upgrade: HTTP/1.1 alone is spoken here\n", 400)
        if scope["method"] not in SAFE_METHODS:
            scheme = "https" if self._settings.secure else "http"
            if headers.get("origin") != f"{scheme}://{host}":
                return PlainTextResponse("wrong Origin header\n", 403)
            length = headers.get("content-length", "")
            if not (length.isascii() and length.isdecimal()) or "transfer-encoding" in headers:
                return PlainTextResponse("the length of the body is wanted\n", 411, _CLOSE)
            if len(length) > _LENGTH_DIGITS or int(length) > self._settings.max_body_bytes:
                return _TOO_LARGE
        if self._settings.token is not None and scope["path"] != LOGIN and not self._has_token(headers):
            if scope["method"] == "GET" and "text/html" in headers.get("accept", ""):
                return PlainTextResponse("", 303, {"Location": LOGIN})
            return PlainTextResponse("a token is wanted\n", 401, {"WWW-Authenticate": "Bearer"})
        return None

    def _has_token(self, headers: Headers) -> bool:
        """Return whether a request carries the token, as a bearer or in the cookie."""
        kind, _, given = headers.get("authorization", "").partition(" ")
        if kind.lower() != "bearer":
            given = cookie_parser(headers.get("cookie", "")).get(COOKIE, "")
        return secrets_equal(given.strip(), self._settings.token or "")


async def _read_body(receive: Receive, most: int) -> bytes | None:
    """Return the body, at most one message beyond `most` bytes; None where the visitor left.

    What the headers say of its length is not relied on: in chunks a body has none.
    """
    body = b""
    more = True
    while more and len(body) <= most:
        message = await receive()
        if message["type"] == "http.disconnect":
            return None
        body += message.get("body", b"")
        more = message.get("more_body", False)
    return body


def _with_body(body: bytes, receive: Receive) -> Receive:
    """Return a `receive` that first gives a body that has been read already."""
    waiting: list[Message] = [{"type": "http.request", "body": body, "more_body": False}]

    async def replay() -> Message:
        return waiting.pop() if waiting else await receive()

    return replay


def secrets_equal(given: str, wanted: str) -> bool:
    """Return whether two secrets are equal, in a time that does not depend on where they differ."""
    return hmac.compare_digest(given.encode("utf-8"), wanted.encode("utf-8"))


def host_name(host: str) -> str:
    """Return the name in a Host header, without the port."""
    if host.startswith("["):
        return host.partition("]")[0].lower() + "]"
    return host.partition(":")[0].lower()
