"""A car whose wheel speeds and position stand in a databroker, for tests of processes."""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from tests.beside import beside
from tests.interfaces.bridges.databroker import Databroker

WHEELS = {
    f"{axle[0]}{side[0].lower()}": f"Vehicle.Chassis.Axle.{row}.Wheel.{side}.Speed"
    for axle, row in (("front", "Row1"), ("rear", "Row2"))
    for side in ("Left", "Right")
}
PLACE = "Vehicle.CurrentLocation."
TYPES = dict.fromkeys(WHEELS.values(), "float") | {
    f"{PLACE}Latitude": "double",
    f"{PLACE}Longitude": "double",
    f"{PLACE}Timestamp": "string",
    f"{PLACE}GNSSReceiver.FixType": "string",
}
SPEED_MPS = 14.0
METRES_PER_DEGREE = 6_371_000.0 * math.pi / 180.0
VEHICLE = """[vehicle]
wheel_radius_m = 0.3
track_front_m = 1.5
track_rear_m = 1.5
wheelbase_m = 2.6
[can]
interface = "{interface}"
channel = "{channel}"
dbc = "vss.dbc"
[can.signals]
wheel_speed_fl = "VSS_SPEED_FL.SPEED_FL"
wheel_speed_fr = "VSS_SPEED_FR.SPEED_FR"
wheel_speed_rl = "VSS_SPEED_RL.SPEED_RL"
wheel_speed_rr = "VSS_SPEED_RR.SPEED_RR"
gnss_latitude = "VSS_LATITUDE.LATITUDE"
gnss_longitude = "VSS_LONGITUDE.LONGITUDE"
gnss_utc = "VSS_UTC.UTC"
gnss_fix = "VSS_FIX.FIX"
[gnss]
source = "can"
"""


def configure(folder: Path, dbc: str, interface: str, channel: str) -> Path:
    """A folder with the configuration that docs/how-to/vss.md has."""
    folder.mkdir(parents=True)
    (folder / "vss.dbc").write_text(dbc, "utf-8")
    (folder / "vehicle.toml").write_text(VEHICLE.format(interface=interface, channel=channel), "utf-8")
    return folder


@contextlib.contextmanager
def driving(broker: Databroker) -> Iterator[None]:
    """North at 14 m/s: each wheel 50 times a second with the noise that wheel speeds have, a fix 5 times."""
    rng = np.random.default_rng(5)

    def drive(over: threading.Event) -> None:
        began_s = next_s = time.time()
        step = 0
        while not over.wait(max(next_s - time.time(), 0.0)):
            noise = rng.normal(0.0, 0.02, 4)
            for path, more in zip(WHEELS.values(), noise, strict=True):
                broker.write({path: 3.6 * (SPEED_MPS + float(more))})
            if step % 10 == 0:
                now_s = time.time()
                broker.write(
                    {
                        f"{PLACE}Latitude": 50.0 + SPEED_MPS * (now_s - began_s) / METRES_PER_DEGREE,
                        f"{PLACE}Longitude": 8.0,
                        f"{PLACE}Timestamp": datetime.fromtimestamp(now_s, UTC).isoformat(),
                        f"{PLACE}GNSSReceiver.FixType": "THREE_D",
                    }
                )
            step, next_s = step + 1, next_s + 0.02

    with beside(drive):
        yield
