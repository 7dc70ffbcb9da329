"""What the change of the radii says of each tyre.

In: the changes against the baseline, now and over the last minutes. Out: a `Judgement`: for each wheel how
probable a deflation and a deviation are, how much radius and how much pressure are lost.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tpmsd.config.model import MonitorConfig, TyreConfig, VehicleConfig
from tpmsd.monitor.baseline import Change
from tpmsd.monitor.hypotheses import Verdict, compare, subsets
from tpmsd.monitor.nuisance import Nuisance, mean_share
from tpmsd.monitor.probability import normal_cdf
from tpmsd.monitor.settings import BASELINE, JUDGE
from tpmsd.physics.tyre import tyre_model
from tpmsd.resonance.evidence import ResonanceEvidence
from tpmsd.wheels import FloatArray


@dataclass(frozen=True, slots=True)
class Judgement:
    """(4,) each; NaN for a wheel that is not monitored, or before anything was judged."""

    change_m: FloatArray
    change_std_m: FloatArray
    deflated: FloatArray
    """Probability of a loss beyond the threshold."""
    deviates: FloatArray
    """Probability of a change of either sign beyond its threshold."""
    loss_m: FloatArray
    pressure_loss: FloatArray
    """Share of the pressure."""
    pressure_loss_std: FloatArray
    suspicion: float
    """Log-likelihood ratio of the best loss to none; infinite if the change is nothing that is known."""
    contrast_std_m: float = math.inf
    """How well the wheels are known against each other: the largest standard deviation of one wheel's change
    less the mean of all."""
    now: Change | None = None
    """The change that was judged, ..."""
    verdict: Verdict | None = None
    """... and what the comparison of hypotheses says of it."""

    def trusted(self, settled: bool) -> bool:
        """Whether the baseline may learn; `settled`: whether it has been learned once."""
        return self.suspicion < (JUDGE.suspicious if settled else JUDGE.suspicious_at_first)

    def by_wheel(self) -> list[tuple[float, ...]]:
        """For each of four wheels its change, standard deviation, probabilities of a deflation and of a
        deviation (0 where nothing was judged), lost pressure and standard deviation."""
        probabilities = np.nan_to_num(np.stack([self.deflated, self.deviates]))
        columns = [
            self.change_m,
            self.change_std_m,
            *probabilities,
            self.pressure_loss,
            self.pressure_loss_std,
        ]
        return [tuple(row) for row in np.stack(columns, axis=1).tolist()]

    @classmethod
    def unknown(cls) -> Judgement:
        """Before anything was judged."""
        nan = np.full(4, math.nan)
        return cls(nan, nan, nan, nan, nan, nan, nan, math.inf)


class Judge:
    """Thresholds and tyres of one car."""

    def __init__(
        self,
        vehicle: VehicleConfig,
        settings: MonitorConfig,
        tyre: TyreConfig,
        wheels: list[int],
        harmless: Nuisance = JUDGE.harmless,
    ) -> None:
        self._wheels = wheels
        self._radius = np.array(vehicle.wheel_radius_m)[wheels]
        self._harmless = harmless
        self.harmless_m2 = harmless.covariance(wheels, self._radius)
        self._unexplained_m2 = JUDGE.unexplained.covariance(wheels, self._radius)
        self._tyres = [tyre_model(tyre, float(radius)) for radius in self._radius]
        self._threshold = settings.deflation_percent / 100.0
        if settings.deflation_pressure_percent is not None:
            share = settings.deflation_pressure_percent / 100.0
            losses = [-one.radius_change_m(share) for one in self._tyres]
            self._threshold = float(np.mean(np.array(losses) / self._radius))
        self._limit_m = settings.deviation_percent / 100.0 * self._radius

    def judge(
        self,
        now: Change,
        mean: Change,
        resonance: ResonanceEvidence | None = None,
        other_tyres: bool = False,
    ) -> Judgement:
        """Judge both changes; what either says of a wheel counts. `resonance` bears witness beside them.

        `other_tyres`: these may be others than those that were learned; what all of them or an axle do is
        then no loss, but one wheel that stands out is.
        """
        harmless_m2 = self.harmless_m2 + self._tolerance_m2(other_tyres)
        ratios = None
        if resonance is not None and resonance.wheels:
            sets = subsets(len(self._wheels))
            ratios = np.array([resonance.log_ratio([self._wheels[i] for i in one]) for one in sets])
        averaged_m2 = harmless_m2 - self.harmless_m2 + self._harmless_of_mean_m2(mean.samples)
        verdicts = [
            self._compare(change, harmless, ratios, other_tyres)
            for change, harmless in ((now, harmless_m2), (mean, averaged_m2))
        ]
        # What shows in the mean alone is slow; what shows now alone is fast.
        likelier = verdicts[int(verdicts[1].deflated.max() > verdicts[0].deflated.max())]
        wide = np.sqrt(np.diag(now.covariance_m2 + self._unexplained_m2 + harmless_m2 - self.harmless_m2))
        limit, change = self._limit_m, now.change_m
        beyond = np.stack([-limit - change, change - limit]) / wide
        deviates = np.array([normal_cdf(below) + normal_cdf(above) for below, above in beyond.T.tolist()])
        std = np.sqrt(np.diag(now.covariance_m2))
        steady_std = np.sqrt(np.diag(mean.covariance_m2 + self.harmless_m2))
        pressure = [
            tyre.pressure_loss(float(x), float(s))
            for tyre, x, s in zip(self._tyres, mean.change_m, steady_std, strict=True)
        ]
        fits = now.fits and mean.fits
        return Judgement(
            change_m=self._on_all(change),
            change_std_m=self._on_all(std),
            deflated=self._on_all(_deflated(verdicts[0], verdicts[1], mean.samples)),
            deviates=self._on_all(deviates),
            loss_m=self._on_all(likelier.loss_m),
            pressure_loss=self._on_all(np.array([loss for loss, _ in pressure])),
            pressure_loss_std=self._on_all(np.array([own for _, own in pressure])),
            suspicion=max(v.suspicion for v in verdicts) if fits else math.inf,
            contrast_std_m=_contrast_std(now.covariance_m2),
            now=now,
            verdict=verdicts[0],
        )

    @property
    def threshold_m(self) -> float:
        """Loss of radius from which a tyre counts as deflated, mean of the wheels."""
        return self._threshold * float(self._radius.mean())

    def pressure_loss(self, wheel: int, change_m: float, std_m: float) -> tuple[float, float]:
        """Share of the pressure that a change of radius stands for, and its standard deviation."""
        return self._tyres[self._wheels.index(wheel)].pressure_loss(change_m, std_m)

    def soft_after_reset(self, change: Change, other_tyres: bool) -> FloatArray:
        """(4,) how probable it is that a tyre was soft when the baseline was reset.

        The change is that against the baseline before. Other tyres may be larger or smaller all together, or
        by axle; a soft one among them still stands out.
        """
        harmless_m2 = self.harmless_m2 + self._tolerance_m2(other_tyres)
        return self._on_all(self._compare(change, harmless_m2).deflated)

    def _harmless_of_mean_m2(self, samples: int) -> FloatArray:
        """(d, d) of what comes and goes in a mean of so many samples."""
        share = mean_share(samples, math.exp(-BASELINE.sample_every_s / JUDGE.harmless_s))
        return self._harmless.averaged(share).covariance(self._wheels, self._radius)

    def _tolerance_m2(self, other_tyres: bool) -> FloatArray:
        d = len(self._wheels)
        return JUDGE.other_tyres.covariance(self._wheels, self._radius) if other_tyres else np.zeros((d, d))

    def _compare(
        self,
        change: Change,
        harmless_m2: FloatArray,
        log_ratios: FloatArray | None = None,
        one_alone: bool = False,
    ) -> Verdict:
        covariance_m2 = change.covariance_m2 + harmless_m2
        return compare(change.change_m, covariance_m2, self._radius, self._threshold, log_ratios, one_alone)

    def _on_all(self, values: FloatArray) -> FloatArray:
        out = np.full(4, math.nan)
        out[self._wheels] = values
        return out


def _contrast_std(covariance_m2: FloatArray) -> float:
    d = len(covariance_m2)
    centring = np.eye(d) - np.ones((d, d)) / d
    return math.sqrt(float(np.max(np.diag(centring @ covariance_m2 @ centring))))


def _deflated(now: Verdict, mean: Verdict, samples: int) -> FloatArray:
    """(d,) probability of a deflation by what both say.

    One tyre alone stands out at once, or once what comes and goes is averaged out. Two or more look like
    slip, slopes or load for a while: so they are believed of the mean over minutes, and what shows of them
    now is only reason not to clear.
    """
    at_once = np.maximum(np.maximum(now.alone, mean.alone), np.minimum(now.deflated, JUDGE.undecided))
    return np.maximum(at_once, mean.deflated) if samples >= JUDGE.full_samples else at_once
