"""The slip of four driven wheels against the receiver's speed, and what it says of grip."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.onboard.monitor.drives import RADIUS_M, VEHICLE
from tests.onboard.monitor.test_drive_evidence import NOISE_M, RADIUS, WHEELS, at, learned_car
from tpmsd.car.config.model import MonitorConfig, TyreConfig
from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.monitor.alarms.judge import Judge, Judgement
from tpmsd.onboard.monitor.baseline.baseline import Change
from tpmsd.onboard.monitor.baseline.reference import AGE, CAR, DRAG, HILL, SIZE, RadiusReference
from tpmsd.onboard.monitor.sampling.drive_evidence import DriveEvidence
from tpmsd.onboard.monitor.sampling.slip_slope import SlipSlope
from tpmsd.onboard.monitor.sampling.slip_sums import Slope, SlopeSums
from tpmsd.onboard.monitor.settings import JUDGE
from tpmsd.onboard.timeline.tick import Fix, Tick

DT_S = 0.1
CAR_OF_ALL = replace(VEHICLE, driven_axle="all")
DRY = 5e-3
ASKED = MonitorConfig().raise_probability


def ticks(
    seconds: float,
    slope: float,
    *,
    rate_hz: float = 1.0,
    age_s: float = 0.0,
    mean_mps: float = 18.0,
    larger_m: float = 0.0,
    doppler_mps: float = 0.0,
    teeth: float = 0.0,
    yaw_radps: float = 0.0,
    phase_s: float = 0.037,
    seed: int = 0,
) -> list[Tick]:
    """Speed swings by 4 m/s in 25 s, all wheels slip alike. The receiver tells the speed of `age_s` ago,
    `phase_s` after each full period, with white noise; `teeth` per revolution: whole ones are counted."""

    def speed(time: FloatArray) -> FloatArray:
        return np.asarray(mean_mps + 4.0 * np.sin(2.0 * math.pi * time / 25.0 + seed))

    rng = np.random.default_rng(seed)
    fine = np.arange(round(seconds / DT_S) * 10 + 1) * DT_S / 10.0
    accel = 4.0 * 2.0 * math.pi / 25.0 * np.cos(2.0 * math.pi * fine / 25.0 + seed)
    track, base = VEHICLE.track_rear_m, VEHICLE.wheelbase_m
    along = speed(fine)[:, None] + np.array([-0.5, 0.5, -0.5, 0.5]) * track * yaw_radps
    hubs = np.hypot(along, np.array([1.0, 1.0, 0.0, 0.0]) * base * yaw_radps)
    rate = hubs / (RADIUS_M + larger_m) * (1.0 + slope * accel[:, None])
    steps = 0.5 * (rate[:-1] + rate[1:]) * DT_S / 10.0
    angle = np.concatenate([np.zeros((1, 4)), np.cumsum(steps, axis=0)])[::10]
    if teeth:
        angle = np.floor(angle * teeth / (2.0 * math.pi) + rng.uniform(0.0, 1.0, 4)) * 2.0 * math.pi / teeth
    moments = np.arange(phase_s, seconds, 1.0 / rate_hz)
    received = speed(moments - age_s) + rng.normal(0.0, 1.0, moments.size) * doppler_mps
    out = []
    for k, turn in enumerate(np.diff(angle, axis=0)):
        here = np.flatnonzero((moments > k * DT_S) & (moments <= (k + 1) * DT_S))
        fixes = tuple(
            Fix(float(moments[n]), float(moments[n] / DT_S - k), 0.0, 0.0, 1.0, speed_mps=float(received[n]))
            for n in here
        )
        out.append(Tick(k, (k + 1) * DT_S, DT_S, turn, np.full(4, 0.01), fixes))
    return out


def sums_of(drive: list[Tick]) -> SlopeSums:
    slip, total = SlipSlope(CAR_OF_ALL), SlopeSums()
    for tick in drive:
        total += slip.update(tick) or SlopeSums()
    return total


def slope_of(drive: list[Tick]) -> Slope:
    found = sums_of(drive).slope()
    assert found is not None
    return found


SMOOTHING = 0.06
"""Relative error of a slope: of a swing of 25 s the mean speed over a second is smaller than that of its
middle by up to 5.8e-4 of 18 m/s, which a window of 20 s does not tell from 3e-4 per m/s2."""


@pytest.mark.parametrize("rate_hz", [1.0, 5.0, 10.0])
@pytest.mark.parametrize("larger_m", [0.0, -4e-3])
def test_the_slope_is_that_of_the_slip_whatever_the_radii(rate_hz: float, larger_m: float) -> None:
    found = slope_of(ticks(100.0, DRY, rate_hz=rate_hz, larger_m=larger_m))
    assert found.slip_s2pm == pytest.approx(DRY, rel=SMOOTHING)


@pytest.mark.parametrize("mean_mps", [14.0, 28.0])
@pytest.mark.parametrize("rate_hz", [1.0, 10.0])
def test_a_speed_of_some_time_ago_adds_what_is_said_of_it(mean_mps: float, rate_hz: float) -> None:
    """A speed that is 0.1 s old is too small by 0.1 s times the acceleration."""
    fresh = slope_of(ticks(100.0, DRY, rate_hz=rate_hz, mean_mps=mean_mps))
    old = slope_of(ticks(100.0, DRY, rate_hz=rate_hz, mean_mps=mean_mps, age_s=0.1))
    assert old.slip_s2pm - fresh.slip_s2pm == pytest.approx(0.1 * old.per_age, rel=0.03)
    assert old.per_age == pytest.approx(1.0 / mean_mps, rel=0.05)


def test_a_bend_is_no_slip() -> None:
    assert abs(slope_of(ticks(100.0, 0.0, yaw_radps=0.2)).slip_s2pm) < 2e-4


@pytest.mark.parametrize("rate_hz", [1.0, 10.0])
def test_stated_errors_cover_rounded_counts_and_the_receivers_noise(rate_hz: float) -> None:
    """Of 60 drives of a minute with 48 teeth and 0.08 m/s of noise, 93 % and more are within 1.96 standard
    deviations, which are at most four times as wide as the errors."""
    off = []
    for seed in range(60):
        found = slope_of(ticks(60.0, DRY, rate_hz=rate_hz, teeth=48.0, doppler_mps=0.08, seed=seed))
        off.append((found.slip_s2pm - DRY) / math.sqrt(found.variance))
    assert np.mean(np.abs(off) < 1.96) >= 0.93
    assert np.std(off) > 0.25


@pytest.mark.parametrize(
    "what", ["no fix", "no speed", "noisy", "slow", "a wheel is not heard", "steady", "standing"]
)
def test_nothing_is_said_where_nothing_can_be_known(what: str) -> None:
    drive = ticks(60.0, DRY, mean_mps=3.0 if what == "slow" else 18.0)
    if what == "no fix":
        drive = [replace(one, fixes=()) for one in drive]
    elif what in ("no speed", "noisy"):
        less = {"speed_mps": math.nan} if what == "no speed" else {"speed_noise": 5.0}
        drive = [replace(one, fixes=tuple(replace(fix, **less) for fix in one.fixes)) for one in drive]
    elif what == "a wheel is not heard":
        lost = np.array([0.0, 0.0, math.nan, 0.0])
        drive = [replace(one, rotation_rad=one.rotation_rad + lost) for one in drive]
    elif what in ("steady", "standing"):
        turn = np.full(4, 1.8 / RADIUS_M if what == "steady" else 0.0)
        drive = [replace(one, rotation_rad=turn) for one in drive]
    assert sums_of(drive).slope() is None


def test_speed_that_changed_in_a_gap_is_no_acceleration() -> None:
    """Of every 12 s the last 3 s were not recorded: the slope is that of the whole drive."""
    kept, missing = [], 0
    for one in ticks(300.0, DRY):
        if one.index % 120 >= 90:
            missing += 1
            continue
        kept.append(replace(one, gap_s=missing * DT_S))
        missing = 0
    assert slope_of(kept).slip_s2pm == pytest.approx(DRY, rel=SMOOTHING)


def test_age_and_slip_are_learned_apart_by_drives_at_several_speeds() -> None:
    """Twenty measurements with 3e-4 each at 10 and at 30 m/s, of a slip of 5e-3 and an age of 0.12 s: least
    squares with both priors."""
    reference = RadiusReference(CAR_OF_ALL)
    rows, seen = [], []
    for _ in range(20):
        for speed_mps in (10.0, 30.0):
            value = 5e-3 + 0.12 / speed_mps
            reference.learn_slip(Slope(value, 3e-4**2, 1.0 / speed_mps))
            rows.append([1.0, 1.0 / speed_mps])
            seen.append(value)
    # Both axles pull by a half of 4e-3 +- 4e-3 each, whose mean the slope is.
    prior = np.diag([2.0 * 4e-3**2 / 4.0, 0.05**2])
    weight = np.linalg.inv(prior)
    h = np.array(rows)
    best = np.linalg.solve(weight + h.T @ h / 3e-4**2, weight @ [2e-3, 0.03] + h.T @ np.array(seen) / 3e-4**2)
    assert -0.5 * reference.mean[HILL].sum() == pytest.approx(best[0], rel=1e-6)
    assert reference.mean[AGE] == pytest.approx(best[1], rel=1e-6)
    assert best == pytest.approx([5e-3, 0.12], rel=0.1)


def judged(extra: FloatArray, slippier: float, seed: int) -> Judgement:
    """Of a drive with a known car that drives all wheels, and a slope every 20 s that is known to 2.5e-3, of
    a receiver whose speed is 0.1 s old; wheels slip so many times as much as they did when the car was
    learned, uphill from the eighth sample on, and `extra` (n,) m comes on top of all of them."""
    rng = np.random.default_rng(seed)
    known = learned_car()
    reference = RadiusReference(CAR_OF_ALL)
    scale = np.sqrt(np.diag(known.covariance) / np.diag(RadiusReference(VEHICLE).covariance))
    reference.covariance = reference.covariance * np.outer(scale, scale)
    reference.mean[HILL], reference.mean[AGE] = -DRY, 0.1
    truth = reference.mean.copy()
    truth[[DRAG, HILL.start, HILL.start + 1]] *= slippier
    evidence = DriveEvidence(reference, WHEELS, RADIUS)
    noise_m2 = np.eye(4) * NOISE_M**2
    changes = []
    for k, more in enumerate(extra):
        speed_mps = 22.0 + 3.0 * math.sin(k / 3.0)
        uphill = replace(at(speed_mps), slope_mps2=0.5 if k >= 8 else 0.0)
        features = reference.features(uphill)
        seen = features @ truth * RADIUS_M + more + rng.normal(0.0, NOISE_M, 4)
        measured = slippier * DRY + 0.1 / speed_mps + float(rng.normal(0.0, 2.5e-3))
        slope = Slope(measured, 2.5e-3**2, 1.0 / speed_mps)
        evidence.update(seen, noise_m2, np.zeros((4, 4)), features, 20.0, slope)
        changes.append(seen - features @ reference.mean * RADIUS_M)
    recent = np.mean(changes[-JUDGE.full_samples :], axis=0)
    now = Change(changes[-1], noise_m2, 1, noise_m2, True)
    mean = Change(recent, noise_m2, JUDGE.full_samples, noise_m2, True)
    judge = Judge(CAR_OF_ALL, MonitorConfig(), TyreConfig(), WHEELS)
    return judge.judge(now, mean, change_hypotheses=evidence.change_hypotheses)


@pytest.mark.parametrize("seed", range(5))
def test_the_slope_tells_low_grip_from_four_soft_tyres(seed: int) -> None:
    """All wheels are smaller by 2.5 mm after three minutes: by loss of air on a dry road, where all are
    named; by 2.4 times the slip on an uphill road nothing is raised."""
    soft = np.zeros(30)
    soft[8:] = -2.5e-3
    dry, slippery = judged(soft, 1.0, seed), judged(np.zeros(30), 2.4, seed)
    assert [0, 1, 2, 3] == np.flatnonzero(dry.deflated > ASKED).tolist()
    assert dry.slippery < 0.1
    assert slippery.slippery > 0.7
    assert np.all(slippery.deflated < ASKED)


def test_a_baseline_saved_before_the_receivers_age_was_learned_is_taken_up() -> None:
    """With the prior of the age, and everything else as it was."""
    reference = RadiusReference(VEHICLE)
    reference.learn_slip(Slope(7e-3, 1e-6))
    saved = reference.to_json()
    old = {
        **saved,
        "mean": np.delete(saved["mean"], AGE).tolist(),
        "covariance": np.delete(np.delete(saved["covariance"], AGE, axis=0), AGE, axis=1).tolist(),
    }
    found = RadiusReference.from_json(old, VEHICLE)
    assert found.mean == pytest.approx(reference.mean)
    assert found.covariance == pytest.approx(reference.covariance)
    assert (AGE, CAR, SIZE) == (20, 21, 29)
    with pytest.raises(ValueError, match="baseline"):
        RadiusReference.from_json({**saved, "mean": saved["mean"][:-3]}, VEHICLE)
