"""UPF and ARUPF on the manoeuvres of [Liu 2022] with a car of Table 1: Table 2's figures, series as Figures 3
to 5.

    python -m bench run vehicle-state-paper [--seeds 4] [--series FILE.csv] [--picture FILE.png]

Truth: the multi-body car of CommonRoad with Table 1's mass, yaw inertia, lengths and wheel radius; springs,
dampers and the body's inertias grow with the mass; front-driven, tyres as they are. Sensors, filters and what
the filters know of the car are those of `vehicle-state`. The paper states neither noise nor outliers.
"""

from __future__ import annotations

import argparse
import csv
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from bench.campaigns.car.vehicle_state import (
    KMH,
    PAPER,
    Drive,
    Sensors,
    double_lane_change,
    filters,
    print_row,
    score,
    sensed,
    sine_with_dwell,
    slowly_rising_steer,
    workshop,
)
from bench.worlds.commonroad_car import DT_S, Run, parameters, run
from tpmsd.car.vehicle_state.car import CarDynamics
from tpmsd.car.vehicle_state.kalman import GaussianState
from tpmsd.car.vehicle_state.model import StepInputs
from tpmsd.foundation.wheels import FloatArray

MASS_KG, YAW_INERTIA_KGM2, FRONT_M, REAR_M, HEIGHT_M = 1558.0, 2538.0, 1.48, 1.08, 0.432
TRACK_FRONT_M, TRACK_REAR_M, WHEEL_RADIUS_M = 1.51, 1.55, 0.32
"""Table 1."""
SHARES = (0.0, 0.02, 0.1)
"""Shares of samples that are outliers."""
SHOWN = ("UPF", "ARUPF")
GRADES = {
    "with biases": Sensors(),
    "without biases": Sensors(
        gyro_bias_radps=0.0, accel_bias_mps2=0.0, steer_bias_rad=0.0, start_speed_mps=0.05
    ),
}
"""Sensors of production, and the same without what an integral makes metres per second of."""


def paper_car() -> Any:
    """The multi-body car with Table 1's values."""
    p = parameters()
    scale = MASS_KG / p.m
    p.m, p.I_z, p.a, p.b, p.h_cg = MASS_KG, YAW_INERTIA_KGM2, FRONT_M, REAR_M, HEIGHT_M
    p.T_f, p.T_r, p.R_w = TRACK_FRONT_M, TRACK_REAR_M, WHEEL_RADIUS_M
    p.m_s = MASS_KG - p.m_uf - p.m_ur
    p.h_s = (MASS_KG * HEIGHT_M - (p.m_uf + p.m_ur) * WHEEL_RADIUS_M) / p.m_s
    for name in ("K_sf", "K_sdf", "K_sr", "K_sdr", "K_ras", "K_tsf", "K_tsr", "K_rad", "K_zt"):
        setattr(p, name, scale * getattr(p, name))
    for name in ("I_Phi_s", "I_y_s"):
        setattr(p, name, scale * getattr(p, name))
    p.T_se = 1.0  # front-driven
    return p


def manoeuvres(p: Any) -> dict[str, Run]:
    """The three of the paper's section 4.1."""
    fast, slow = 80 * KMH, 60 * KMH
    return {
        "sine with dwell 80": run(sine_with_dwell(0.04), 5.0, fast, p),
        "double lane change 60": run(double_lane_change(slow, p.a + p.b), 10.0, slow, p),
        "slowly rising steer 80": run(slowly_rising_steer(fast), 4.0, fast, p),
    }


def compare(
    truth: Run, car: CarDynamics, seeds: int, particles: int, grade: str, labels: tuple[str, ...]
) -> list[dict[str, Any]]:
    """Filters on the lane change, a row for each and each share of outliers."""
    rows = []
    for share in SHARES:
        print(f"\ndouble lane change at 60 km/h, sensors {grade}, {share:.0%} outliers: RMSE (spread), MAE")
        for label in labels:
            scores = []
            for seed in range(1, seeds + 1):
                sensors = replace(GRADES[grade], outliers=share)
                drive = sensed(truth, sensors, np.random.default_rng(1000 + seed))
                scores.append(score(filters(particles)[label], car, drive, seed))
            rmse, mae = np.array([s.rmse for s in scores]), np.array([s.mae for s in scores])
            row = {
                "sensors": grade,
                "outliers": share,
                "filter": label,
                "rmse": rmse.mean(axis=0).tolist(),
                "rmse_spread": rmse.std(axis=0, ddof=1).tolist() if seeds > 1 else [float("nan")] * 3,
                "mae": mae.mean(axis=0).tolist(),
                "ms_per_step": float(np.median([s.seconds_per_step for s in scores]) * 1e3),
            }
            rows.append(row)
            print_row(row)
    return rows


