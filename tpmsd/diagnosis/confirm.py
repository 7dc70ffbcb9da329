"""Confirms faint effects that only the receiver can see, against slow noise that could make them.

In: a `Study` and its `Selection`. Out: both without the terms that do not stand.

Warm-up, growth with speed and slopes act on all wheels alike, so that only the receiver shows them, as a
slow drift. With such a term in the model the receiver's slow error is estimated smaller than it is, and
the term looks the surer for it. So the term is asked again under the noise that fits best without it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from tpmsd.diagnosis.evidence import Evidence
from tpmsd.diagnosis.noise_fit import PRIORS, SLOW, log_posterior, refit_slow
from tpmsd.diagnosis.selection import ADMIT, Selection, Selector

if TYPE_CHECKING:
    from tpmsd.diagnosis.diagnose import Study

COMMON = ("thermal_growth", "centrifugal_growth", "road_grade")
SURE = 80.0
"""Log-likelihood beyond which no slow noise is the reason."""


def confirmed(study: Study, selection: Selection, evidence: Evidence) -> tuple[Selection, Evidence]:
    """Take out the common terms that the noise explains as well."""
    for one in selection.chosen:
        if not (one.term.effect in COMMON or one.term.place == "all") or one.gain > SURE:
            continue
        windows = study.reader.windows
        terms = [other.term for other in selection.chosen if other is not one]
        selector = Selector(evidence, study.hypotheses)
        without = study.believed(selector.design(terms))
        with_it = study.believed(selector.design([*terms, one.term]))
        null = refit_slow(windows, without, study.noise, study.inflate)
        middles: dict[str, Any] = {name: PRIORS[name][0] for name in SLOW}
        usual = replace(study.noise, **middles)
        other = refit_slow(windows, without, usual, study.inflate)
        if log_posterior(windows, without, other, study.inflate) > log_posterior(
            windows, without, null, study.inflate
        ):
            null = other
        best_with = log_posterior(windows, with_it, null, study.inflate)
        if best_with - log_posterior(windows, without, null, study.inflate) < ADMIT + one.term.penalty:
            study.noise = null
            evidence = study.evidence()
            selection = Selector(evidence, study.hypotheses).judged(terms)
            return confirmed(study, selection, evidence)
    return selection, evidence
