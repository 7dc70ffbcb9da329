"""The running daemon for any number of visitors, over one connection to its status socket.

In: the path of the socket. Out: the newest document, and a history of the last hours. However many look on,
and however slow they are, the daemon serves one watcher: a visitor that does not keep up misses updates,
since it is always given the newest one. Each event is put into words once for all visitors.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
from collections import deque
from collections.abc import AsyncIterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tpmsd.foundation.errors import TpmsdError
from tpmsd.foundation.wheels import WHEELS
from tpmsd.interfaces.web.settings import WebSettings
from tpmsd.onboard.sinks.status_client import parse_status, refusal

MAX_LINE_BYTES = 1 << 20
log = logging.getLogger("tpmsd.interfaces.web")


@dataclass
class LiveHub:
    """The daemon as it was last heard of."""

    socket: Path
    settings: WebSettings
    document: Mapping[str, Any] | None = None
    """None until the daemon has answered, and while it does not."""
    reason: str = "not asked yet"
    """Reason why there is no document."""
    history: deque[dict[str, Any]] = field(default_factory=deque)
    streams: int = 0
    """Visitors that look on, as whoever answers them counts them."""
    _version: int = 0
    _newest: bytes = field(default_factory=lambda: event("down", {"reason": LiveHub.reason}))
    """The event of this version, as all visitors get it."""
    _past: bytes = b""
    """The event with the history; empty where that has grown since it was made."""
    _changed: asyncio.Condition = field(default_factory=asyncio.Condition)

    async def run(self) -> None:
        """Follow the daemon until cancelled; reconnect when it goes away."""
        while True:
            try:
                await self._follow_daemon()
            except TpmsdError as error:
                await self._publish(None, str(error))
            except (OSError, ValueError) as error:
                await self._publish(None, f"{self.socket}: {error}")
            except Exception as error:  # a defect is said, too: the last document would else stay on show
                log.exception("the daemon's page")
                await self._publish(None, f"internal error: {type(error).__name__}: {error}")
            await asyncio.sleep(self.settings.retry_s)

    async def _follow_daemon(self) -> None:
        """Publish each document that the daemon sends; TpmsdError where it cannot be reached or falls
        silent."""
        try:
            reader, writer = await asyncio.open_unix_connection(str(self.socket), limit=MAX_LINE_BYTES)
        except OSError as error:
            raise TpmsdError(refusal(self.socket, error)) from None
        try:
            writer.write(b'{"request": "watch"}\n')
            await writer.drain()
            while True:
                line = await asyncio.wait_for(reader.readline(), self.settings.silence_s)
                if not line.endswith(b"\n"):
                    raise TpmsdError("tpmsd has closed the connection: it is stopping or starting again")
                await self._publish(parse_status(self.socket, line), "")
        except TimeoutError:
            raise TpmsdError(f"tpmsd has said nothing for {self.settings.silence_s:g} s") from None
        finally:
            writer.close()
            with contextlib.suppress(OSError):
                await writer.wait_closed()

    async def _publish(self, document: Mapping[str, Any] | None, reason: str) -> None:
        """Set the newest document, None where the daemon is down, and wake all streams."""
        self.document, self.reason = document, reason
        if document is not None:
            self._add_to_history(document)
        self._newest = event("down", {"reason": reason}) if document is None else event("status", document)
        self._version += 1
        async with self._changed:
            self._changed.notify_all()

    def _add_to_history(self, document: Mapping[str, Any]) -> None:
        """Add the document's row to the timeline, unless less than a step has passed since the last row."""
        now = document.get("time")
        if not isinstance(now, int | float):
            return
        step_s = self.settings.history_s / self.settings.history_rows
        if self.history and now < self.history[-1]["time"]:
            self.history.clear()  # the clock was set back: what was before has no place on this axis
        if self.history and now - self.history[-1]["time"] < step_s:
            return
        self.history.append(history_row(document))
        self._past = b""
        while len(self.history) > self.settings.history_rows or (
            self.history and now - self.history[0]["time"] > self.settings.history_s
        ):
            self.history.popleft()

    async def _wait_for_update(self, version: int) -> bool:
        """Wait for a version other than `version`, at most `heartbeat_s`; return whether there is one."""
        try:
            async with asyncio.timeout(self.settings.heartbeat_s), self._changed:
                await self._changed.wait_for(lambda: self._version != version)
        except TimeoutError:
            return False
        return True

    async def events(self) -> AsyncIterator[bytes]:
        """Yield server-sent events for one visitor: the history first, then every update it can take."""
        seen = -1
        self._past = self._past or event("history", list(self.history))
        yield self._past
        while True:
            if not await self._wait_for_update(seen):
                yield b": still here\n\n"
                continue
            seen = self._version
            yield self._newest


def history_row(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return the timeline's row of one document: per wheel its change since learned with the deviation, mm.

    None where the change is not known, as after a start and until a stop is decided: the line has a gap
    there. The deviation from nominal is another quantity and is millimetres off. `changeRow` of the page's
    script makes the same row.
    """
    wheels = document.get("wheels")
    known = wheels if isinstance(wheels, dict) else {}
    row: dict[str, Any] = {"time": document["time"]}
    for wheel in WHEELS:
        one = known.get(wheel)
        one = one if isinstance(one, dict) else {}
        change = one.get("change_mm")
        row[wheel] = None if change is None else [change, one.get("change_std_mm")]
    return row


def event(name: str, data: object) -> bytes:
    """Return one server-sent event (WHATWG HTML, 9.2)."""
    return f"event: {name}\ndata: {json.dumps(data, separators=(',', ':'))}\n\n".encode()
