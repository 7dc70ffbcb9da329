"""Posterior of each tyre's loss, given the change of the radii.

In: the changes against the baseline, now and over the last minutes. Out: a `Judgement`: for each wheel how
probable a deflation and a deviation are, how much radius and how much pressure are lost.
"""

from __future__ import annotations

import functools
import math
from collections import deque
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from tpmsd.car.config.model import MonitorConfig, TyreConfig, VehicleConfig
from tpmsd.car.physics.motion import driven_mask
from tpmsd.car.physics.tyre import tyre_model
from tpmsd.foundation.wheels import IS_FRONT, FloatArray
from tpmsd.onboard.monitor.baseline.baseline import Change
from tpmsd.onboard.monitor.evidence.detectable import DetectableLoss, LossDetectability
from tpmsd.onboard.monitor.evidence.grip import Grip
from tpmsd.onboard.monitor.evidence.hypotheses import Comparison, Verdict
from tpmsd.onboard.monitor.evidence.nuisance import Nuisance, log_normal, variance_ratio_of_mean
from tpmsd.onboard.monitor.evidence.posterior import Posterior, Window, posterior
from tpmsd.onboard.monitor.evidence.sizes import (
    SizeHypotheses,
    TyreSizeChange,
    size_rows,
    subsets,
    unchanged_sizes,
    with_sizes,
)
from tpmsd.onboard.monitor.sampling.drive_evidence import ChangeHypotheses, ChangeSinceStart
from tpmsd.onboard.monitor.settings import BASELINE, DRIVE_EVIDENCE, JUDGE
from tpmsd.onboard.resonance.evidence import ResonanceEvidence

Weighed = tuple[FloatArray, FloatArray, FloatArray]
"""Changes (m, d), their covariances (m, d, d) and the log weights (m,) of the drive models if none has
changed."""


@dataclass(frozen=True, slots=True)
class ComparisonResult:
    """Result of one comparison of hypotheses, with the change that it is about."""

    over: Literal["now", "minutes", "drive"]
    """The time over which the change was seen."""
    verdict: Verdict
    change_m: FloatArray
    """(d,)"""
    covariance_m2: FloatArray
    """(d, d) with what is nuisance."""
    change_index: int | None = None
    """Index of the change among those of the drive; None for another comparison."""
    came: int = 0
    """Number of the last rows of sizes, which came in that time."""
    usual: float = 1.0
    """Probability that the drive is as learned, no tyre has lost air and none is of another size."""


