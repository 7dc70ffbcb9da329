"""What the slips are good for: gates and weights of the tyre filter on hard drives of the multi-body car.

    python -m bench run slip-gate [--json FILE] [--drives 3] [--first 1] [--minutes 7]
    python -m bench run slip-gate --roads --first 11 --minutes 8     three cars, dry and wet

Three questions. (1) Which gate keeps the radii true, and how much driving does it throw away: none, one
vendor's thresholds (4 m/s, 2 degrees at the road wheels, 2 m/s2 along and across) and those scaled, the
thresholds of `motion_gate` and those scaled, slips by the tyre model, and the true slips as the best that any
estimate could do. (2) What the weights of fixes do when a third of the fixes are reflected. (3) How true the
slips are themselves.

Radius errors are root mean squares over all four wheels from the third minute on; the share is that of the
informative ticks.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from bench.campaigns.car.vehicle_state import workshop
from bench.registry import UsageError
from bench.vehicle_state.observer import SlipObserver
from bench.worlds.commonroad_car import Run
from bench.worlds.hard_drives import (
    OFFSETS_M,
    SETTINGS,
    STEERING_RATIO,
    TICK_S,
    HardDrive,
    instrumented,
    truth,
)
from tpmsd.car.config.model import FilterConfig, GnssConfig
from tpmsd.car.vehicle_state.car import CarDynamics, typical
from tpmsd.car.vehicle_state.slips import slip_traces
from tpmsd.foundation.wheels import RL, RR, FloatArray
from tpmsd.onboard.estimators.build import build_filter
from tpmsd.onboard.estimators.gates.motion_gate import MotionGate
from tpmsd.onboard.timeline.tick import Tick

SETTLED_TICK = 1200

Rule = Callable[[Tick, float], bool]
"""Whether a tick is informative, by the tick and the wheels' speed."""


class RuledGate(MotionGate):
    """A gate that asks a rule of this benchmark instead."""

    def __init__(self, rule: Rule) -> None:
        super().__init__(FilterConfig())
        self._rule = rule

    def update(self, tick: Tick, speed_mps: float, yaw_rate_radps: float) -> bool:
        """The motion is smoothed as always; the verdict is the rule's."""
        fresh = math.isnan(self.speed_mps)
        super().update(tick, speed_mps, yaw_rate_radps)
        return not fresh and self._rule(tick, speed_mps)


def vendor(scale: float = 1.0) -> Rule:
    """Speed, steering and acceleration; the last two scaled."""
    steer, accel = math.radians(2.0) * scale, 2.0 * scale

    def rule(tick: Tick, speed_mps: float) -> bool:
        return (
            speed_mps >= 4.0
            and abs(tick.steering_wheel_angle_rad) / STEERING_RATIO <= steer
            and abs(tick.accel_long_mps2) <= accel
            and abs(tick.accel_lat_mps2) <= accel
        )

    return rule


def oracle(drive: HardDrive, slip: float, side_slip_rad: float) -> Rule:
    """The true slips of the tick."""
    largest, side = np.abs(drive.slip).max(axis=1), np.abs(true_side_slip(drive))
    good = (largest <= slip) & (side <= side_slip_rad)
    return lambda tick, speed_mps: speed_mps >= 6.0 and bool(good[tick.index])


def true_side_slip(drive: HardDrive) -> FloatArray:
    """(n,) of the rear axle's middle."""
    v, u, r = drive.state.T
    return np.arctan2(v - drive.rear_m * r, u)


@dataclass(frozen=True)
class Outcome:
    """Of one filter on one drive."""

    error_mm: float
    share: float
    overconfidence: float
    """Root mean square of error over stated standard deviation; 1 is honest."""
    lost_pose: int


def learn(drive: HardDrive, settings: FilterConfig, rule: Rule | None = None) -> Outcome:
    """Run the tyre filter over a drive, behind a rule of this benchmark or its own gate."""
    rng, gate = np.random.default_rng(1), rule and RuledGate(rule)
    filter_ = build_filter(drive.vehicle, GnssConfig(), settings, rng, front=True, gate=gate)
    reported = [filter_.step(tick) for tick in drive.ticks]
    off = np.array([t.deviation_m for t in reported[SETTLED_TICK:]]) - OFFSETS_M
    std = np.sqrt([np.diag(t.covariance_m2) for t in reported[SETTLED_TICK:]])
    return Outcome(
        error_mm=float(np.sqrt((off**2).mean()) * 1e3),
        share=float(np.mean([t.informative for t in reported])),
        overconfidence=float(np.sqrt(((off / std) ** 2).mean())),
        lost_pose=filter_.counts["lost_pose"],
    )


