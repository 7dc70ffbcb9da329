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

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

from tpmsd.car.physics.effect import NoiseResemblance
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.hypotheses.group_gain import group_gain
from tpmsd.offline.diagnosis.hypotheses.terms import Term
from tpmsd.offline.diagnosis.prepared.drive_regression import DriveRegression
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.diagnosis.refinement.refine import exact_term
from tpmsd.offline.diagnosis.robustness.confirm import acts_on_all_read_wheels, gain_under_other_noise
from tpmsd.offline.diagnosis.robustness.found_terms import FoundTerms
from tpmsd.offline.diagnosis.robustness.with_drift import as_wide_as, fit_ramps_with_drift
from tpmsd.offline.diagnosis.selection.chosen import Selection
from tpmsd.offline.diagnosis.selection.selector import Selector
from tpmsd.offline.diagnosis.settings import SETTINGS
from tpmsd.offline.inference.noise import Noise, with_usual_drift
from tpmsd.offline.inference.noise_fit import RADIUS_DRIFT, VELOCITY, log_posterior, refit


@dataclass(frozen=True)
class NoiseFit:
    """A model of a drive with the radius drift that is likeliest jointly with it."""

    log_likelihood: float
    noise: Noise


def add_radius_change(
    found: FoundTerms, earlier: Selection, tried: Sequence[Sequence[Term]] = ()
) -> FoundTerms:
    """Return the findings with the change of a radius that is likelier than radius drift. Only single drives
    are tested, and for one change: where radii drift far, what is left beside it is the road's own. A change
    that was chosen earlier is asked for with the values that it had.
    `tried` are the sets of terms that were chosen beside another drift. Which terms a drive shows depends on
    the drift, and the drift on the terms: a slope that is missing makes the drift in which a loss of air is
    nothing unusual. So a change is also asked for together with the terms that it was chosen with.
    """
    before, drive = found.regression, found.regression.drives[0]
    if len(before.drives) > 1 or drive.noise.radius_drift < SETTINGS.robustness.drifts_from:
        return found
    terms = [one.term for one in found.selection.chosen]
    drifting = _with_likeliest_noise(drive, Selector(found.evidence, before.hypotheses).design(terms))
    regression = before.copied().with_noise({0: drifting.noise})
    taken = {term.key for term in terms}
    likely = _likely_changes(regression, terms, drifting, earlier)
    terms, likely = ([as_wide_as(regression, one) for one in some] for some in (terms, likely))
    models = _WholeModels(regression)
    alone = models.score(terms)
    best = max([[*terms, one] for one in likely], key=models.score, default=terms)
    if starts := _sets_with_one_change(tried, taken):
        models, best = _likeliest_set(models, starts, terms, best)
    if models.score(best) <= alone:
        return found
    regression = models.regression.with_noise({0: models.likeliest_noise(best).noise})
    evidence = regression.evidence()
    judged = Selector(evidence, regression.hypotheses, last=True).selection_of(best)
    events = {one.term.key for one in judged.chosen if one.term.ramp or one.term.pulse}
    return FoundTerms(regression, judged, evidence) if events - taken else found


def _likely_changes(
    regression: Regression, terms: Sequence[Term], drifting: NoiseFit, earlier: Selection
) -> list[Term]:
    """Return the changes of radii of an earlier selection that are no longer chosen, and the likeliest new
    change or event."""
    taken = {term.key for term in terms}
    likely = [one.term for one in earlier.chosen if one.term.ramp and one.term.key not in taken]
    term = _likeliest_change(regression, terms, drifting)
    if term is not None:
        here = regression.evidence()
        likely.append(
            exact_term(regression, here, Selector(here, regression.hypotheses).design(list(terms)), term)
        )
    return likely


def _likeliest_set(
    models: _WholeModels, starts: Sequence[Sequence[Term]], terms: list[Term], best: list[Term]
) -> tuple[_WholeModels, list[Term]]:
    """Return the likeliest set that the starts lead to, its change exact, and the models it is one of; those
    given and `best` where that, the present terms or the set without its change score as high."""
    regression = models.regression
    wide = [[as_wide_as(regression, term) for term in start] for start in starts]
    likeliest = max(_best_sets_under_less_drift(regression, wide, terms), key=models.score)
    refined, exactly = fit_ramps_with_drift(
        regression.with_noise({0: models.likeliest_noise(likeliest).noise}), likeliest
    )
    among = _WholeModels(refined)
    # What the other terms of the set bring is no merit of the change.
    without = [term for term in exactly if not term.ramp]
    if among.score(exactly) > max(models.score(terms), models.score(best), among.score(without)):
        return among, exactly
    return models, best


def _sets_with_one_change(
    tried: Sequence[Sequence[Term]], taken: Collection[tuple[str, ...]]
) -> list[list[Term]]:
    """Return the sets of terms, each with one of its changes of a radius that is not chosen already."""
    return [
        [one, *(term for term in terms if not term.ramp)]
        for terms in tried
        for one in terms
        if one.ramp and one.key not in taken
    ]


class _WholeModels:
    """Sets of terms of one drive, each with the radius drift that is likeliest beside it."""

    def __init__(self, regression: Regression) -> None:
        self.regression, self._drive = regression, regression.drives[0]
        self._selector = Selector(regression.evidence(), regression.hypotheses)
        self._fitted: dict[tuple[Term, ...], NoiseFit] = {}

    def likeliest_noise(self, terms: Sequence[Term]) -> NoiseFit:
        """Return the likeliest noise fitted jointly with a set of terms, and its log posterior."""
        key = tuple(terms)
        if key not in self._fitted:
            self._fitted[key] = _with_likeliest_noise(self._drive, self._selector.design(list(terms)))
        return self._fitted[key]

    def score(self, terms: Sequence[Term]) -> float:
        """Return the log posterior of a set of terms less the gain that they need (nats)."""
        return self.likeliest_noise(terms).log_likelihood - _total_needed_gain(terms)


