"""Do the 95 % intervals of the joint estimate hold the truth? Drives of other cars, each judged on its own.

In: a number of drives, a seed. Out: `covered` (how each drive went), `report` (the table).

The drives come from `bench/worlds/kinematic.py`, which shares no line with the program: cars, roads,
receivers and buses are drawn, 5 to 10 minutes each. Receivers have 1, 5 or 10 fixes a second with
wandering errors of position and velocity; buses carry counts or rounded speeds, of four wheels or two; tyres
grow with speed, slip and lean in bends; roads slant; antenna, tracks and the GNSS latency are not quite
as configured.
"""

from __future__ import annotations

import math
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from scipy.signal import lfilter

from bench.campaigns.offline.calibrate_recording import configured, recording_of
from bench.statistics import share
from bench.worlds.kinematic import STEP_S, Drive, Spec, drive
from tpmsd.foundation.wheels import WHEELS
from tpmsd.offline.calibration.calibrate import calibrate
from tpmsd.offline.calibration.checks import RefusedError

LEVEL, SIGMAS = 0.95, 1.959964
ROADS = ("mixed", "rural", "motorway", "city")
GRAVITY_MPS2 = 9.80665
SLANT = 0.01
ROUNDING_KMH = (0.01, 0.0625)
"""Of wheel speeds on two widespread buses."""


@dataclass(frozen=True)
class Outcome:
    """One drive."""

    seed: int
    road: str
    bus: str
    receiver_hz: float
    duration_s: float
    refused: str = ""
    errors: dict[str, float] | None = None
    """By quantity, SI units."""
    stds: dict[str, float] | None = None

    @property
    def sigmas(self) -> dict[str, float]:
        """Errors in standard deviations."""
        errors, stds = self.errors or {}, self.stds or {}
        return {name: errors[name] / stds[name] for name in errors}


def on_slanting_road(world: Drive, seed: int) -> Drive:
    """The same drive on a road that slants across, by 1 % all the way and by 1 % for some seconds (standard
    deviations): the car leans as in a bend of that lateral acceleration."""
    rng = np.random.default_rng([seed, 11])
    load = float(world.spec.physics["load_transfer_lateral"]["coefficient"])
    size = load * GRAVITY_MPS2 * SLANT / world.spec.radius_m
    keep = math.exp(-STEP_S / float(rng.uniform(5.0, 20.0)))
    kicks = rng.standard_normal(len(world.time_s)) * size * math.sqrt(1.0 - keep**2)
    kicks[0] = size * rng.standard_normal()
    lean = size * rng.standard_normal() + lfilter([1.0], [1.0, -keep], kicks)
    turned = np.diff(world.shown_rad, axis=0, prepend=world.shown_rad[:1])
    shown = world.shown_rad[0] + np.cumsum(turned * (1.0 + lean[:, None] * [1.0, -1.0, 1.0, -1.0]), axis=0)
    return replace(world, shown_rad=shown)


