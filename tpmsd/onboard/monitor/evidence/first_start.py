"""Was a tyre soft before it was ever learned? The first radii of a car held against what cars have.

In: radii of the first minutes with their covariance. Out: for each wheel the probability that it is a soft
tyre, and that it is a larger one than the other wheel of its axle.

The prior is hierarchical, in parts of the radius: a level common to the car, a difference of front and rear,
and on each axle a difference of left and right, which is small where both tyres are of one set and wear, and
larger where they are mixed. Tyres of one car come in sets: a wheel that is smaller than the other wheel of
its axle by more than a mixed set explains has lost air, or is a spare.

Assumed, without a source at hand: about 1 % of the overall diameter differs from maker to maker (`car_std`,
`axle_std`); tyres of one type and batch run within 0.1 %, and 1 mm more tread on one side is 0.3 % of the
radius (`within_std`). The recordings at hand have 0.0 to 0.4 % between the rear wheels, once with an
encoder that loses counts.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from tpmsd.foundation.wheels import IS_FRONT, IS_LEFT, FloatArray
from tpmsd.onboard.monitor.alarms.alarm_state import Hysteresis
from tpmsd.onboard.monitor.evidence.kernel import compiled
from tpmsd.onboard.monitor.records import AlarmKind
from tpmsd.onboard.monitor.settings import FIRST_START

BEFORE = "before the first start"
"""Text of `since` for such an alarm."""
LOSS_GRID = np.geomspace(*FIRST_START.losses)


@dataclass(frozen=True, slots=True)
class FirstVerdict:
    """(d,) each, of the wheels that are monitored."""

    soft: FloatArray
    """Probability that it differs from the other wheel of its axle as no set does, and more probably by a
    loss of its own.
    """
    larger: FloatArray
    """Probability (d,) that it is larger than the other wheel of its axle."""
    loss_m: FloatArray
    """Expected loss, m."""
    smaller_share: FloatArray
    """Relative amount by which it is smaller than the other wheel of its axle; negative where it is larger.
    """


def judge_first(
    deviation_m: FloatArray, covariance_m2: FloatArray, radius_m: FloatArray, wheels: list[int]
) -> FirstVerdict:
    """Return the probabilities that each of the first radii is of a soft or a larger tyre. deviation_m (d,):
    radius minus nominal; covariance_m2 (d, d); radius_m (d,) nominal."""
    x, noise = deviation_m / radius_m, covariance_m2 / np.outer(radius_m, radius_m)
    found = first_by_compiled(x, noise, wheels) if compiled is not None else None
    soft, larger, expected = first_by_arrays(x, noise, wheels) if found is None else found
    soft, larger = _resolve_pairs(soft, larger, wheels)
    return FirstVerdict(
        np.minimum(soft, 1.0), np.minimum(larger, 1.0), expected * radius_m, _smaller_than_other(x, wheels)
    )


def first_by_compiled(
    x: FloatArray, noise: FloatArray, wheels: list[int]
) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Return what `first_by_arrays` returns, computed by `_evidence.c`; None where a covariance has no
    factor.
    """
    d = len(wheels)
    soft, larger, expected = np.empty(d), np.empty(d), np.empty(d)
    shifts, log_priors = _radius_hypotheses(d)
    shares, priors = _healthy_mixture(tuple(wheels))
    scratch = np.empty((len(shares) + 1, len(log_priors)))
    known = x, noise, shifts, log_priors, shares, priors, LOSS_GRID
    return (soft, larger, expected) if compiled.first(soft, larger, expected, scratch, *known) else None