@dataclass(frozen=True, slots=True)
class Judgement:
    """(4,) each; NaN for a wheel that is not monitored, or before anything was judged."""

    change_m: FloatArray
    change_std_m: FloatArray
    deflated: FloatArray
    """Probability of a loss beyond the threshold."""
    deviates: FloatArray
    """Probability of a change of either sign beyond its threshold."""
    possible: FloatArray
    """Probability of such a loss, or of what passes and looks the same now: an alarm is active as long."""
    loss_m: FloatArray
    pressure_loss: FloatArray
    """Share of the pressure."""
    pressure_loss_std: FloatArray
    suspicion: float
    """Log-likelihood ratio of the best loss to none; infinite if the change is nothing that is known."""
    contrast_std_m: float = math.inf
    """Largest standard deviation of one wheel's change less the mean of all."""
    now: Change | None = None
    """The change at this moment."""
    finding: ComparisonResult | None = None
    """Comparison that detects the most of a loss."""
    change_index: int | None = None
    """The likeliest of the drive's `ChangeHypotheses`, where it alone shows a loss."""
    detectability: LossDetectability | None = None
    """Knowledge that minimum detectable losses are computed of; None before anything was judged."""
    drive_models: dict[str, float] = field(default_factory=dict)
    """Posterior probability of each drive model; empty while the drive is too short."""
    unusual: float = 0.0
    """Probability that this drive is not as learned or a tyre has changed, and that no wheel slips now more,
    now less: even slip of the driven wheels looks like a loss of both."""
    all_larger: float = 0.0
    """Probability that all wheels are larger alike."""
    posterior: Posterior | None = None
    """The bank of which the probabilities are marginals; None before anything was judged."""

    @property
    def detectable(self) -> DetectableLoss | None:
        """Minimum detectable losses, computed again each time; None before anything was judged."""
        return None if self.detectability is None else self.detectability.losses()

    @property
    def all_lost(self) -> bool:
        """True if all wheels have probably lost air, which only the receiver's speed tells from no loss."""
        return self.posterior is not None and float(self.posterior.subsets[-1]) > JUDGE.undecided

    @property
    def min_hold_s(self) -> float:
        """Time for which an alarm must last before it is sent, s. One of all wheels rests on the receiver's
        speed alone, and waits until that speed was compared with the receiver's own positions."""
        return JUDGE.all_hold_s if self.all_lost else 0.0

    @property
    def slippery(self) -> float:
        """Probability that wheels slip on this drive as they have not before."""
        return Grip.low_grip_probability(self.drive_models)

    def may_learn(self, settled: bool) -> bool:
        """Return whether the baseline may learn; `settled`: it has been learned once. Nothing is learned on a
        slippery drive of a car that is known."""
        if settled and self.slippery > JUDGE.undecided:
            return False
        return self.suspicion < (JUDGE.suspicious if settled else JUDGE.suspicious_at_first)

    def by_wheel(self) -> list[tuple[float, ...]]:
        """Return for each of four wheels its change, standard deviation, probabilities of a deflation and of
        a deviation (0 where nothing was judged), lost pressure and standard deviation."""
        deflated, deviates = (
            [0.0 if math.isnan(chance) else chance for chance in chances.tolist()]
            for chances in (self.deflated, self.deviates)
        )
        change_m, std_m = self.change_m.tolist(), self.change_std_m.tolist()
        loss, loss_std = self.pressure_loss.tolist(), self.pressure_loss_std.tolist()
        return list(zip(change_m, std_m, deflated, deviates, loss, loss_std, strict=True))

    @classmethod
    def unknown(cls) -> Judgement:
        """Return the judgement before anything was judged: all NaN, of infinite suspicion."""
        nan = np.full(4, math.nan)
        return cls(nan, nan, nan, nan, nan, nan, nan, nan, math.inf)


