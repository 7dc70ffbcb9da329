"""Assignment of the members of a cluster to wheels: likelihoods of positions, delays and names.

In: `Follower`s with their places. Out: `Assignment`.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tpmsd.foundation.plain import brief
from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.discovery.library import Match
from tpmsd.offline.discovery.names import CLEAR, named_wheel
from tpmsd.offline.discovery.regress import RegressionFit
from tpmsd.offline.discovery.settings import SETTINGS, Settings
from tpmsd.offline.discovery.wheels import Follower


@brief
@dataclass(frozen=True, slots=True)
class Role:
    """Series that is taken for a wheel."""

    wheel: str
    follower: Follower
    probability: float
    alternatives: tuple[tuple[str, float], ...]
    """Other signals and their probability."""


@brief
@dataclass(frozen=True, slots=True)
class Assignment:
    """Signals that are the wheels, with the probabilities of sides and axles."""

    kind: str
    """'counts' or 'speeds'."""
    roles: tuple[Role, ...]
    pair_only: bool
    """True if only two wheels were found: the rear pair, as it is the only pair that can be monitored."""
    left_right: float
    """Probability of the sides, given the four."""
    front_rear: float
    """Probability of the axles, given the four."""


def assign(
    group: Sequence[Follower],
    receiver_position: RegressionFit | None,
    settings: Settings = SETTINGS,
    match: Match | None = None,
) -> Assignment | None:
    """Return roles within one cluster; None if it holds no pair of wheels.

    `receiver_position`: the receiver's own place against the common speed, as `_position_fit` has it.
    `match`: the platform whose bus this one looks like, as prior.
    """
    members = _outermost_members(group, settings)
    if len(members) < 2:
        return None
    scores = _role_log_likelihood_ratios(members, receiver_position, settings, match)
    four = _best_four_wheels(members, scores, settings) if len(members) >= 4 else None
    if four is not None:
        return four
    return _best_rear_pair(members, scores, settings)


def _outermost_members(group: Sequence[Follower], settings: Settings) -> list[Follower]:
    """Return at most `max_in_cluster` members, those farthest from the centre line first, the less late of
    equals.
    """
    return sorted(group, key=lambda m: (-abs(m.lateral_m), m.lag_s))[: settings.max_in_cluster]


def _log_normal(x: float, mean: float, std: float) -> float:
    """Return the logarithm of a normal density, without its constant."""
    return -0.5 * ((x - mean) / std) ** 2 - float(np.log(std))


def _role_log_likelihood_ratios(
    members: Sequence[Follower],
    receiver_position: RegressionFit | None,
    settings: Settings,
    match: Match | None,
) -> FloatArray:
    """Return (m, 4) log-likelihood ratio of each wheel's role against 'no wheel'."""
    zero, zero_std = (
        (-float(receiver_position.value[0]), receiver_position.std(0)) if receiver_position else (0.0, 0.0)
    )
    if not np.isfinite(zero) or abs(zero) > 1.5:
        zero, zero_std = 0.0, 0.5
    # The antenna's own place across the car is some decimetres from the middle.
    lateral = np.array([m.lateral_m for m in members])
    middle = 0.5 * (lateral.max() + lateral.min())
    middle_std = 0.1
    shift_std = np.hypot(zero_std, 0.4)
    weight = 1 / middle_std**2, 1 / shift_std**2
    centre = (weight[0] * middle + weight[1] * zero) / sum(weight)
    half = settings.track_m / 2
    earliest = min((m.lag_s for m in members if abs(m.lateral_m - centre) > 0.4), default=0.0)
    out = np.zeros((len(members), 4))
    for i, member in enumerate(members):
        std = float(np.hypot(member.lateral_std_m, settings.contrast_floor_m))
        side_std = float(np.hypot(std, np.hypot(settings.track_std_m / 2, 0.05)))
        non_wheel = np.logaddexp(
            _log_normal(member.lateral_m, centre, std) + np.log(0.9),
            _log_normal(member.lateral_m, centre, float(np.hypot(std, settings.decoy_std_m))) + np.log(0.1),
        )
        late = max(member.lag_s - earliest, 0.0)
        late_std = float(np.hypot(member.lag_std_s, 0.003))
        for k, wheel in enumerate(WHEELS):
            side = half if wheel[1] == "l" else -half
            score = _log_normal(member.lateral_m - centre, side, side_std) - non_wheel
            score -= max(late - late_std, 0.0) / settings.lag_scale_s
            score += 1.0 * (named_wheel(member.series.field.signal) is not None)
            if match is not None and match.wheels.get(wheel) == member.series.field.signal:
                score += settings.named_platform if match.by_name else settings.platform_layout
            out[i, k] = score
    return out


