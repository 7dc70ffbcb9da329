"""What one more effect changes, by the channels on which it acts, against two predictions in full."""

from __future__ import annotations

import numpy as np
import pytest

from bench.worlds.kinematic import Spec, drive
from tests.offline.diagnosis.recorded import recording_of
from tpmsd.car.physics.catalogue import TEETH, make_effect, probes
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.offline.inference.trajectory import reference
from tpmsd.offline.inference.windows import Reader

BASES = {
    "rolling": ExtendedModel(),
    "slip and growth": ExtendedModel(
        (
            make_effect("centrifugal_growth", coefficient=2e-6),
            make_effect("longitudinal_slip", slip_per_accel=3e-3, slip_per_speed2=1e-6),
            make_effect("lateral_slip", coefficient=-2e-3),
        )
    ),
    "teeth": ExtendedModel((make_effect(TEETH.name, wheel="rl", teeth_per_rev=47.0),)),
}


@pytest.fixture(scope="module")
def reader() -> Reader:
    """Five minutes with hills."""
    recording = recording_of(drive(Spec(duration_s=300.0, hilly=0.03), 3), counted=True)
    return Reader(recording, reference(recording))


@pytest.mark.parametrize("base", BASES.values(), ids=BASES.keys())
def test_a_change_is_the_difference_of_two_predictions(reader: Reader, base: ExtendedModel) -> None:
    """Every effect that is looked for in windows changes no other channels than those that are predicted, and
    these by what two full predictions part by, up to rounding."""
    before = reader.predict(base)
    scale = np.nanmax(np.abs(before), axis=0)
    for probe in probes():
        effect = probe.probing_effect()
        expected = np.nan_to_num(reader.predict(base.plus(effect)) - before)

        assert np.abs(expected - reader.change(base, effect)).max(axis=0) == pytest.approx(
            np.zeros(9), abs=1e-10 * float(scale.max())
        ), probe.key
