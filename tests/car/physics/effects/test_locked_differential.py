"""An axle whose wheels turn alike."""

from __future__ import annotations

import numpy as np
import pytest

from tests.car.physics.motions import car, steady
from tpmsd.car.physics.catalogue import EFFECTS, make_effect
from tpmsd.car.physics.forward import wheel_rates
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.wheels import FL, FR, RL, RR


@pytest.mark.parametrize(("share", "left", "right"), [(1.0, 10.0, 10.0), (0.5, 9.81, 10.19)])
def test_locked_wheels_turn_at_the_speed_of_the_axle(share: float, left: float, right: float) -> None:
    """At 10 m/s and 0.5 rad/s rear hubs pass at 10 -+ 0.38 m/s: locked wheels turn at 10 m/s, half locked
    ones half as far apart."""
    model = ExtendedModel((make_effect("locked_differential", coefficient=share),))
    rim = wheel_rates(steady(10.0, 0.5), car("rear"), model)[10] * 0.316

    assert (rim[RL], rim[RR]) == pytest.approx((left, right), rel=1e-9)


def test_the_other_axle_and_straights_know_nothing_of_it() -> None:
    """Front wheels of a car with a driven rear axle roll as ever, and on a straight all do."""
    effect = make_effect("locked_differential", coefficient=1.0)
    bend = effect.wheel_slip(steady(10.0, 0.5), car("rear"))

    assert not np.any(bend[:, [FL, FR]])
    assert not np.any(effect.wheel_slip(steady(10.0), car("rear")))
    assert ("rl", "rr") == type(effect).acting_wheels(car("rear"), ("coefficient",))


def test_what_a_track_can_be_is_no_lock() -> None:
    """It costs odds of fifty more than a track error, which no fit takes beyond 0.25 m, c = 0.15."""
    cls, track = EFFECTS["locked_differential"], EFFECTS["track_width_error"]

    assert cls.penalty(0.1) == track.penalty(-0.15) + 4.0
    assert cls.confounding.limit == track.name
    assert track.limits(car())["rear_m"] == (-0.25, 0.25)
    with pytest.raises(ConfigError, match="coefficient = 9 is outside"):
        make_effect("locked_differential", coefficient=9)
