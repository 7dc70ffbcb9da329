"""Status documents for the tests, and a daemon that serves them."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tests.beside import beside
from tpmsd.onboard.sinks.status_server import StatusServer

WHEEL = {
    "state": "monitoring",
    "deviation_mm": -0.5,
    "std_mm": 0.1,
    "change_mm": -0.25,
    "change_std_mm": 0.1,
    "deflation_probability": 0.01,
    "deviation_probability": 0.0,
    "pressure_loss_percent": 4.0,
    "pressure_loss_std_percent": 3.0,
}


def alarm(kind: str = "deflation", wheel: str | None = "rl", time_s: float = 1000.0) -> dict[str, Any]:
    return {
        "time": time_s,
        "kind": kind,
        "wheel": wheel,
        "state": "raised",
        "deviation_mm": -2.0,
        "reason": "soft",
    }


def document(*alarms: dict[str, Any], **changed: Any) -> dict[str, Any]:
    base: dict[str, Any] = {
        "version": 1,
        "tpmsd": "9.9",
        "time": 1190.0,
        "uptime_s": 60.0,
        "ticks": 600,
        "missed_deadlines": 2,
        "learning_fraction": 1.0,
        "can": {"state": "ok", "channel": "can0", "faults": {"lost": 3}, "age_s": 0.01, "frames": 1234},
        "gnss": {"state": "ok", "device": "d", "faults": {"no_fix": 1}, "age_s": 0.1, "fixes": 300},
        "wheels": {name: dict(WHEEL) for name in ("fl", "fr", "rl", "rr")},
        "alarms": list(alarms),
        "estimator": {"speed_mps": 20.0},
    }
    return base | changed


class ServedDaemon:
    """What stands behind the socket; `document` may be changed at any time."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.document: dict[str, Any] = document()


@contextlib.contextmanager
def served(path: Path, period_s: float = 0.1) -> Iterator[ServedDaemon]:
    """A daemon's socket with a document that is published every `period_s`."""
    daemon = ServedDaemon(path)
    server = StatusServer(path, lambda: daemon.document)
    server.open()

    def loop(over: threading.Event) -> None:
        next_s = 0.0
        while not over.is_set():
            now_s = time.monotonic()
            server.service(now_s)
            if now_s >= next_s:
                server.publish(now_s)
                next_s = now_s + period_s
            time.sleep(0.005)

        server.close()

    with beside(loop):
        yield daemon
