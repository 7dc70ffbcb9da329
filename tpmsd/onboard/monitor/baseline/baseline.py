"""When the baseline is learned, and from what: it must never learn a fault.

In: ticks, estimates, and whether anything is suspected. Out: the `RadiusReference` and the change against it.

It is ready when `learn_s` of driving have taught the wheels against each other. Then, while nothing is
suspected, samples refine it: each range of speed takes `range_samples`, after which it is frozen. Load and
day are learned in the first `drive_samples` after a standstill. An estimate is a mean over its memory, so
samples are `sample_every_s` apart.

A leak of half an hour looks like nothing from one sample to the next, and what learned it would hide it. So
from `settled_samples` on what a drive shows of the car is learned in a shadow baseline (`_shadow`) and
counts from the next drive on, unless something was suspected when this one ended.
"""

from __future__ import annotations

import functools
import math
from collections import deque
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from tpmsd.car.config.model import CalibrationConfig, VehicleConfig
from tpmsd.car.physics.priors import GROWTH_S2PM
from tpmsd.foundation.bounds import number, whole
from tpmsd.foundation.median import median
from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.estimators.base import RadiusEstimate
from tpmsd.onboard.monitor.baseline.reference import RadiusReference, speed_range
from tpmsd.onboard.monitor.evidence.nuisance import squared_distance
from tpmsd.onboard.monitor.evidence.probability import chi_square_quantile
from tpmsd.onboard.monitor.sampling.conditions import Conditions, ConditionTracker
from tpmsd.onboard.monitor.sampling.drive_evidence import ChangeHypotheses, ChangeSinceStart, DriveEvidence
from tpmsd.onboard.monitor.sampling.slip_slope import SlipSlope
from tpmsd.onboard.monitor.sampling.slip_sums import SlopeSums
from tpmsd.onboard.monitor.settings import BASELINE, CONDITIONS, JUDGE, REFERENCE
from tpmsd.onboard.timeline.tick import Tick

FIT_LIMIT = {count: chi_square_quantile(BASELINE.fit_probability, count) for count in range(1, 5)}
"""Largest squared distance of a sample that is learned, by number of wheels: quantile of chi-square."""


_Sample = tuple[FloatArray, FloatArray, FloatArray, FloatArray]
"""Deviation (d,), its covariance, that of what the memory has not followed (d, d), features (d, n)."""


def least_disturbed_sample(
    moments: list[_Sample], expected: FloatArray, radius_m: FloatArray, axle_contrasts: FloatArray
) -> _Sample:
    """Return the last of several moments; or, where one wheel of an axle spins or is locked just then, the
    one nearest to the median of each wheel. What both wheels of an axle do is kept, for it shows grip.

    `expected` (n,): parameters of the reference; radius_m (d,) nominal; axle_contrasts (a, d): 1, -1 for the
    wheels of an axle.
    """
    rest = np.stack([deviation - h @ expected * radius_m for deviation, _, _, h in moments])
    apart = rest @ axle_contrasts.T
    off = apart[-1] - median(apart)
    nuisance_m2 = JUDGE.nuisance.own**2 * np.diag(radius_m**2)
    variance = np.diag(axle_contrasts @ (moments[-1][1] + nuisance_m2) @ axle_contrasts.T)
    if np.all(off**2 <= FIT_LIMIT[1] * variance):
        return moments[-1]
    return moments[int(np.abs(rest - median(rest)).sum(axis=1).argmin())]


def _add_fields(one: _Sample, other: _Sample) -> _Sample:
    """Return the sum of two samples, field by field."""
    return one[0] + other[0], one[1] + other[1], one[2] + other[2], one[3] + other[3]


@dataclass(frozen=True, slots=True)
class Change:
    """Radii against the baseline, of the monitored wheels."""

    change_m: FloatArray
    """(d,)"""
    covariance_m2: FloatArray
    """(d, d) of estimate and baseline."""
    samples: int
    """Number of estimates that it is the mean of."""
    own_m2: FloatArray
    """(d, d) of the estimate alone."""
    fits: bool
    """True if it is what the baseline expects, nuisance changes allowed for."""


