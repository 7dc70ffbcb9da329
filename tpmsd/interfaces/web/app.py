"""The pages and what they ask for, as an ASGI application (Starlette).

In: the status socket of a daemon, or a replayed drive. Out: pages, JSON and server-sent events. Nothing
changes anything but `POST /api/reset`, which takes the visitor's Origin and a secret that only this page's
own scripts read; and nothing begins work but `POST /api/diagnosis`, which takes the Origin.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import secrets
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import (
    FileResponse,
    HTMLResponse,
    JSONResponse,
    PlainTextResponse,
    Response,
    StreamingResponse,
)
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles
from starlette.types import Receive, Scope, Send

from tpmsd.foundation.errors import ConfigError, TpmsdError
from tpmsd.foundation.version import __version__
from tpmsd.interfaces.api.results import Replay
from tpmsd.interfaces.web import drive as drive_data
from tpmsd.interfaces.web.diagnosis import DiagnosisJob
from tpmsd.interfaces.web.guard import COOKIE, LOGIN, Guard, secrets_equal
from tpmsd.interfaces.web.live import LiveHub
from tpmsd.interfaces.web.settings import WebSettings
from tpmsd.offline.report.page import ASSETS
from tpmsd.onboard.sinks.status_client import request_reset

STATIC = Path(__file__).parent / "static"
Handler = Callable[[Request], Any]


def live_app(socket: Path, settings: WebSettings) -> Starlette:
    """Return the application that shows a running daemon."""
    hub = LiveHub(socket, settings)
    csrf = secrets.token_urlsafe(32)

    @contextlib.asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        task = asyncio.create_task(hub.run())
        try:
            yield
        finally:
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await task

    async def status(_: Request) -> Response:
        if hub.document is None:
            return JSONResponse({"error": hub.reason}, 503)
        return JSONResponse(hub.document)

    async def events(_: Request) -> Response:
        if hub.streams >= settings.max_streams:
            return PlainTextResponse("too many visitors; try again later\n", 503, {"Retry-After": "30"})
        return _Live(hub)

    async def session(_: Request) -> Response:
        return JSONResponse({"version": __version__, "csrf": csrf, "resets": settings.resets})

    async def reset(request: Request) -> Response:
        if not secrets_equal(request.headers.get("x-csrf-token", ""), csrf):
            return PlainTextResponse("wrong CSRF token\n", 403)
        if not settings.resets:
            return PlainTextResponse("a reset over this page takes tpmsd web --token-file\n", 403)
        try:
            body = json.loads(await request.body() or b"{}")
            tyres = body.get("tyres") if isinstance(body, dict) else None
            if tyres is not None and not isinstance(tyres, str):
                raise ValueError
        except (ValueError, RecursionError):
            return PlainTextResponse('a JSON object such as {"tyres": "winter"} is wanted\n', 400)
        try:
            await asyncio.to_thread(request_reset, socket, tyres)
        except TpmsdError as error:
            return JSONResponse({"error": str(error)}, 503)
        return JSONResponse({"asked": True}, 202)

    routes = [
        Route("/", page("live.html")),
        Route("/api/status", status),
        Route("/api/live", events),
        Route("/api/session", session),
        Route("/api/reset", reset, methods=["POST"]),
    ]
    return _guarded_app(routes, settings, lifespan)


class _Live(StreamingResponse):
    """The events for one visitor, who counts from the moment at which the answer begins."""

    def __init__(self, hub: LiveHub) -> None:
        super().__init__(hub.events(), media_type="text/event-stream")
        self._hub = hub

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send them, until the visitor leaves."""
        self._hub.streams += 1
        try:
            await super().__call__(scope, receive, send)
        finally:
            self._hub.streams -= 1


