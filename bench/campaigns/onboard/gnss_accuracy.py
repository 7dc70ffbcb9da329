"""What a receiver's own accuracy of its speed is worth: radii with and without it, also where it lies.

    python -m bench run gnss-accuracy [--json FILE] [--drives 6] [--first 300] [--minutes 6]

Simulated drives whose Doppler speeds are ten times worse (0.5 m/s, Gauss-Markov of 2 s) in spans of 20 to
40 s, a third of the time, as between high houses. The receiver states its accuracy honestly, three times too
great, three times too small, or not at all. The same ticks go through the default filter. Printed: root mean
square of the radii's errors over all wheels from the second minute on, and its ratio to that without a
statement.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from tpmsd.car.config.load import load_config
from tpmsd.interfaces.cli.drive_reading import read_ticks
from tpmsd.offline.simulator.drive import DriveSpec, simulate_drive
from tpmsd.offline.simulator.drive_writer import write_drive
from tpmsd.onboard.estimators.build import build_estimator
from tpmsd.onboard.timeline.speed_accuracy import SpeedAccuracy
from tpmsd.onboard.timeline.tick import Fix, Tick

OPEN_MPS, STREET_MPS, TAU_S = 0.05, 0.5, 2.0
STATEMENTS = {"none": math.nan, "honest": 1.0, "three times too great": 3.0, "three times too small": 1 / 3}
FROM_S = 60.0


def spans(duration_s: float, rng: np.random.Generator) -> list[tuple[float, float]]:
    """Where the sky is narrow: 20 to 40 s, with 40 to 80 s between."""
    out, at_s = [], float(rng.uniform(20.0, 60.0))
    while at_s < duration_s:
        end_s = at_s + float(rng.uniform(20.0, 40.0))
        out.append((at_s, end_s))
        at_s = end_s + float(rng.uniform(40.0, 80.0))
    return out


def worsened(ticks: list[Tick], rng: np.random.Generator) -> list[tuple[Tick, list[float]]]:
    """The ticks with worse speeds in places, and the honest accuracy of each fix."""
    begin_s = ticks[0].time_s
    narrow = spans(ticks[-1].time_s - begin_s, rng)
    error, last_s, out = np.zeros(2), begin_s, []
    for tick in ticks:
        fixes: list[Fix] = []
        stated: list[float] = []
        for fix in tick.fixes:
            street = any(a <= fix.time_s - begin_s < b for a, b in narrow)
            decay = math.exp(-max(fix.time_s - last_s, 0.0) / TAU_S)
            error = decay * error + STREET_MPS * math.sqrt(1.0 - decay**2) * rng.standard_normal(2)
            last_s = fix.time_s
            if street and math.isfinite(fix.speed_mps) and math.isfinite(fix.heading_rad):
                along = np.array([math.cos(fix.heading_rad), math.sin(fix.heading_rad)])
                east, north = fix.speed_mps * along + error
                heading = math.atan2(north, east) % (2.0 * math.pi)
                fix = replace(fix, speed_mps=math.hypot(east, north), heading_rad=heading)
            fixes.append(fix)
            stated.append(math.hypot(OPEN_MPS, STREET_MPS) if street else OPEN_MPS)
        out.append((replace(tick, fixes=tuple(fixes)), stated))
    return out


def rms_mm(ticks: list[tuple[Tick, list[float]]], factor: float, config: Any, truth: dict[str, Any]) -> float:
    """Root mean square error of the radii (mm) where accuracies are stated `factor` times too great."""
    accuracy, estimator = SpeedAccuracy(), build_estimator(config, np.random.default_rng(1))
    times = np.array(truth["time_s"])
    radii = np.array([truth["deviation_m"][wheel] for wheel in ("fl", "fr", "rl", "rr")])
    squares = []
    for tick, stated in ticks:
        fixes = tuple(
            replace(fix, speed_noise=accuracy.factor(factor * std_mps))
            for fix, std_mps in zip(tick.fixes, stated, strict=True)
        )
        estimate = estimator.step(replace(tick, fixes=fixes))
        if tick.host_time_s - times[0] > FROM_S:
            true = [np.interp(tick.host_time_s, times, one) for one in radii]
            squares.append((1e3 * (estimate.deviation_m - np.array(true))) ** 2)
    return float(np.sqrt(np.nanmean(squares)))


def options(parser: argparse.ArgumentParser) -> None:
    """Number, seeds and length of the drives."""
    parser.add_argument("--drives", type=int, default=6, help="number of drives (6)")
    parser.add_argument("--first", type=int, default=300, help="seed of the first (300)")
    parser.add_argument("--minutes", type=float, default=6.0, help="length of each (6)")


def main(args: argparse.Namespace) -> dict[str, Any]:
    """Run it and print the table."""
    errors: dict[str, list[float]] = {name: [] for name in STATEMENTS}
    for seed in range(args.first, args.first + args.drives):
        with TemporaryDirectory() as folder:
            drive = simulate_drive(DriveSpec(duration_s=60.0 * args.minutes, seed=seed))
            path = write_drive(Path(folder), drive)
            config = load_config(path)
            ticks = worsened(read_ticks(path, config, config.filter.rate_hz), np.random.default_rng(seed))
            truth = drive.truth()
        for name, factor in STATEMENTS.items():
            errors[name].append(rms_mm(ticks, factor, config, truth))
    result: dict[str, Any] = {}
    print(f"| stated accuracy | rms error of the radii, mm | ratio (median; range of {args.drives} drives) |")
    print("| --- | --- | --- |")
    for name, values in errors.items():
        ratios = np.array(values) / np.array(errors["none"])
        result[name] = {"rms_mm": float(np.sqrt(np.mean(np.square(values)))), "ratios": ratios.tolist()}
        spread = f"{np.median(ratios):.2f} ({ratios.min():.2f} to {ratios.max():.2f})"
        print(f"| {name} | {result[name]['rms_mm']:.3f} | {spread} |")
    return result
