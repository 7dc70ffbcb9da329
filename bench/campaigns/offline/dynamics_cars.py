"""The diagnosis of vehicle dynamics on cars of every size, with tyres of another formula, and with physics
that its catalogue does not have.

    python -m bench run dynamics-cars [--kinds null,single,tyres,outside] [--seeds 1] [--duration 150]

The world is `bench/worlds/varied_cars.py`: another car in each drive (900 to 3,500 kg, 2.3 to 4 m,
understeer and oversteer), four styles of driving, loggers of 20, 50 and 100 Hz. Kinds: `null`, linear tyres
and nothing concealed; `single`, one effect of the catalogue each; `tyres`, one effect beside brush or Magic
Formula tyres, whose saturation the linear car leaves out; `outside`, physics of no name in the catalogue. A
wrong name is one with a confidence above 0.9 that was not concealed.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bench.registry import UsageError
from bench.worlds.varied_cars import OUTSIDE, STYLES, Case, Recorded, Sensors, drives
from tpmsd.car.config.dynamics import load_car
from tpmsd.offline.dynamics.diagnose import diagnose_dynamics
from tpmsd.offline.dynamics.result import FINDING, DynamicsDiagnosis
from tpmsd.offline.signals.drive import make_drive
from tpmsd.offline.signals.read import read_signals
from tpmsd.offline.signals.write import signals_text

SINGLE: dict[str, dict[str, float]] = {
    "mass_error": {"relative": 0.15},
    "yaw_inertia_error": {"relative": -0.2},
    "cornering_stiffness_error": {"front": -0.2, "rear": 0.1},
    "cg_position_error": {"forward_m": 0.1},
    "tyre_relaxation": {"length_m": 0.6},
    "roll_steer": {"coefficient": 0.0015},
    "compliance_steer": {"coefficient": 0.0018},
    "steering_ratio_error": {"ratio": 0.92},
    "steering_offset": {"road_rad": 0.004},
    "steering_delay": {"delay_s": 0.05},
    "yaw_rate_bias": {"bias": -0.006},
    "yaw_rate_scale": {"scale": 0.96},
    "gyro_delay": {"delay_s": 0.04},
    "accelerometer_bias": {"lat_mps2": -0.25},
    "accelerometer_position": {"forward_m": -0.6},
    "accelerometer_tilt": {"yaw_rad": 0.06},
    "side_wind": {"speed_mps": 9.0, "onset_s": 60.0, "duration_s": 15.0},
    "road_bank": {"amplitude_rad": 0.04},
}
"""Concealed sizes: usual ones."""
RATES_HZ = (50.0, 20.0, 100.0)
SURE = 0.9
KINDS = ("null", "single", "tyres", "outside")


@dataclass(frozen=True)
class Asked:
    """One drive and the baseline that it is compared with."""

    kind: str
    name: str
    baseline: str
    case: Case


def options(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument(
        "--kinds", default=",".join(KINDS), help=f"with commas between; default: {','.join(KINDS)}"
    )
    parser.add_argument("--seeds", type=int, default=1, help="drives of each case (default: 1)")
    parser.add_argument("--duration", type=float, default=150.0, metavar="S", help="default: 150")
    parser.add_argument("--first-seed", type=int, default=1, help="default: 1")
    parser.add_argument("--baseline", choices=("single-track", "three-dof"), help="one alone (default: both)")
    parser.add_argument("--only", default="", metavar="NAMES", help="effects, with commas between")


def main(args: argparse.Namespace) -> dict[str, Any]:
    """Run and print."""
    asked = chosen(args)
    rows = []
    for one, made in zip(asked, drives([one.case for one in asked], args.duration), strict=True):
        row = judged(one, made)
        rows.append(row)
        said = ", ".join(f"{name} {sure:.2f}" for name, sure in row["named"]) or "-"
        print(
            f"{one.kind:8}{one.baseline:13}{one.name:26}{one.case.tyres:7}{one.case.style:9}"
            f"{made.car.mass:5.0f} kg {one.case.sensors.rate_hz:4.0f} Hz  {'WRONG ' if row['wrong'] else ''}"
            f"{said}  ({row['cpu_s']:.1f} s)",
            flush=True,
        )
    summary = summarised(rows)
    for key, value in summary.items():
        print(f"{key}: {value}")
    return {"rows": rows, "summary": summary}


def chosen(args: argparse.Namespace) -> list[Asked]:
    """Return the drives that the options ask for; UsageError where there is none."""
    kinds, only = set(args.kinds.split(",")), set(filter(None, args.only.split(",")))
    every = cases(args.seeds, args.first_seed)
    asked = [
        one
        for one in every
        if one.kind in kinds and args.baseline in (None, one.baseline) and (not only or one.name in only)
    ]
    if not asked:
        there = sorted({f"{one.kind} with {one.baseline}" for one in every})
        raise UsageError(f"no drive is of these kinds, baseline and names; there are {', '.join(there)}")
    return asked


def cases(seeds: int, first_seed: int) -> list[Asked]:
    """Return every drive; car, style and rate change from one to the next."""
    out: list[Asked] = []

    def add(
        kind: str,
        name: str,
        baseline: str,
        effects: Mapping[str, Mapping[str, float]],
        tyres: str,
        lat: float,
    ) -> None:
        number = len(out)
        case = Case(
            1000 * first_seed + number,
            tyres,
            STYLES[number % len(STYLES)],
            effects,
            Sensors(rate_hz=RATES_HZ[number % len(RATES_HZ)]),
            max_lat_mps2=lat,
        )
        out.append(Asked(kind, name, baseline, case))

    for _ in range(seeds):
        for k in range(12):
            model = ("single-track", "three-dof")[k % 2]
            tyres, lat = ("linear", 5.0) if model == "single-track" else ("dugoff", 2.5)
            add("null", "null", model, {}, tyres, lat)
        for name, values in SINGLE.items():
            add("single", name, "single-track", {name: values}, "linear", 5.0)
        for k, (name, values) in enumerate(SINGLE.items()):
            add(
                "tyres",
                name,
                "three-dof" if k % 2 else "single-track",
                {name: values},
                ("brush", "magic")[k // 2 % 2],
                6.0,
            )
        for name, values in OUTSIDE.items():
            for model in ("single-track", "three-dof"):
                if name != "slip_drag" or model == "three-dof":
                    add(
                        "outside",
                        name,
                        model,
                        {name: values},
                        "linear",
                        5.0 if model == "single-track" else 3.0,
                    )
    return out


def judged(asked: Asked, made: Recorded) -> dict[str, Any]:
    """Return what was found on one drive."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        (folder / "signals.csv").write_text(signals_text(made.columns), encoding="utf-8")
        (folder / "vehicle.toml").write_text(made.vehicle, encoding="utf-8")
        baseline, loaded = make_drive(read_signals(folder), load_car(folder), asked.baseline, asked.name)
    began = time.process_time()
    found = diagnose_dynamics(baseline, loaded)
    took = time.process_time() - began
    concealed = set(asked.case.effects)
    # linear tyres have no limit: the 3-DOF car's friction is an error there as well
    limits_differ = asked.case.tyres != "linear" or asked.baseline == "three-dof"
    allowed = concealed | ({"tyre_saturation"} if limits_differ else set()) | {"unknown"}
    return {
        "kind": asked.kind,
        "concealed": asked.name,
        "baseline": asked.baseline,
        "tyres": asked.case.tyres,
        "named": [(one.effect, round(one.confidence, 3)) for one in found.findings],
        "values": {
            f"{one.effect}.{key}": (value.value, value.std)
            for one in found.findings
            for key, value in one.parameters.items()
        },
        "twins": {one.effect: list(one.indistinguishable_from) for one in found.findings},
        "right": named(found, concealed),
        "wrong": [o.effect for o in found.findings if o.confidence > SURE and o.effect not in allowed],
        "rms": {key: (fit.rms_before, fit.rms_after) for key, fit in found.outputs.items()},
        "verdict": found.verdict,
        "cpu_s": took,
    }