class Judge:
    """Judges the changes of one car's radii by its thresholds and tyres."""

    def __init__(
        self,
        vehicle: VehicleConfig,
        settings: MonitorConfig,
        tyre: TyreConfig,
        wheels: list[int],
        nuisance: Nuisance = JUDGE.nuisance,
    ) -> None:
        self._wheels = wheels
        self._radius = np.array(vehicle.wheel_radius_m)[wheels]
        self._nuisance = nuisance
        self.nuisance_m2 = nuisance.covariance(wheels, self._radius)
        self._of_mean_m2: dict[int, FloatArray] = {}
        """Covariance (d, d) of the nuisance changes that a mean of so many samples keeps, m2."""
        self._tyres = [tyre_model(tyre, float(radius)) for radius in self._radius]
        self._threshold = settings.deflation_percent / 100.0
        if settings.deflation_pressure_percent is not None:
            share = settings.deflation_pressure_percent / 100.0
            losses = [-one.radius_change_m(share) for one in self._tyres]
            self._threshold = float(np.mean(np.array(losses) / self._radius))
        self._asked = settings.raise_probability
        self._grip = Grip(vehicle, wheels, self._radius)
        self._limit = settings.deviation_percent / 100.0
        self._sizes = size_rows(tuple(wheels))
        lasting = nuisance.averaged(DRIVE_EVIDENCE.lasting_share)
        self._lasting_m2 = lasting.covariance(wheels, self._radius)
        """(d, d) nuisance that lasts all drive long."""
        self._of_beginning: deque[tuple[ChangeSinceStart, TyreSizeChange]] = deque(maxlen=2)
        """Rows of sizes by what was before each of two windows."""
        self._apart = _distinguishable_members(wheels)
        members = [
            [float(index in subset) for index in range(len(wheels))] for subset in subsets(len(wheels))
        ]
        self._together = np.array(members) - self._apart
        """(s, d): 1 for the other wheels of each of `subsets`."""
        self._of_driven = ~np.any(self._together[:, ~driven_mask(vehicle.driven_axle)[wheels]] > 0.0, axis=1)
        """(s,) whether these are all driven."""
        front = IS_FRONT[wheels]
        self._axles = [mask * self._radius for mask in (front, ~front) if np.count_nonzero(mask) == 2]
        """(d,) each: radii of an axle both of whose wheels are monitored, 0 for the others."""
        self._cached: tuple[ChangeHypotheses, bool, ComparisonResult, dict[str, float], Weighed] | None = None
        """The last comparison of a drive: it changes with every sample, and is asked for every second."""

    def judge(
        self,
        now: Change,
        mean: Change,
        resonance: ResonanceEvidence | None = None,
        other_tyres: bool = False,
        change_hypotheses: ChangeHypotheses | None = None,
        before: tuple[ChangeSinceStart | None, ChangeSinceStart | None] = (None, None),
    ) -> Judgement:
        """Return the judgement of the change now and of the mean change over the last minutes; what either
        says of a wheel counts. `resonance` is evidence independent of the radii. `change_hypotheses`: those
        of the drive as a whole, None while it is too short; `before`: the change by the samples before each
        of the two changes.

        `other_tyres`: these may be others than those that were learned; what all of them or an axle do is
        then no loss, but one wheel that stands out is.
        """
        nuisance_m2 = self.nuisance_m2 + self._other_tyres_m2(other_tyres)
        ratios = self._resonance_log_ratios(resonance)
        averaged_m2 = nuisance_m2 - self.nuisance_m2 + self._nuisance_covariance_of_mean_m2(mean.samples)
        against = [self._comparison_setup(ratios, other_tyres, one) for one in before]
        of_drive: ComparisonResult | None = None
        models: dict[str, float] = {}
        similar: Weighed | None = None
        if change_hypotheses is not None:
            of_drive, models, similar = self._compare_drive(change_hypotheses, ratios, other_tyres)
        now_m2, mean_m2 = now.covariance_m2 + nuisance_m2, mean.covariance_m2 + averaged_m2
        at_once = self._compare_change("now", now, now_m2, against[0], models)
        lately = self._compare_change("minutes", mean, mean_m2, against[1], models)
        # What shows in a mean alone is slow; what shows now alone is fast.
        findings = [at_once, lately] if of_drive is None else [at_once, lately, of_drive]
        finding = max(findings, key=lambda one: float(one.verdict.deflated.max()))
        std = np.sqrt(np.diag(now.covariance_m2))
        steady, steady_m2 = mean.change_m, mean.covariance_m2 + self.nuisance_m2
        if finding is of_drive:
            steady, steady_m2 = finding.change_m, finding.covariance_m2
        pressure = [
            tyre.pressure_loss(float(x), float(s))
            for tyre, x, s in zip(self._tyres, steady, np.sqrt(np.diag(steady_m2)), strict=True)
        ]
        fits = now.fits and mean.fits
        whole = of_drive is None and mean.samples >= JUDGE.full_samples
        bank = posterior(self._windows(at_once, lately, of_drive, models, whole=whole))
        change_index = None
        if of_drive is not None and bank.deflated.max() > JUDGE.undecided:
            whole = mean.samples >= JUDGE.full_samples
            without = posterior(self._windows(at_once, lately, None, models, whole=whole))
            change_index = of_drive.change_index if without.deflated.max() <= JUDGE.undecided else None
        return Judgement(
            change_m=self._to_four_wheels(now.change_m),
            change_std_m=self._to_four_wheels(std),
            deflated=self._to_four_wheels(bank.deflated),
            deviates=self._to_four_wheels(bank.deviates),
            possible=self._to_four_wheels(bank.possible),
            loss_m=self._to_four_wheels(finding.verdict.loss_m),
            pressure_loss=self._to_four_wheels(np.array([loss for loss, _ in pressure])),
            pressure_loss_std=self._to_four_wheels(np.array([own for _, own in pressure])),
            suspicion=bank.suspicion if fits else math.inf,
            contrast_std_m=_contrast_std(now.covariance_m2),
            now=now,
            finding=finding,
            change_index=change_index,
            detectability=self._detectability(lately.covariance_m2, mean, mean_m2, similar),
            drive_models=models,
            unusual=0.0
            if of_drive is None
            else max(1.0 - of_drive.usual - self._grip.uneven_slip_probability(models), 0.0),
            all_larger=self._all_larger_probability(bank.sizes),
            posterior=bank,
        )

    def _resonance_log_ratios(self, resonance: ResonanceEvidence | None) -> FloatArray | None:
        """Return the (s,) log-likelihood ratio of each of `subsets` to no loss by the resonances; None
        without any."""
        if resonance is None or not resonance.wheels:
            return None
        sets = subsets(len(self._wheels))
        return np.array([resonance.log_ratio([self._wheels[i] for i in one]) for one in sets])

    def _compare_change(
        self,
        over: Literal["now", "minutes"],
        change: Change,
        covariance_m2: FloatArray,
        against: Comparison,
        models: dict[str, float],
    ) -> ComparisonResult:
        """Return the comparison of a change of covariance (d, d) with the hypotheses, on a drive of these
        probabilities of its `models`."""
        slipping = self._grip.change_hypotheses(change.change_m, covariance_m2, change.samples, models)
        each_m2 = slipping.covariance_m2
        change_m = np.broadcast_to(change.change_m, each_m2.shape[:2])
        sizes = against.sizes or unchanged_sizes(len(self._wheels))
        change_hypotheses = with_sizes(change_m, each_m2, slipping.log_weight, self._radius, sizes)
        verdict = against.compare_hypotheses(change_hypotheses)
        best = int(verdict.change_hypotheses.argmax())
        change_m, best_m2 = change_hypotheses.change_m[best], change_hypotheses.covariance_m2[best]
        return ComparisonResult(over, verdict, change_m, best_m2, came=sizes.came)

    def _all_larger_probability(self, sizes: FloatArray) -> float:
        """Return the probability that all wheels are larger; 0 where no sizes were compared."""
        all_wheels_row = self._sizes.all_wheels_row
        return float(sizes @ all_wheels_row) if sizes.size == all_wheels_row.size else 0.0

    def _comparison_setup(
        self, ratios: FloatArray | None, other_tyres: bool, before: ChangeSinceStart | None = None
    ) -> Comparison:
        """Return the comparison of hypotheses for one window, with the car's thresholds and the resonance's
        log-likelihood `ratios`; after a change of tyres without the hypotheses of another tyre size."""
        # Of other tyres the covariance holds what they may be larger already.
        sizes = None if other_tyres else self._size_rows_of_window(before)
        return Comparison(self._radius, self._threshold, ratios, other_tyres, sizes, self._limit)

    def _size_rows_of_window(self, before: ChangeSinceStart | None) -> TyreSizeChange:
        """Return the rows of sizes of a window, with what the samples before it say of them; kept for two
        windows."""
        if before is None:
            return self._sizes
        for beginning, known in self._of_beginning:
            if beginning is before:
                return known
        change_m, m2 = before.change_m, before.covariance_m2
        total_m2 = m2 + self._lasting_m2
        log_weight = before.log_weight + log_normal(change_m, total_m2) - log_normal(change_m, m2)
        found = with_sizes(change_m, total_m2, log_weight, self._radius, self._sizes, every=True)
        as_learned = np.tile(before.resized, len(self._sizes.mean)) & (found.row == 0)
        found = replace(found, log_weight=np.where(as_learned, -np.inf, found.log_weight))
        lost = (
            self._comparison_setup(None, other_tyres=False).compare_hypotheses(found).table.lost_probability
        )
        self._of_beginning.append((before, self._sizes.rows_of_window(found, lost)))
        return self._of_beginning[-1][1]

    def _windows(
        self,
        now: ComparisonResult,
        mean: ComparisonResult,
        drive: ComparisonResult | None,
        models: dict[str, float],
        *,
        whole: bool,
    ) -> list[Window]:
        """Return the windows of onsets, each with the share of a subset's change that counts as a loss.

        `drive`: the drive as a whole; `whole`: the mean counts for several tyres as well.

        A tyre that has lost what the other one of its axle has not stands out at once, or once fluctuations
        are averaged out, whatever else is soft or loaded. Both tyres of an axle look like slip, slopes or
        load for a while: so they are judged by the drive as a whole, or by the mean over minutes where the
        car is not known yet. Of an axle and of all a deviation is not asked of minutes beside the drive.
        """
        every = self._apart + self._together
        lately = every if whole else self._apart
        off_lately = every if whole else np.zeros_like(self._apart)
        windows = [
            Window("now", now.verdict, self._apart, self._apart, now.came),
            Window("minutes", mean.verdict, lately, off_lately, mean.came),
        ]
        if drive is not None:
            by_drive = self._drive_loss_fraction(models)
            windows.append(Window("drive", drive.verdict, by_drive, by_drive))
        return windows

    def _drive_loss_fraction(self, models: dict[str, float]) -> FloatArray:
        """Return the (s, d) fraction of the drive's evidence for each of `subsets` that is not slip.

        Where grip fluctuates, axles and the level of all wheels do far more than the models have; on any
        slippery road what driven axles do is slip. One that stands out beside the other wheel of its axle
        over many samples still tells.
        """
        slippery, uneven = self._grip.low_grip_probability(models), self._grip.uneven_slip_probability(models)
        trusted = np.where(self._of_driven, 1.0 - slippery, 1.0 - uneven)
        return np.minimum(self._apart + trusted[:, None] * self._together, 1.0)

    def _detectability(
        self, likeliest_m2: FloatArray, mean: Change, mean_m2: FloatArray, similar: Weighed | None
    ) -> LossDetectability:
        """Return the inputs of minimum detectable losses: one tyre by the mean over minutes under its
        likeliest sizes and slip (d, d); all alike and axles by the drive as a whole, `similar`, or if there
        is none all alike by a mean that is long enough."""
        lost: tuple[FloatArray, ...] = (self._radius, *self._axles)
        if similar is None and mean.samples >= JUDGE.full_samples:
            similar = mean.change_m[None], mean_m2[None], np.zeros(1)
        return LossDetectability(
            likeliest_m2, similar, lost, self._radius, self._tyres, self._threshold, self._asked
        )

    def _compare_drive(
        self, change_hypotheses: ChangeHypotheses, log_ratios: FloatArray | None, other_tyres: bool
    ) -> tuple[ComparisonResult, dict[str, float], Weighed]:
        """Return the comparison of the whole drive's changes, the probability of each drive model, and the
        changes by which losses of all tyres and of axles are known; computed once for each of its samples."""
        cached = self._cached
        if (
            cached is not None
            and cached[0] is change_hypotheses
            and cached[1] == other_tyres
            and log_ratios is None
        ):
            return cached[2:]
        nuisance_m2 = self._lasting_m2 + self._other_tyres_m2(other_tyres)
        covariance_m2, log_weight = change_hypotheses.with_nuisance(nuisance_m2)
        against = self._comparison_setup(log_ratios, other_tyres)
        kept = change_hypotheses.likely_indices(log_weight)
        if other_tyres:
            kept = kept[change_hypotheses.row[kept] == 0]
        verdict = against.compare_hypotheses(
            SizeHypotheses(
                change_hypotheses.change_m[kept],
                covariance_m2[kept],
                log_weight[kept],
                change_hypotheses.row[kept],
                change_hypotheses.size[kept],
                change_hypotheses.size_std[kept],
            )
        )
        chances = np.zeros(log_weight.size)
        chances[kept] = verdict.change_hypotheses
        best = int(chances.argmax())
        as_learned = (change_hypotheses.model[kept] == 0) & (change_hypotheses.row[kept] == 0)
        usual = float(verdict.intact[as_learned].sum())
        finding = ComparisonResult(
            "drive", verdict, change_hypotheses.change_m[best], covariance_m2[best], best, usual=usual
        )
        models = change_hypotheses.model_probabilities(chances)
        # Of each model a change before the drive, with no wheel of another size.
        first = np.unique(change_hypotheses.model, return_index=True)[1]
        similar = change_hypotheses.change_m[first], covariance_m2[first], log_weight[first]
        self._cached = (change_hypotheses, other_tyres, finding, models, similar)
        return finding, models, similar

    def pressure_loss(self, wheel: int, change_m: float, std_m: float) -> tuple[float, float]:
        """Return the share of the pressure that a change of radius stands for, and its standard deviation."""
        return self._tyres[self._wheels.index(wheel)].pressure_loss(change_m, std_m)

    def soft_probability_at_reset(self, change: Change, other_tyres: bool) -> FloatArray:
        """Return the (4,) probability that each tyre was soft when the baseline was reset.

        The change is that against the baseline before. Other tyres may be larger or smaller all together, or
        by axle; a soft one among them still stands out.
        """
        nuisance_m2 = self.nuisance_m2 + self._other_tyres_m2(other_tyres)
        covariance_m2 = change.covariance_m2 + nuisance_m2
        if other_tyres:
            against = Comparison(self._radius, self._threshold)
            return self._to_four_wheels(against.compare(change.change_m, covariance_m2).deflated)
        found = self._compare_change("now", change, covariance_m2, self._comparison_setup(None, False), {})
        return self._to_four_wheels(found.verdict.deflated)

    def _nuisance_covariance_of_mean_m2(self, samples: int) -> FloatArray:
        """Return the (d, d) covariance of the fluctuating nuisance in a mean of so many correlated samples;
        cached."""
        if samples not in self._of_mean_m2:
            share = variance_ratio_of_mean(samples, math.exp(-BASELINE.sample_every_s / JUDGE.nuisance_s))
            averaged = self._nuisance.averaged(share)
            self._of_mean_m2[samples] = averaged.covariance(self._wheels, self._radius)
        return self._of_mean_m2[samples]

    def _other_tyres_m2(self, other_tyres: bool) -> FloatArray:
        """Return the covariance (d, d) of radii between tyre models; zero where the tyres are the learned
        ones."""
        d = len(self._wheels)
        return JUDGE.other_tyres.covariance(self._wheels, self._radius) if other_tyres else np.zeros((d, d))

    def _to_four_wheels(self, values: FloatArray) -> FloatArray:
        """Return (4,) values from those of the monitored wheels (d,), NaN for the others."""
        out = np.full(4, math.nan)
        out[self._wheels] = values
        return out


@functools.cache
def _centring_matrix(d: int) -> FloatArray:
    """Return the (d, d) matrix that subtracts the mean from each of d values."""
    return np.asarray(np.eye(d) - np.ones((d, d)) / d)


def _contrast_std(covariance_m2: FloatArray) -> float:
    """Return the largest standard deviation (m) of one wheel's change less the mean of all."""
    centring = _centring_matrix(len(covariance_m2))
    return math.sqrt(float(np.max(np.diag(centring @ covariance_m2 @ centring))))


def _distinguishable_members(wheels: list[int]) -> FloatArray:
    """Return the (s, d) mask of the wheels of each of `subsets` that stand out: the other one of the axle is
    monitored and not in it, or no other wheel is in it."""
    found = subsets(len(wheels))
    out = np.zeros((len(found), len(wheels)))
    for row, members in zip(out, found, strict=True):
        sound = set(wheels) - {wheels[index] for index in members}
        row[list(members)] = [float(len(members) == 1 or wheels[index] ^ 1 in sound) for index in members]
    return out
