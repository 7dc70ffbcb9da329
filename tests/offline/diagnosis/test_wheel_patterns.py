"""Every wheel pattern that a term can have can be reported."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.worlds.kinematic import Spec, drive
from tests.offline.diagnosis.recorded import recording_of
from tpmsd.foundation.wheels import WHEELS
from tpmsd.offline.diagnosis.hypotheses.terms import Term, patterns, wheels_acted_on
from tpmsd.offline.diagnosis.prepared.admission import admitted_readers
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.diagnosis.reporting.findings import report
from tpmsd.offline.diagnosis.robustness.verdict import is_outweighed
from tpmsd.offline.diagnosis.selection.chosen import Chosen
from tpmsd.offline.diagnosis.selection.selector import Selector


@pytest.fixture(scope="module")
def regressions() -> tuple[Regression, Regression]:
    """Two short drives, one alone and both together."""
    made = [recording_of(drive(Spec(duration_s=150.0, road="rural"), seed)) for seed in (4, 5)]
    readers, _ = admitted_readers(made)
    return Regression(readers[:1]), Regression(readers)


def terms_of(regression: Regression) -> list[Term]:
    """One term of every kind, wheel pattern and group of wheels that the regression's hypotheses make."""
    hypotheses = regression.hypotheses
    gram, b = regression.evidence().projected(hypotheses.nuisance)
    scanned = [
        term
        for gains in (hypotheses.smooth_gains, hypotheses.ramp_gains, hypotheses.pulse_gains)
        for _, term in gains(gram, b)
    ]
    every = [*hypotheses.catalogue, *hypotheses.splines, *scanned]
    kinds = {
        (term.effect, term.pattern, term.wheel, term.pulse): term for term in every if not term.calibrates
    }
    return list(kinds.values())


def chosen(term: Term, gain: float) -> Chosen:
    """A term with values of usual size."""
    values = np.full(term.design.shape[1], 1e-3)
    return Chosen(term, gain, gain, gain, 1.0, (), values, 0.1 * values)


def test_all_patterns_of_the_hypotheses_are_walked(regressions: tuple[Regression, Regression]) -> None:
    """Each pattern is met in a term, so that no pattern escapes the reports below."""
    names = {name for name, _ in patterns()}

    for regression in regressions:
        assert names <= {term.pattern for term in terms_of(regression)}


@pytest.mark.parametrize("number", [0, 1])
def test_every_pattern_is_held_against_an_effect_on_the_same_wheels(
    regressions: tuple[Regression, Regression], number: int
) -> None:
    """An instrument's effect on fl loses to a stronger spline on any pattern with fl, and to no other."""
    terms = terms_of(regressions[number])
    missed = next(t for t in terms if (t.effect, t.pattern) == ("counter_missed_pulses", "fl"))
    selection = Selector(regressions[number].evidence(), regressions[number].hypotheses).selection_of([])
    found = {}
    for term in terms:
        if term.nonparametric and not term.pulse:
            both = replace(selection, chosen=(chosen(missed, 9.0), chosen(term, 10.0)))
            found[term.pattern] = is_outweighed(both.chosen[0], both)

    assert {name: "fl" in dict(signed) for name, signed in patterns()} == found


def test_every_pattern_has_its_wheels() -> None:
    """A contrast acts on the wheels of either sign, a reading on none."""
    for name, signed in patterns():
        assert {wheel for wheel, _ in signed if wheel in WHEELS} == set(wheels_acted_on(name))
    assert WHEELS == wheels_acted_on("")


@pytest.mark.parametrize("number", [0, 1])
def test_every_pattern_is_reported(regressions: tuple[Regression, Regression], number: int) -> None:
    """Findings on all patterns, beside an effect of an instrument on wheels, end in a report with their
    wheels."""
    regression = regressions[number]
    evidence = regression.evidence()
    selector = Selector(evidence, regression.hypotheses)
    gram, b = evidence.projected(regression.hypotheses.nuisance)
    common = [term for _, term in regression.hypotheses.smooth_gains(gram, b) if term.drive is None]
    covariates = sorted({term.covariate for term in common})
    # Over a covariate of its own each, for all, front and rear over one are not told apart.
    wanted = {name: covariates[k % len(covariates)] for k, (name, _) in enumerate(patterns())}
    splines = [term for term in common if wanted[term.pattern] == term.covariate]
    missed = next(t for t in terms_of(regression) if (t.effect, t.pattern) == ("counter_missed_pulses", "fl"))
    selection = replace(
        selector.selection_of([]),
        chosen=(chosen(missed, 9.0), *(chosen(term, 10.0) for term in splines)),
        fit=evidence.fit(selector.design([missed, *splines])),
    )
    findings = [one for one in report(regression, selection, evidence).findings if one.effect == "unknown"]

    assert len(wanted) == len(splines)
    assert [set(wheels_acted_on(term.pattern)) for term in splines] == [set(f.where.wheels) for f in findings]
