"""Radii on line against those of `calibrate` on the same recording, at the same speed.

    python -m bench run online-radii [DRIVE ...] [--json FILE]

On line: the mean of the estimates above 20 m/s after five minutes, as `tpmsd replay` has them, with the mean
of their stated standard deviations. `calibrate` states radii at a reference speed, and the growth with the
square of speed, by which they are moved to the root of the mean square of the same stretch.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from bench.campaigns.onboard.recorded_losses import Drive, read_drive
from bench.places import RECORDINGS
from bench.worlds.magic_tyre import Array
from tpmsd.foundation.wheels import RL, RR, WHEELS
from tpmsd.interfaces.api.functions import calibrate
from tpmsd.onboard.pipeline import Pipeline
from tpmsd.onboard.sources.can.decoder import load_database

NAMES = ("van-motorway-a", "van-motorway-b")
REAR = (RL, RR)
STEADY_MPS, STEADY_AFTER_S = 20.0, 300.0
BAR_M = 0.3e-3
"""Of the difference, and of the stated standard deviation."""


def steady(drive: Drive) -> tuple[float, Array, Array]:
    """Mean square of the speed over the steady part, and of the rear wheels the mean deviation from nominal
    and the mean standard deviation, m."""
    pipeline = Pipeline(drive.config, load_database(drive.config.can.dbc))
    rows = []
    for tick in drive.ticks:
        estimate = pipeline.on_tick(tick).estimate
        if tick.host_time_s - drive.start_s > STEADY_AFTER_S and estimate.speed_mps > STEADY_MPS:
            std = np.sqrt(np.diag(estimate.covariance_m2))
            rear = list(REAR)
            rows.append([estimate.speed_mps**2, *estimate.deviation_m[rear], *std[rear]])
    mean = np.mean(rows, axis=0)
    return float(mean[0]), mean[1:3], mean[3:5]


def compared(folder: Path) -> list[dict[str, Any]]:
    """A row for each rear wheel of a recording."""
    drive = read_drive(folder)
    speed2, on_line, stated = steady(drive)
    found = calibrate(folder).to_dict()
    grown = found["effects"]["growth"]["value"] * (speed2 - found["reference_speed_mps"] ** 2)
    rows = []
    for place, wheel in enumerate(REAR):
        radius = found["wheels"][WHEELS[wheel]]
        calibrated_m = radius["radius_m"] + grown - drive.config.vehicle.wheel_radius_m[wheel]
        rows.append(
            {
                "drive": drive.name,
                "wheel": WHEELS[wheel],
                "speed_mps": speed2**0.5,
                "on_line_mm": 1e3 * float(on_line[place]),
                "on_line_std_mm": 1e3 * float(stated[place]),
                "calibrate_mm": 1e3 * calibrated_m,
                "calibrate_std_mm": 1e3 * radius["radius_std_m"],
                "within": abs(float(on_line[place]) - calibrated_m) <= BAR_M
                and float(stated[place]) <= BAR_M,
            }
        )
    return rows


def options(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    parser.add_argument("drives", nargs="*", type=Path, metavar="DRIVE", help="default: motorways a and b")


def main(args: argparse.Namespace) -> dict[str, Any]:
    """Run and print."""
    rows = [
        row for folder in args.drives or [RECORDINGS / name for name in NAMES] for row in compared(folder)
    ]
    for row in rows:
        print(
            f"{row['drive']} {row['wheel']} at {row['speed_mps']:.1f} m/s: on line "
            f"{row['on_line_mm']:+.2f} +- {row['on_line_std_mm']:.2f} mm, calibrate "
            f"{row['calibrate_mm']:+.2f} +- {row['calibrate_std_mm']:.2f} mm from nominal: "
            f"{'within' if row['within'] else 'beyond'} {1e3 * BAR_M:.1f} mm"
        )
    return {"online_radii": rows}
