"""What does my simulator leave out: arrays of a simulator against a recording of the same road.

    python docs/examples/what_my_simulator_leaves_out.py

The 'recording' is simulated here with a receiver that answers 0.2 s late; 'my simulator' is the same drive
without. Its wheels and fixes are taken as arrays, as any simulator has them: no file is needed.
"""

from __future__ import annotations

import numpy as np

import tpmsd
from tpmsd.car.physics.catalogue import parse_effect
from tpmsd.car.physics.model import ExtendedModel

SAME = {"duration_s": 150.0, "seed": 8, "route": "rural"}
late = ExtendedModel().plus(parse_effect("gnss_latency:latency_s=0.2"))
recording = tpmsd.simulate(model=late, **SAME)

ticks = tpmsd.replay(tpmsd.simulate(**SAME)).to_pandas()
fixes = ticks[np.isfinite(ticks["gnss_arrival_s"])]
wheels = {"time_s": ticks["time_s"]}
wheels |= {f"wheel_angle_{w}_rad": ticks[f"wheel_angle_{w}_rad"] for w in ("fl", "fr", "rl", "rr")}
gnss = {
    "time_s": fixes["gnss_arrival_s"],
    "utc_s": fixes["gnss_utc_s"],
    "latitude_deg": fixes["gnss_latitude_deg"],
    "longitude_deg": fixes["gnss_longitude_deg"],
    "altitude_m": fixes["gnss_altitude_m"],
    "speed_mps": fixes["gnss_speed_mps"],
    "course_rad": fixes["gnss_course_rad"],
    "position_std_m": fixes["gnss_position_std_m"],
}
inertial = {"time_s": ticks["time_s"], "yaw_rate_radps": ticks["yaw_rate_radps"]}
mine = tpmsd.Drive.from_tables(wheels, gnss, inertial, vehicle=recording.config)

found = tpmsd.diagnose(recording, simulation=mine)
print(found.verdict)
for finding in found.findings:
    value = finding.parameters.get("latency_s")
    size = f" {value.value:.2g} {value.unit}" if value is not None else ""
    print(f"{finding.effect}{size}, confidence {finding.confidence:.2f}, held by {finding.held_by}")