def report(label: str, found: list[Outcome], rows: list[dict[str, Any]], **more: object) -> None:
    """Print and keep one line."""
    errors = np.array([o.error_mm for o in found])
    row = {
        "label": label,
        "error_mm": float(np.sqrt((errors**2).mean())),
        "error_by_drive_mm": errors.tolist(),
        "share": float(np.mean([o.share for o in found])),
        "overconfidence": float(np.sqrt(np.mean([o.overconfidence**2 for o in found]))),
        "lost_pose": sum(o.lost_pose for o in found),
        **more,
    }
    rows.append(row)
    each = " ".join(f"{e:.2f}" for e in errors)
    print(
        f"  {label:34s} {row['error_mm']:.2f} mm ({each})   {row['share']:4.0%} of ticks informative   "
        f"error / std {row['overconfidence']:.1f}   pose lost {row['lost_pose']} times",
        flush=True,
    )


def gates(drives: list[HardDrive], rows: list[dict[str, Any]]) -> None:
    """Question 1."""
    print("\ngates, good fixes: radius error (by drive)")
    base = FilterConfig()
    report("none (above 6 m/s)", [learn(d, base, lambda tick, speed: speed >= 6.0) for d in drives], rows)
    for scale in (1.0, 0.8, 0.6):
        report(f"vendor, times {scale:g}", [learn(d, base, vendor(scale)) for d in drives], rows)
    for scale in (1.0, 0.75, 0.5):
        scaled = FilterConfig(max_accel_long_mps2=1.2 * scale, max_accel_lat_mps2=3.0 * scale)
        report(f"thresholds, times {scale:g}", [learn(d, scaled) for d in drives], rows)
    for slip in (0.01, 0.0075, 0.005, 0.004):
        settings = FilterConfig(gate="slip", max_wheel_slip=slip)
        report(f"slip {slip:g}", [learn(d, settings) for d in drives], rows)
    report(
        "slip 0.005, side slip 0.015",
        [learn(d, FilterConfig(gate="slip", max_side_slip_rad=0.015)) for d in drives],
        rows,
    )
    report("true slip 0.005", [learn(d, base, oracle(d, 0.005, 0.05)) for d in drives], rows)
    report(
        "true slip 0.005, side slip 0.015", [learn(d, base, oracle(d, 0.005, 0.015)) for d in drives], rows
    )


def weights(good: list[HardDrive], bad: list[HardDrive], rows: list[dict[str, Any]]) -> None:
    """Question 2."""
    for name, drives in (("good fixes", good), ("30 % of the time with reflected fixes", bad)):
        print(f"\nweights of fixes, {name}: radius error (by drive)")
        for gate in ("thresholds", "slip"):
            for kind in ("square", "igg3"):
                settings = FilterConfig(gate=gate, fix_weights=kind)
                report(f"gate {gate}, weights {kind}", [learn(d, settings) for d in drives], rows, fixes=name)


def bare(runs: list[Run], first: int, rows: list[dict[str, Any]]) -> None:
    """Question 1 again on a bus with wheels only."""
    print("\nno inertial signals and no steering on the bus: radius error (by drive)")
    drives = [instrumented(r, seed, inertial=False) for seed, r in enumerate(runs, start=first)]
    for gate in ("thresholds", "slip"):
        report(f"gate {gate}", [learn(d, FilterConfig(gate=gate)) for d in drives], rows, bus="wheels only")


def slips(drives: list[HardDrive], rows: list[dict[str, Any]]) -> None:
    """Question 3."""
    print("\nslips: root mean square of the truth, and errors of the estimates")
    car = drives[0].vehicle
    cars = {
        "typical car": typical(car.wheelbase_m, car.track_front_m, car.track_rear_m, car.driven_axle),
        "identified car": workshop(),
    }
    for label, dynamics in cars.items():
        found = np.array([_slip_errors(d, dynamics) for d in drives])
        side, side_seen, side_forces, wheel, wheel_seen, wheel_forces = np.sqrt((found**2).mean(axis=0))
        rows.append({"label": label, "slip_rms": np.sqrt((found**2).mean(axis=0)).tolist()})
        print(
            f"  {label:15s} side slip {side:.4f} rad: observer {side_seen:.4f}, forces {side_forces:.4f};",
            end=" ",
        )
        print(f"wheel slip {wheel:.4f}: observer {wheel_seen:.4f}, forces {wheel_forces:.4f}", flush=True)


