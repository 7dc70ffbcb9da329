"""Losses between the drives of a car, on drawn fleets: found on their wheel, and none where there is none."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from tests.offline.fleet.test_hierarchy import P, drawn
from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.fleet.discoveries import FleetHypothesis, control_false_discoveries
from tpmsd.offline.fleet.hierarchy import FleetStatistics
from tpmsd.offline.fleet.losses import radius_losses, step_changes
from tpmsd.offline.fleet.parameters import RADII_OF_CONTRASTS, SCALES

CARS = [f"car-{k}" for k in range(6)]
USUAL = np.where(np.arange(P) < 4, 0.3, 0.2)
"""Spread of drives in scales: of tyres 0.03 % left against right, and 0.15 % else."""


def fleet(seed: int, per_car: int = 6, information: float = 400.0) -> tuple[FleetStatistics, FloatArray]:
    """Drives of six cars, one a day."""
    rng = np.random.default_rng(seed)
    stack, _ = drawn(rng, len(CARS), per_car, np.zeros(P), np.full(P, 0.8), USUAL, information)
    return stack, np.tile(np.arange(per_car, dtype=np.float64) + 20_000.0, len(CARS))


def changed(
    stack: FleetStatistics, days: FloatArray, car: int, day: float, radius: FloatArray
) -> FleetStatistics:
    """The same with this change (4,) of the radii of one car, in parts of them, from a day on."""
    step = np.zeros(P)
    step[:4] = np.linalg.solve(RADII_OF_CONTRASTS, radius) / SCALES[:4]
    those = (stack.car == car) & (days >= day)
    vector = stack.vector + np.where(those[:, None], np.einsum("nij,j->ni", stack.information, step), 0.0)
    return FleetStatistics(stack.information, vector, stack.car)


def kept(stack: FleetStatistics, days: FloatArray) -> list[FleetHypothesis]:
    """What is reported; cars are those that the stack has."""
    found = radius_losses("m", CARS[: stack.cars], stack, days, np.square(USUAL))
    return [one for one in control_false_discoveries(found) if one.kept]


@pytest.mark.parametrize("wheel", range(4))
@pytest.mark.parametrize(("per_car", "day"), [(2, 20_001.0), (6, 20_004.0)])
def test_a_tyre_that_went_soft_overnight_is_found(wheel: int, per_car: int, day: float) -> None:
    """0.5 % of one radius from a day on, as 20 % of the pressure: car, wheel, size and day."""
    stack, days = fleet(wheel, per_car)
    [found] = kept(changed(stack, days, 3, day, np.where(np.arange(4) == wheel, -5e-3, 0.0)), days)

    assert ("car-3", "loss", "radius_change", WHEELS[wheel]) == (
        found.car,
        found.kind,
        found.effect,
        found.parameter,
    )
    assert abs(found.value + 0.5) < 3.0 * found.std < 0.3
    assert day * 86_400.0 == found.since_s


@pytest.mark.parametrize(("per_car", "moments"), [(2, 1), (6, 5)])
def test_the_best_of_several_moments_pays_for_all(per_car: int, moments: int) -> None:
    """The p-value is a normal distribution's, times the number of moments between drives (Bonferroni)."""
    stack, days = fleet(5, per_car)
    step = changed(stack, days, 3, days.max(), np.array([0.0, -2e-3, 0.0, 0.0]))
    [found] = [
        one
        for one in radius_losses("m", CARS, step, days, np.square(USUAL))
        if (one.car, one.parameter) == ("car-3", "fr")
    ]

    assert moments * stats.norm.cdf(found.value / found.std) == pytest.approx(found.p_value)


def test_a_single_car_with_two_drives_is_enough() -> None:
    """The first fleet of a user: one car, two drives, a soft tyre on the second."""
    stack, days = fleet(9, 2)
    one = stack.of_cars(np.arange(len(CARS)) == 0)
    [found] = kept(changed(one, days[:2], 0, 20_001.0, np.array([0.0, 0.0, 0.0, -5e-3])), days[:2])

    assert "rr" == found.parameter


def test_a_fleet_without_losses_has_none() -> None:
    """Forty fleets whose tyres differ from day to day as tyres do; a load on the back is no loss either."""
    assert [] == [one for seed in range(40) for one in kept(*fleet(seed))]
    stack, days = fleet(3)
    assert [] == kept(changed(stack, days, 2, 20_003.0, np.array([5e-4, 5e-4, -2e-3, -2e-3])), days)


def test_what_a_model_does_from_day_to_day_is_no_loss() -> None:
    """Encoders that lose counts move left against right by 0.3 % from drive to drive: no car stands out."""
    rng = np.random.default_rng(4)
    spread = np.where(np.arange(P) < 4, 3.0, 0.2)
    stack, _ = drawn(rng, len(CARS), 8, np.zeros(P), np.full(P, 0.8), spread, 400.0)

    assert [] == kept(stack, np.tile(np.arange(8.0) + 20_000.0, len(CARS)))


def test_a_tyre_that_was_inflated_is_no_loss() -> None:
    """1 % more of one radius: the other wheel of its axle is not said to be soft."""
    for seed in range(8):
        stack, days = fleet(seed)
        reported = kept(changed(stack, days, 1, 20_003.0, np.array([1e-2, 0.0, 0.0, 0.0])), days)
        assert [] == [one.parameter for one in reported]


def test_steps_are_the_generalised_least_squares_of_each_moment() -> None:
    """The change from each drive on equals that of a design with one more column, solved whole."""
    stack, days = fleet(7, 5)
    part = stack.car_slices()[2]
    K, k = stack.information[part], stack.vector[part]
    value, std = step_changes(K, k)

    assert (4, 4) == value.shape
    assert len(days) == sum(one.stop - one.start for one in stack.car_slices())
    for moment in range(1, 5):
        for wheel in range(4):
            step = np.zeros(P)
            step[:4] = np.linalg.solve(RADII_OF_CONTRASTS, np.eye(4)[wheel]) / SCALES[:4]
            design = np.array([np.column_stack([np.eye(P), step * (d >= moment)]) for d in range(5)])
            normal = np.einsum("dpi,dpq,dqj->ij", design, K, design)
            solved = np.linalg.solve(normal, np.einsum("dpi,dp->i", design, k))
            assert value[moment - 1, wheel] == pytest.approx(solved[-1], rel=1e-6, abs=1e-12)
            expected = np.sqrt(np.linalg.inv(normal)[-1, -1])
            assert std[moment - 1, wheel] == pytest.approx(expected, rel=1e-6)
