"""The best candidates for the wheels of a drive that does not decide them, with probabilities.

In: `Follower`s and the receiver's reference. Out: `Candidate`s, the most probable first. Pure.

Where a drive turns little, the regression of each signal on the receiver's yaw rate is attenuated by the
noise of that rate, and no signal stands apart from the common speed. The other way round it is not: with
d = ((v_fr - v_fl) + (v_rr - v_rl)) / 2 of four signals as wheels, yaw rate = d / track + noise, and d is
known far better than the yaw rate (errors in variables: Fuller 1987, ch. 1). So every order to give the
four places to four signals of one scale is weighed by the slope of the yaw rate on d against 1 / track,
by how alike the differences of front and rear are, and by whether an axle's signals share a message,
against the hypothesis that there is no wheel among them, with which both slopes are anywhere. Front and
rear stay undecided.
"""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tpmsd.foundation.wheels import WHEELS
from tpmsd.offline.discovery.reference import ReceiverMotion
from tpmsd.offline.discovery.regress import fit
from tpmsd.offline.discovery.series import MessageField
from tpmsd.offline.discovery.settings import SETTINGS, Settings
from tpmsd.offline.discovery.wheels import Follower, clusters

Order = tuple[int, ...]
_AXLES_SIMILAR = 0.15
"""Standard deviation of what the axles' differences differ by, in parts of their mean: tracks by 3 %, the
longer path of the front axle in a bend, and loads that shift (0.1)."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """A signal that may be a wheel."""

    field: MessageField
    kind: str
    """count | speed"""
    side: str
    """left | right, the more probable one."""
    probability: float
    """Probability that the signal is a wheel of that side."""
    any_wheel: float
    """Probability that the signal is one of the four wheels."""

    def document(self) -> dict[str, str | float]:
        """Return the candidate as JSON has it."""
        return {
            "signal": self.field.signal,
            "kind": self.kind,
            "side": self.side,
            "probability": self.probability,
            "any_wheel": self.any_wheel,
        }


def candidates(
    found: Sequence[Follower],
    reference: ReceiverMotion,
    settings: Settings = SETTINGS,
) -> tuple[Candidate, ...]:
    """Return candidates of the cluster of equal scale in which four wheels are most probable; empty where no
    cluster has four members.
    """
    best: tuple[Candidate, ...] = ()
    for group in clusters(found, settings):
        if len(group) < len(WHEELS):
            continue
        members = sorted(group, key=lambda one: -one.r2)[: settings.max_in_cluster]
        made = _candidates_of_cluster(members, reference, settings)
        if made and (not best or _expected_wheels(made) > _expected_wheels(best)):
            best = made
    return best


def _expected_wheels(made: Sequence[Candidate]) -> float:
    """Return the expected number of wheels among candidates: the sum of their probabilities."""
    return sum(one.any_wheel for one in made)


def _candidates_of_cluster(
    members: Sequence[Follower], reference: ReceiverMotion, settings: Settings
) -> tuple[Candidate, ...]:
    """Return the members with marginal probabilities over all orders, the prior of `no wheel` being a half;
    empty where no order can be judged.
    """
    slopes: dict[Order, float | None] = {}
    orders, scores = [], []
    for order in itertools.permutations(range(len(members)), len(WHEELS)):
        similar = (
            order if order[0] < order[2] else (order[2], order[3], order[0], order[1])
        )  # front and rear for each other
        if similar not in slopes:
            slopes[similar] = _yaw_log_likelihood_ratio(members, similar, reference, settings)
        by_yaw = slopes[similar]
        if by_yaw is not None:
            orders.append(order)
            scores.append(by_yaw + _message_evidence(members, order))
    if not orders:
        return ()
    logs = np.append(np.array(scores) - np.log(len(orders)), 0.0)
    weights = np.exp(logs - logs.max())
    weights /= weights.sum()
    share: dict[int, dict[str, float]] = defaultdict(lambda: dict.fromkeys(WHEELS, 0.0))
    for weight, order in zip(weights, orders, strict=False):
        for wheel, member in zip(WHEELS, order, strict=True):
            share[member][wheel] += float(weight)
    made = []
    for member, by_wheel in share.items():
        left, right = by_wheel["fl"] + by_wheel["rl"], by_wheel["fr"] + by_wheel["rr"]
        series = members[member].series
        kind = "count" if series.kind == "count" else "speed"
        most, total = (min(value, settings.max_probability) for value in (max(left, right), left + right))
        side = "left" if left > right else "right"
        made.append(Candidate(series.field, kind, side, most, total))
    return tuple(sorted(made, key=lambda one: (-one.any_wheel, one.field.signal)))


def _yaw_log_likelihood_ratio(
    members: Sequence[Follower], order: Order, reference: ReceiverMotion, settings: Settings
) -> float | None:
    """Return the log-likelihood ratio of four signals as fl, fr, rl and rr against no wheels; None where it
    cannot be computed.

    By two slopes: that of the receiver's yaw rate on the mean difference of the axles, and that of the
    difference between front and rear on it, which is zero for wheels and 2/3 with the speed of the car itself
    in place of one.
    """
    fl, fr, rl, rr = (members[k].speed for k in order)
    turned = 0.5 * ((fr - fl) + (rr - rl))
    common = 0.25 * (fl + fr + rl + rr)
    moving = common > settings.min_speed_mps
    accel = np.gradient(common, reference.edge_s[:-1])
    blocks = np.floor(reference.edge_s[:-1] / settings.block_s)
    design = np.column_stack([turned, common, accel, np.ones_like(common)])
    by_receiver = fit(design, np.where(moving, reference.yaw_radps, np.nan), blocks)
    between = fit(design, np.where(moving, (fr - fl) - (rr - rl), np.nan), blocks)
    if by_receiver is None or between is None:
        return None
    stds = by_receiver.std(0), between.std(0)
    if not np.isfinite(stds).all():
        return None
    slope, expected = float(by_receiver.value[0]), 1.0 / settings.track_m
    std = float(np.hypot(stds[0], settings.track_std_m / settings.track_m**2))
    score = _log_normal(slope - expected, std) - _log_normal(slope, float(np.hypot(stds[0], expected)))
    unlike = float(between.value[0])
    similar = float(np.hypot(stds[1], _AXLES_SIMILAR))
    return score + _log_normal(unlike, similar) - _log_normal(unlike, float(np.hypot(stds[1], 1.0)))


def _message_evidence(members: Sequence[Follower], order: Order) -> float:
    """Return a nat for each axle whose wheels come in one message, and one for each whose wheels have one
    width.
    """
    fields = [members[k].series.field for k in order]
    axles = ((fields[0], fields[1]), (fields[2], fields[3]))
    return float(
        sum((one.key == other.key) + (one.layout.length == other.layout.length) for one, other in axles)
    )


def _log_normal(x: float, std: float) -> float:
    """Return the logarithm of a normal density of mean zero, without its constant."""
    return -0.5 * (x / std) ** 2 - float(np.log(std))
