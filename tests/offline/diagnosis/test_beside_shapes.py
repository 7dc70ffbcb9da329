"""Effects beside spline terms over the same covariate, and values that no force makes together."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from tpmsd.car.physics.kinematics import WheelPositions
from tpmsd.car.physics.motion import Car, driven_mask
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.hypotheses.penalties import spline_penalty
from tpmsd.offline.diagnosis.hypotheses.plausible import limits_of
from tpmsd.offline.diagnosis.hypotheses.terms import ANY_CAR, CarLimits, Hypotheses, Term
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.diagnosis.robustness.confirm import _with_instrument_effects
from tpmsd.offline.diagnosis.selection.selector import Selector
from tpmsd.offline.inference.least_squares import Evidence, part

WINDOWS = 600
RATIO, COMMON, OWN = 100.0, 15.0, slice(3, 8)
"""Lengths of the whitened responses: of one axle against the other, and of both against the receiver."""
PER_SECOND, PER_METRE = 150.0, 1e5
LAG_S = 0.065
"""Neither usual nor unusual for the speed of a receiver."""


class Given(Hypotheses):
    """These terms and no others."""

    def __init__(
        self, width: int, catalogue: list[Term], shapes: list[Term], car: CarLimits = ANY_CAR
    ) -> None:
        super().__init__(np.zeros((width, 0)), catalogue, shapes, car)

    def ramp_gains(self, gram: FloatArray, b: FloatArray) -> list[tuple[float, Term]]:
        """None."""
        return []

    pulse_gains = ramp_gains


def columns(*numbers: int, width: int) -> FloatArray:
    """(width, k) design of these columns."""
    return np.eye(width)[:, list(numbers)]


def shape(pattern: str, covariate: str, design: FloatArray) -> Term:
    """A spline term."""
    names = tuple(f"at_{k}" for k in range(design.shape[1]))
    return Term("unknown", design, names, spline_penalty(len(names)), pattern=pattern, covariate=covariate)


def directions(count: int) -> FloatArray:
    """(rows, count) orthonormal responses."""
    rng = np.random.default_rng(5)
    return np.asarray(np.linalg.qr(rng.standard_normal((WINDOWS * 9, count)))[0])


def evidence(data: FloatArray, responses: FloatArray) -> Evidence:
    """Data with noise of unit size, and the columns of all terms."""
    return noiseless(data + np.random.default_rng(6).standard_normal(len(data)), responses)


def noiseless(data: FloatArray, responses: FloatArray) -> Evidence:
    """Data as they are, and the columns of all terms."""
    rows = np.concatenate([data[:, None], responses], axis=1)
    return Evidence([part(rows.reshape(WINDOWS, 9, -1), np.arange(WINDOWS) // 8)], rows.shape[1])


@pytest.mark.parametrize(
    ("old_fix", "found"),
    [(False, {("unknown", "rear"), ("unknown", "all")}), (True, {("unknown", "rear"), ("gnss_latency", "")})],
)
def test_an_old_fix_is_distinguished_from_slip_of_the_other_axle(
    old_fix: bool, found: set[tuple[str, str]]
) -> None:
    """Nine tenths of a GNSS latency look like slip of all wheels; only the last tenth may give it its name.

    The shape of all wheels costs 26 nats, the latency 3.5, so by what they bring for their penalty slip alone
    (some 100 nats, of which the latency takes four fifths) would be GNSS latency.
    """
    u = directions(8)
    latency = 0.9 * u[:, 1] + np.sqrt(0.19) * u[:, 2]
    responses = np.concatenate(
        [PER_METRE * u[:, :2], PER_METRE * u[:, OWN], PER_SECOND * latency[:, None]], axis=1
    )
    rear = shape("rear", "accel_long", columns(1, width=9))
    both = shape("all", "accel_long", columns(2, 3, 4, 5, 6, 7, width=9))
    lag = Term("gnss_latency", columns(8, width=9), ("latency_s",), 3.5)
    data = RATIO * u[:, 0] + COMMON * (latency if old_fix else u[:, 1])
    selector = Selector(evidence(data, responses), Given(9, [lag], [rear, both]), last=True)
    chosen = selector.select().chosen

    assert selector.gain([rear, lag]) - selector.gain([rear]) > 50.0
    assert found == {(one.term.effect, one.term.pattern) for one in chosen}
    for one in chosen:
        if one.term.effect == "gnss_latency":
            assert one.values[0] == pytest.approx(COMMON / PER_SECOND, abs=3.0 * one.stds[0])
            assert one.stds[0] > 1.5 / PER_SECOND  # what it would be beside the rear axle's shape alone: 1.0


@pytest.mark.parametrize(
    ("per_accel", "per_speed2", "effect"),
    [(2e-3, 6e-7, "longitudinal_slip"), (2e-3, -6e-6, "unknown"), (1e-6, -3e-5, "unknown")],
)
def test_slip_that_no_force_makes_is_not_called_slip(
    per_accel: float, per_speed2: float, effect: str
) -> None:
    """Drag is a small share of what speeds a car up, and of its sign; a spline term over the speed is not."""
    u = directions(2)
    responses = u * np.array([3e4, 3e7])
    data = responses @ np.array([per_accel, per_speed2])
    slip = Term("longitudinal_slip", columns(1, 2, width=5), ("slip_per_accel", "slip_per_speed2"), 7.0)
    shapes = [shape("rear", "speed", columns(3, 4, width=5))]
    every = np.concatenate([responses, 3e-2 * responses], axis=1)
    chosen = Selector(evidence(data, every), Given(5, [slip], shapes), last=True).select().chosen

    assert [effect] == [one.term.effect for one in chosen]


@pytest.mark.parametrize(
    ("slip_m", "found"), [(RATIO, {"unknown"}), (0.2 * RATIO, {"unknown", "track_width_error"})]
)
def test_a_faint_track_beside_strong_slip_of_no_name_is_none(slip_m: float, found: set[str]) -> None:
    """Slip of 31,000 nats leaves a thousandth of that in bends, whatever covariate its shape is over."""
    u = directions(3)
    responses = np.concatenate([PER_METRE * u[:, :2], 100.0 * u[:, 2:]], axis=1)
    rear = shape("rear", "accel_long", columns(1, 2, width=4))
    track = Term("track_width_error", columns(3, width=4), ("rear_m",), 3.5)
    data = 2.5 * slip_m * u[:, 0] + 6.0 * u[:, 2]
    selector = Selector(evidence(data, responses), Given(4, [track], [rear]), last=True)

    assert 6.0 + 3.5 < selector.gain([rear, track]) - selector.gain([rear]) < 25.0
    assert found == {one.term.effect for one in selector.select().chosen}


@pytest.mark.parametrize(("rear_m", "thinkable"), [(0.2, True), (-0.4, False)])
def test_no_track_is_off_by_the_width_of_a_tyre(rear_m: float, thinkable: bool) -> None:
    """However sure it looks."""
    u = directions(1)
    track = Term("track_width_error", columns(1, width=2), ("rear_m",), 3.5)
    geometry = WheelPositions(track_front_m=1.5, track_rear_m=1.5, wheelbase_m=2.7)
    car = Car(np.full(4, 0.3), geometry, driven_mask("rear"))
    given = Given(2, [track], [], limits_of(car))
    selector = Selector(evidence(100.0 * rear_m * u[:, 0], 100.0 * u), given, last=True)

    assert thinkable == bool(selector.select().chosen)


@pytest.mark.parametrize(("configured_m", "thinkable"), [(0.0, False), (1.5, True)])
def test_no_antenna_is_where_there_is_no_car(configured_m: float, thinkable: bool) -> None:
    """2.2 m behind a place over the rear axle there is none; behind one before it there may be."""
    u = directions(2)
    names = ("forward_m", "left_m")
    arm = Term("antenna_lever_arm", columns(1, 2, width=3), names, 7.0)
    geometry = WheelPositions(track_front_m=1.5, track_rear_m=1.5, wheelbase_m=2.7)
    car = Car(np.full(4, 0.3), geometry, driven_mask("rear"), antenna_forward_m=configured_m)
    given = Given(3, [arm], [], limits_of(car))
    chosen = Selector(evidence(-220.0 * u[:, 0], 100.0 * u), given, last=True).select().chosen

    assert thinkable == bool(chosen)


@pytest.mark.parametrize(("factor", "named"), [(0.9, True), (-9.0, False), (6.0, False)])
def test_slopes_shorten_the_distance_by_their_geometry_and_no_more(factor: float, named: bool) -> None:
    """It has no parameter: what shows nine times as much, or the other way, is another thing."""
    u = directions(1)
    grade = Term("road_grade", columns(1, width=2), ("",), 3.5)
    car = Car(
        np.full(4, 0.3),
        WheelPositions(track_front_m=1.5, track_rear_m=1.5, wheelbase_m=2.7),
        driven_mask("rear"),
    )
    made = noiseless(8.0 * u[:, 0], 8.0 / factor * u)
    chosen = Selector(made, Given(2, [grade], [], limits_of(car)), last=True).select().chosen

    assert named == bool(chosen)


@pytest.mark.parametrize(("own_nats", "named"), [(1.5, "velocity_lag"), (12.0, "gnss_latency")])
def test_an_old_fix_that_may_be_an_old_speed_is_the_receivers_own(own_nats: float, named: str) -> None:
    """Alike but for what the positions tell: with one and a half nats of that no name is given."""
    u = directions(2)
    lag = Term("velocity_lag", columns(1, width=3), ("lag_s",), 3.5)
    latency = Term("gnss_latency", columns(2, width=3), ("latency_s",), 3.5)
    position = np.sqrt(2.0 * own_nats)
    responses = 300.0 * np.stack([u[:, 0], u[:, 0] + position / (300.0 * LAG_S) * u[:, 1]], axis=1)
    given = Given(3, [lag, latency], [])
    made = noiseless(LAG_S * responses[:, 1], responses)
    selection = Selector(made, given, last=True).selection_of([latency])
    regression = SimpleNamespace(hypotheses=given)
    found = _with_instrument_effects(cast(Regression, regression), selection, made)

    assert [named] == [one.term.effect for one in found.chosen]


class Swaps(Selector):
    """Exchanges two terms for one that scatters too much to stay, and one of little worth."""

    def _exchange(self, chosen: list[Term]) -> list[Term]:
        return chosen if len(chosen) < 2 else self.hypotheses.catalogue[1:]

    def _prune(self, chosen: list[Term]) -> list[Term]:
        return [term for term in chosen if term is not self.hypotheses.catalogue[1]]


def test_a_search_does_not_end_with_less_than_it_had() -> None:
    """An exchange may bring a term that does not stand; what went for it is not lost with it."""
    u = directions(6)
    names = ("antenna_lever_arm", "longitudinal_slip", "track_width_error")
    terms = [
        Term(name, columns(1 + 2 * k, 2 + 2 * k, width=7), ("first", "second"), 7.0)
        for k, name in enumerate(names)
    ]
    data = 20.0 * u[:, 0] + 12.0 * u[:, 2] + 6.0 * u[:, 4]
    chosen = Swaps(evidence(data, 10.0 * u), Given(7, terms, [])).select().chosen

    assert {"antenna_lever_arm"} == {one.term.effect for one in chosen}


def test_what_falls_for_its_scatter_takes_no_place() -> None:
    """A alternative of 25 nats that one block makes is no candidate, nor may it oust one of 12 in all
    blocks."""
    u = directions(2)
    block = (np.arange(len(u)) // (8 * 9) == 40).astype(float)
    once = u[:, 1] * block
    once *= np.sqrt(2.0 * 25.0) / float(once @ u[:, 1])
    terms = [
        Term(name, columns(1 + k, width=3), ("value",), 3.5)
        for k, name in enumerate(("track_width_error", "gnss_latency"))
    ]
    data = np.sqrt(2.0 * 15.5) * u[:, 0] + once
    selector = Selector(noiseless(data, 100.0 * u), Given(3, terms, []), last=True)

    assert selector.gain(terms[1:]) > selector.gain(terms[:1])
    assert {"track_width_error"} == {one.term.effect for one in selector.select().chosen}


def test_a_description_that_could_not_be_added_takes_no_place() -> None:
    """Beside 3,200 nats of a slip a spline of 45 is what its formula leaves: it ousts no track of 12."""
    u = directions(3)
    slip = Term("longitudinal_slip", columns(1, width=4), ("slip_per_accel",), 3.5)
    track = Term("track_width_error", columns(2, width=4), ("rear_m",), 3.5)
    rest = shape("diagonal", "accel_lat", columns(3, width=4))
    part = np.sqrt(15.5 / 45.0)
    tilted = part * u[:, 2] + np.sqrt(1.0 - part**2) * u[:, 1]
    responses = np.stack([1e4 * u[:, 0], 100.0 * tilted, 1e4 * u[:, 2]], axis=1)
    data = 80.0 * u[:, 0] + np.sqrt(90.0) * u[:, 2]
    selector = Selector(noiseless(data, responses), Given(4, [slip, track], [rest]), last=True)

    assert selector.gain([slip, rest]) - selector.gain([slip]) == pytest.approx(45.0)
    assert "unknown" not in {one.term.effect for one in selector.select().chosen}
