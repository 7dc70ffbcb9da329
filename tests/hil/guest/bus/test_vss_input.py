"""Wheel speeds of a databroker on a real vcan, read by the daemon and by candump."""

from __future__ import annotations

import contextlib
import subprocess
import sys
from pathlib import Path

import cantools

from tests.hil.guest.rig import end, listening, run, running, wait_until
from tests.interfaces.bridges.databroker import Databroker, databroker
from tests.interfaces.bridges.vss_car import SPEED_MPS, TYPES, configure, driving

BRIDGE = [sys.executable, "-m", "tpmsd", "bridge", "vss"]
"""Of the sources: the package that is installed here has no gRPC."""


def test_values_of_a_databroker_are_frames_on_vcan(tmp_path: Path) -> None:
    """Wheels are learned at the car's speed; candump hears each wheel 50 times a second; a silent databroker
    is a silent bus; an interface that is no vcan is refused."""
    dbc = run(*BRIDGE, "--print-dbc")
    car = configure(tmp_path / "car", dbc, "socketcan", "vcan0")
    broker = Databroker(TYPES)
    with contextlib.ExitStack() as stack:
        port = stack.enter_context(databroker(broker))
        heard = stack.enter_context(listening("vcan0", tmp_path / "heard", "6C0:7F0"))
        with (tmp_path / "bridge.log").open("wb") as log:
            options = ["--databroker", f"localhost:{port}", "--input", "vcan0"]
            bridge = subprocess.Popen([*BRIDGE, *options], stderr=log)
        stack.callback(bridge.kill)
        daemon = stack.enter_context(running(car))
        wait_until(lambda: broker.subscribers, "the bridge has subscribed")
        with driving(broker):
            daemon.until(lambda status: status["can"]["frames"] > 1000, "wheels come")
            status = daemon.until(lambda status: status["gnss"]["fixes"] > 25, "fixes come")
        wait_until(lambda: daemon.status()["can"]["state"] != "ok", "the bus is silent")
        frames = heard.frames()
        assert 0 == end(bridge)
        refused = subprocess.run(
            [*BRIDGE, "--databroker", "localhost", "--input", "lo"], capture_output=True, text=True
        )

    assert {"learning"} == {wheel["state"] for wheel in status["wheels"].values()}
    assert abs(status["estimator"]["speed_mps"] - SPEED_MPS) < 0.5
    database = cantools.database.load_string(dbc, "dbc")
    for number, wheel in enumerate(("FL", "FR", "RL", "RR")):
        mine = [one for one in frames if one.identifier == 0x6C0 + number]
        took_s = mine[-1].time_s - mine[0].time_s
        assert 25.0 < (len(mine) - 1) / took_s < 52.0
        (kmh,) = database.decode_message(mine[-1].identifier, mine[-1].data).values()
        assert abs(kmh / 3.6 - SPEED_MPS) < 0.2, wheel
    assert (2, True) == (refused.returncode, "lo is no virtual CAN interface" in refused.stderr)
