"""What a 3-DOF car leaves out of a multi-body car and of a real one, and how its errors shrink effect by
effect.

    python -m bench run dynamics-proof [--real FOLDER] [--picture FILE] [--page FILE]

The multi-body car is that of `bench/worlds/commonroad_car.py`, which shares no line with the baselines. It
drives the double lane change and the slowly rising steer of [Liu 2022], with a sine with dwell beside them,
each to both sides. The baseline is the paper's: masses, lengths, and tyres as fitted to one slow ramp. It is
diagnosed at 60 and 80 km/h, and every model on the way is judged at 70 km/h, which took no part. FOLDER is
`ferrari-250lm` of the recordings: found on the first half, judged on the second.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from bench.campaigns.car.vehicle_state import (
    KMH,
    double_lane_change,
    sine_with_dwell,
    slowly_rising_steer,
    workshop,
)
from bench.registry import UsageError
from bench.worlds.commonroad_car import Driver, Now, parameters, run
from tpmsd.car.config.dynamics import load_car
from tpmsd.car.physics.baselines.base import UNITS, Baseline
from tpmsd.car.physics.baselines.car import DynamicCar
from tpmsd.car.physics.baselines.inputs import make_inputs
from tpmsd.car.physics.baselines.three_dof import ThreeDof
from tpmsd.foundation.plain import with_unit
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.dynamics.diagnose import curve_rating, diagnose_dynamics
from tpmsd.offline.dynamics.drive import DynamicsDrive
from tpmsd.offline.dynamics.result import DynamicsDiagnosis
from tpmsd.offline.dynamics.simulate import simulated_outputs
from tpmsd.offline.signals.drive import make_drive
from tpmsd.offline.signals.read import read_signals

JUDGED = ("speed", "velocity_lat", "yaw_rate", "accel_lat")
"""u, v, r and lateral acceleration."""
TWINS = 3
"""Names of confounded effects that a line of the page has; the JSON has all."""
PAUSE_S = 5.0
SENSORS = {"yaw_rate": 0.0026, "accel_lat": 0.06, "velocity_lat": 0.02, "speed": 0.03, "accel_long": 0.06}
"""Standard deviations of white noise: production gyros and accelerometers, an optical speed sensor."""


def options(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("--real", type=Path, metavar="FOLDER", help="drive folder of the real car")
    parser.add_argument("--skip-multibody", action="store_true", help="the real car alone")
    parser.add_argument("--picture", type=Path, metavar="FILE", help="draw how the errors shrink (.png)")
    parser.add_argument("--page", type=Path, metavar="FILE", help="put the tables into this page")
    parser.add_argument("--seed", type=int, default=1, help="of the sensors' noise (default: 1)")


@dataclass(frozen=True)
class Row:
    """A model on what took no part in finding it."""

    model: str
    """What its step added and removed, or the baseline."""
    errors: dict[str, float]
    """By output."""
    ratings: dict[str, float]


@dataclass(frozen=True)
class Proof:
    """One car with one baseline: what was found, and errors on what took no part."""

    title: str
    diagnosis: DynamicsDiagnosis
    rows: tuple[Row, ...]
    """The baseline first."""

    @property
    def models(self) -> tuple[str, ...]:
        """Return the names of the rows."""
        return tuple(row.model for row in self.rows)

    @property
    def errors(self) -> tuple[dict[str, float], ...]:
        """Return the errors by output, for each row."""
        return tuple(row.errors for row in self.rows)

    @property
    def ratings(self) -> tuple[dict[str, float], ...]:
        """Return the ratings by output, for each row."""
        return tuple(row.ratings for row in self.rows)


def main(args: argparse.Namespace) -> dict[str, Any]:
    """Run, print and write."""
    keys = [] if args.skip_multibody else ["proof-1"]
    keys += ["proof-2", "proof-3"] if args.real is not None else []
    if args.page is not None:
        put(args.page, dict.fromkeys(keys, ""))
    proofs = []
    if not args.skip_multibody:
        proofs.append(multibody(args.seed))
    if args.real is not None:
        proofs += [real(args.real, name) for name in ("single-track", "three-dof")]
    tables = {key: table(one) for key, one in zip(keys, proofs, strict=True)}
    for one in tables.values():
        print(f"\n{one}", flush=True)
    if args.picture is not None:
        args.picture.write_bytes(picture(proofs))
    if args.page is not None:
        put(args.page, tables)
    return {"proofs": [document(one) for one in proofs]}


# -- the multi-body car --------------------------------------------------------------------------------------


def multibody(seed: int) -> Proof:
    """Return what the 3-DOF car leaves out of the multi-body car."""
    baseline = ThreeDof(workshop_car(), forces=True)
    rng = np.random.default_rng(seed)
    learnt = joined([manoeuvre(*one, rng) for one in courses(60.0) + courses(80.0)])
    judged = joined([manoeuvre(*one, rng) for one in courses(70.0)])
    title = "Multi-body car, `three-dof`: found at 60 and 80 km/h, judged at 70 km/h"
    return proof(title, baseline, learnt, judged, JUDGED)


def workshop_car() -> DynamicCar:
    """Return the car as the paper's filters know it: data sheet, and tyres by one slow ramp."""
    known, p = workshop(), parameters()
    return DynamicCar(
        mass_kg=known.mass_kg,
        yaw_inertia_kgm2=known.yaw_inertia_kgm2,
        front_m=known.front_m,
        rear_m=known.rear_m,
        cornering_front_n=2.0 * known.cornering_front_n,
        cornering_rear_n=2.0 * known.cornering_rear_n,
        height_m=known.height_m,
        track_front_m=known.track_front_m,
        track_rear_m=known.track_rear_m,
        longitudinal_n=known.longitudinal_n,
        friction=known.friction,
        drive_front_share=known.drive_front_share,
        brake_front_share=float(p.T_sb),
    )


