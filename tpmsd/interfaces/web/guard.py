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


class Guard:
    """ASGI middleware; refuses before anything else has looked at the request."""

    def __init__(self, app: ASGIApp, settings: WebSettings, names: Iterable[str] = ()) -> None:
        self._app = app
        self._settings = settings
        self._names = {name.lower() for name in names} | {settings.host.lower()}
        if settings.host in LOOPBACK:
            self._names |= LOOPBACK

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Refuse, or pass on."""
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
        await (self._app if refusal is None else refusal)(scope, receive, with_headers)

    def _refusal(self, scope: Scope) -> PlainTextResponse | None:
        headers = Headers(scope=scope)
        host = headers.get("host", "")
        if host_name(host) not in self._names:
            return PlainTextResponse("wrong Host header\n", 421)
        if scope["method"] not in SAFE_METHODS:
            scheme = "https" if self._settings.secure else "http"
            if headers.get("origin") != f"{scheme}://{host}":
                return PlainTextResponse("wrong Origin header\n", 403)
            if not headers.get("content-length", "").isdecimal():
                return PlainTextResponse("the length of the body is wanted\n", 411)
            if int(headers["content-length"]) > self._settings.max_body_bytes:
                return PlainTextResponse("too large\n", 413)
        if self._settings.token is not None and scope["path"] != LOGIN and not self._known(headers):
            if scope["method"] == "GET" and "text/html" in headers.get("accept", ""):
                return PlainTextResponse("", 303, {"Location": LOGIN})
            return PlainTextResponse("a token is wanted\n", 401, {"WWW-Authenticate": "Bearer"})
        return None

    def _known(self, headers: Headers) -> bool:
        kind, _, given = headers.get("authorization", "").partition(" ")
        if kind.lower() != "bearer":
            given = cookie_parser(headers.get("cookie", "")).get(COOKIE, "")
        return same(given.strip(), self._settings.token or "")


def same(given: str, wanted: str) -> bool:
    """Whether two secrets are equal, in a time that tells nothing about where they differ."""
    return hmac.compare_digest(given.encode("utf-8"), wanted.encode("utf-8"))


def host_name(host: str) -> str:
    """The name in a Host header, without the port."""
    if host.startswith("["):
        return host.partition("]")[0].lower() + "]"
    return host.partition(":")[0].lower()