def _best_four_wheels(
    members: Sequence[Follower], scores: FloatArray, settings: Settings
) -> Assignment | None:
    """Return the likeliest assignment of the four roles to four members, with marginal probabilities over all
    assignments; None where it is less likely than no wheels and its sides are not apart.
    """
    top = [list(np.argsort(-scores[:, k])[:6]) for k in range(4)]
    orders, weights = [], []
    for order in itertools.product(*top):
        if len(set(order)) == 4:
            orders.append(order)
            weights.append(
                sum(scores[i, k] for k, i in enumerate(order))
                + _similarity_evidence(members, order)
                + _name_evidence(members, order)
                + _axle_evidence(members, order, settings)
            )
    if not orders:
        return None
    weight = np.exp(np.array(weights) - max(weights))
    weight /= weight.sum()
    best = orders[int(np.argmax(weight))]
    span = [members[i].lateral_m for i in best]
    if min(span[0] - span[1], span[2] - span[3]) < 0.5 and max(weights) < 0.0:
        return None
    sides = sum(
        w for w, order in zip(weight, orders, strict=True) if {order[0], order[2]} == {best[0], best[2]}
    )
    axles = sum(
        w for w, order in zip(weight, orders, strict=True) if {order[0], order[1]} == {best[0], best[1]}
    )
    roles = []
    for k, wheel in enumerate(WHEELS):
        share: dict[int, float] = {}
        for w, order in zip(weight, orders, strict=True):
            share[order[k]] = share.get(order[k], 0.0) + float(w)
        roles.append(_wheel_role(wheel, members, best[k], share, settings))
    return Assignment(_assignment_kind(members[best[0]]), tuple(roles), False, float(sides), float(axles))


def _name_evidence(
    members: Sequence[Follower], order: Sequence[int], wheels: Sequence[str] = WHEELS
) -> float:
    """Return the evidence of the names, nats: `CLEAR` if all names that state a wheel agree with the order,
    else 0. It counts once for all wheels: a DBC that has the sides wrong has them wrong throughout.
    """
    named = [named_wheel(members[i].series.field.signal) for i in order]
    named_wheels = [(name, wheel) for name, wheel in zip(named, wheels, strict=True) if name is not None]
    return CLEAR if named_wheels and all(name == wheel for name, wheel in named_wheels) else 0.0


def _axle_evidence(members: Sequence[Follower], order: Sequence[int], settings: Settings) -> float:
    """Return the log-likelihood (nats) of front and rear: front wheels roll farther in a bend, by half the
    square of the wheelbase.
    """
    q = [members[i].curve_m2 for i in order]
    stds = [float(np.hypot(members[i].curve_std_m2, settings.curvature_floor_m2)) for i in order]
    front, spread = 0.5 * settings.wheelbase_m**2, settings.wheelbase_m * settings.wheelbase_std_m
    score = 0.0
    for left, right in ((0, 2), (1, 3)):
        std = float(np.hypot(np.hypot(stds[left], stds[right]), spread))
        if np.isfinite(std):
            score += 0.5 * _log_normal(q[left] - q[right], front, std) + float(0.5 * np.log(std))
    return score


def _similarity_evidence(members: Sequence[Follower], order: Sequence[int]) -> float:
    """Return the evidence (nats) of what wheels have in common: those of an axle come in one message, have
    one width and slip alike; all are equally late.
    """
    score = 0.0
    for left, right in ((0, 1), (2, 3)):
        one, other = members[order[left]].series.field, members[order[right]].series.field
        score += 1.0 * (one.key == other.key) + 1.0 * (one.layout.length == other.layout.length)
        # A driven axle's wheels slip alike.
        pair = members[order[left]], members[order[right]]
        std = float(np.hypot(np.hypot(pair[0].slip_std, pair[1].slip_std), SETTINGS.slip_similar_s2pm))
        if np.isfinite(std):
            score -= 0.5 * min(((pair[0].slip - pair[1].slip) / std) ** 2, 30.0)
    lags = [members[i].lag_s for i in order]
    stds = [np.hypot(members[i].lag_std_s, 0.006) for i in order]
    mean = float(np.mean(lags))
    return score - 0.5 * float(
        sum(min(((lag - mean) / std) ** 2, 50.0) for lag, std in zip(lags, stds, strict=True))
    )


def _best_rear_pair(members: Sequence[Follower], scores: FloatArray, settings: Settings) -> Assignment | None:
    """Return the likeliest rear left and right, for wheels of one axle alone (only the rear pair can be
    monitored); None where they are less likely than no wheels and not apart.
    """
    orders, weights = [], []
    side = np.logaddexp(scores[:, (0, 1)], scores[:, (2, 3)]) - np.log(2.0)
    for order in itertools.permutations(range(len(members)), 2):
        orders.append(order)
        weights.append(side[order[0], 0] + side[order[1], 1] + _name_evidence(members, order, ("rl", "rr")))
    weight = np.exp(np.array(weights) - max(weights))
    weight /= weight.sum()
    best = orders[int(np.argmax(weight))]
    left, right = members[best[0]], members[best[1]]
    apart = abs(left.lateral_m - right.lateral_m)
    if apart < 0.5 and max(weights) < 0.0:
        return None
    roles = []
    for k, wheel in enumerate(("rl", "rr")):
        share: dict[int, float] = {}
        for w, order in zip(weight, orders, strict=True):
            share[order[k]] = share.get(order[k], 0.0) + float(w)
        roles.append(_wheel_role(wheel, members, best[k], share, settings))
    sides = float(sum(w for w, order in zip(weight, orders, strict=True) if order == best))
    return Assignment(_assignment_kind(left), tuple(roles), True, sides, 1.0)


def _wheel_role(
    wheel: str, members: Sequence[Follower], best: int, share: dict[int, float], settings: Settings
) -> Role:
    """Return the role of a wheel with its probability, `share` by member, and the next three members as
    alternatives.
    """
    alternatives = sorted(
        ((members[i].series.field.signal, p) for i, p in share.items() if i != best and p > 1e-4),
        key=lambda alternative: -alternative[1],
    )
    probability = min(share[best], settings.max_probability)
    return Role(wheel, members[best], probability, tuple(alternatives[:3]))


def _assignment_kind(member: Follower) -> str:
    return "counts" if member.series.kind == "count" else "speeds"