class TyreSetBaseline:
    """Learned radii of one set of tyres, and the change of the present radii against them."""

    def __init__(self, vehicle: VehicleConfig, wheels: list[int], learn_s: float) -> None:
        self._vehicle = vehicle
        self._wheels = wheels
        self._radius = np.array(vehicle.wheel_radius_m)[wheels]
        self._radius2 = np.outer(self._radius, self._radius)
        self._grid = np.ix_(wheels, wheels)
        pairs = [(w, w + 1) for w in (0, 2) if w in wheels and w + 1 in wheels]
        self._axle_contrasts = np.array([[float(w == a) - float(w == b) for w in wheels] for a, b in pairs])
        self._axle_contrasts = self._axle_contrasts.reshape(-1, len(wheels))
        self._steep = BASELINE.steep.covariance(wheels, self._radius)
        self._learn_s = learn_s
        self._conditions = ConditionTracker()
        self._slip = SlipSlope(vehicle)
        self._slip_seen, self._slip_taught = SlopeSums(), SlopeSums()
        """Since the last of the recent samples, and since the last that was learned."""
        self.reference = RadiusReference(vehicle)
        self._shadow: RadiusReference | None = None
        """Shadow baseline: counts from the next drive on; None as long as the car is learned for the first
        time.
        """
        self._doubt = 0.0
        """Share of the last minutes of driving during which something was suspected."""
        self.ready = self.calibrated = False
        self._learned_s = 0.0
        self._since_s = 0.0
        self._drive_samples = 0
        self._recent: deque[_Sample] = deque(maxlen=BASELINE.recent_samples)
        self._recent_sum: tuple[_Sample, _Sample] | None = None
        """Sum of the recent samples, and the newest one in it."""
        self._recent_s = 0.0
        self._sampled: tuple[RadiusEstimate, FloatArray, _Sample | None] | None = None
        """Sample of this tick's estimate against this mean of the reference: asked for more than once."""
        self._compared: tuple[_Sample, _Sample, FloatArray, bool] | None = None
        """Result of comparing this sample with the recent ones up to this, under this nuisance; likewise."""
        self._moments: list[_Sample] = []
        """Each second since the last of the recent samples."""
        self._evidence: DriveEvidence | None = None
        """Evidence of this drive."""
        self._first_drive = False
        """True if the car was not known when the drive began."""
        self._by_drive = False
        """True if the last alarm was raised by the first drive as a whole alone."""
        self._closed = False
        """True if the drive as a whole is not judged any more."""

    def start_from_calibration(self, calibration: CalibrationConfig) -> None:
        """Start from calibrated radii: the car counts as learned, and its drives are compared with them.
        Nothing changes where a monitored wheel is not calibrated, or not as precisely as learning
        requires."""
        speed_mps = calibration.reference_speed_mps
        std_m = np.array([calibration.radius_std_m[wheel] or math.nan for wheel in self._wheels])
        if speed_mps is None or not self._contrasts_known(np.diag(std_m**2)):
            return
        self.reference.learn_calibration(std_m, speed_mps, self._wheels)
        self._shadow = self.reference.copy()
        self.ready = self.calibrated = True

    @property
    def fraction(self) -> float:
        """Fraction of the first learning that is done, 0 to 1."""
        return 1.0 if self.ready else min(self._learned_s / self._learn_s, 0.99)

    @property
    def learned_s(self) -> float:
        """Driving time that it was learned from."""
        return self._learned_s

    def update(self, tick: Tick, estimate: RadiusEstimate) -> None:
        """Update the conditions and the sums of slip by a tick; after a standstill forget what it may have
        changed."""
        self._sampled = self._compared = None
        stood_s = self._conditions.update(tick, estimate)
        if (window := self._slip.update(tick)) is not None:
            self._slip_seen += window
            self._slip_taught += window
        if stood_s >= CONDITIONS.parked_s:
            if stood_s >= CONDITIONS.new_day_s:
                self._adopt_shadow()
            for reference in self._references():
                reference.forget_drive(load_only=stood_s < CONDITIONS.new_day_s)
            self._drive_samples = 0
            self.forget_recent()
        if estimate.informative:
            self._since_s += tick.dt_s
            self._recent_s += tick.dt_s
            if not self.ready:
                self._learned_s += tick.dt_s

    @property
    def settled(self) -> bool:
        """True if the car has been learned once, so that drives are compared with what was known before."""
        return self._shadow is not None

    @property
    def origin(self) -> Literal["learned", "calibrated"]:
        """Source of the radii that changes count from: calibrated, until drives have taught more."""
        return "calibrated" if self.calibrated and not any(self.reference.ranges) else "learned"

    @property
    def own_growth_m(self) -> FloatArray:
        """(4,) m, growth of each wheel with the present speed beyond the others."""
        return self.reference.own_growth_m(self._conditions.now)

    def _references(self) -> tuple[RadiusReference, ...]:
        """Return the reference, and the shadow baseline if there is one."""
        return (self.reference,) if self._shadow is None else (self.reference, self._shadow)

    def _adopt_shadow(self) -> None:
        """Make the shadow baseline the reference unless the last drives ended in doubt, and begin another
        shadow."""
        if self._shadow is not None and self._doubt < 0.5:
            self.reference = self._shadow
        if self._shadow is not None or sum(self.reference.ranges) >= BASELINE.next_drive_samples:
            self._shadow = self.reference.copy()
        self._doubt = 0.0

    def changes(self, estimate: RadiusEstimate, nuisance_m2: FloatArray) -> tuple[Change, Change] | None:
        """Return the change now, and its mean over the last minutes; None where it is not known, or larger
        than that of any tyre. Leaves the state as it is; `observe` adds the sample.

        `nuisance_m2` (d, d): what is not the baseline's. What is slow (a leak of two or four tyres) shows
        better in the mean, for an estimate of the radius common to all wheels is known less well than
        differences between them.
        """
        now = self._sample(estimate)
        if now is None:
            return None
        one = self._make_change(now, 1, nuisance_m2)
        if not self._recent or self._jumped(now, nuisance_m2):
            return one, one
        return one, self._make_change(
            _add_fields(self._recent_total(), now), len(self._recent) + 1, nuisance_m2
        )

    def observe(self, estimate: RadiusEstimate, nuisance_m2: FloatArray) -> None:
        """Add a second of driving to the last minutes' samples and to the evidence of the drive.

        `nuisance_m2` as in `changes`.
        """
        now = self._sample(estimate)
        if now is None:
            return
        if self._recent and self._jumped(now, nuisance_m2):
            self._recent.clear()
            if self._evidence is not None:
                self._evidence.note_jump()
        if self._evidence is None and not self._closed:
            self._evidence = DriveEvidence(self.reference, self._wheels, self._radius)
            self._first_drive = not self.settled
        self._moments.append(now)
        if self._recent_s < BASELINE.sample_every_s:
            return
        sample = least_disturbed_sample(
            self._moments, self.reference.mean, self._radius, self._axle_contrasts
        )
        self._recent.append(sample)
        if self._evidence is not None:
            self._evidence.update(*sample, self._recent_s, self._slip_seen.slope())
        self._recent_s, self._slip_seen = 0.0, SlopeSums()
        self._moments.clear()

    def _sample(self, estimate: RadiusEstimate) -> _Sample | None:
        """Return the sample of the present estimate; None where it is not finite, or a wheel is larger than
        any tyre gets."""
        expected = self.reference.mean
        if (kept := self._sampled) is not None and kept[0] is estimate and kept[1] is expected:
            return kept[2]
        now, found = None, self._finite_estimate(estimate)
        if found is not None:
            h = self.reference.features(self._conditions.now)[self._wheels]
            larger_m = found[0] - h @ expected * self._radius
            if not np.any(larger_m > JUDGE.max_relative_growth * self._radius):
                now = (*found, self._unsettled_m2(), h)
        self._sampled = estimate, expected, now
        return now

    def note_transition(self, change_index: int | None) -> None:
        """Note that an alarm was raised or cleared; `change_index`: the one by which the drive as a whole
        raised it, and nothing else did.

        While the car is learned for the first time, what was learned on such a drive holds part of the loss,
        and is estimated again beside it. After any other alarm the drive is not asked again until the car has
        stood: it would not show that the tyre is in order again.
        """
        if self.settled and not self._first_drive:
            return
        self._by_drive = change_index is not None
        if self._evidence is None or change_index is None:
            self._evidence, self._closed = None, True
            return
        ranges = self.reference.ranges
        self.reference = self._evidence.reference_fitted_jointly(change_index)
        self.reference.ranges = list(ranges)
        if self._shadow is not None:
            self._shadow = self.reference.copy()

    def forget_recent(self) -> None:
        """Forget the samples of the last minutes, which are wrong or another drive's."""
        self._slip_seen, self._slip_taught = SlopeSums(), SlopeSums()
        self._recent.clear()
        self._moments.clear()
        self._evidence, self._closed, self._first_drive = None, False, False

    def change_hypotheses(self, *, alarm_active: bool) -> ChangeHypotheses | None:
        """Return the changes by the drive as a whole; None as long as it is too short, or while an alarm is
        active that a first drive has not raised by itself."""
        asked = self.settled or self._by_drive or not alarm_active
        return self._evidence.change_hypotheses if asked and self._evidence is not None else None

    def change_before(self, change: Change) -> ChangeSinceStart | None:
        """Return the change since the drive began by the samples before those of `change`; None where it is
        not known."""
        return None if self._evidence is None else self._evidence.change_before(change.samples)

    def _jumped(self, now: _Sample, nuisance_m2: FloatArray) -> bool:
        """Return whether the radii differ from those of the last minutes, so that a mean would mix two
        states."""
        newest = self._recent[-1]
        if (kept := self._compared) is not None and (
            kept[0] is now and kept[1] is newest and kept[2] is nuisance_m2
        ):
            return kept[3]
        before, before_own = self._mean_change(self._recent_total(), len(self._recent))
        change, own = self._mean_change(now, 1)
        off = change - before
        jumped = squared_distance(off, own + nuisance_m2 + before_own) > FIT_LIMIT[off.size]
        self._compared = now, newest, nuisance_m2, jumped
        return jumped

    def _recent_total(self) -> _Sample:
        """Return the sum of the recent samples, of which there is one at least."""
        if self._recent_sum is None or self._recent_sum[1] is not self._recent[-1]:
            self._recent_sum = functools.reduce(_add_fields, self._recent), self._recent[-1]
        return self._recent_sum[0]

    def _mean_change(self, total: _Sample, samples: int) -> tuple[FloatArray, FloatArray]:
        """Return the mean (d,) of samples, whose sum is given, minus the mean of what is expected, and the
        covariance (d, d) of the mean alone."""
        deviation, own, unsettled, h = total
        change = (deviation - h @ self.reference.mean * self._radius) / samples
        return change, (own / samples + unsettled) / samples

    def _make_change(self, total: _Sample, samples: int, nuisance_m2: FloatArray) -> Change:
        """Return the `Change` of `_mean_change`, with the covariance of what is expected added."""
        change, own_m2 = self._mean_change(total, samples)
        h = total[3] / samples
        covariance = own_m2 + h @ self.reference.covariance @ h.T * self._radius2
        nis = squared_distance(change, covariance + nuisance_m2)
        return Change(change, covariance, samples, own_m2, nis <= FIT_LIMIT[change.size])

    def learn(
        self, estimate: RadiusEstimate, nuisance_m2: FloatArray, trusted: bool, elapsed_s: float
    ) -> None:
        """Learn from the present estimate if a sample is due. `trusted`: nothing is suspected of any tyre;
        `elapsed_s`: driving since the last call."""
        found = self._finite_estimate(estimate)
        if found is None:
            return
        self._update_doubt(trusted, elapsed_s)
        at = self._conditions.now
        if self._since_s < BASELINE.sample_every_s or not self._may_learn(found[1], trusted, at):
            return
        taught = self._shadow or self.reference
        car = not self.ready or taught.ranges[speed_range(at)] < BASELINE.range_samples
        first = self._drive_samples < BASELINE.drive_samples
        if not car and not first:
            return
        self._learn_sample(found[0], found[1] + self._unsettled_m2() + nuisance_m2, at, car=car, first=first)
        if self.ready:
            self._learned_s += self._since_s
        self.ready = True
        self._drive_samples += 1
        self._since_s = 0.0

    def _update_doubt(self, trusted: bool, elapsed_s: float) -> None:
        """Low-pass the fraction of driving under suspicion; drop sums of slip collected meanwhile."""
        if not self.ready:
            return
        self._doubt += (float(not trusted) - self._doubt) * min(elapsed_s / BASELINE.doubt_s, 1.0)
        if not trusted:
            self._slip_taught = SlopeSums()

    def _may_learn(self, covariance_m2: FloatArray, trusted: bool, at: Conditions) -> bool:
        """Return whether a sample of this covariance (d, d) may be learned now."""
        if not self.ready:
            return self._may_become_ready(covariance_m2)
        return trusted and abs(at.unsettled) <= BASELINE.unsettled_speed2

    def _learn_sample(
        self, deviation_m: FloatArray, noise_m2: FloatArray, at: Conditions, *, car: bool, first: bool
    ) -> None:
        """Learn a sample (d,) with its noise (d, d). `car`: what belongs to the car as well; `first`: it is
        one of the first of this drive, from which what counts now learns the drive."""
        taught = self._shadow or self.reference
        taught.predict(self._since_s)
        taught.learn(deviation_m, noise_m2, self._wheels, at, car=car)
        slope, self._slip_taught = self._slip_taught.slope(), SlopeSums()
        if slope is not None and car:
            taught.learn_slip(slope)
        if self._shadow is not None and first:
            self.reference.predict(self._since_s)
            self.reference.learn(deviation_m, noise_m2, self._wheels, at, car=False)
        elif self._shadow is None and sum(self.reference.ranges) >= BASELINE.settled_samples:
            self._shadow = self.reference.copy()

    def _may_become_ready(self, covariance_m2: FloatArray) -> bool:
        """Return whether enough was driven and the differences of the wheels are known precisely."""
        return self._learned_s >= self._learn_s and self._contrasts_known(covariance_m2)

    def _contrasts_known(self, covariance_m2: FloatArray) -> bool:
        """Return whether radii of this covariance (d, d) are known precisely enough relative to each other;
        False for NaN."""
        d = len(self._wheels)
        centring = np.eye(d) - np.ones((d, d)) / d
        contrast = math.sqrt(float(np.max(np.diag(centring @ covariance_m2 @ centring))))
        return contrast <= BASELINE.max_contrast_std * float(self._radius.mean())

    def _finite_estimate(self, estimate: RadiusEstimate) -> tuple[FloatArray, FloatArray] | None:
        """Return deviation (d,) and covariance (d, d) of the monitored wheels; None where any is not
        finite."""
        deviation = estimate.deviation_m[self._wheels]
        covariance = estimate.covariance_m2[self._grid]
        if not (np.isfinite(deviation).all() and np.isfinite(covariance).all()):
            return None
        return deviation, covariance

    def _unsettled_m2(self) -> FloatArray:
        """Return the (d, d) covariance of what the baseline cannot follow: growth while speed changes, and
        slopes."""
        at = self._conditions.now
        off = BASELINE.unsettled_share * GROWTH_S2PM.mean * at.unsettled
        return off**2 + at.steep_mps2**2 * self._steep

    def copy_conditions(self, other: TyreSetBaseline) -> None:
        """Copy the driving conditions from another baseline of the same car."""
        self._sampled = self._compared = None
        self._conditions.restore(other._conditions.to_json())

    @property
    def samples_by_kmh(self) -> tuple[tuple[int, int], ...]:
        """Samples learned in each range of speed, by its middle in km/h; those of this drive among them."""
        ranges = (self._shadow or self.reference).ranges
        return tuple((round(3.6 * k), n) for k, n in zip(REFERENCE.knots_mps, ranges, strict=True))

    # -- what survives a restart -----------------------------------------------------------------------------

    def to_json(self) -> dict[str, Any]:
        """Return plain numbers for the state file."""
        return {
            "ready": self.ready,
            "calibrated": self.calibrated,
            "learned_s": self._learned_s,
            "since_s": self._since_s,
            "drive_samples": self._drive_samples,
            "conditions": self._conditions.to_json(),
            "reference": self.reference.to_json(),
            "lessons": None if self._shadow is None else self._shadow.to_json(),
            "doubt": self._doubt,
        }

    def restore(self, saved: dict[str, Any]) -> None:
        """Restore what `to_json` returned; ValueError (nothing restored) if it does not fit."""
        try:
            learned_s = number(saved["learned_s"], 0.0, BASELINE.longest_s, "learning time")
            since_s = number(saved["since_s"], 0.0, BASELINE.longest_s, "learning time")
            drive_samples = whole(saved["drive_samples"], 0, REFERENCE.max_samples, "number of samples")
            ready = saved["ready"]
            calibrated = saved.get("calibrated", False)  # states of before have none
            reference = RadiusReference.from_json(saved["reference"], self._vehicle)
            shadow = saved.get("lessons")  # states of before have none: the next drive begins again
            if shadow is not None:
                shadow = RadiusReference.from_json(shadow, self._vehicle)
            doubt = number(saved.get("doubt", 0.0), 0.0, 1.0, "doubt")
            conditions = ConditionTracker()
            conditions.restore(saved["conditions"])
        except (KeyError, TypeError, AttributeError, OverflowError) as error:
            raise ValueError(f"the saved baseline is not one: {type(error).__name__}: {error}") from error
        if not isinstance(ready, bool) or not isinstance(calibrated, bool):
            raise ValueError("the saved baseline is not one")
        self._shadow, self._doubt = shadow, doubt
        self.reference, self._conditions, self.ready = reference, conditions, ready
        self.calibrated = calibrated
        self._sampled = self._compared = None
        self._learned_s, self._since_s, self._drive_samples = learned_s, since_s, drive_samples
