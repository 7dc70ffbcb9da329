"""The hub between one daemon and many visitors."""

from __future__ import annotations

import asyncio
import base64
import json
import shutil
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from tests.beside import beside
from tpmsd.interfaces.web.app import STATIC
from tpmsd.interfaces.web.live import LiveHub, history_row
from tpmsd.interfaces.web.settings import WebSettings
from tpmsd.onboard.sinks.status_server import StatusServer

SETTINGS = WebSettings(retry_s=0.05, silence_s=2.0, heartbeat_s=0.2, history_s=100.0, history_rows=10)


def document(time_s: float) -> dict[str, Any]:
    """What a daemon says."""
    wheel = {
        "state": "monitoring",
        "change_mm": -time_s,
        "change_std_mm": 0.1,
        "deviation_mm": 5.0,
        "std_mm": 1,
    }
    return {"version": 1, "time": time_s, "wheels": {"rl": wheel}, "alarms": []}


@contextmanager
def daemon(path: Path) -> Iterator[StatusServer]:
    """A status server whose clock advances by 10 s with each of its updates, every 20 ms."""
    ticks = [0]
    server = StatusServer(path, lambda: document(10.0 * ticks[0]))
    server.open()

    def loop(over: threading.Event) -> None:
        while not over.wait(0.02):
            ticks[0] += 1
            server.publish(time.monotonic())
        server.close()

    with beside(loop):
        yield server


async def received(hub: LiveHub, name: str, count: int) -> list[Any]:
    """The data of the next events of a kind."""
    found: list[Any] = []
    async for sent in hub.events():
        kind, _, data = sent.decode().partition("\n")
        if kind == f"event: {name}":
            found.append(json.loads(data.removeprefix("data: ")))
        if len(found) == count:
            return found
    raise AssertionError("the stream ended")


def run(coroutine: Any, hub: LiveHub) -> Any:
    """Run beside the hub."""

    async def both() -> Any:
        task = asyncio.create_task(hub.run())
        try:
            return await asyncio.wait_for(coroutine, 10.0)
        finally:
            task.cancel()

    return asyncio.run(both())


def test_many_visitors_are_one_watcher(tmp_path: Path) -> None:
    """Fifty streams get the newest documents; the daemon serves one connection."""
    with daemon(tmp_path / "s") as server:
        hub = LiveHub(tmp_path / "s", SETTINGS)

        async def look() -> tuple[list[list[Any]], int]:
            streams = [asyncio.create_task(received(hub, "status", 5)) for _ in range(50)]
            found = await asyncio.gather(*streams)
            return found, server.watchers

        found, watchers = run(look(), hub)
    assert 1 == watchers
    for one in found:
        times = [entry["time"] for entry in one]
        assert sorted(times) == times


def test_a_slow_visitor_gets_the_newest_and_not_a_queue(tmp_path: Path) -> None:
    """Who reads nothing for a while continues with what is true now."""
    with daemon(tmp_path / "s"):
        hub = LiveHub(tmp_path / "s", SETTINGS)

        async def dawdle() -> tuple[float, float]:
            events = hub.events()
            while not (await anext(events)).startswith(b"event: status"):
                pass
            await asyncio.sleep(0.5)
            assert hub.document is not None
            now = hub.document["time"]
            return now, json.loads((await anext(events)).partition(b"data: ")[2])["time"]

        now, got = run(dawdle(), hub)
    assert now <= got


def test_a_daemon_that_goes_and_comes_back(tmp_path: Path) -> None:
    """The page is told why there is no data, and goes on by itself."""
    hub = LiveHub(tmp_path / "s", SETTINGS)

    async def follow() -> list[Any]:
        (absent,) = await received(hub, "down", 1)
        with daemon(tmp_path / "s"):
            (first,) = await received(hub, "status", 1)
            await asyncio.sleep(0.1)
        (gone,) = await received(hub, "down", 1)
        with daemon(tmp_path / "s"):
            (second,) = await received(hub, "status", 1)
        return [absent, first, gone, second]

    absent, first, gone, second = run(follow(), hub)
    assert "is tpmsd running?" in absent["reason"]
    assert gone["reason"]
    assert "wheels" in first
    assert "wheels" in second


def test_history_is_bounded_and_starts_anew_where_the_clock_goes_back(tmp_path: Path) -> None:
    """Rows are as far apart as the span allows; what is older than the span goes."""
    hub = LiveHub(tmp_path / "s", SETTINGS)
    for k in range(1000):
        hub._add_to_history(document(float(k)))
    times = [row["time"] for row in hub.history]
    assert len(times) <= SETTINGS.history_rows
    assert all(later - earlier >= 10.0 for earlier, later in pairwise(times))
    assert times[-1] - times[0] <= SETTINGS.history_s
    assert [-times[-1], 0.1] == hub.history[-1]["rl"]
    hub._add_to_history(document(3.0))
    assert [3.0] == [row["time"] for row in hub.history]


