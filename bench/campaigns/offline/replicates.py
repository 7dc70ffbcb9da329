"""How long bootstrap replicates of a drive take: design fixed (`refit`), and everything again (`rerun`).

    python -m bench run replicates [--refit 300] [--rerun 20] [--minutes 20]

A drive of the kinematic world on which load transfer acts. `refit` draws residuals from the fitted noise
about the fitted model and solves them all at once: gains and columns are computed once. `rerun` draws the
drive's ticks and fixes again, and smooths, compares, whitens and fits each replicate on its own. Both spread
as the fit's own standard deviation says, or the covariance is wrong.
"""

from __future__ import annotations

import argparse
import math
import time
from dataclasses import dataclass

import numpy as np

from bench.campaigns.offline.calibrate_recording import recording_of
from bench.campaigns.offline.fixed_design import (
    Design,
    DriveNoise,
    Prepared,
    design,
    fit,
    prepare,
    redrawn,
)
from bench.worlds.kinematic import drive
from bench.worlds.spec import Spec
from tpmsd.car.physics.catalogue import make_effect
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.inference.fit import ParameterFit
from tpmsd.offline.inference.noise import Noise
from tpmsd.offline.inference.noise_fit import SearchStage, fit_noise
from tpmsd.offline.inference.recording import INERTIAL, Recording
from tpmsd.offline.inference.replicate import replicate
from tpmsd.offline.inference.windows import Reader

EFFECT, COEFFICIENT = "load_transfer_lateral", 1.5e-4
SEED = 7


@dataclass(frozen=True)
class Fitted:
    """The drive as it was driven."""

    drive: Prepared
    model: ExtendedModel
    design: Design
    noise: DriveNoise
    fit: ParameterFit


def fitted(minutes: float) -> Fitted:
    """Drive and fit: noise beside the model, then the model under that noise."""
    physics: dict[str, dict[str, object]] = {EFFECT: {"coefficient": COEFFICIENT}}
    recording = _recording(Spec(duration_s=60.0 * minutes, physics=physics))
    prepared = prepare(recording, recording.car)
    model = ExtendedModel((make_effect(EFFECT, coefficient=COEFFICIENT),))
    columns = design(prepared, {EFFECT: model})
    data = np.concatenate([prepared.y[:, :, None], columns.columns], axis=2)
    first = Noise.first(recording.quantum_rad, prepared.reference.car.radius_m)
    noise = DriveNoise(fit_noise(prepared.windows, data, first, SearchStage.SECOND))
    return Fitted(prepared, model, columns, noise, fit([prepared], [columns], [noise]))


def refit(one: Fitted, count: int, rng: np.random.Generator) -> FloatArray:
    """(count,) values of the effect, design fixed."""
    many = redrawn(one.drive, one.design, one.fit.values[:, 0], one.noise, rng, count)
    return np.asarray(fit([many], [one.design], [one.noise]).values[one.fit.keys.index(EFFECT)])


def rerun(one: Fitted, count: int, rng: np.random.Generator) -> FloatArray:
    """(count,) values of the effect, each from a drive that was drawn and prepared again."""
    reader = Reader(one.drive.recording, one.drive.reference, kept=one.drive.windows.index)
    out = []
    for _ in range(count):
        drawn = replicate(reader, one.model, one.noise.noise, rng)
        again = prepare(drawn, one.drive.recording.car)
        found = fit([again], [design(again, {EFFECT: one.model})], [one.noise])
        out.append(found.values[found.keys.index(EFFECT), 0])
    return np.array(out)


def _recording(spec: Spec) -> Recording:
    recording = recording_of(drive(spec, SEED))
    for name in INERTIAL:  # signals that this bus does not have
        recording.inertial.setdefault(name, np.full(recording.ticks, math.nan))
    return recording


def options(parser: argparse.ArgumentParser) -> None:
    """How many, of how long a drive."""
    parser.add_argument("--refit", type=int, default=300, help="replicates with the design fixed")
    parser.add_argument("--rerun", type=int, default=20, help="replicates that are prepared again")
    parser.add_argument("--minutes", type=float, default=20.0, help="of driving")


def main(args: argparse.Namespace) -> dict[str, object]:
    """Run and print."""
    began = time.perf_counter()
    one = fitted(args.minutes)
    stated = one.fit.std(EFFECT)
    print(f"{len(one.drive.windows)} windows; prepared and fitted in {time.perf_counter() - began:.1f} s")
    result: dict[str, object] = {"windows": len(one.drive.windows), "stated_std": stated}
    rng = np.random.default_rng(SEED)
    for name, draw, count in (("refit", refit, args.refit), ("rerun", rerun, args.rerun)):
        if count < 2:
            continue
        began = time.perf_counter()
        values = draw(one, count, rng)
        took_s = time.perf_counter() - began
        ratio = float(values.std(ddof=1)) / stated
        print(
            f"{name}: {count} replicates in {took_s:.2f} s ({took_s / count * 300:.1f} s for 300); "
            f"they spread {ratio:.2f} times as far as stated, mean {values.mean():.3f} of {EFFECT}"
        )
        result[name] = {"count": count, "seconds": took_s, "spread_over_stated": ratio}
    return result
