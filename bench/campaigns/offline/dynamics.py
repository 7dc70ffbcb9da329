"""The diagnosis of vehicle dynamics on drives of an independent world: null drives, single effects, pairs.

In: number of seeds. Out: what was named, how often the truth lies in the 95 % interval, the time. With
`--certify N` the p-value of the best hypothesis that a null drive leaves out is counted in N replicates, and
all of them are compared with the uniform distribution (Kolmogorov and Smirnov).
`bench/worlds/lively_car.py` is the world: the same equations in other code, with the sensors' noise.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import kstest

from bench.statistics import even_p_value
from bench.worlds.lively_car import CarSpec, Concealed, drive, vehicle_tables
from tpmsd.car.config.dynamics import load_car
from tpmsd.offline.diagnosis.settings import SETTINGS
from tpmsd.offline.dynamics.certify import Replicates
from tpmsd.offline.dynamics.diagnose import diagnose_dynamics
from tpmsd.offline.dynamics.result import Certificate, DynamicsDiagnosis
from tpmsd.offline.signals.drive import make_drive
from tpmsd.offline.signals.read import read_signals
from tpmsd.offline.signals.write import signals_text

Effects = Mapping[str, Mapping[str, float]]
SINGLE: dict[str, dict[str, float]] = {
    "mass_error": {"relative": 0.12},
    "yaw_inertia_error": {"relative": 0.2},
    "cornering_stiffness_error": {"front": -0.15, "rear": 0.1},
    "cg_position_error": {"forward_m": -0.08},
    "tyre_relaxation": {"length_m": 0.5},
    "tyre_saturation": {"friction": 0.8},
    "load_dependent_stiffness": {"coefficient": 0.4},
    "roll_steer": {"coefficient": 0.0015},
    "compliance_steer": {"coefficient": 0.0015},
    "camber_thrust": {"coefficient": 0.05},
    "steering_ratio_error": {"ratio": 1.08},
    "steering_offset": {"offset_rad": 0.05},
    "steering_delay": {"delay_s": 0.04},
    "yaw_rate_bias": {"bias": 0.005},
    "yaw_rate_scale": {"scale": 1.03},
    "gyro_delay": {"delay_s": 0.03},
    "accelerometer_bias": {"lat_mps2": 0.2},
    "accelerometer_tilt": {"yaw_rad": 0.05},
    "accelerometer_position": {"forward_m": 0.5},
    "locked_differential": {"coefficient": 0.3},
    "yaw_moment": {"coefficient": 0.06},
    "side_wind": {"speed_mps": 9.0, "onset_s": 80.0, "duration_s": 15.0},
    "road_bank": {"amplitude_rad": 0.04},
}
"""Concealed sizes: usual ones."""
FORCED: dict[str, dict[str, float]] = {
    "rolling_resistance": {"coefficient": 0.012},
    "aero_drag": {"drag_area_m2": 0.65},
    "drive_force_error": {"relative": 0.1},
    "brake_force_error": {"relative": -0.1},
}
"""The same that show where forces are given."""
PAIRS = (
    ("yaw_rate_scale", "tyre_relaxation"),
    ("mass_error", "steering_delay"),
    ("cornering_stiffness_error", "accelerometer_position"),
    ("yaw_inertia_error", "yaw_rate_bias"),
    ("steering_ratio_error", "accelerometer_bias"),
)


def options(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("--seeds", type=int, default=1, help="drives of each kind (default: 1)")
    parser.add_argument("--nulls", type=int, default=10, help="null drives of each baseline (default: 10)")
    parser.add_argument("--duration", type=float, default=300.0, metavar="S", help="default: 300")
    parser.add_argument("--baseline", choices=("single-track", "three-dof"), help="one alone (default: both)")
    parser.add_argument("--first-seed", type=int, default=1000, help="default: 1000")
    parser.add_argument(
        "--only", default="", metavar="NAMES", help="effects, with commas between; null, pairs"
    )
    parser.add_argument(
        "--outputs", default="", metavar="NAMES", help="outputs compared, with commas between (default: all)"
    )
    parser.add_argument(
        "--certify", type=int, default=0, metavar="N", help="replicates for p-values of null drives"
    )


def main(args: argparse.Namespace) -> dict[str, Any]:
    """Run and print."""
    only, outputs = (set(filter(None, names.split(","))) for names in (args.only, args.outputs))
    rows: list[dict[str, Any]] = []
    for model, forces in (("single-track", False), ("three-dof", True)):
        if args.baseline not in (None, model):
            continue
        for number, (name, effects) in enumerate(drawn(only, args.nulls, args.seeds, forces)):
            asked = Asked(model, forces, args.first_seed + number, args.duration, args.certify, outputs)
            row = case(name, effects, asked)
            rows.append(row)
            print(f"{model:13}{name:46}{row['named']!s:60}{row['cpu_s']:6.1f} s  {row['sizes']}", flush=True)
    summary = summarised(rows)
    for key, value in summary.items():
        print(f"{key}: {value}")
    return {"rows": rows, "summary": summary}


def drawn(only: Collection[str], nulls: int, seeds: int, forces: bool) -> list[tuple[str, Effects]]:
    """Return name and effects of every drive of a baseline."""
    cases: list[tuple[str, Effects]] = []
    if not only or "null" in only:
        cases += [("null", {})] * nulls
    single = SINGLE | (FORCED if forces else {})
    for name, values in single.items():
        if not only or name in only:
            cases += [(name, {name: values})] * seeds
    if not only or "pairs" in only:
        cases += [("+".join(p), {n: SINGLE[n] for n in p}) for p in PAIRS for _ in range(seeds)]
    return cases


@dataclass(frozen=True)
class Asked:
    """How a drive is made and looked at."""

    model: str
    forces: bool
    seed: int
    duration_s: float
    replicates: int = 0
    """For the p-value of a null drive."""
    outputs: Collection[str] = ()
    """Compared; all of the baseline unless given."""


def case(name: str, effects: Effects, asked: Asked) -> dict[str, Any]:
    """Return what was found on one drive."""
    spec, model = CarSpec(), asked.model
    rng = np.random.default_rng(asked.seed)
    made = drive(spec, Concealed(effects), rng, model, asked.duration_s, forces=asked.forces)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        (folder / "signals.csv").write_text(signals_text(made.columns), encoding="utf-8")
        (folder / "vehicle.toml").write_text(vehicle_tables(spec), encoding="utf-8")
        baseline, loaded = make_drive(read_signals(folder), load_car(folder), model, name)
    if asked.outputs:
        kept = {key: values for key, values in loaded.outputs.items() if key in asked.outputs}
        loaded = replace(loaded, outputs=kept)
    began = time.process_time()
    found = diagnose_dynamics(baseline, loaded)
    took = time.process_time() - began
    p_value = None
    if asked.replicates and not effects:
        replicates = Replicates(asked.replicates, np.random.default_rng(asked.seed))
        certificate = diagnose_dynamics(baseline, loaded, replicates=replicates).certificate
        p_value = None if certificate is None else p_of_the_rest(certificate, rng)
    return {
        "p_value": p_value,
        "outputs": list(loaded.outputs),
        "baseline": model,
        "concealed": name,
        "named": [one.effect for one in found.findings],
        "confidence": [one.confidence for one in found.findings],
        "right": right(found, effects),
        "inside": list(intervals(found, effects)),
        "sizes": [f"{a}: {d:+.1f} std" for a, d in deviations(found, effects)],
        "rms": {key: (fit.rms_before, fit.rms_after) for key, fit in found.outputs.items()},
        "cpu_s": took,
    }


def p_of_the_rest(certificate: Certificate, rng: np.random.Generator) -> float:
    """Return the p-value of the best hypothesis that was not chosen, as `even_p_value`."""
    reached = certificate.remaining_exceeded
    stopped = reached == SETTINGS.robustness.exceeded
    return even_p_value(reached, certificate.remaining_replicates, stopped, rng)


def right(found: DynamicsDiagnosis, effects: Effects) -> bool:
    """Return True if all that was concealed was named, or a twin of it that lists it, and nothing else."""
    open_names = set(effects)
    for one in found.findings:
        said = {one.effect, *one.indistinguishable_from}
        met = open_names & said
        if not met:
            return False
        open_names -= {one.effect} if one.effect in met else {next(iter(met))}
    return not open_names


def deviations(found: DynamicsDiagnosis, effects: Effects) -> Iterable[tuple[str, float]]:
    """Yield value minus truth in standard deviations of every parameter of what was named rightly."""
    for one in found.findings:
        for parameter, truth in effects.get(one.effect, {}).items():
            if parameter in one.parameters and parameter not in ("onset_s", "duration_s"):
                got = one.parameters[parameter]
                yield parameter, (got.value - truth) / got.std


def intervals(found: DynamicsDiagnosis, effects: Effects) -> Iterable[bool]:
    """Yield for each of them whether the truth lies in the 95 % interval."""
    for _, apart in deviations(found, effects):
        yield abs(apart) <= 1.96


def summarised(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the counts."""
    nulls = [row for row in rows if row["concealed"] == "null"]
    pairs = [row for row in rows if "+" in row["concealed"]]
    single = [row for row in rows if row not in nulls and row not in pairs]
    inside = [one for row in rows for one in row["inside"]]
    chances = [row["p_value"] for row in nulls if row["p_value"] is not None]
    return {
        "p-values of null drives": uniform(chances) if chances else None,
        "outputs": sorted({name for row in rows for name in row["outputs"]}),
        "null drives with a finding": f"{sum(bool(row['named']) for row in nulls)} of {len(nulls)}",
        "single effects right": f"{sum(row['right'] for row in single)} of {len(single)}",
        "pairs right": f"{sum(row['right'] for row in pairs)} of {len(pairs)}",
        "truth in the 95 % interval": f"{sum(inside)} of {len(inside)}",
        "median CPU, s": float(np.median([row["cpu_s"] for row in rows])) if rows else None,
    }


def uniform(p_values: Sequence[float]) -> str:
    """Return how p-values lie against the uniform distribution."""
    test = kstest(p_values, "uniform")
    quarters = np.histogram(p_values, np.linspace(0.0, 1.0, 5))[0].tolist()
    at_most = sum(one <= 0.05 for one in p_values)
    return (
        f"{len(p_values)}, quarters {quarters}, {at_most} at most 0.05,"
        f" Kolmogorov-Smirnov D {test.statistic:.2f}, p {test.pvalue:.2f}"
    )