def courses(speed_kmh: float) -> list[tuple[Driver, float, float]]:
    """Return drivers with duration and speed: each manoeuvre to the left and to the right."""
    p, speed = parameters(), speed_kmh * KMH
    out = []
    for side in (1.0, -1.0):
        for driver, lasts in (
            (double_lane_change(speed, p.a + p.b), 9.0),
            (slowly_rising_steer(speed), 4.6),
            (sine_with_dwell(0.04), 4.0),
        ):
            out.append((sided(driver, side), lasts, speed))
    return out


def sided(driver: Driver, side: float) -> Driver:
    """Return a driver, or its mirror image."""

    def drive(now: Now) -> tuple[float, float]:
        seen = replace(
            now,
            north_m=side * now.north_m,
            heading_rad=side * now.heading_rad,
            left_mps=side * now.left_mps,
            yaw_rate_radps=side * now.yaw_rate_radps,
        )
        steer, pull = driver(seen)
        return side * steer, pull

    return drive


def manoeuvre(
    driver: Driver, lasts_s: float, speed_mps: float, rng: np.random.Generator
) -> dict[str, FloatArray]:
    """Return the columns that instruments write down, at 100 Hz."""
    pulls: list[float] = []

    def logged(now: Now) -> tuple[float, float]:
        steer, pull = driver(now)
        pulls.append(pull)
        return steer, pull

    truth = run(logged, lasts_s, speed_mps)
    force = float(parameters().m) * np.array(pulls)
    columns = {
        "time": truth.time_s,
        "steer": truth.steer_rad,
        "drive": np.maximum(force, 0.0),
        "brake": np.maximum(-force, 0.0),
        "yaw_rate": truth.yaw_rate_radps,
        "accel_lat": truth.accel_lat_mps2,
        "velocity_lat": truth.left_mps,
        "speed": truth.forward_mps,
        "accel_long": truth.accel_long_mps2,
    }
    noisy = {
        name: columns[name] + std * rng.standard_normal(len(truth.time_s)) for name, std in SENSORS.items()
    }
    return {**columns, **noisy}


def joined(parts: Sequence[Mapping[str, FloatArray]]) -> DynamicsDrive:
    """Return manoeuvres one after the other, with pauses between them."""
    columns: dict[str, list[FloatArray]] = {name: [] for name in parts[0]}
    begins = 0.0
    for part in parts:
        for name, values in part.items():
            columns[name].append(values + begins if name == "time" else values)
        begins = float(columns["time"][-1][-1]) + PAUSE_S
    whole = {name: np.concatenate(values) for name, values in columns.items()}
    inputs = make_inputs(
        whole["time"], whole["steer"], whole["speed"], whole["accel_long"], whole["drive"], whole["brake"]
    )
    rate = np.concatenate([np.gradient(part["steer"], part["time"]) for part in parts])
    outputs = {name: whole[name] for name in SENSORS}
    return DynamicsDrive("multi-body", replace(inputs, steer_rate_radps=rate), outputs, True)


# -- the real car --------------------------------------------------------------------------------------------


def real(folder: Path, name: str) -> Proof:
    """Return what a baseline leaves out of the first half of a drive, judged on the second."""
    baseline, drive = make_drive(read_signals(folder), load_car(folder), name, folder.name)
    half = len(drive.time_s) // 2
    title = f"Ferrari 250 LM, `{name}`: found on the first half, judged on the second"
    first, second = drive.part(0, half), drive.part(half, len(drive.time_s))
    return proof(title, baseline, first, second, ("yaw_rate", "accel_lat", "velocity_lat"))


# -- both ----------------------------------------------------------------------------------------------------


def proof(
    title: str, baseline: Baseline, learnt: DynamicsDrive, judged: DynamicsDrive, outputs: Sequence[str]
) -> Proof:
    """Diagnose one drive, and predict another one from its inputs alone after each step."""
    found = diagnose_dynamics(baseline, learnt)
    rows: list[Row] = []
    before: tuple[str, ...] = ()
    for step in found.steps:
        new = [f"+ `{name}`" for name in step.effects if name not in before]
        gone = [f"- `{name}`" for name in before if name not in step.effects]
        model = ", ".join([*new, *gone]) or f"`{baseline.name}`"
        if rows and not new and not gone:  # values alone moved: the row of their model gets the last ones
            model = rows.pop().model
        before = step.effects
        fitted = tuple(effect for effect in step.model if not over_time(effect))
        guess = simulated_outputs(baseline, judged, fitted)
        known = {name: np.asarray(judged.outputs[name]) for name in outputs}
        errors = {name: rms(known[name] - guess[name]) for name in outputs}
        ratings = {name: curve_rating(judged.time_s, known[name], guess[name]) for name in outputs}
        rows.append(Row(model, errors, ratings))
    return Proof(title, found, tuple(rows))