def named(found: DynamicsDiagnosis, concealed: set[str]) -> bool:
    """Return True if every concealed effect is a finding, or a twin of one that lists it."""
    said = [{one.effect, *one.indistinguishable_from} for one in found.findings if one.status == FINDING]
    return all(any(name in names for names in said) for name in concealed)


def summarised(rows: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """Return the counts by kind."""
    out = {}
    for kind in KINDS:
        mine = [row for row in rows if row["kind"] == kind]
        if not mine:
            continue
        wrong = sum(bool(row["wrong"]) for row in mine)
        if kind == "null":
            out["null drives with a finding"] = f"{sum(bool(row['named']) for row in mine)} of {len(mine)}"
        elif kind == "outside":
            located = sum(row["verdict"] == "mismatch" for row in mine)
            unknown = sum(any(name == "unknown" for name, _ in row["named"]) for row in mine)
            out["outside: located"] = f"{located} of {len(mine)}"
            out["outside: unknown"] = f"{unknown} of {len(mine)}"
        else:
            alone = sum(row["right"] and len(row["named"]) == 1 for row in mine)
            out[f"{kind}: named"] = f"{sum(row['right'] for row in mine)} of {len(mine)}, alone {alone}"
        out[f"{kind}: a wrong name above {SURE:g}"] = f"{wrong} of {len(mine)}"
    if rows:
        out["median CPU, s"] = f"{float(np.median([row['cpu_s'] for row in rows])):.2f}"
    return out
