"""From a databroker to the daemon, each in its process, over a CAN bus made of two slcan adapters."""

from __future__ import annotations

import contextlib
import os
import select
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tests.beside import beside
from tests.connect.servers import PATIENCE_S, Process, free_port, raw_pty, wait_for
from tests.interfaces.bridges.databroker import Databroker, databroker
from tests.interfaces.bridges.vss_car import SPEED_MPS, TYPES, configure, driving
from tpmsd.onboard.sinks.status_client import StatusError, read_status


@contextlib.contextmanager
def slcan_pair() -> Iterator[tuple[str, str]]:
    """Two adapters on one bus: a frame that is written into either of the lines comes out of the other."""
    with raw_pty() as (one, path), raw_pty() as (other, other_path):

        def carry(over: threading.Event) -> None:
            rest = {one: b"", other: b""}
            while not over.is_set():
                for line in select.select([one, other], [], [], 0.05)[0]:
                    *lines, rest[line] = (rest[line] + os.read(line, 4096)).split(b"\r")
                    frames = [text + b"\r" for text in lines if text[:1] in b"tT"]
                    os.write(other if line == one else one, b"".join(frames))

        with beside(carry):
            yield path, other_path


def test_wheels_and_position_of_a_databroker_move_the_daemon(tmp_path: Path) -> None:
    """All wheels are learned and the speed is right; with the bridge killed, then the databroker restarted,
    the daemon goes on and frames come again."""
    port, path = free_port(), tmp_path / "s"
    dbc = subprocess.run(
        [sys.executable, "-m", "tpmsd", "bridge", "vss", "--print-dbc"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    with contextlib.ExitStack() as stack:
        here, there = stack.enter_context(slcan_pair())
        car = configure(tmp_path / "car", dbc, "slcan", there)
        broker = Databroker(TYPES)
        stack.enter_context(driving(broker))
        options = ("--databroker", f"localhost:{port}", "--input", here, "--interface", "slcan")
        bridge = Process(tmp_path, "bridge", "vss", *options)
        daemon = Process(
            tmp_path, "run", "--config", str(car), "--socket", str(path), "--state", str(tmp_path / "state")
        )
        stack.callback(daemon.end, signal.SIGKILL)

        def until(what: str, key: str, count: int) -> dict[str, Any]:
            """The status once so many more frames or fixes have come."""
            source, name = key.split(".")
            seen: dict[str, Any] = {}

            def ask() -> bool:
                with contextlib.suppress(StatusError):
                    seen.update(read_status(path))
                return bool(seen) and seen[source][name] >= count and seen[source]["state"] == "ok"

            wait_for(what, ask, PATIENCE_S)
            return seen

        with databroker(broker, port):
            until("wheels", "can.frames", 1000)
            status = until("fixes", "gnss.fixes", 25)
            assert bridge.end(signal.SIGKILL)
            bridge.start()
            frames = until("wheels after a kill", "can.frames", status["can"]["frames"] + 1000)["can"][
                "frames"
            ]
        with databroker(broker, port):
            last = until("wheels after a restart", "can.frames", frames + 1000)
        assert 0 == bridge.end(signal.SIGTERM)
        assert daemon.lives()

    assert {"fl", "fr", "rl", "rr"} == set(status["wheels"])
    assert {"learning"} == {wheel["state"] for wheel in last["wheels"].values()}
    assert abs(status["estimator"]["speed_mps"] - SPEED_MPS) < 0.2
    assert {} == {kind: count for kind, count in status["can"]["faults"].items() if kind in ("jump", "late")}
    log = (tmp_path / "bridge-vss.log").read_text("utf-8")
    assert log.index("the databroker gives no values (") < log.index("the databroker gives values")
    assert "values sent" in log
