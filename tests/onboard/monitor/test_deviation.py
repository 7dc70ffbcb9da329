"""A wheel of another size, with slip as a rival."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from tests.onboard.monitor.drives import RADIUS_M, VEHICLE
from tests.onboard.monitor.test_drive_evidence import RADIUS, WHEELS
from tpmsd.car.config.model import MonitorConfig
from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.monitor.deviation import Deviation
from tpmsd.onboard.monitor.grip import Grip
from tpmsd.onboard.monitor.settings import DRIVE_EVIDENCE, JUDGE

SETTINGS = MonitorConfig()
LIMIT = SETTINGS.deviation_percent / 100.0
HARMLESS_M2 = JUDGE.unexplained.covariance(WHEELS, RADIUS) + 4e-4**2 * np.eye(4)
AS_LEARNED = {model.name: float(model.name == "as learned") for model in DRIVE_EVIDENCE.models}
SAME_AXLE = np.kron(np.eye(2), np.ones((2, 2)))


def probabilities(change_m: FloatArray, models: dict[str, float]) -> FloatArray:
    grip = Grip(VEHICLE, WHEELS, RADIUS)
    return Deviation(WHEELS, RADIUS, LIMIT * RADIUS, grip).probabilities(change_m, HARMLESS_M2, models)


@pytest.mark.parametrize(
    "change_mm",
    [(0.0, 0.0, -3.2, 0.2), (-4.0, -4.5, 0.0, 0.0), (3.5, 0.0, 0.5, 0.0), (-2.5, -2.5, -2.6, -2.4)],
)
def test_the_probability_is_that_of_an_integral_over_all_sizes(change_mm: tuple[float, ...]) -> None:
    """Before the drive can tell: the sum over drive models, without what only a slip slope tells, and
    resized wheels of prior times density, integrated over the size by the trapezium rule, beyond the limit
    and in all."""
    change = 1e-3 * np.array(change_mm)
    sizes = np.linspace(-8.0, 8.0, 16001) * JUDGE.resized_std
    weights = JUDGE.prior_resized * np.exp(-0.5 * (sizes / JUDGE.resized_std) ** 2)
    weights /= JUDGE.resized_std * np.sqrt(2.0 * np.pi) / (sizes[1] - sizes[0])
    groups = [(0,), (1,), (2,), (3,), (0, 1), (2, 3), (0, 1, 2, 3)]
    total, beyond = 0.0, np.zeros(4)
    for model in DRIVE_EVIDENCE.models:
        if model.name == "evenly low grip":
            continue
        slip = np.zeros((4, 4))
        if model.name in DRIVE_EVIDENCE.slipping:
            shared = model.pull_std**2 + model.axle_scatter**2
            slip = shared * SAME_AXLE + model.own_scatter**2 * np.eye(4)
        around = multivariate_normal(np.zeros(4), HARMLESS_M2 + slip * RADIUS_M**2)
        total += model.prior * float(around.pdf(change))
        for group in groups:
            members = np.isin(np.arange(4), group)
            parts = model.prior * weights * around.pdf(change - np.outer(sizes, members) * RADIUS_M)
            total += float(parts.sum())
            beyond += members * parts[np.abs(sizes) > LIMIT].sum()
    assert probabilities(change, {}) == pytest.approx(beyond / total, rel=0.02, abs=1e-6)


def test_a_driven_axle_that_pulls_hard_at_first_has_no_other_tyres() -> None:
    """On gravel, with a trailer, the driven wheels slip by 8 mm as the car sets off, and either axle shows
    it: nothing is raised; the same of one wheel, or of either axle on a drive that has shown its grip, is."""
    slips = np.array([-8e-3, -7.5e-3, 0.0, 0.0])
    assert np.all(probabilities(slips, {}) < 0.9)
    assert [0, 1] == np.flatnonzero(probabilities(slips, AS_LEARNED) > SETTINGS.raise_probability).tolist()
    behind = slips[[2, 3, 0, 1]]
    assert np.all(probabilities(behind, {}) < 0.9)
    assert [2, 3] == np.flatnonzero(probabilities(behind, AS_LEARNED) > SETTINGS.raise_probability).tolist()
    spare = np.array([-9e-3, 0.0, 0.0, 0.0])
    assert [0] == np.flatnonzero(probabilities(spare, {}) > SETTINGS.raise_probability).tolist()


def test_slip_for_minutes_at_low_grip_is_no_other_tyre() -> None:
    """At half the grip the driven axle slips by 2.6 mm for minutes, beyond the limit: nothing is raised."""
    low = dict.fromkeys(AS_LEARNED, 0.0) | {"low grip": 1.0}
    assert np.all(probabilities(np.array([-2.7e-3, -2.6e-3, 0.0, 0.0]), low) < 0.5)
