"""What a baseline learns of slip slopes, and what they say of the next drive."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.onboard.monitor.drives import RADIUS_M, VEHICLE
from tests.onboard.monitor.test_slip_slope import DRY, ticks
from tpmsd.car.config.model import MonitorConfig, TyreConfig
from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.estimators.base import RadiusEstimate
from tpmsd.onboard.monitor.alarms.judge import Judge, Judgement
from tpmsd.onboard.monitor.baseline.baseline import TyreSetBaseline
from tpmsd.onboard.monitor.baseline.reference import HILL
from tpmsd.onboard.timeline.tick import Tick

WHEELS = [0, 1, 2, 3]
NOISE_M = 1e-4


def estimate_at(tick: Tick, deviation_m: FloatArray) -> RadiusEstimate:
    """Radii that are known to `NOISE_M` each."""
    rear = float(np.mean(tick.rotation_rad[2:])) * RADIUS_M / tick.dt_s
    return RadiusEstimate(
        time_s=tick.time_s,
        deviation_m=deviation_m,
        covariance_m2=np.eye(4) * NOISE_M**2,
        noise_std_m=np.full(4, NOISE_M),
        informative=True,
        informative_s=tick.time_s,
        speed_mps=rear,
        yaw_rate_radps=0.0,
        east_m=0.0,
        north_m=0.0,
        heading_rad=0.0,
        position_std_m=1.0,
        heading_std_rad=0.01,
        gnss_age_s=0.1,
        effective_particles=40.0,
    )


def drive(baseline: TyreSetBaseline, driven: str, slope: float, seconds: float, start_s: float) -> Judgement:
    """One with this slip slope and radii as nominal, 48 teeth; what is judged at its end."""
    rng = np.random.default_rng(int(start_s))
    judge = Judge(replace(VEHICLE, driven_axle=driven), MonitorConfig(), TyreConfig(), WHEELS)
    judged = Judgement.unknown()
    for tick in ticks(seconds, slope, driven=driven, teeth=48.0, seed=int(start_s)):
        tick = replace(tick, time_s=start_s + tick.time_s)
        second = tick.index % 10 == 0
        if second:
            deviation_m = rng.normal(0.0, NOISE_M / 3.0, 4)
        estimate = estimate_at(tick, deviation_m)
        baseline.update(tick, estimate)
        if not second:
            continue
        if baseline.ready and (changes := baseline.changes(estimate, judge.nuisance_m2)) is not None:
            baseline.observe(estimate, judge.nuisance_m2)
            judged = judge.judge(*changes, change_hypotheses=baseline.change_hypotheses(alarm_active=False))
        baseline.learn(estimate, judge.nuisance_m2, judged.may_learn(baseline.settled), 1.0)
    return judged


@pytest.mark.parametrize("driven", ["front", "rear"])
def test_the_slip_slope_is_learned_with_the_car_and_tells_low_grip(driven: str) -> None:
    """From 4e-3 +- 4e-3 per m/s2 the car's 7e-3 (1.01 times that by differences over two seconds) is learned
    to 3e-4. A drive with as much is as learned; one with 2.4 times that has evenly low grip, though its radii
    are those of the first."""
    baseline = TyreSetBaseline(replace(VEHICLE, driven_axle=driven), WHEELS, MonitorConfig().learn_s)
    drive(baseline, driven, DRY, 800.0, 0.0)
    front, rear = baseline.reference.mean[HILL]
    assert (rear - front if driven == "front" else front - rear) == pytest.approx(1.01 * DRY, abs=3e-4)
    dry = drive(baseline, driven, DRY, 240.0, 6000.0)
    assert dry.drive_models["as learned"] > 0.8
    low = drive(baseline, driven, 2.4 * DRY, 240.0, 12000.0)
    assert low.drive_models["evenly low grip"] > 0.8
