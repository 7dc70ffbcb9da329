"""Counts reported lost on drives that lose none, and on drives that do.

    python -m bench run lost-counts [--number 100] [--seed 1] [--kinds plain,latched] [--json FILE]

The statistic of `rings.single_losses` alone, beside a calibration and no effect: a tenth of a second a
drive. Drives are ten minutes of the kinematic world with rings of 40 to 100 counts, on which the control unit

    plain           reads its counters at the frame
    latched         reads them every 2 to 20 ms of its own clock, for all wheels or for each apart
    beating         the same, near a part of the frames' period: the age sweeps over it within 3 to 300 s
    effects         reads them at the frame, while slip, loads, a leak or physics of no catalogue act unfitted
    losing          loses or adds 0.3 to 1.5 counts a second at random on one wheel
    losing-latched  does so with a latch

Printed: drives on which a loss is named, and of those that lose, how many have the right wheel or its twin.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from bench.registry import UsageError
from bench.worlds import kinematic
from bench.worlds.folder import WHEELS, wheel_messages
from bench.worlds.instruments import Array, Drive
from bench.worlds.latch import draw_beat, draw_latch
from bench.worlds.spec import Spec, draw_spec
from tpmsd.car.physics.kinematics import WheelPositions
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.car.physics.motion import Car, driven_mask
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.hypotheses.response import calibration_columns
from tpmsd.offline.inference.recording import Recording
from tpmsd.offline.inference.trajectory import reference
from tpmsd.offline.inference.windows import Reader
from tpmsd.offline.rings.single_losses import SingleLosses, single_losses

TICK_S, PER_TICK = 0.1, 5
GYRO_RADPS, NO_GYRO_RADPS = 2e-4, 1.0
"""Standard deviation of a window's yaw rate."""
TEETH = (40.0, 43.0, 44.0, 46.0, 47.0, 48.0, 52.0, 60.0, 80.0, 96.0, 100.0)
EFFECTS: tuple[dict[str, dict[str, Any]], ...] = (
    {"longitudinal_slip": {"slip_per_accel": 4e-3, "slip_per_speed2": 2e-6}},
    {"load_transfer_lateral": {"coefficient": 2e-4}},
    {"load_transfer_longitudinal": {"coefficient": 2e-4}},
    {"strange_camber": {"size_m": 1.5e-3, "wheels": [1]}},
    {"strange_effort": {"size_m": 8e-4, "wheels": [2, 3]}},
    {"strange_effort": {"size_m": 1e-3, "wheels": [0]}},
    {"radius_change": {"wheel": "fr", "deviation_m": -1.5e-3, "onset_s": 250.0, "duration_s": 60.0}},
    {"wheel_spin": {"wheels": [0], "slip": 0.008, "onset_s": 300.0, "duration_s": 20.0}},
    {"strange_span": {"size_m": -1e-3, "from_s": 200.0, "to_s": 260.0, "wheels": [2]}},
    {"yaw_rate_scale": {"scale": 1.02}},
    {"track_width_error": {"rear_m": 0.05, "front_m": 0.0}},
    {"tone_ring_error": {"wheel": "rl", "amplitude_rad": 4e-3}},
    {"lateral_slip": {"coefficient": 5e-3}},
    {"strange_brake_heat": {"size_m": 1e-3, "cooling_s": 60.0, "wheels": [0]}},
)
KINDS = ("plain", "latched", "beating", "effects", "losing", "losing-latched")


@dataclass(frozen=True)
class Case:
    """One drive and what it loses."""

    spec: Spec
    recording: Recording
    wheel: str = ""
    rate_per_s: float = 0.0
    """Positive where counts are lost."""


def case(kind: str, seed: int) -> Case:
    """Draw and drive it; UsageError for another kind."""
    if kind not in KINDS:
        raise UsageError(f"{kind}: not among {', '.join(KINDS)}")
    rng = np.random.default_rng([seed, sum(map(ord, kind))])
    changed: dict[str, Any] = {
        "duration_s": 600.0,
        "wheel_signal": "counts",
        "teeth": float(rng.choice(TEETH)),
        "radius_drift": float(rng.choice([0.0, 2e-4])),
    }
    if kind == "beating":
        changed |= draw_beat(rng)
    elif kind.endswith("latched"):
        changed |= draw_latch(rng)
    wheel, rate = "", 0.0
    if kind == "effects":
        changed["physics"] = EFFECTS[seed % len(EFFECTS)]
    if kind.startswith("losing"):
        number, rate = int(rng.integers(4)), float(rng.choice([-1.0, 1.0]) * rng.uniform(0.3, 1.5))
        wheel = WHEELS[number]
        changed |= {
            "physics": {"pulses": {"wheel": number, "per_s": -rate}},
            "teeth": float(rng.choice([44.0, 48.0, 60.0])),
        }
    spec = draw_spec(rng, **changed)
    return Case(spec, recorded(kinematic.drive(spec, seed)), wheel, rate)


