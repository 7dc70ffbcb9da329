"""The car of the paper's Table 1 in the multi-body world, and the series that are written."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
import pytest

from bench.campaigns.car.vehicle_state import slowly_rising_steer
from bench.campaigns.car.vehicle_state_paper import SHOWN, paper_car, print_ratios, write_series
from bench.worlds.commonroad_car import run


def test_the_car_keeps_its_centre_of_gravity() -> None:
    """Body and axles together have Table 1's mass, at Table 1's height."""
    p = paper_car()
    axles = p.m_uf + p.m_ur
    assert (p.m_s + axles, p.I_z, p.a + p.b) == pytest.approx((1558.0, 2538.0, 2.56))
    assert (p.m_s * p.h_s + axles * p.R_w) / p.m == pytest.approx(0.432)


def test_it_drives_round_a_bend() -> None:
    """One second of slowly rising steer: it turns left, and lateral acceleration is speed times yaw rate."""
    truth = run(slowly_rising_steer(60 / 3.6, math.radians(3.0)), 1.5, 60 / 3.6, paper_car())
    assert truth.yaw_rate_radps[-1] > 0.05
    steady = truth.forward_mps[-1] * truth.yaw_rate_radps[-1]
    assert truth.accel_lat_mps2[-1] == pytest.approx(steady, rel=0.15)


def test_the_series_read_back(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A row per sample with v, u, r of truth and both filters; the ratios are printed beside Table 2's."""
    series = {"lane": {name: np.full((3, 3), float(k)) for k, name in enumerate(("truth", *SHOWN))}}
    write_series(tmp_path / "s.csv", series)
    with (tmp_path / "s.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["time_s"] for row in rows] == ["0.00", "0.01", "0.02"]
    assert [rows[0][f"r_{name}"] for name in ("truth", *SHOWN)] == ["0", "1", "2"]
    results = [
        {"sensors": grade, "outliers": share, "filter": name, "rmse": [2.0 - k, 2.0, 2.0]}
        for grade in ("with biases", "without biases")
        for share in (0.0, 0.02, 0.1)
        for k, name in enumerate(SHOWN)
    ]
    print_ratios(results)
    said = capsys.readouterr().out
    assert said.count("0.50  1.00  1.00") == 6
    assert "Table 2  0.21  0.41  0.05" in said
