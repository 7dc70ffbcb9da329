"""Values that are told beside effects of which every car has some."""

from __future__ import annotations

import numpy as np
import pytest

from tests.offline.diagnosis.test_beside_shapes import Given, columns, directions, noiseless
from tpmsd.car.physics.catalogue import EFFECTS, prior_rms
from tpmsd.offline.diagnosis.hypotheses.terms import Term
from tpmsd.offline.diagnosis.selection.candidates import Candidates
from tpmsd.offline.diagnosis.selection.selector import Selector
from tpmsd.offline.inference.least_squares import LeastSquaresFit

ARM_M, SLIP, SPEED2 = -0.6, 3e-3, 225.0
"""An antenna behind the rear axle, the side slip of a car, and the square of a speed at which both turn the
antenna's course alike: f * yaw_rate / v and -c * v * yaw_rate."""
PER_METRE = 30.0


@pytest.mark.parametrize(("one_speed", "std_m"), [(True, 1.31), (False, 1.0 / PER_METRE)])
def test_an_arm_is_as_uncertain_as_the_side_slip_that_looks_like_it(one_speed: bool, std_m: float) -> None:
    """At one speed usual side slip moves it by more than a metre; bends at two speeds tell them apart."""
    u = directions(2)
    slip = -SPEED2 * u[:, 0] if one_speed else -SPEED2 * u[:, 1]
    responses = PER_METRE * np.stack([u[:, 0], slip], axis=1)
    arm = Term("antenna_lever_arm", columns(1, width=3), ("forward_m",), 3.5)
    usual = Term("lateral_slip", columns(2, width=3), ("coefficient",), 3.5)
    made = noiseless(ARM_M * responses[:, 0] + SLIP * responses[:, 1], responses)
    (found,) = Selector(made, Given(3, [arm, usual], [])).selection_of([arm]).chosen

    assert found.stds[0] == pytest.approx(std_m, rel=0.05)
    assert abs(found.values[0] - ARM_M) < found.stds[0]


def test_what_is_known_beforehand_is_a_reading_more() -> None:
    """Values and covariance are those of least squares with a row that reads one value as zero."""
    rng = np.random.default_rng(2)
    rows, data, std = rng.standard_normal((50, 3)), rng.standard_normal(50), 0.05
    more = np.concatenate([rows, [[0.0, 1.0 / std, 0.0]]])
    expected = np.linalg.inv(more.T @ more)
    covariance = np.linalg.inv(rows.T @ rows)
    fit = LeastSquaresFit(np.eye(3), covariance @ rows.T @ data, covariance, 1.0).known(1, std)

    assert fit.covariance == pytest.approx(expected)
    assert fit.values == pytest.approx(expected @ rows.T @ data)


def test_the_usual_size_is_that_of_the_prior() -> None:
    """The root mean square about no effect; what has no prior has no usual size."""
    assert prior_rms(EFFECTS["lateral_slip"], "coefficient") == pytest.approx(np.hypot(5e-3, 3e-3))
    with pytest.raises(ValueError, match=r"radius_change\.wheel has no prior"):
        prior_rms(EFFECTS["radius_change"], "wheel")


@pytest.mark.parametrize(
    ("gain", "share_nearer", "against_nats"),
    [(17.0, 0.3, 6.0 * (2.0 * 0.06 - 1.0)), (1000.0, 0.0, 6.0 * (2.0 * 0.8 - 1.0))],
)
def test_a_lag_that_may_be_usual_is_priced_as_such(
    gain: float, share_nearer: float, against_nats: float
) -> None:
    """0.074 s known to 0.013 s may be the 0.052 s that receivers have; known to 2 ms they are not."""
    lag = Term("velocity_lag", columns(1, width=2), ("lag_s",), 3.5)
    penalised_gain = gain * (1.0 - share_nearer**2) - 3.5 - against_nats

    assert penalised_gain == pytest.approx(Candidates.penalised_gain(lag, gain, 0.074))


@pytest.mark.parametrize(
    ("effect", "parameter", "beside", "others", "usual"),
    [
        ("gnss_latency", "latency_s", "velocity_lag", ("lag_s",), np.hypot(0.03, 0.05)),
        ("antenna_lever_arm", "forward_m", "gnss_latency", ("latency_s",), np.hypot(0.05, 0.1)),
        ("track_width_error", "rear_m", "yaw_rate_scale", ("scale",), 0.03),
        ("yaw_rate_scale", "scale", "track_width_error", ("rear_m", "front_m"), 0.045),
    ],
)
def test_a_value_is_as_uncertain_as_what_reads_the_same_is_usual(
    effect: str, parameter: str, beside: str, others: tuple[str, ...], usual: float
) -> None:
    """Responses that are the same: the value may be that of the other effect, which counts once, however many
    hypotheses it has."""
    u = directions(2)
    responses = PER_METRE * np.stack([u[:, 0], u[:, 0], u[:, 1]], axis=1)
    asked = Term(effect, columns(1, width=4), (parameter,), 3.5)
    singles = [Term(beside, columns(2 + k, width=4), (name,), 3.5) for k, name in enumerate(others)]
    whole = Term(beside, columns(*(2 + k for k in range(len(others))), width=4), others, 7.0)
    made = noiseless(10.0 * usual * responses[:, 0], responses)
    (found,) = Selector(made, Given(4, [asked, *singles, whole], [])).selection_of([asked]).chosen

    assert found.stds[0] == pytest.approx(np.hypot(usual, 1.0 / PER_METRE), rel=0.05)


def test_slip_is_as_uncertain_as_the_load_that_no_name_is_given() -> None:
    """A usual load transfer moves the slip that is told without it: the interval holds the true slip, and the
    value is the one with which the model predicts. In closed form: of the
    load its prior is known, and what the second direction shows of it."""
    slip, load, per_slip = 4e-3, 8e-5, 6e4
    u = directions(2)
    responses = per_slip * np.stack([u[:, 0], -6.0 * u[:, 0] + 0.3 * u[:, 1]], axis=1)
    asked = Term("longitudinal_slip", columns(1, width=3), ("slip_per_accel",), 3.5)
    usual = Term("load_transfer_longitudinal", columns(2, width=3), ("coefficient",), 3.5)
    made = noiseless(slip * responses[:, 0] + load * responses[:, 1], responses)
    (found,) = Selector(made, Given(3, [asked, usual], [])).selection_of([asked]).chosen

    assert found.values[0] == pytest.approx(slip - 6.0 * load)
    prior, seen = prior_rms(usual.kind_of, "coefficient"), 1.0 / (0.3 * per_slip)
    share = prior**2 / (prior**2 + seen**2)
    spread = np.hypot(1.0 / per_slip, 6.0 * np.sqrt(share) * seen)
    assert found.stds[0] == pytest.approx(np.hypot(spread, 6.0 * share * load), rel=0.01)
