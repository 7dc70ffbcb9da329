"""The filters of the vehicle state on a recording whose lateral speed was measured.

    python -m bench run vehicle-state-drive DRIVE [--filters ekf ukf]

DRIVE holds `signals.csv` with `velocity_lat_mps` beside the inputs, and a `vehicle.toml` with `[dynamics]`.
The measured lateral speed is kept from the filters and compared with theirs.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np

from tpmsd.car.config.dynamics import load_car
from tpmsd.car.config.model import VEHICLE_STATE_METHODS
from tpmsd.offline.signals.read import read_signals
from tpmsd.offline.signals.vehicle_state import states_along


def options(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    parser.add_argument("drive", type=Path, metavar="DRIVE")
    parser.add_argument(
        "--filters", nargs="+", choices=VEHICLE_STATE_METHODS, default=list(VEHICLE_STATE_METHODS)
    )
    parser.add_argument("--particles", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)


def main(args: argparse.Namespace) -> dict[str, Any]:
    """Run and print."""
    table, car = read_signals(args.drive), load_car(args.drive)
    measured = table.columns["velocity_lat_mps"]
    good = np.isfinite(measured)
    rows = []
    for method in args.filters:
        began = time.process_time()
        rng = np.random.default_rng(args.seed)
        times, states = states_along(table, car, method, rng, args.particles)
        took_s = time.process_time() - began
        truth = np.interp(times, table.time_s[good], measured[good])
        known = np.array([state is not None for state in states])
        found = np.array([(s.velocity_lat_mps, s.velocity_lat_std_mps) for s in states if s is not None])
        off = found[:, 0] - truth[known]
        row = {
            "filter": method,
            "known": float(known.mean()),
            "rmse_mps": float(np.sqrt(np.mean(off**2))),
            "measured_rms_mps": float(np.sqrt(np.mean(truth[known] ** 2))),
            "correlation": float(np.corrcoef(found[:, 0], truth[known])[0, 1]),
            "within_two_stds": float(np.mean(np.abs(off) < 2.0 * found[:, 1])),
            "ms_per_step": 1e3 * took_s / len(times),
        }
        rows.append(row)
        print(
            f"{method:6s} lateral speed RMSE {row['rmse_mps']:.3f} of {row['measured_rms_mps']:.3f} m/s, "
            f"correlation {row['correlation']:.3f}, within two stated deviations "
            f"{row['within_two_stds']:.0%}, known {row['known']:.1%}, {row['ms_per_step']:.2f} ms a step",
            flush=True,
        )
    return {"drive": args.drive.name, "rows": rows}