def print_ratios(rows: list[dict[str, Any]]) -> None:
    """ARUPF over UPF, of each state, beside Table 2's."""
    print("\nARUPF over UPF, RMSE of v, u, r")
    of = {(row["sensors"], row["outliers"], row["filter"]): np.array(row["rmse"]) for row in rows}
    for grade in GRADES:
        for share in SHARES:
            ratios = of[grade, share, "ARUPF"] / of[grade, share, "UPF"]
            print(f"  {grade}, {share:4.0%}  " + "  ".join(f"{ratio:.2f}" for ratio in ratios))
    published = np.array(PAPER["ARUPF"]["rmse"]) / np.array(PAPER["UPF"]["rmse"])
    print("  Table 2  " + "  ".join(f"{ratio:.2f}" for ratio in published))


def series_of(label: str, car: CarDynamics, drive: Drive, particles: int) -> FloatArray:
    """(n, 3) v, u, r as a filter has them."""
    start = GaussianState(np.array([0.0, drive.start_speed, 0.0]), np.diag([0.1, 0.15, 0.01]) ** 2)
    filter_ = filters(particles)[label](car, start, np.random.default_rng(1))
    out = np.empty_like(drive.truth)
    out[0] = start.mean
    for k in range(1, len(out)):
        inputs = StepInputs(DT_S, float(drive.accel_long[k - 1]), float(drive.steer[k - 1]))
        out[k] = filter_.step(inputs, drive.reading[k]).mean
    return out


def write_series(path: Path, series: dict[str, dict[str, FloatArray]]) -> None:
    """A row per sample: manoeuvre, time, v, u, r of the truth and of both filters."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        names = ("truth", *SHOWN)
        writer.writerow(["manoeuvre", "time_s", *(f"{state}_{name}" for name in names for state in "vur")])
        for manoeuvre, of in series.items():
            for k in range(len(of["truth"])):
                values = [f"{value:.6g}" for name in names for value in of[name][k]]
                writer.writerow([manoeuvre, f"{k * DT_S:.2f}", *values])


def draw(path: Path, series: dict[str, dict[str, FloatArray]]) -> None:
    """Longitudinal speed, lateral speed and yaw rate over time, a column for each manoeuvre."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 8), layout="constrained")
    axes = figure.subplots(3, len(series), squeeze=False)
    for column, (manoeuvre, of) in enumerate(series.items()):
        time_s = np.arange(len(of["truth"])) * DT_S
        for row, (place, name) in enumerate(((1, "u, m/s"), (0, "v, m/s"), (2, "r, rad/s"))):
            for label, values in of.items():
                axes[row][column].plot(time_s, values[:, place], label=label, linewidth=1.0)
            axes[row][column].set_ylabel(name)
        axes[0][column].set_title(f"{manoeuvre} km/h")
        axes[2][column].set_xlabel("time, s")
    axes[0][0].legend()
    figure.savefig(path)


def options(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--particles", type=int, default=100)
    parser.add_argument("--series", type=Path, metavar="FILE", help="write the time series as CSV")
    parser.add_argument("--picture", type=Path, metavar="FILE", help="draw them")


def main(args: argparse.Namespace) -> dict[str, Any]:
    """Run and print."""
    p = paper_car()
    runs, car = manoeuvres(p), replace(workshop(p), drive_front_share=1.0)
    print(f"the filters' car: {car}")
    for name, truth in runs.items():
        lateral, left = (np.abs(values).max() for values in (truth.accel_lat_mps2, truth.left_mps))
        print(f"{name} km/h: up to {lateral:.1f} m/s2, lateral speed up to {left:.2f} m/s")
    change, rows = runs["double lane change 60"], []
    for grade, labels in zip(GRADES, (tuple(filters(1)), SHOWN), strict=True):
        rows += compare(change, car, args.seeds, args.particles, grade, labels)
    print_ratios(rows)
    for label in SHOWN:
        cells = zip(PAPER[label]["mae"], PAPER[label]["rmse"], strict=True)
        print(f"Table 2, {label}: " + ", ".join(f"{mae:g} / {rmse:g}" for mae, rmse in cells) + " (v, u, r)")
    if args.series is not None or args.picture is not None:
        series = {}
        for name, truth in runs.items():
            drive = sensed(truth, replace(Sensors(), outliers=SHARES[1]), np.random.default_rng(1001))
            of = {label: series_of(label, car, drive, args.particles) for label in SHOWN}
            series[name] = {"truth": drive.truth, **of}
        if args.series is not None:
            write_series(args.series, series)
        if args.picture is not None:
            draw(args.picture, series)
    return {"rows": rows, "published": PAPER}
