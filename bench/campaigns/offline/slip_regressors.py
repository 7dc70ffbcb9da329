"""What slips by the tyre model would explain that the diagnosis' own terms do not.

    python -m bench run slip-regressors [--seed 11] [--minutes 8]

A drive of each multi-body car on dry road, hurried and calm, is compared with the rolling model as
`tpmsd diagnose` does: same channels, same whitening, noise fitted with all its terms. Then columns are
fitted by least squares and their gains printed (log-likelihood over calibration alone, nats; nothing is held
out). Those of slip are the diagnosis' own (`tpmsd.offline.diagnosis.hypotheses.wheel_slip`): per axle the
slip under drive and under brakes, and the side slip of the rear axle.
"""

from __future__ import annotations

import argparse
from types import SimpleNamespace
from typing import Any

import numpy as np

from bench.worlds.hard_drives import SETTINGS, HardDrive, instrumented, truth
from tpmsd.car.config.model import GnssConfig
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.hypotheses.wheel_slip import SIDE_SLIP, WHEEL_SLIP
from tpmsd.offline.diagnosis.prepared.admission import admitted_readers
from tpmsd.offline.diagnosis.prepared.drive_regression import DriveRegression
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.inference.noise_fit import SearchStage, fit_noise
from tpmsd.offline.inference.recording import Recording, record

CARS = ("Escort, dry", "BMW, dry", "Vanagon, dry")


def recorded(drive: HardDrive, name: str) -> Recording:
    """The drive as the diagnosis reads it."""
    config: Any = SimpleNamespace(vehicle=drive.vehicle, gnss=GnssConfig())
    return record(drive.ticks, config, name)


def gain(data: FloatArray, columns: FloatArray) -> float:
    """Log-likelihood that columns (w, 9, k) gain on white data (w, 9)."""
    target, design = data.reshape(-1), columns.reshape(data.size, -1)
    size = np.sqrt((design**2).sum(axis=0))
    design = design[:, size > 0.0] / size[size > 0.0]
    left = target - design @ np.linalg.lstsq(design, target, rcond=1e-10)[0]
    return 0.5 * float(target @ target - left @ left)


def compared(regression: DriveRegression) -> list[tuple[str, int, float]]:
    """Label, number of columns and gain of each set of columns."""
    white, names = regression.white, regression.names

    def where(*kinds: str) -> list[int]:
        return [k for k, name in enumerate(names) if name[0] in kinds]

    calibration, wheels, side = where("radius", "gyro_delay"), where(WHEEL_SLIP), where(SIDE_SLIP)
    apart = {*where("data", "ramp", "smooth"), *wheels, *side}
    catalogue = [k for k in range(len(names)) if k not in apart]
    shapes = [
        k
        for k, name in enumerate(names)
        if name[0] == "smooth" and name[1] in ("fl", "fr", "rl", "rr") and name[2] == "accel_long"
    ]
    sets = {
        "longitudinal_slip": where("longitudinal_slip"),
        "wheel slips": wheels,
        "spline term per wheel over accel_long": shapes,
        "the same and wheel slips": shapes + wheels,
        "lateral_slip": where("lateral_slip"),
        "side slip": side,
        "whole catalogue": catalogue,
        "whole catalogue and wheel slips": catalogue + wheels,
        "whole catalogue and side slip": catalogue + side,
        "whole catalogue and spline terms over accel_long": catalogue + shapes,
        "all of this": catalogue + shapes + wheels + side,
    }
    start = gain(white[:, :, 0], white[:, :, calibration])
    rows = []
    for label, columns in sets.items():
        used = sorted({*calibration, *columns})
        brought = gain(white[:, :, 0], white[:, :, used]) - start
        rows.append((label, len(used) - len(calibration), brought))
    return rows


def options(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    parser.add_argument("--seed", type=int, default=11)
    parser.add_argument("--minutes", type=float, default=8.0)


def main(args: argparse.Namespace) -> int:
    """Run and print."""
    for hard in (True, False):
        for name in CARS:
            setting = SETTINGS[name]
            drive = instrumented(
                truth(args.seed, 60.0 * args.minutes, hard, setting), args.seed, setting=setting
            )
            regression = Regression(admitted_readers([recorded(drive, name)])[0])
            one = regression.drives[0]
            windows = one.reader.windows
            one.noise = fit_noise(
                windows,
                one.data_and_design(regression.hypotheses.fullest_design),
                one.noise,
                SearchStage.FIRST,
                one.inflate,
            )
            print(f"\n{name}, {'hurried' if hard else 'calm'}: {len(windows)} windows")
            for label, number, gained in compared(one):
                print(f"  {label:47s} {number:3d} columns  {gained:8.1f} nats", flush=True)
    return 0