def drawn(seed: int) -> tuple[Spec, str, int, dict[str, float]]:
    """A car on its road, its bus (kind, wheels) and how far its configuration is off."""
    rng = np.random.default_rng([seed, 7])

    def between(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    physics: dict[str, dict[str, Any]] = {
        "centrifugal_growth": {"coefficient": between(0.5e-6, 2e-6)},
        "load_transfer_lateral": {"coefficient": between(0.0, 2e-4)},
        "longitudinal_slip": {"slip_per_accel": between(1e-3, 4e-3)},
        "lateral_slip": {"coefficient": between(0.0, 6e-3)},
        "gnss_latency": {"latency_s": between(0.0, 0.2)},
        "track_width_error": {"rear_m": between(-0.04, 0.04), "front_m": between(-0.04, 0.04)},
        "antenna_lever_arm": {"forward_m": between(-0.2, 0.2), "left_m": between(-0.05, 0.05)},
    }
    spec = Spec(
        duration_s=between(300.0, 600.0),
        road=ROADS[seed % 4],
        radius_m=between(0.28, 0.36),
        radius_spread_m=2e-3,
        track_front_m=between(1.45, 1.65),
        track_rear_m=between(1.45, 1.65),
        wheelbase_m=between(2.4, 3.0),
        driven=str(rng.choice(["front", "rear"])),
        teeth=float(rng.choice([44, 48, 96])),
        receiver_hz=float((1, 5, 10)[seed % 3]),
        position_slow_m=between(0.5, 2.0),
        position_tau_s=between(20.0, 80.0),
        position_white_m=between(0.05, 0.5),
        doppler_mps=between(0.03, 0.07),
        doppler_tau_s=between(0.5, 1.5),
        gyro_std=between(0.001, 0.003),
        rough=between(2e-4, 6e-4),
        hilly=float(rng.choice([0.0, 0.02])),
        antenna_forward_m=between(0.0, 2.0),
        antenna_left_m=between(-0.4, 0.4),
        physics=physics,
    )
    bus = ("counts", "speeds")[seed // 4 % 2]
    return spec, bus, (4, 2)[seed // 8 % 2], {"rounding_kmh": float(rng.choice(ROUNDING_KMH))}


def outcome(seed: int) -> Outcome:
    """Draw, drive, calibrate and compare."""
    spec, bus, wheels, rounding = drawn(seed)
    world = on_slanting_road(drive(spec, seed), seed)
    recording = recording_of(world, bus, wheels, **rounding)
    name = bus if bus == "counts" else f"speeds {rounding['rounding_kmh']:g} km/h"
    about = (seed, spec.road, f"{name}, {wheels} wheels", spec.receiver_hz, spec.duration_s)
    try:
        found, _ = calibrate([recording], configured(spec))
    except RefusedError as refusal:
        return Outcome(*about, refused=str(refusal))
    growth = spec.physics["centrifugal_growth"]["coefficient"] * found.reference_speed_mps**2
    truth = dict(zip(WHEELS, world.radius_m + growth, strict=True))
    errors = {
        f"circumference {w}": r.circumference_m - 2 * math.pi * truth[w] for w, r in found.wheels.items()
    }
    stds = {f"circumference {w}": r.circumference_std_m for w, r in found.wheels.items()}
    apart = found.wheels["rr"].radius_m - found.wheels["rl"].radius_m
    errors["right minus left"] = 2 * math.pi * (apart - (truth["rr"] - truth["rl"]))
    stds["right minus left"] = 2 * math.pi * found.difference_std_m
    track = spec.physics["track_width_error"]
    errors["track rear"] = found.track_rear_m - spec.track_rear_m - track["rear_m"]
    stds["track rear"] = found.track_rear_std_m
    if wheels == 4:
        errors["track front"] = found.track_front_m - spec.track_front_m - track["front_m"]
        stds["track front"] = found.track_front_std_m
    return Outcome(*about, errors=errors, stds=stds)


def covered(drives: int, first: int, jobs: int) -> list[Outcome]:
    """Every drive's outcome, in order; a note on standard error every tenth."""
    out = []
    with ProcessPoolExecutor(jobs) as pool:
        for result in pool.map(outcome, range(first, first + drives)):
            out.append(result)
            if len(out) % 10 == 0:
                print(f"{len(out)} of {drives} drives", file=sys.stderr, flush=True)
    return out


KINDS = ("circumference", "right minus left", "track")


def table(outcomes: list[Outcome]) -> list[dict[str, Any]]:
    """One row per quantity, over all drives and by bus and road."""
    rows = []
    groups = [("all", lambda o: True)]
    groups += [(road, lambda o, road=road: o.road == road) for road in ROADS]
    groups += [(bus, lambda o, bus=bus: o.bus.startswith(bus)) for bus in ("counts", "speeds")]
    groups += [(f"{hz} Hz", lambda o, hz=hz: o.receiver_hz == hz) for hz in (1, 5, 10)]
    for group, belongs in groups:
        for kind in KINDS:
            used = [
                (z, o.errors[name], o.stds[name])
                for o in outcomes
                if belongs(o) and o.errors is not None and o.stds is not None
                for name, z in o.sigmas.items()
                if name.startswith(kind)
            ]
            if not used:
                continue
            sigmas, errors, stds = np.array(used).T
            inside = int((np.abs(sigmas) < SIGMAS).sum())
            rows.append(
                {
                    "drives": group,
                    "quantity": kind,
                    "intervals": len(sigmas),
                    "coverage": inside / len(sigmas),
                    "coverage_95": [share(inside, len(sigmas))[side] for side in ("low", "high")],
                    "rms_sigmas": float(np.sqrt(np.mean(sigmas**2))),
                    "rms_error_mm": float(np.sqrt(np.mean(errors**2)) * 1e3),
                    "median_std_mm": float(np.median(stds) * 1e3),
                }
            )
    return rows


def report(outcomes: list[Outcome]) -> dict[str, Any]:
    """Print the table; also as a document."""
    refused = [o for o in outcomes if o.refused]
    print(f"\n{len(outcomes)} drives of other cars, {len(refused)} refused:")
    for o in refused:
        print(f"  drive {o.seed} ({o.road}, {o.duration_s:.0f} s): {o.refused}")
    print(f"{'drives':<10} {'quantity':<17} {'intervals':>9}  coverage of 95 %   rms sigmas", end="")
    print("   rms error   median std / mm")
    rows = table(outcomes)
    for row in rows:
        low, high = row["coverage_95"]
        print(
            f"{row['drives']:<10} {row['quantity']:<17} {row['intervals']:9d}  "
            f"{row['coverage']:6.1%} ({low:.0%}-{high:.0%})  {row['rms_sigmas']:9.2f}   "
            f"{row['rms_error_mm']:9.2f}   {row['median_std_mm']:9.2f}"
        )
    return {"rows": rows, "drives": [asdict(o) | {"sigmas": o.sigmas} for o in outcomes]}
