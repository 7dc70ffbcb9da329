"""Names that a recording holds of its own are told from those that a concealed effect leaves."""

from __future__ import annotations

from dataclasses import replace

import pytest

from bench.campaigns.offline.of_the_recording import paired
from bench.worlds.kinematic import Spec, drive
from tests.offline.diagnosis.recorded import recording_of
from tpmsd.car.physics.catalogue import make_effect
from tpmsd.offline.diagnosis.prepared.admission import admitted_readers
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.diagnosis.robustness.found_terms import FoundTerms
from tpmsd.offline.diagnosis.selection.selector import Selector
from tpmsd.offline.inference.recording import Recording


def found(recording: Recording, names: tuple[str, ...]) -> FoundTerms:
    """These effects, judged on a recording."""
    regression = Regression(admitted_readers([recording])[0])
    evidence = regression.evidence()
    single = [one for one in regression.hypotheses.catalogue if len(one.parameters) == 1]
    terms = [next(one for one in single if one.effect == name) for name in names]
    return FoundTerms(regression, Selector(evidence, regression.hypotheses).selection_of(terms), evidence)


def test_a_load_of_the_recording_is_its_own_and_one_that_was_added_is_not() -> None:
    """Bends shift load in one of two recordings; latency is concealed in it; both are asked for the load."""
    plain = recording_of(drive(Spec(duration_s=240.0, road="city", radius_drift=0.0), 8))
    reader = Regression(admitted_readers([plain])[0]).drives[0].reader
    truth = make_effect("load_transfer_lateral", coefficient=2e-4)
    change = truth.radius_change_m(reader.reference.motion, reader.reference.car)
    loaded = replace(
        plain, rotation_rad=plain.rotation_rad / (1.0 + change[: plain.ticks] / plain.car.radius_m)
    )
    late = replace(loaded, fix_time_s=loaded.fix_time_s + 0.3)
    case = found(late, ("load_transfer_lateral", "gnss_latency"))

    (own,) = paired(found(loaded, ()), case, "gnss_latency")
    (added,) = paired(found(plain, ()), case, "gnss_latency")

    assert own.own
    assert own.values[0] == pytest.approx(2e-4, abs=3.0 * own.stds[0])
    assert not added.own