def drive_app(replay: Replay, settings: WebSettings, model: Path | None = None) -> Starlette:
    """Return the application that shows a recorded drive, and its diagnosis if it lies in a folder.

    `model`: effects that belong to the baseline of the diagnosis, those of `[filter] model` unless given.
    """
    folders = replay.source.folders
    job = DiagnosisJob(folders[0], model) if folders else None
    overview = {**drive_data.overview(replay), "diagnosis": job is not None}

    @contextlib.asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        try:
            yield
        finally:
            if job is not None:
                await job.stop()

    async def diagnosis(_: Request) -> Response:
        if job is None:
            raise HTTPException(404, "the drive is in memory alone: there is no diagnosis")
        if job.page is None:
            return FileResponse(STATIC / "wait.html", media_type="text/html")
        return HTMLResponse(job.page)

    async def progress(_: Request) -> Response:
        if job is None:
            raise HTTPException(404, "the drive is in memory alone: there is no diagnosis")
        return JSONResponse(job.document())

    async def begin(_: Request) -> Response:
        if job is None:
            raise HTTPException(404, "the drive is in memory alone: there is no diagnosis")
        job.start()
        return JSONResponse(job.document(), 202)

    def series(request: Request) -> Response:
        query = request.query_params
        names = [name for name in query.get("columns", "").split(",") if name][:32]
        found = drive_data.series(
            replay,
            names,
            _number(query.get("from"), 0.0),
            _number(query.get("to"), float(overview["duration_s"] or 0.0)),
            _points(query.get("points"), settings),
        )
        return JSONResponse(found)

    def track(request: Request) -> Response:
        query = request.query_params
        points = _points(query.get("points"), settings)
        return JSONResponse(drive_data.track(replay, query.get("colour", "speed_mps"), points))

    routes = [
        Route("/", page("drive.html")),
        Route("/api/drive", lambda _: JSONResponse(overview)),
        Route("/api/series", series),
        Route("/api/track", track),
        Route("/diagnosis", diagnosis),
        Route("/api/diagnosis", progress),
        Route("/api/diagnosis", begin, methods=["POST"]),
    ]
    return _guarded_app(routes, settings, lifespan)


def page(name: str) -> Handler:
    """Return a handler that sends one of the pages."""

    async def send(_: Request) -> Response:
        return FileResponse(STATIC / name, media_type="text/html")

    return send


def _guarded_app(routes: list[Route], settings: WebSettings, lifespan: Any) -> Starlette:
    async def login(request: Request) -> Response:
        if request.method == "GET":
            return FileResponse(STATIC / "login.html", media_type="text/html")
        body = (await request.body()).decode("utf-8", "replace").strip()
        if settings.token is None or not secrets_equal(body, settings.token):
            return PlainTextResponse("wrong token\n", 403)
        answer = PlainTextResponse("welcome\n")
        answer.set_cookie(COOKIE, settings.token, httponly=True, samesite="strict", secure=settings.secure)
        return answer

    return Starlette(
        routes=[
            *routes,
            Route(LOGIN, login, methods=["GET", "POST"]),
            Mount("/static", StaticFiles(directory=STATIC)),
            Mount("/assets", StaticFiles(directory=ASSETS)),
        ],
        middleware=[Middleware(Guard, settings=settings)],
        exception_handlers={TpmsdError: _bad_request, HTTPException: _http_error},
        lifespan=lifespan,
    )


async def _bad_request(_: Request, error: Exception) -> Response:
    return JSONResponse({"error": str(error)}, 400)


async def _http_error(_: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    return PlainTextResponse(f"{error.detail}\n", error.status_code)


def _number(text: str | None, usual: float) -> float:
    """Return a query's finite number, `usual` if not given; ConfigError if it is not a number."""
    if text is None:
        return usual
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise ConfigError(f"{text[:20]!r}: a number is wanted")
    return number


def _points(text: str | None, settings: WebSettings) -> int:
    """Return the number of points that a query asks for, limited to 2 to `max_points`."""
    return int(min(max(_number(text, 2000.0), 2.0), settings.max_points))
