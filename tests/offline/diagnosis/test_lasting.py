"""Wheels that slip are told from a receiver that errs, where only the receiver shows it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from bench.worlds.kinematic import Spec, drive
from tests.offline.diagnosis.recorded import recording_of
from tpmsd.offline.diagnosis.hypotheses.terms import Term
from tpmsd.offline.diagnosis.prepared.admission import admitted_readers
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.diagnosis.refinement.refine import exact_term
from tpmsd.offline.diagnosis.robustness.found_terms import FoundTerms
from tpmsd.offline.diagnosis.robustness.receiver_outliers import jump_evidence, remove_receiver_events
from tpmsd.offline.diagnosis.selection.selector import Selector
from tpmsd.offline.diagnosis.stages import with_estimated_noise
from tpmsd.offline.inference.least_squares import Evidence
from tpmsd.offline.inference.noise_fit import SearchStage
from tpmsd.offline.inference.recording import Recording

BEGIN_S = 120.0


def two_wheels() -> Recording:
    """A car of which the rear wheels are read, both driven."""
    recording = recording_of(drive(Spec(duration_s=240.0, road="rural", driven="rear"), 8))
    rotation = recording.rotation_rad.copy()
    rotation[:, :2] = np.nan
    return replace(recording, rotation_rad=rotation)


def slipping(recording: Recording) -> Recording:
    """Both wheels spin by 3 % for 12 s."""
    times = recording.edges_s[:-1]
    on = (times >= BEGIN_S) & (times < BEGIN_S + 12.0)
    return replace(recording, rotation_rad=recording.rotation_rad * (1.0 + 0.03 * on[:, None]))


def erring(recording: Recording) -> Recording:
    """The receiver's speed is 2 m/s too low for 2 s, and so is the way that its positions make."""
    times = recording.fix_time_s
    on = (times >= BEGIN_S) & (times < BEGIN_S + 2.0)
    behind = 2.0 * np.clip(times - BEGIN_S, 0.0, 2.0)
    ahead = np.unwrap(recording.course_rad[np.isfinite(recording.course_rad)])
    course = np.interp(times, times[np.isfinite(recording.course_rad)], ahead)
    return replace(
        recording,
        speed_mps=recording.speed_mps - 2.0 * on,
        east_m=recording.east_m - behind * np.cos(course) * on,
        north_m=recording.north_m - behind * np.sin(course) * on,
    )


def looked_at(happens: Callable[[Recording], Recording]) -> tuple[Regression, Evidence, Term]:
    """A drive under the noise that it has without what happens, and the event that shows most."""
    usual, regression = (
        Regression(admitted_readers([one])[0]) for one in (two_wheels(), happens(two_wheels()))
    )
    usual = with_estimated_noise(usual, usual.hypotheses.nuisance, SearchStage.SECOND)
    regression = regression.with_noise({0: usual.drives[0].noise})
    evidence = regression.evidence()
    gram, b = evidence.projected(regression.hypotheses.nuisance)
    events = [entry for entry in regression.hypotheses.pulse_gains(gram, b) if entry[1].pattern == "rear"]
    gain, event = max(events, key=lambda entry: entry[0])
    assert gain > 40.0
    return regression, evidence, event


@pytest.mark.parametrize(("happens", "stands"), [(slipping, True), (erring, False)])
def test_slip_that_only_the_receiver_shows_must_last(
    happens: Callable[[Recording], Recording], stands: bool
) -> None:
    """Twelve seconds of slip stand; two seconds in which the receiver errs do not, though they gain more."""
    regression, evidence, event = looked_at(happens)
    selector = Selector(evidence, regression.hypotheses, last=True)

    found = remove_receiver_events(FoundTerms(regression, selector.selection_of([event]), evidence))

    assert stands == (len(found.selection.chosen) == 1)


def test_where_an_event_goes_the_rest_is_chosen_again() -> None:
    """Fixes 0.2 s late were not chosen beside an error of the receiver; without it they are."""

    def late(recording: Recording) -> Recording:
        return replace(erring(recording), fix_time_s=recording.fix_time_s + 0.2)

    regression, evidence, event = looked_at(late)
    event = exact_term(regression, evidence, regression.hypotheses.nuisance, event)
    evidence = regression.evidence()
    before = Selector(evidence, regression.hypotheses, last=True).selection_of([event])

    found = remove_receiver_events(FoundTerms(regression, before, evidence))

    assert [event.effect] == [one.term.effect for one in before.chosen]
    assert ["gnss_latency"] == [one.term.effect for one in found.selection.chosen]


@pytest.mark.parametrize(("happens", "by_wheels"), [(slipping, True), (erring, False)])
def test_the_wheels_speed_separates_slip_from_an_error_of_the_receiver(
    happens: Callable[[Recording], Recording], by_wheels: bool
) -> None:
    """Wheels that spin jump in their own speed; a receiver that errs leaves the wheels smooth."""
    regression, evidence, event = looked_at(happens)
    event = exact_term(regression, evidence, regression.hypotheses.nuisance, event)
    (one,) = Selector(regression.evidence(), regression.hypotheses).selection_of([event]).chosen

    nats = jump_evidence(regression.drives[0], one)

    assert by_wheels == (nats > 5.0)
    assert by_wheels != (nats < -5.0)
