"""When the baseline is learned, and from what: it must never learn a fault.

In: ticks, estimates, and whether anything is suspected. Out: the `Reference` and the change against it.

It is ready when `learn_s` of driving have taught the wheels against each other. Then, while nothing is
suspected, samples refine it: each range of speed takes `RANGE_SAMPLES`, after which it is frozen. Load and
day are learned in the first `DRIVE_SAMPLES` after a standstill. An estimate is a mean over its memory, so
samples are `SAMPLE_EVERY_S` apart.

A leak of half an hour looks like nothing from one sample to the next, and what learned it would hide it. So
from `SETTLED_SAMPLES` on what a drive shows of the car is learned in a shadow baseline (`_shadow`) and
counts from the next drive on, unless something was suspected when this one ended.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np

from tpmsd.bounds import number, whole
from tpmsd.config.model import VehicleConfig
from tpmsd.estimators.base import RadiusEstimate
from tpmsd.monitor.conditions import NEW_DAY_S, PARKED_S, ConditionTracker
from tpmsd.monitor.hypotheses import Nuisance
from tpmsd.monitor.reference import (
    GROWTH_PRIOR,
    KNOTS_MPS,
    MOST_SAMPLES,
    PER_SPEED2,
    Reference,
    speed_range,
)
from tpmsd.timeline.tick import Tick
from tpmsd.wheels import FloatArray

SAMPLE_EVERY_S = 20.0
RANGE_SAMPLES = 40
DRIVE_SAMPLES = 8
MAX_CONTRAST_STD = 0.0008
"""Learning goes on until the contrast between the wheels is known this well, relative to the radius."""
FIT_LIMIT = {1: 10.827566170662733, 2: 13.815510557964274, 3: 16.266236196238129, 4: 18.466826952903151}
"""A sample that fits worse than the 0.999 quantile of chi-square is not learned; by number of wheels."""
RECENT_SAMPLES = 9
SETTLED_SAMPLES = 45
"""From so many (15 min of driving) on a drive is held against what was known before it, ..."""
NEXT_DRIVE_SAMPLES = 20
"""... and on the next drive from so many."""
DOUBT_S = 180.0
"""Time constant of the share of driving during which something was suspected."""
UNSETTLED_SHARE = 0.5
"""Of the growth that the estimate's memory has yet to follow: how well its lag is known."""
UNSETTLED_SPEED2 = 150.0
"""(m/s)^2; while speed changes faster, nothing is learned."""
LONGEST_S = 1e9
"""Thirty years of driving: a saved time beyond is none."""


STEEP_COMMON, STEEP_AXLE, STEEP_OWN = 2e-3, 3e-3, 2e-4
"""Relative changes of radius per m/s2 of slope, standard deviations: heights are known late, and slip is not
quite in proportion to force."""

_Sample = tuple[FloatArray, FloatArray, FloatArray, FloatArray]
"""Deviation (d,), its covariance, that of what the memory has not followed (d, d), features (d, n)."""


@dataclass(frozen=True, slots=True)
class Change:
    """Radii against the baseline, of the monitored wheels."""

    change_m: FloatArray
    """(d,)"""
    covariance_m2: FloatArray
    """(d, d) of estimate and baseline."""
    samples: int
    """How many estimates it is the mean of."""
    own_m2: FloatArray
    """(d, d) of the estimate alone."""
    fits: bool
    """Whether it is what the baseline expects, harmless changes allowed for."""


