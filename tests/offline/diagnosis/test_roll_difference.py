"""Load that bends shift more on one axle than on the other."""

from __future__ import annotations

from dataclasses import replace

import pytest

from bench.worlds.kinematic import Spec, drive
from tests.offline.diagnosis.recorded import recording_of
from tpmsd.car.physics.catalogue import make_effect
from tpmsd.offline.diagnosis.prepared.admission import admitted_readers
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.diagnosis.selection.selector import Selector

C, D = 1.2e-4, -5e-5


def test_the_diagonal_that_stiffness_in_roll_leaves_is_no_error_of_the_track() -> None:
    """Rear wheels change by 2.4 times as much as the front ones: both coefficients come out, and no other
    effect takes the diagonal."""
    recording = recording_of(drive(Spec(duration_s=400.0, road="city", radius_drift=0.0), 8))
    reader = Regression(admitted_readers([recording])[0]).drives[0].reader
    truth = make_effect("load_transfer_lateral", coefficient=C, front_more=D)
    change = truth.radius_change_m(reader.reference.motion, reader.reference.car)
    turns = recording.rotation_rad / (1.0 + change[: recording.ticks] / recording.car.radius_m)
    regression = Regression(admitted_readers([replace(recording, rotation_rad=turns)])[0])

    chosen = Selector(regression.evidence(), regression.hypotheses, last=True).select().chosen

    assert ["load_transfer_lateral"] == [one.term.effect for one in chosen]
    (found,) = chosen
    assert ("coefficient", "front_more") == found.term.parameters
    for true, value, std in zip((C, D), found.values, found.stds, strict=True):
        assert value == pytest.approx(true, abs=3.0 * std)
        assert std < 1e-5