def first_by_arrays(
    x: FloatArray, noise: FloatArray, wheels: list[int]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the probabilities of a soft and of a larger wheel and the expected loss, (d,) each, of relative
    deviations x (d,) known with `noise` (d, d): by NumPy, the reference."""
    d = len(wheels)
    shifts, log_priors = _radius_hypotheses(d)
    shares, priors = _healthy_mixture(tuple(wheels))
    whitener = np.linalg.inv(np.linalg.cholesky(priors + noise))
    rest = (x - shifts) @ whitener.swapaxes(1, 2)
    scale = np.log(shares * np.prod(np.diagonal(whitener, axis1=1, axis2=2), axis=1))
    logs = scale[:, None] - 0.5 * np.einsum("khd,khd->kh", rest, rest)
    total = np.logaddexp.reduce(logs) + log_priors
    posterior = np.exp(total - total.max())
    posterior /= posterior.sum()
    kinds = posterior[1:].reshape(2, d, LOSS_GRID.size)
    soft, larger = kinds.sum(axis=2)
    return soft, larger, np.where(soft > 0.0, kinds[0] @ LOSS_GRID / np.maximum(soft, 1e-300), 0.0)


def _resolve_pairs(soft: FloatArray, larger: FloatArray, wheels: list[int]) -> tuple[FloatArray, FloatArray]:
    """Return the (d,) probabilities of a soft and of a larger wheel, where of a soft wheel and a larger other
    one of its axle, which look alike but for the axle's level, the more probable has the sum of both and the
    other 0."""
    soft, larger = soft.copy(), larger.copy()
    for k, wheel in enumerate(wheels):
        if wheel ^ 1 not in wheels:
            continue
        other = wheels.index(wheel ^ 1)
        both = soft[k] + larger[other]
        if soft[k] >= larger[other]:
            soft[k], larger[other] = both, 0.0
        else:
            soft[k], larger[other] = 0.0, both
    return soft, larger


def _smaller_than_other(x: FloatArray, wheels: list[int]) -> FloatArray:
    """Return the (d,) relative amount by which each wheel is smaller than the other of its axle, 0 without
    that."""
    out = np.zeros(len(wheels))
    for k, wheel in enumerate(wheels):
        other = wheel ^ 1  # fl fr rl rr: the other wheel of the axle
        if other in wheels:
            out[k] = x[wheels.index(other)] - x[k]
    return out


@functools.cache
def _radius_hypotheses(d: int) -> tuple[FloatArray, FloatArray]:
    """Return the (h, d) change of the radii under each hypothesis (none, one soft, one larger), and log
    priors (h,)."""
    rows = [np.zeros(d)]
    logs = [math.log1p(-d * (FIRST_START.soft_prior + FIRST_START.larger_prior))]
    for sign, prior in ((-1.0, FIRST_START.soft_prior), (1.0, FIRST_START.larger_prior)):
        for wheel in range(d):
            for loss in LOSS_GRID:
                rows.append(sign * loss * np.eye(d)[wheel])
                logs.append(math.log(prior / LOSS_GRID.size))
    return np.array(rows), np.array(logs)


@functools.cache
def _healthy_mixture(wheels: tuple[int, ...]) -> tuple[FloatArray, FloatArray]:
    """Return the mixture of the radii of healthy cars: weights (k,) and relative covariances (k, d, d)."""
    index = list(wheels)
    front, left = IS_FRONT[index], np.where(IS_LEFT[index], 1.0, -1.0)
    side = np.where(front, 1.0, -1.0)
    base = FIRST_START.car_std**2 * np.ones((len(index), len(index))) + FIRST_START.axle_std**2 * np.outer(
        side, side
    )
    axles = [mask for mask in (front, ~front) if mask.any()]
    shares, covariances = [], []
    for parts in itertools.product(FIRST_START.within_std, repeat=len(axles)):
        covariance = base + 1e-12 * np.eye(len(index))
        for mask, (_, std) in zip(axles, parts, strict=True):
            apart = np.where(mask, left, 0.0) / 2.0
            covariance = covariance + std**2 * np.outer(apart, apart)
        shares.append(math.prod(share for share, _ in parts))
        covariances.append(covariance)
    return np.array(shares), np.array(covariances)


@dataclass(frozen=True, slots=True)
class Transition:
    """An alarm of the first start that was raised or cleared."""

    kind: AlarmKind
    wheel: int
    """Index into fl fr rl rr."""
    state: Literal["raised", "cleared"]
    probability: float
    loss_m: float
    """Expected; negative for a larger wheel, NaN when cleared."""
    reason: str


class FirstStart:
    """Alarms about the first radii of a car, with their hysteresis."""

    def __init__(self, wheels: list[int], radius_m: FloatArray, make: Callable[[], Hysteresis]) -> None:
        """`radius_m` (d,): nominal, of these wheels."""
        self._wheels = wheels
        self._radius = radius_m
        kinds = (AlarmKind.DEFLATION, AlarmKind.RADIUS_DEVIATION)
        self._alarms = {(kind, wheel): make() for kind in kinds for wheel in wheels}
        self.verdict: FirstVerdict | None = None
        self.suspected: tuple[int, float, str] | None = None
        """Wheel that is soft or a mixed tyre most probably, with its probability and in words; None before
        anything was judged."""

    @property
    def reported(self) -> set[int]:
        """Wheels of which an alarm of the first start is active."""
        return {wheel for (_, wheel), alarm in self._alarms.items() if alarm.active}

    def restore_reported(self, keys: Iterable[tuple[AlarmKind, int]]) -> None:
        """Make these alarms active, and no others, after a restart or a reset."""
        wanted = set(keys)
        for key, alarm in self._alarms.items():
            alarm.active, alarm.hold_elapsed_s = key in wanted, 0.0
        self.verdict = self.suspected = None

    def changed_axles(self, change_m: FloatArray, ordinary: set[int]) -> set[int]:
        """Return the wheels of the axles on which a tyre has changed since it was learned: differences there
        may be new.

        change_m (4,): against the baseline, NaN where there is none; `ordinary`: wheels with another alarm.
        """
        limit = FIRST_START.changed_share * float(self._radius.mean())
        moved = {w for w in self._wheels if w in ordinary or abs(float(change_m[w])) > limit}
        return moved | {w ^ 1 for w in moved}

    def update(
        self, deviation_m: FloatArray, covariance_m2: FloatArray, elapsed_s: float, changed: set[int]
    ) -> list[Transition]:
        """Return the alarms that an estimate (d,), (d, d) raises or clears; it stands for `elapsed_s` of
        driving.

        `changed`: wheels whose difference may be younger than the first start.
        """
        verdict = self.verdict = judge_first(deviation_m, covariance_m2, self._radius, self._wheels)
        index = int(
            np.argmax([0.0 if wheel in changed else verdict.soft[k] for k, wheel in enumerate(self._wheels)])
        )
        probability = 0.0 if self._wheels[index] in changed else float(verdict.soft[index])
        words = self._reason_text(AlarmKind.DEFLATION, index, "raised", verdict)
        self.suspected = self._wheels[index], probability, words
        transitions = []
        for (kind, wheel), alarm in self._alarms.items():
            k = self._wheels.index(wheel)
            soft, other = float(verdict.soft[k]), float(verdict.larger[k])
            probability = soft if kind is AlarmKind.DEFLATION else other
            if not alarm.active and wheel in changed:
                probability = 0.0
            state = alarm.update(probability, elapsed_s)
            if state is None:
                continue
            loss = float(verdict.loss_m[k]) if kind is AlarmKind.DEFLATION else -math.inf
            transitions.append(
                Transition(kind, wheel, state, probability, loss, self._reason_text(kind, k, state, verdict))
            )
        return transitions

    def _reason_text(self, kind: AlarmKind, k: int, state: str, verdict: FirstVerdict) -> str:
        """Return the sentence that an alarm about wheel k gives as its reason."""
        by = float(verdict.smaller_share[k])
        if state == "cleared":
            return "no longer outside of what tyres of one set have"
        mm = 1e3 * abs(by) * float(self._radius[k])
        if kind is AlarmKind.DEFLATION:
            return (
                f"{mm:.1f} mm ({100 * by:.1f} %) smaller than the other tyre of its axle since before the "
                "first start: soft, or else a mixed tyre or a spare (then: tpmsd reset --tyres NAME)"
            )
        return (
            f"{mm:.1f} mm ({100 * -by:.1f} %) larger than the other tyre of its axle since before the "
            "first start: a mixed tyre (then: tpmsd reset --tyres NAME), or else the other one is soft"
        )
