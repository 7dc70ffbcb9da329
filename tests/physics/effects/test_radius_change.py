"""A tyre that changes, or several alike."""

from __future__ import annotations

import pytest

from tests.physics.motions import car, steady
from tpmsd.physics.catalogue import make_effect


@pytest.mark.parametrize(("wheel", "acts"), [("rl", [0, 0, 1, 0]), ("rr rl", [0, 0, 1, 1])])
def test_the_wheels_that_are_named_change(wheel: str, acts: list[int]) -> None:
    """By the whole deviation once the ramp is over; the others stay."""
    effect = make_effect("radius_change", wheel=wheel, deviation_m=-1e-3, onset_s=1.0, duration_s=2.0)

    assert (
        pytest.approx([-1e-3 * one for one in acts])
        == effect.radius_change_m(steady(20.0), car())[-1].tolist()
    )


@pytest.mark.parametrize("wheel", ["", "xx", "rl xx", 3])
def test_no_other_word_is_a_wheel(wheel: object) -> None:
    """None, or one that no car has."""
    with pytest.raises(ValueError, match="wheel"):
        make_effect("radius_change", wheel=wheel, deviation_m=-1e-3)


def test_several_wheels_are_named_in_the_order_of_the_car() -> None:
    """However they were written."""
    effect = make_effect("radius_change", wheel="rr  rl rr", deviation_m=-1e-3)

    assert "rl rr" == effect.wheels  # type: ignore[attr-defined]