def _slip_errors(drive: HardDrive, car: CarDynamics) -> tuple[float, ...]:
    radius = np.array(drive.vehicle.wheel_radius_m)[[RL, RR]]
    speed = np.array([t.rotation_rad[[RL, RR]] @ radius / 2 for t in drive.ticks]) / TICK_S
    along = np.array([t.accel_long_mps2 for t in drive.ticks])
    across = np.array([t.accel_lat_mps2 for t in drive.ticks])
    yaw = np.array([t.yaw_rate_radps for t in drive.ticks])
    steer = np.array([t.steering_wheel_angle_rad for t in drive.ticks]) / STEERING_RATIO
    observer = SlipObserver(car)
    reported = [
        observer.step(TICK_S, *(float(a[k]) for a in (along, across, yaw, steer, speed)))
        for k in range(len(speed))
    ]
    side_seen = np.array([math.nan if t is None else t.side_slip_rad for t in reported])
    wheel_seen = np.array([np.full(4, math.nan) if t is None else t.wheel_slip for t in reported])
    forces = slip_traces(car, along, speed * yaw, np.gradient(yaw, TICK_S), steer)
    side = true_side_slip(drive)
    # A wheel that spins or locks is off by more than anything the gate must tell apart.
    rolling = np.isfinite(side_seen) & (np.abs(drive.slip).max(axis=1) < 0.05)

    def rms(values: FloatArray) -> float:
        return float(np.sqrt((values[rolling] ** 2).mean()))

    return (
        rms(side), rms(side_seen - side), rms(forces.side_slip_rad - side),
        rms(drive.slip), rms(wheel_seen - drive.slip), rms(forces.wheel_slip - drive.slip),
    )  # fmt: skip


def regression(runs: list[Run], first: int = 1) -> list[dict[str, Any]]:
    """All three questions on these runs; `first` is the seed of the first one's instruments."""
    rows: list[dict[str, Any]] = []
    good = [instrumented(r, seed) for seed, r in enumerate(runs, start=first)]
    bad = [instrumented(r, seed, bad_fixes=0.3) for seed, r in enumerate(runs, start=first)]
    accel = np.concatenate([np.abs(d.accel) for d in good])
    print(f"{len(runs)} drives; above 2 m/s2 along {np.mean(accel[:, 0] > 2):.0%} of the time,", end=" ")
    print(f"across {np.mean(accel[:, 1] > 2):.0%}, above 5 m/s2 across {np.mean(accel[:, 1] > 5):.0%}")
    slips(good, rows)
    gates(good, rows)
    weights(good, bad, rows)
    bare(runs, first, rows)
    return rows


def roads(first: int, drives: int, minutes: float) -> list[dict[str, Any]]:
    """Question 1 for three cars on dry and wet roads, `drives` of each; errors in the order of `SETTINGS`."""
    rows: list[dict[str, Any]] = []
    seeds = range(first, first + drives)
    made = []
    for seed in seeds:
        for name, setting in SETTINGS.items():
            drive = instrumented(truth(seed, 60.0 * minutes, setting=setting), seed, setting=setting)
            if len(drive.ticks) < 2 * SETTLED_TICK:
                print(f"left out: {name}, seed {seed}, spins after {TICK_S * len(drive.ticks):.0f} s")
            else:
                made.append(drive)
    print(f"{len(made)} drives: {'; '.join(SETTINGS)}{', in turn' if drives > 1 else ''}")
    base = FilterConfig()
    report("none (above 6 m/s)", [learn(d, base, lambda tick, speed: speed >= 6.0) for d in made], rows)
    for scale in (1.0, 0.6):
        report(f"vendor, times {scale:g}", [learn(d, base, vendor(scale)) for d in made], rows)
    for scale in (1.0, 0.75, 0.5):
        scaled = FilterConfig(max_accel_long_mps2=1.2 * scale, max_accel_lat_mps2=3.0 * scale)
        report(f"thresholds, times {scale:g}", [learn(d, scaled) for d in made], rows)
    for slip in (0.0075, 0.005):
        report(
            f"slip {slip:g}", [learn(d, FilterConfig(gate="slip", max_wheel_slip=slip)) for d in made], rows
        )
    return rows


def options(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    parser.add_argument("--drives", type=int, default=3)
    parser.add_argument("--first", type=int, default=1, help="seed of the first drive")
    parser.add_argument("--minutes", type=float, default=7.0)
    parser.add_argument("--roads", action="store_true", help="gates alone, three cars on dry and wet roads")


def main(args: argparse.Namespace) -> list[dict[str, Any]]:
    """Run and print."""
    if args.minutes * 60 / TICK_S <= SETTLED_TICK:
        raise UsageError("a drive must be longer than two minutes")
    seeds = range(args.first, args.first + args.drives)
    if args.roads:
        return roads(args.first, args.drives, args.minutes)
    return regression([truth(seed, 60.0 * args.minutes) for seed in seeds], args.first)