UNKNOWN = {"state": "learning", "change_mm": None, "change_std_mm": None, "deviation_mm": -7.7, "std_mm": 0.4}
"""A wheel after a stop: its deviation from nominal is known, its change since learned is not yet."""


def around_a_stop() -> list[dict[str, Any]]:
    """Documents before, at and after a stop."""
    known = document(0.0)["wheels"]["rl"] | {"change_mm": 0.1}
    return [
        {"version": 1, "time": 10.0 * k, "wheels": {"rl": wheel}, "alarms": []}
        for k, wheel in enumerate((known, UNKNOWN, {}, known))
    ]


def test_a_change_that_is_not_known_is_a_gap_of_the_timeline() -> None:
    """The line holds the change since learned alone: the deviation from nominal never stands in for it."""
    rows = [history_row(one) for one in around_a_stop()]

    assert [[0.1, 0.1], None, None, [0.1, 0.1]] == [row["rl"] for row in rows]
    assert [None] * 4 == [row["fr"] for row in rows]


def test_the_page_adds_the_rows_that_the_server_keeps() -> None:
    """The script makes the same row of a document as the server does, so that a reload changes nothing."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("node is not installed")
    module = base64.b64encode((STATIC / "common.js").read_bytes()).decode()
    script = (
        f'import {{ changeRow }} from "data:text/javascript;base64,{module}";'
        f"console.log(JSON.stringify({json.dumps(around_a_stop())}.map(changeRow)))"
    )
    made = subprocess.run(
        [node, "--input-type=module", "-e", script], capture_output=True, text=True, timeout=60.0
    )

    assert "" == made.stderr
    assert [history_row(one) for one in around_a_stop()] == json.loads(made.stdout)


def test_a_new_visitor_gets_the_history_as_it_is_now(tmp_path: Path) -> None:
    """The history is encoded once for all visitors, and again when it has grown."""

    async def first(hub: LiveHub) -> list[float]:
        (rows,) = await received(hub, "history", 1)
        return [row["time"] for row in rows]

    async def visits() -> list[list[float]]:
        hub, seen = LiveHub(tmp_path / "s", SETTINGS), []
        for time_s in (0.0, 1.0, 20.0):
            await hub._publish(document(time_s), "")
            seen.append(await first(hub))
        return seen

    assert [[0.0], [0.0], [0.0, 20.0]] == asyncio.run(visits())


def test_before_the_daemon_was_asked_a_visitor_reads_so(tmp_path: Path) -> None:
    """A page that is opened at once says why it is empty."""
    (down,) = asyncio.run(received(LiveHub(tmp_path / "s", SETTINGS), "down", 1))

    assert "not asked yet" == down["reason"]


def test_what_is_no_daemon_is_said(tmp_path: Path) -> None:
    """Somebody else on the socket is one line, not a dead page."""

    async def stranger(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(b"HTTP/1.1 400 Bad Request\r\n\r\n")
        await writer.drain()
        writer.close()

    hub = LiveHub(tmp_path / "s", SETTINGS)

    async def ask() -> str:
        server = await asyncio.start_unix_server(stranger, str(tmp_path / "s"))
        async with server:
            while True:
                (down,) = await received(hub, "down", 1)
                if "what answers" in down["reason"]:
                    return str(down["reason"])
                await asyncio.sleep(0.01)

    assert "what answers is not tpmsd (no JSON)" in run(ask(), hub)


@pytest.mark.parametrize("trouble", [RuntimeError("odd"), KeyError("time"), RecursionError(), MemoryError()])
def test_no_error_leaves_old_data_on_show(tmp_path: Path, trouble: Exception) -> None:
    """Whatever goes wrong while the daemon is followed is said, and the daemon is followed again."""

    class Troubled(LiveHub):
        async def _follow_daemon(self) -> None:
            if self.document is None and self.troubles == 0:
                self.troubles += 1
                await self._publish(document(1.0), "")
                raise trouble
            await super()._follow_daemon()

        troubles = 0

    async def follow() -> tuple[str, list[Any]]:
        (down,) = await received(hub, "down", 1)
        while type(trouble).__name__ not in down["reason"]:
            (down,) = await received(hub, "down", 1)
        return down["reason"], await received(hub, "status", 1)

    with daemon(tmp_path / "s"):
        hub = Troubled(tmp_path / "s", SETTINGS)
        reason, again = run(follow(), hub)
    assert "internal error" in reason
    assert "wheels" in again[0]