class Baseline:
    """One set of tyres."""

    def __init__(self, vehicle: VehicleConfig, wheels: list[int], learn_s: float) -> None:
        self._vehicle = vehicle
        self._wheels = wheels
        self._radius = np.array(vehicle.wheel_radius_m)[wheels]
        self._learn_s = learn_s
        self._conditions = ConditionTracker()
        self.reference = Reference(vehicle)
        self._shadow: Reference | None = None
        """What counts from the next drive on; None as long as the car is learned for the first time."""
        self._doubt = 0.0
        """Share of the last minutes of driving during which something was suspected."""
        self.ready = False
        self._learned_s = 0.0
        self._since_s = 0.0
        self._drive_samples = 0
        self._recent: deque[_Sample] = deque(maxlen=RECENT_SAMPLES)
        self._recent_s = 0.0

    @property
    def fraction(self) -> float:
        """How much of the first learning is done, 0 to 1."""
        return 1.0 if self.ready else min(self._learned_s / self._learn_s, 0.99)

    @property
    def learned_s(self) -> float:
        """Driving time that it was learned from."""
        return self._learned_s

    def update(self, tick: Tick, estimate: RadiusEstimate) -> None:
        """Take every tick: conditions, and what a standstill changes."""
        stood_s = self._conditions.update(tick, estimate)
        if stood_s >= PARKED_S:
            if stood_s >= NEW_DAY_S:
                self._adopt_shadow()
            for reference in self._references():
                reference.forget_drive(load_only=stood_s < NEW_DAY_S)
            self._drive_samples = 0
            self._recent.clear()
        if estimate.informative:
            self._since_s += tick.dt_s
            self._recent_s += tick.dt_s
            if not self.ready:
                self._learned_s += tick.dt_s

    @property
    def settled(self) -> bool:
        """Whether the car has been learned once, so that drives are held against what was known before."""
        return self._shadow is not None

    @property
    def own_growth_m(self) -> FloatArray:
        """(4,) what each wheel grows now with speed beyond the others."""
        return self.reference.own_growth_m(self._conditions.now)

    def _references(self) -> tuple[Reference, ...]:
        return (self.reference,) if self._shadow is None else (self.reference, self._shadow)

    def _adopt_shadow(self) -> None:
        """Another drive begins: what the last ones taught counts now, unless they ended in doubt."""
        if self._shadow is not None and self._doubt < 0.5:
            self.reference = self._shadow
        if self._shadow is not None or sum(self.reference.ranges) >= NEXT_DRIVE_SAMPLES:
            self._shadow = self.reference.copy()
        self._doubt = 0.0

    def changes(self, estimate: RadiusEstimate, harmless_m2: FloatArray) -> tuple[Change, Change] | None:
        """The change now, and its mean over the last minutes; None where it is not known.

        `harmless_m2` (d, d): what is not the baseline's. What is slow (a leak of two or four tyres) shows
        better in the mean, for an estimate of the radius common to all wheels is known less well than
        differences between them.
        """
        found = self._known(estimate)
        if found is None:
            return None
        now = (*found, self._unsettled(), self.reference.features(self._conditions.now)[self._wheels])
        if self._recent and self._jumped(now, harmless_m2):
            self._recent.clear()
        recent = [*self._recent, now]
        if self._recent_s >= SAMPLE_EVERY_S:
            self._recent.append(now)
            self._recent_s = 0.0
        return self._change([now], harmless_m2), self._change(recent, harmless_m2)

    def forget_recent(self) -> None:
        """What was seen in the last minutes is not to be believed."""
        self._recent.clear()

    def _jumped(self, now: _Sample, harmless_m2: FloatArray) -> bool:
        """Whether the radii are others than in the last minutes, so that a mean would mix two states."""
        before = self._change(list(self._recent), harmless_m2)
        change = now[0] - now[3] @ self.reference.mean * self._radius
        off = change - before.change_m
        covariance = now[1] + now[2] + harmless_m2 + before.own_m2
        return float(off @ np.linalg.solve(covariance, off)) > FIT_LIMIT[off.size]

    def _change(self, samples: list[_Sample], harmless_m2: FloatArray) -> Change:
        """Mean of samples against the mean of what is expected."""
        deviation, own, unsettled, h = (
            sum(parts[1:], parts[0]) / len(samples) for parts in zip(*samples, strict=True)
        )
        scale = np.outer(self._radius, self._radius)
        change = deviation - h @ self.reference.mean * self._radius
        covariance = own / len(samples) + unsettled + h @ self.reference.covariance @ h.T * scale
        nis = float(change @ np.linalg.solve(covariance + harmless_m2, change))
        return Change(
            change, covariance, len(samples), own / len(samples) + unsettled, nis <= FIT_LIMIT[change.size]
        )

    def learn(
        self, estimate: RadiusEstimate, harmless_m2: FloatArray, trusted: bool, elapsed_s: float
    ) -> None:
        """Learn from the present estimate if it is time. `trusted`: nothing is suspected of any tyre;
        `elapsed_s`: driving since the last call."""
        found = self._known(estimate)
        if found is None:
            return
        if self.ready:
            self._doubt += (float(not trusted) - self._doubt) * min(elapsed_s / DOUBT_S, 1.0)
        if self._since_s < SAMPLE_EVERY_S:
            return
        if not self.ready and not self._may_begin(found[1]):
            return
        at = self._conditions.now
        if self.ready and (not trusted or abs(at.unsettled) > UNSETTLED_SPEED2):
            return
        noise = found[1] + self._unsettled() + harmless_m2
        taught = self._shadow or self.reference
        car = not self.ready or taught.ranges[speed_range(at)] < RANGE_SAMPLES
        first = self._drive_samples < DRIVE_SAMPLES
        if not car and not first:
            return
        taught.wander(self._since_s)
        taught.learn(found[0], noise, self._wheels, at, car=car)
        if self._shadow is not None and first:
            self.reference.wander(self._since_s)
            self.reference.learn(found[0], noise, self._wheels, at, car=False)
        elif self._shadow is None and sum(self.reference.ranges) >= SETTLED_SAMPLES:
            self._shadow = self.reference.copy()
        if self.ready:
            self._learned_s += self._since_s
        self.ready = True
        self._drive_samples += 1
        self._since_s = 0.0

    def _may_begin(self, covariance_m2: FloatArray) -> bool:
        """Whether enough was driven and the wheels are known against each other."""
        if self._learned_s < self._learn_s:
            return False
        d = len(self._wheels)
        centring = np.eye(d) - np.ones((d, d)) / d
        contrast = math.sqrt(float(np.max(np.diag(centring @ covariance_m2 @ centring))))
        return contrast <= MAX_CONTRAST_STD * float(self._radius.mean())

    def _known(self, estimate: RadiusEstimate) -> tuple[FloatArray, FloatArray] | None:
        deviation = estimate.deviation_m[self._wheels]
        covariance = estimate.covariance_m2[np.ix_(self._wheels, self._wheels)]
        if not (np.all(np.isfinite(deviation)) and np.all(np.isfinite(covariance))):
            return None
        return deviation, covariance

    def _unsettled(self) -> FloatArray:
        """(d, d) covariance of what the baseline cannot follow: growth while speed changes, and slopes."""
        at = self._conditions.now
        off = UNSETTLED_SHARE * GROWTH_PRIOR[0] * at.unsettled / PER_SPEED2
        slope = Nuisance(
            STEEP_COMMON * at.steep_mps2, STEEP_AXLE * at.steep_mps2, 0.0, STEEP_OWN * at.steep_mps2
        )
        growth = off**2 * np.outer(self._radius, self._radius)
        return growth + slope.covariance(self._wheels, self._radius)

    def follow(self, other: Baseline) -> None:
        """Take over from another baseline of the same car how it is being driven."""
        self._conditions.take_up(other._conditions.to_json())

    @property
    def samples_by_kmh(self) -> tuple[tuple[int, int], ...]:
        """Samples learned in each range of speed, by its middle in km/h; those of this drive among them."""
        ranges = (self._shadow or self.reference).ranges
        return tuple((round(3.6 * k), n) for k, n in zip(KNOTS_MPS, ranges, strict=True))

    # -- what survives a restart -----------------------------------------------------------------------------

    def to_json(self) -> dict[str, Any]:
        """Plain numbers for the state file."""
        return {
            "ready": self.ready,
            "learned_s": self._learned_s,
            "since_s": self._since_s,
            "drive_samples": self._drive_samples,
            "conditions": self._conditions.to_json(),
            "reference": self.reference.to_json(),
            "lessons": None if self._shadow is None else self._shadow.to_json(),
            "doubt": self._doubt,
        }

    def take_up(self, saved: dict[str, Any]) -> None:
        """Take up what was saved; ValueError (nothing taken up) if it does not fit."""
        try:
            learned_s = number(saved["learned_s"], 0.0, LONGEST_S, "learning time")
            since_s = number(saved["since_s"], 0.0, LONGEST_S, "learning time")
            drive_samples = whole(saved["drive_samples"], 0, MOST_SAMPLES, "number of samples")
            ready = saved["ready"]
            reference = Reference.from_json(saved["reference"], self._vehicle)
            shadow = saved.get("lessons")  # states of before have none: the next drive begins anew
            if shadow is not None:
                shadow = Reference.from_json(shadow, self._vehicle)
            doubt = number(saved.get("doubt", 0.0), 0.0, 1.0, "doubt")
            conditions = ConditionTracker()
            conditions.take_up(saved["conditions"])
        except (KeyError, TypeError, AttributeError, OverflowError) as error:
            raise ValueError(f"the saved baseline is not one: {type(error).__name__}: {error}") from error
        if not isinstance(ready, bool):
            raise ValueError("the saved baseline is not one")
        self._shadow, self._doubt = shadow, doubt
        self.reference, self._conditions, self.ready = reference, conditions, ready
        self._learned_s, self._since_s, self._drive_samples = learned_s, since_s, drive_samples