def over_time(effect: Any) -> bool:
    """Return True if an effect belongs to the time of its own drive."""
    return getattr(effect, "over", "time") == "time" and hasattr(effect, "knots")


def rms(values: FloatArray) -> float:
    """Return the root mean square of what is known."""
    return math.sqrt(float(np.nanmean(values**2)))


WORDS = {"speed": "u", "velocity_lat": "v", "yaw_rate": "r", "accel_lat": "lateral acceleration"}


def table(one: Proof) -> str:
    """Return the errors after each step, and what was found, in Markdown."""
    names = list(one.errors[0])
    heads = [f"{WORDS[name]}, {UNITS[name]}" for name in names]
    lines = [
        f"{one.title}. Root mean square error of the prediction from the inputs alone:",
        "",
        f"| model | {' | '.join(heads)} |",
        f"| --- |{' --- |' * len(heads)}",
    ]
    for model, row in zip(one.models, one.errors, strict=True):
        lines.append(f"| {model} | {' | '.join(f'{row[name]:.3g}' for name in names)} |")
    shares = " | ".join(
        f"{one.errors[-1][name] / one.errors[0][name]:.2f}" if one.errors[0][name] else "-" for name in names
    )
    rated = " | ".join(f"{one.ratings[0][n]:.2f} to {one.ratings[-1][n]:.2f}" for n in names)
    lines += [f"| last over first | {shares} |", f"| rating by ISO/TS 18571 | {rated} |", ""]
    for finding in one.diagnosis.findings:
        values = ", ".join(
            with_unit(f"{k} {v.value:.3g} +- {v.std:.1g}", v.unit) for k, v in finding.parameters.items()
        )
        others = [f"`{name}`" for name in finding.indistinguishable_from]
        more = [f"{len(others) - TWINS} more"] if len(others) > TWINS else []
        confounded_with = ", ".join([*others[:TWINS], *more])
        doubt = f"; confounded with {confounded_with}" if confounded_with else ""
        proxy = ", proxy" if finding.may_be_proxy else ""
        lines.append(f"- `{finding.effect}`: {values} (confidence {finding.confidence:.2f}{proxy}{doubt})")
    return "\n".join(lines)


def put(page: Path, tables: Mapping[str, str]) -> None:
    """Put tables into a page, each between its two marks; UsageError without the page or a mark.

    An empty table leaves what stands there, so that a page can be checked before anything is computed.
    """
    try:
        text = page.read_text(encoding="utf-8")
    except OSError as error:
        raise UsageError(str(error)) from error
    for key, content in tables.items():
        first, last = f"<!-- {key} -->", f"<!-- /{key} -->"
        if first not in text or last not in text:
            raise UsageError(f"{page}: no marks {first} and {last}")
        head, _, rest = text.partition(first)
        if content:
            text = f"{head}{first}\n{content}\n{last}{rest.partition(last)[2]}"
    page.write_text(text, encoding="utf-8")


def document(one: Proof) -> dict[str, Any]:
    """Return the numbers."""
    return {"title": one.title, "models": one.models, "errors": one.errors, "ratings": one.ratings}


def picture(proofs: Sequence[Proof]) -> bytes:
    """Return the errors over the baseline's after each step, a panel for each car and baseline."""
    import io
    import textwrap

    from matplotlib.figure import Figure

    from tpmsd.foundation.palette import line_style

    heights = [1.2 + 0.32 * len(one.models) for one in proofs]
    figure = Figure(figsize=(8.0, sum(heights)), layout="constrained")
    panels = figure.subplots(len(proofs), 1, squeeze=False, height_ratios=heights)[:, 0]
    for axes, one in zip(panels, proofs, strict=True):
        steps = range(len(one.models))
        for role, name in zip(("fl", "fr", "rl", "rr"), one.errors[0], strict=False):
            shares = [row[name] / one.errors[0][name] for row in one.errors]
            axes.plot(shares, steps, marker="o", ms=4, label=WORDS[name], **line_style(role))
        signed = (model.replace("`", "").replace("+ ", "+\N{NO-BREAK SPACE}") for model in one.models)
        signed = (label.replace("- ", "-\N{NO-BREAK SPACE}") for label in signed)
        labels = [textwrap.fill(label, 44, break_on_hyphens=False) for label in signed]
        axes.set_yticks(steps, labels, fontsize=7)
        axes.set_title(one.title.replace("`", ""), fontsize=9)
        axes.set(xlim=(0.0, None), xlabel="error over the baseline's")
        axes.invert_yaxis()
        axes.axvline(0.6, lw=0.8, color="0.7")
        axes.legend(frameon=False, fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
        axes.spines[["top", "right"]].set_visible(False)
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=110, format="png")
    return buffer.getvalue()
