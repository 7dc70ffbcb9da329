"""A wheel of another size."""

from __future__ import annotations

from tests.car.physics.motions import car, steady
from tpmsd.car.physics.catalogue import EFFECTS, make_effect, probes


def test_one_wheel_is_smaller_from_the_start_to_the_end() -> None:
    """A spare that is 10 mm smaller at the rear right."""
    change = make_effect("spare_or_mixed_tyre", wheel="rr", deviation_m=-0.01).radius_change_m(
        steady(), car()
    )

    assert [0.0, 0.0, 0.0, -0.01] == change[0].tolist() == change[-1].tolist()


def test_it_is_no_hypothesis_for_calibration_takes_it_up() -> None:
    """No fit has a column of it; what reads the same is named."""
    assert "spare_or_mixed_tyre" not in {probe.effect for probe in probes()}
    for name in EFFECTS["spare_or_mixed_tyre"].confounding.confounded:
        assert name in EFFECTS