def recorded(drive: Drive) -> Recording:
    """Ticks of what the frames carry: angles between two frames lie on the line through both."""
    spec = drive.spec
    edges_s = np.arange(TICK_S, drive.time_s[-1] - TICK_S, TICK_S)
    ticks = len(edges_s) - 1
    angle = np.full((ticks + 1, 4), math.nan)
    for message in wheel_messages(drive):
        for k, (role, *_) in enumerate(message.signals):
            shown = message.raw[:, k] * 2.0 * math.pi / spec.teeth
            angle[:, WHEELS.index(role[-2:])] = np.interp(edges_s, message.time_s, shown)

    def mean(values: Array, there: bool) -> FloatArray:
        part = values[PER_TICK : (ticks + 1) * PER_TICK].reshape(ticks, PER_TICK).mean(axis=1)
        return np.asarray(part if there else np.full(ticks, math.nan))

    return Recording(
        car=Car(
            radius_m=np.full(4, spec.radius_m),
            geometry=WheelPositions(spec.track_front_m, spec.track_rear_m, spec.wheelbase_m),
            driven=driven_mask(spec.driven),
            teeth_per_rev=spec.teeth,
            antenna_forward_m=spec.antenna_forward_m,
            antenna_left_m=spec.antenna_left_m,
        ),
        dt_s=TICK_S,
        start_s=0.0,
        rotation_rad=np.diff(angle, axis=0),
        quantum_rad=np.full(4, 2.0 * math.pi / spec.teeth / math.sqrt(6.0)),
        inertial={
            "yaw_rate_radps": mean(drive.gyro, spec.with_gyro),
            "accel_long_mps2": mean(drive.accel_long, spec.with_accel),
            "accel_lat_mps2": mean(drive.accel_lat, spec.with_accel),
            "steering_wheel_angle_rad": mean(drive.steering_wheel, spec.with_steering),
            "drive_torque_nm": np.full(ticks, math.nan),
            "ambient_temp_k": np.full(ticks, math.nan),
        },
        fix_time_s=drive.fix_true_s - TICK_S,
        east_m=drive.fix_east,
        north_m=drive.fix_north,
        up_m=drive.fix_up,
        speed_mps=drive.fix_speed,
        course_rad=drive.fix_course_math,
    )


def found(one: Case) -> SingleLosses | None:
    """The losses that the statistic tells beside a calibration of the four radii alone."""
    reader = Reader(one.recording, reference(one.recording))
    left = reader.windows.measured - reader.predict(ExtendedModel())
    for wheel, column in enumerate(calibration_columns(reader).arrays[:4]):
        response, known = column[:, wheel], np.isfinite(left[:, wheel])
        value = float(response[known] @ left[known, wheel]) / float(response[known] @ response[known])
        left[:, wheel] -= value * response
    car = one.recording.car
    count_m = 2.0 * math.pi * car.radius_m / car.teeth_per_rev
    return single_losses(reader.windows, left, count_m, GYRO_RADPS if one.spec.with_gyro else NO_GYRO_RADPS)


def options(parser: argparse.ArgumentParser) -> None:
    """Kinds, number and seeds of the drives."""
    parser.add_argument("--kinds", default=",".join(KINDS), help=f"comma-separated ({','.join(KINDS)})")
    parser.add_argument("--number", type=int, default=100, help="drives of each kind (100)")
    parser.add_argument("--seed", type=int, default=1, help="the first seed (1)")


def main(args: argparse.Namespace) -> dict[str, Any]:
    """Run it and print the table."""
    out: dict[str, Any] = {}
    print("| drives | number | named | right wheel or its twin | within two standard deviations |")
    print("| --- | --- | --- | --- | --- |")
    for kind in args.kinds.split(","):
        named = right = inside = 0
        for seed in range(args.seed, args.seed + args.number):
            one = case(kind, seed)
            losses = found(one)
            if losses is None:
                continue
            named += 1
            if one.wheel in (losses.wheel, *losses.similar_wheels):
                right += 1
                off = min(abs(losses.rate_per_s - sign * one.rate_per_s) for sign in (1.0, -1.0))
                inside += off < 2.0 * losses.rate_std_per_s
        out[kind] = {"number": args.number, "named": named, "right": right, "inside": inside}
        print(f"| {kind} | {args.number} | {named} | {right} | {inside} |", flush=True)
    return out
