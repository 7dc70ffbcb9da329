"""Names what the noise model took for slow noise: a change of a radius, an event, a constant velocity error.

In: `FoundTerms`. Out: the same with the term that a drive demands, and the noise fitted jointly.

How much radii drift is estimated from the drive, and a change that stays raises that estimate, the more the
larger it is: a step of 2 mm makes a drift of 0.7 mm, in which it is nothing unusual. Gains under one noise
cannot tell the two apart. So two models of the drive are compared as wholes, each with the drift that is
likeliest in it (generalised likelihood ratio; the jump of Willsky and Jones, IEEE Transactions on Automatic
Control 21, 1976): radii that drift alone, and radii that drift and change.

The same holds of the receiver's speed. Along a motorway a heading changes within minutes, so an error that
stands in the earth's frame is a slow error of speed, and the noise estimated with it in the drive holds it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from tpmsd.car.physics.effect import NoiseResemblance
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.hypotheses.group_gain import group_gain
from tpmsd.offline.diagnosis.hypotheses.terms import Term
from tpmsd.offline.diagnosis.prepared.drive_regression import DriveRegression
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.diagnosis.refinement.refine import exact
from tpmsd.offline.diagnosis.robustness.confirm import of_all_read, under_other_noise
from tpmsd.offline.diagnosis.robustness.found_terms import FoundTerms
from tpmsd.offline.diagnosis.robustness.with_drift import as_wide_as
from tpmsd.offline.diagnosis.selection.chosen import Selection
from tpmsd.offline.diagnosis.selection.selector import Selector
from tpmsd.offline.diagnosis.settings import SETTINGS
from tpmsd.offline.inference.noise import Noise
from tpmsd.offline.inference.noise_fit import RADIUS_DRIFT, VELOCITY, log_posterior, refit


@dataclass(frozen=True)
class NoiseFit:
    """A model of a drive with the radius drift that is likeliest jointly with it."""

    log_likelihood: float
    noise: Noise


def changed(found: FoundTerms, earlier: Selection) -> FoundTerms:
    """Add the change that is likelier than drift. Only single drives are tested, and for one change: where
    radii drift far, what is left beside it is the road's own. A change that was chosen earlier is asked for
    with the values that it had."""
    before, drive = found.regression, found.regression.drives[0]
    if len(before.drives) > 1 or drive.noise.radius_drift < SETTINGS.robustness.drifts_from:
        return found
    terms = [one.term for one in found.selection.chosen]
    drifting = _with_likeliest_noise(drive, Selector(found.evidence, before.hypotheses).design(terms))
    regression = before.copied().under({0: drifting.noise})
    drive = regression.drives[0]
    noise = found.regression.drives[0].noise
    taken = {term.key for term in terms}
    likely = [one.term for one in earlier.chosen if one.term.ramp and one.term.key not in taken]
    term = _likeliest(regression, terms, drifting)
    if term is not None:
        here = regression.evidence()
        likely.append(exact(regression, here, Selector(here, regression.hypotheses).design(terms), term))
    terms, likely = ([as_wide_as(regression, one) for one in some] for some in (terms, likely))
    models = [
        (
            _with_likeliest_noise(
                drive, Selector(regression.evidence(), regression.hypotheses).design([*terms, one])
            ),
            one,
        )
        for one in likely
    ]
    if models:
        jointly, term = max(models, key=lambda entry: entry[0].log_likelihood - entry[1].penalty)
        if jointly.log_likelihood - drifting.log_likelihood > term.penalty + SETTINGS.selection.admit_nats:
            terms, noise = [*terms, term], jointly.noise
    regression = regression.under({0: noise})
    evidence = regression.evidence()
    return FoundTerms(
        regression, Selector(evidence, regression.hypotheses, last=True).judged(terms), evidence
    )


def erring(found: FoundTerms) -> FoundTerms:
    """Add the constant error of the receiver's velocity that is likelier than slow noise of its speed; asked
    of single drives."""
    regression, drive = found.regression, found.regression.drives[0]
    if len(regression.drives) > 1:
        return found
    terms = [one.term for one in found.selection.chosen]
    selector = Selector(found.evidence, regression.hypotheses)
    design = selector.design(terms)
    quiet = min(SETTINGS.robustness.drift_levels) * drive.noise.speed_mps
    calm = drive.under(replace(drive.noise, speed_mps=quiet))
    chosen = {term.effect for term in terms}
    likely: list[Term] = []
    for term in regression.hypotheses.catalogue:
        if term.kind_of.confounding.resembles is NoiseResemblance.VELOCITY and term.effect not in chosen:
            most = under_other_noise(regression, selector.design([*terms, term]), design.shape[1], {0: calm})
            likely += [term] if most > term.penalty + SETTINGS.selection.admit_nats else []
    if not likely:
        return found
    alone = _with_likeliest_noise(drive, design, VELOCITY).log_likelihood
    models = [
        (_with_likeliest_noise(drive, selector.design([*terms, term]), VELOCITY), term) for term in likely
    ]
    jointly, term = max(models, key=lambda entry: entry[0].log_likelihood - entry[1].penalty)
    if jointly.log_likelihood - alone <= term.penalty + SETTINGS.selection.admit_nats:
        return found
    regression = regression.under({0: jointly.noise})
    evidence = regression.evidence()
    judged = Selector(evidence, regression.hypotheses, last=True).judged([*terms, term])
    return (
        FoundTerms(regression, judged, evidence) if any(one.term is term for one in judged.chosen) else found
    )


def _with_likeliest_noise(
    drive: DriveRegression, design: FloatArray, names: Sequence[str] = RADIUS_DRIFT
) -> NoiseFit:
    """Return the likeliest slow noise of these names beside a design: there may be two, a far and slow one
    and a near and quick one.
    """
    windows, columns = drive.reader.windows, drive.white_design(design)
    default = replace(drive.noise, **{name: getattr(Noise, name) for name in names})
    found = [refit(windows, columns, start, drive.inflate, names) for start in (drive.noise, default)]
    models = [NoiseFit(log_posterior(windows, columns, noise, drive.inflate), noise) for noise in found]
    return max(models, key=lambda model: model.log_likelihood)


def _likeliest(regression: Regression, terms: Sequence[Term], drifting: NoiseFit) -> Term | None:
    """Return the change or event on the grid that goes with the likeliest model, over some sizes of the
    drift.
    """
    drive = regression.drives[0]
    best: tuple[float, Term] | None = None
    for share in SETTINGS.robustness.drift_levels:
        tried = drive.under(replace(drifting.noise, radius_drift=share * drifting.noise.radius_drift))
        selector = Selector(regression.trial([tried]).evidence(), regression.hypotheses, last=True)
        design = selector.design(terms)
        gram, b = selector.evidence.projected(design)
        alone = log_posterior(drive.reader.windows, drive.white_design(design), tried.noise, tried.inflate)
        found = regression.hypotheses.ramp_gains(gram, b) + regression.hypotheses.pulse_gains(gram, b)
        own = [term for term in regression.hypotheses.catalogue if term.ramp or term.pulse]
        found += [(group_gain(term.design[1:], gram, b)[0], term) for term in own]
        # A term on all wheels is identified by the receiver, not by the drift of single radii.
        taken = {term.key for term in terms}
        usable = [
            (gain, term)
            for gain, term in found
            if term.key not in taken and not of_all_read(regression, term)
        ]
        for gain, term in sorted(usable, key=lambda entry: entry[1].penalty - entry[0])[
            : SETTINGS.robustness.judged
        ]:
            # What a few blocks decide is less sure than it looks.
            margin = alone + gain / selector.ratio([*terms, term], len(terms)) - term.penalty
            if best is None or margin > best[0]:
                best = (margin, term)
    return None if best is None else best[1]