def _best_sets_under_less_drift(
    regression: Regression, starts: Sequence[list[Term]], pool: Sequence[Term]
) -> list[list[Term]]:
    """Return the best set from each start beside less drift than was estimated, for some sizes of it."""
    out, noise = [], regression.drives[0].noise
    for share in SETTINGS.robustness.drift_levels[1:]:
        less = replace(with_usual_drift(noise), radius_drift=share * noise.radius_drift)
        under = regression.with_noise({0: less})
        selector = Selector(under.evidence(), under.hypotheses, last=True)
        out += [_stepwise_best_set(selector, start, pool) for start in starts]
    return out


def _stepwise_best_set(selector: Selector, start: list[Term], pool: Sequence[Term]) -> list[Term]:
    """Return the set from which no step brings more: a term added, of a pool or of those that bring most
    beside the set, or one left out that is no change of a radius. No event and no spline term is added."""

    def penalised(terms: list[Term]) -> float:
        return selector.gain(terms) - _total_needed_gain(terms)

    best, before = start, None
    while best is not before:
        before, keys = best, {term.key for term in best}
        foremost = [added[0] for _, added in selector.best_candidates(best) if len(added) == 1]
        steps = [[*best[:k], *best[k + 1 :]] for k, term in enumerate(best) if not term.ramp]
        steps += [
            [*best, term]
            for term in [*pool, *foremost]
            if term.key not in keys and not (term.ramp or term.pulse or term.nonparametric)
        ]
        best = max([best, *steps], key=penalised)
    return best


def _total_needed_gain(terms: Sequence[Term]) -> float:
    """Return the gain (nats) that terms need in sum to be chosen."""
    return sum(term.penalty + SETTINGS.selection.admit_nats for term in terms)


def add_velocity_error(found: FoundTerms) -> FoundTerms:
    """Return the findings with the constant error of the receiver's velocity, where it is likelier.

    Likelier than slow noise of its speed; single drives only.
    """
    regression, drive = found.regression, found.regression.drives[0]
    if len(regression.drives) > 1:
        return found
    terms = [one.term for one in found.selection.chosen]
    selector = Selector(found.evidence, regression.hypotheses)
    design = selector.design(terms)
    quiet = min(SETTINGS.robustness.drift_levels) * drive.noise.speed_mps
    calm = drive.with_noise(replace(drive.noise, speed_mps=quiet))
    chosen = {term.effect for term in terms}
    likely: list[Term] = []
    for term in regression.hypotheses.catalogue:
        if term.kind_of.confounding.resembles is NoiseResemblance.VELOCITY and term.effect not in chosen:
            most = gain_under_other_noise(
                regression, selector.design([*terms, term]), design.shape[1], {0: calm}
            )
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
    regression = regression.with_noise({0: jointly.noise})
    evidence = regression.evidence()
    judged = Selector(evidence, regression.hypotheses, last=True).selection_of([*terms, term])
    return (
        FoundTerms(regression, judged, evidence) if any(one.term is term for one in judged.chosen) else found
    )


def _with_likeliest_noise(
    drive: DriveRegression, design: FloatArray, names: Sequence[str] = RADIUS_DRIFT
) -> NoiseFit:
    """Return the likeliest slow noise of these names beside a design: there may be two, a far and slow one
    and a near and quick one.
    """
    windows, columns = drive.reader.windows, drive.data_and_design(design)
    default = replace(drive.noise, **{name: getattr(Noise, name) for name in names})
    found = [refit(windows, columns, start, drive.inflate, names) for start in (drive.noise, default)]
    models = [NoiseFit(log_posterior(windows, columns, noise, drive.inflate), noise) for noise in found]
    return max(models, key=lambda model: model.log_likelihood)


def _likeliest_change(regression: Regression, terms: Sequence[Term], drifting: NoiseFit) -> Term | None:
    """Return the change or event on the grid with the likeliest model, over some sizes of the drift; None
    without one."""
    drive = regression.drives[0]
    best: tuple[float, Term] | None = None
    for share in SETTINGS.robustness.drift_levels:
        tried = drive.with_noise(replace(drifting.noise, radius_drift=share * drifting.noise.radius_drift))
        selector = Selector(regression.with_drives([tried]).evidence(), regression.hypotheses, last=True)
        design = selector.design(terms)
        gram, b = selector.evidence.projected(design)
        alone = log_posterior(drive.reader.windows, drive.data_and_design(design), tried.noise, tried.inflate)
        found = regression.hypotheses.ramp_gains(gram, b) + regression.hypotheses.pulse_gains(gram, b)
        own = [term for term in regression.hypotheses.catalogue if term.ramp or term.pulse]
        found += [(group_gain(term.design[1:], gram, b)[0], term) for term in own]
        # A term on all wheels is identified by the receiver, not by the drift of single radii.
        taken = {term.key for term in terms}
        usable = [
            (gain, term)
            for gain, term in found
            if term.key not in taken and not acts_on_all_read_wheels(regression, term)
        ]
        for gain, term in sorted(usable, key=lambda entry: entry[1].penalty - entry[0])[
            : SETTINGS.robustness.judged
        ]:
            # What a few blocks decide is less sure than it looks.
            margin = alone + gain / selector.variance_ratio([*terms, term], len(terms)) - term.penalty
            if best is None or margin > best[0]:
                best = (margin, term)
    return None if best is None else best[1]
