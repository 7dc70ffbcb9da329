"""Which speed-like series are the four wheels.

In: series, the receiver's reference. Out: `Assignment`: posterior probability of each role for each series.

Over a cell a wheel of a rolling car at lateral place y and longitudinal place x (from the middle of the rear axle) runs

    u = v - y r + x^2 r^2 / (2 v)        (first order in r x / v; Lundquist 2013, ch. 5, for the rear axle)

so against the common speed a left wheel falls behind in a left turn by half a track, and a front wheel gains by its
longer way. Decoys that follow the car's speed have neither, or are late. Places and delays of all series come from
one regression each, and roles from their likelihoods.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from tpmsd.discovery.names import CLEAR, named_wheel
from tpmsd.discovery.reference import Reference
from tpmsd.discovery.regress import Fit, fit
from tpmsd.discovery.series import Series
from tpmsd.discovery.settings import SETTINGS, Settings
from tpmsd.wheels import WHEELS, FloatArray

_MOST_IN_CLUSTER = 14
_LAG_SCALE_S = 0.008
"""A copy of a wheel that comes this much later is that much less likely the wheel itself."""
_DECOY_STD_M = 0.5
"""Spread of lateral places of speeds that are no wheel's."""


@dataclass(frozen=True, slots=True)
class Follower:
    """A series that follows the car's speed."""

    series: Series
    per_mps: float
    """Raw counts per metre, or raw units per m/s."""
    base: float
    """Raw number at standstill (0 for counters)."""
    r2: float
    lateral_m: float = 0.0
    lateral_std_m: float = np.inf
    """Place to the left of the common speed's, m."""
    curve_m2: float = 0.0
    curve_std_m2: float = np.inf
    """x^2/2 against the common speed's, m2."""
    lag_s: float = 0.0
    lag_std_s: float = np.inf
    slip: float = 0.0
    slip_std: float = np.inf
    """Relative speed per acceleration, s2/m."""
    rms_mps: float = 0.0
    speed: FloatArray = field(default_factory=lambda: np.zeros(0))
    """(n,) m/s over the cells."""


@dataclass(frozen=True, slots=True)
class Role:
    """Who plays a wheel."""

    wheel: str
    follower: Follower
    probability: float
    rivals: tuple[tuple[str, float], ...]
    """Other signals and their probability."""


@dataclass(frozen=True, slots=True)
class Assignment:
    """The wheels."""

    kind: str
    """'counts' or 'speeds'."""
    roles: tuple[Role, ...]
    pair_only: bool
    """Only two wheels were found: the rear pair, as it is the only pair that can be monitored."""
    left_right: float
    """Probability of the sides, given the four."""
    front_rear: float
    """Probability of the axles, given the four."""


def followers(
    series: Sequence[Series], reference: Reference, settings: Settings = SETTINGS
) -> list[Follower]:
    """The series that follow the receiver's speed, best first."""
    moving = reference.moving
    speed, accel = reference.speed_mps, reference.accel_mps2
    blocks = np.floor(reference.edge_s[:-1] / settings.block_s)
    found = []
    use = np.isfinite(speed) & np.isfinite(accel)
    for one in series:
        rows = use & np.isfinite(one.rate)
        if rows.sum() < 40 or not np.ptp(one.rate[rows]) > 0:
            continue
        # A quick look before the full regression: most fields have nothing to do with the speed.
        if not _rank_correlation(one.rate[rows], speed[rows]) > 0.8:
            continue
        columns = [speed, accel] if one.kind == "count" else [speed, accel, np.ones_like(speed)]
        made = fit(np.column_stack(columns), np.where(use, one.rate, np.nan), blocks)
        if made is None or made.r2 < settings.speed_r2 or made.value[0] <= 0:
            continue
        per_mps = float(made.value[0])
        base = 0.0 if one.kind == "count" else float(made.value[2])
        lag = -float(made.value[1]) / per_mps
        if abs(lag) > settings.max_lag_s:
            continue
        found.append(Follower(one, per_mps, base, made.r2, lag_s=lag, speed=(one.rate - base) / per_mps))
    return [f for f in sorted(found, key=lambda f: -f.r2) if (moving & np.isfinite(f.speed)).sum() > 40]


def _rank_correlation(x: FloatArray, y: FloatArray) -> float:
    """Spearman's, on at most 500 of the cells; single wild cells do not matter."""
    every = max(1, len(x) // 500)
    ranks = [np.argsort(np.argsort(values[::every])) for values in (x, y)]
    return float(np.corrcoef(ranks[0], ranks[1])[0, 1])


def clusters(found: Sequence[Follower], settings: Settings = SETTINGS) -> list[list[Follower]]:
    """Followers of one kind whose scales agree, the largest first."""
    groups: list[list[Follower]] = []
    for one in sorted(found, key=lambda f: (f.series.kind, physical_scale(f))):
        last = groups[-1] if groups else None
        if (
            last
            and last[-1].series.kind == one.series.kind
            and physical_scale(one) <= physical_scale(last[0]) * (1 + settings.same_scale)
        ):
            last.append(one)
        else:
            groups.append([one])
    return groups


def physical_scale(one: Follower) -> float:
    """Counts per metre, or units of the signal per m/s, as the DBC scales them."""
    return one.per_mps * abs(one.series.field.scale)


def placed(
    group: Sequence[Follower],
    reference: Reference,
    gyro: FloatArray | None = None,
    settings: Settings = SETTINGS,
) -> list[Follower]:
    """The cluster with places and delays of its members; `gyro`: a better yaw rate than the receiver's."""
    yaw = reference.yaw_radps if gyro is None else gyro
    for _ in range(2):
        members = [_place(one, group, reference, yaw, settings) for one in group]
        better = _yaw_of(members, yaw)
        if better is None:
            return members
        yaw = better
    return [_place(one, group, reference, yaw, settings) for one in group]


def _common(group: Sequence[Follower]) -> FloatArray:
    return np.asarray(np.median(np.vstack([one.speed for one in group]), axis=0))


def _place(
    one: Follower,
    group: Sequence[Follower],
    reference: Reference,
    yaw: FloatArray,
    settings: Settings,
) -> Follower:
    common = _common(group) if len(group) > 2 else reference.speed_mps
    fitted = _place_fit(one.speed, common, yaw, reference, settings)
    if fitted is None:
        return one
    return Follower(
        one.series,
        one.per_mps * (1 + float(fitted.value[4])),
        one.base,
        one.r2,
        lateral_m=-float(fitted.value[0]),
        lateral_std_m=fitted.std(0),
        curve_m2=float(fitted.value[1]),
        curve_std_m2=fitted.std(1),
        lag_s=-float(fitted.value[2]),
        lag_std_s=fitted.std(2),
        slip=float(fitted.value[3]),
        slip_std=fitted.std(3),
        rms_mps=fitted.residual_rms,
        speed=one.speed,
    )


def _place_fit(
    speed: FloatArray, common: FloatArray, yaw: FloatArray, reference: Reference, settings: Settings
) -> Fit | None:
    cell = settings.cell_s
    accel = np.full(len(common), np.nan)
    accel[1:-1] = (common[2:] - common[:-2]) / (2 * cell)
    usable = (common > settings.min_speed_mps) & np.isfinite(yaw) & (np.abs(yaw) < 0.6 * common)
    with np.errstate(divide="ignore", invalid="ignore"):
        design = np.column_stack([yaw, yaw**2 / common, accel, accel * common, common])
    design[~usable] = np.nan
    return fit(design, speed - common, np.floor(reference.edge_s[:-1] / settings.block_s))


def _yaw_of(members: Sequence[Follower], yaw: FloatArray) -> FloatArray | None:
    """Yaw rate by the widest pair of wheels, scaled to the one so far; None if there is no such pair."""
    clear = [m for m in members if m.lateral_std_m < 0.2]
    if len(clear) < 2:
        return None
    left, right = max(clear, key=lambda m: m.lateral_m), min(clear, key=lambda m: m.lateral_m)
    if left.lateral_m - right.lateral_m < 0.8:
        return None
    difference = right.speed - left.speed
    speed = 0.5 * (left.speed + right.speed)
    rows = np.isfinite(difference) & np.isfinite(yaw) & (speed > 2.0)
    if rows.sum() < 40 or np.corrcoef(difference[rows], yaw[rows])[0, 1] < 0.7:
        return None
    # Inverse regression: the noise is that of the yaw rate so far.
    slope = float(difference[rows] @ difference[rows] / (difference[rows] @ yaw[rows]))
    straight = rows & (np.abs(yaw) < 0.02) & (speed > 5.0)
    tilt = float((difference[straight] / speed[straight]).mean()) if straight.sum() > 40 else 0.0
    return np.asarray((difference - tilt * speed) / slope)


def assign(
    group: Sequence[Follower],
    anchor: Fit | None,
    settings: Settings = SETTINGS,
    prior: dict[str, str] | None = None,
) -> Assignment | None:
    """Roles within one cluster; None if it holds no pair of wheels.

    `anchor`: the receiver's own place against the common speed, as `_place_fit` has it. `prior`: wheel -> signal
    of a car library's entry that fits this bus.
    """
    members = _likely(group, settings)
    if len(members) < 2:
        return None
    scores = _scores(members, anchor, settings, prior or {})
    four = _best_four(members, scores, settings) if len(members) >= 4 else None
    if four is not None:
        return four
    return _best_pair(members, scores, settings)


def anchor_of(group: Sequence[Follower], reference: Reference, settings: Settings = SETTINGS) -> Fit | None:
    """The receiver's place against the cluster's common speed; None where the cluster's speed is the receiver's."""
    if len(group) <= 2:
        return None
    return _place_fit(reference.speed_mps, _common(group), reference.yaw_radps, reference, settings)


def _likely(group: Sequence[Follower], settings: Settings) -> list[Follower]:
    return sorted(group, key=lambda m: (-abs(m.lateral_m), m.lag_s))[:_MOST_IN_CLUSTER]


def _log_normal(x: float, mean: float, std: float) -> float:
    return -0.5 * ((x - mean) / std) ** 2 - float(np.log(std))


def _scores(
    members: Sequence[Follower], anchor: Fit | None, settings: Settings, prior: dict[str, str]
) -> FloatArray:
    """(m, 4) log-likelihood ratio of each wheel's role against 'no wheel'."""
    zero, zero_std = (-float(anchor.value[0]), anchor.std(0)) if anchor else (0.0, 0.0)
    if not np.isfinite(zero) or abs(zero) > 1.5:
        zero, zero_std = 0.0, 0.5
    # The antenna's own place across the car is some decimetres from the middle.
    places = np.array([m.lateral_m for m in members])
    middle = 0.5 * (places.max() + places.min())
    middle_std = 0.1
    shift_std = np.hypot(zero_std, 0.4)
    weight = 1 / middle_std**2, 1 / shift_std**2
    centre = (weight[0] * middle + weight[1] * zero) / sum(weight)
    half = settings.track_m / 2
    earliest = min((m.lag_s for m in members if abs(m.lateral_m - centre) > 0.4), default=0.0)
    rear = min((m.curve_m2 for m in members if np.isfinite(m.curve_std_m2)), default=0.0)
    out = np.zeros((len(members), 4))
    for i, member in enumerate(members):
        std = float(np.hypot(member.lateral_std_m, settings.contrast_floor_m))
        side_std = float(np.hypot(std, np.hypot(settings.track_std_m / 2, 0.05)))
        decoy = np.logaddexp(
            _log_normal(member.lateral_m, centre, std) + np.log(0.9),
            _log_normal(member.lateral_m, centre, float(np.hypot(std, _DECOY_STD_M))) + np.log(0.1),
        )
        curve_std = float(np.hypot(member.curve_std_m2, settings.curvature_floor_m2))
        late = max(member.lag_s - earliest, 0.0)
        late_std = float(np.hypot(member.lag_std_s, 0.003))
        for k, wheel in enumerate(WHEELS):
            side = half if wheel[1] == "l" else -half
            score = _log_normal(member.lateral_m - centre, side, side_std) - decoy
            front = 0.5 * settings.wheelbase_m**2
            front_std = settings.wheelbase_m * settings.wheelbase_std_m
            if wheel[0] == "f":
                score += _log_normal(member.curve_m2 - rear, front, float(np.hypot(curve_std, front_std)))
            else:
                score += _log_normal(member.curve_m2 - rear, 0.0, curve_std)
            # Either axle, before the curve is known.
            score -= float(
                np.logaddexp(
                    _log_normal(member.curve_m2 - rear, front, float(np.hypot(curve_std, front_std))),
                    _log_normal(member.curve_m2 - rear, 0.0, curve_std),
                )
                - np.log(2.0)
            )
            score -= max(late - late_std, 0.0) / _LAG_SCALE_S
            score += 1.0 * (named_wheel(member.series.field.signal) is not None)
            if prior.get(wheel) == member.series.field.signal:
                score += 6.0
            out[i, k] = score
    return out


def _best_four(members: Sequence[Follower], scores: FloatArray, settings: Settings) -> Assignment | None:
    """Marginals over all ways to give the four roles to four members."""
    top = [list(np.argsort(-scores[:, k])[:6]) for k in range(4)]
    ways, weights = [], []
    for way in itertools.product(*top):
        if len(set(way)) == 4:
            ways.append(way)
            weights.append(
                sum(scores[i, k] for k, i in enumerate(way)) + _coherence(members, way) + _named(members, way)
            )
    if not ways:
        return None
    weight = np.exp(np.array(weights) - max(weights))
    weight /= weight.sum()
    best = ways[int(np.argmax(weight))]
    span = [members[i].lateral_m for i in best]
    if min(span[0] - span[1], span[2] - span[3]) < 0.5 and max(weights) < 0.0:
        return None
    sides = sum(w for w, way in zip(weight, ways, strict=True) if {way[0], way[2]} == {best[0], best[2]})
    axles = sum(w for w, way in zip(weight, ways, strict=True) if {way[0], way[1]} == {best[0], best[1]})
    roles = []
    for k, wheel in enumerate(WHEELS):
        share: dict[int, float] = {}
        for w, way in zip(weight, ways, strict=True):
            share[way[k]] = share.get(way[k], 0.0) + float(w)
        roles.append(_role(wheel, members, best[k], share, settings))
    return Assignment(_kind(members[best[0]]), tuple(roles), False, float(sides), float(axles))


def _named(members: Sequence[Follower], way: Sequence[int], wheels: Sequence[str] = WHEELS) -> float:
    """Names count once for all wheels: a DBC that has the sides wrong has them wrong throughout."""
    named = [named_wheel(members[i].series.field.signal) for i in way]
    told = [(name, wheel) for name, wheel in zip(named, wheels, strict=True) if name is not None]
    return CLEAR * sum(name == wheel for name, wheel in told) / len(told) if told else 0.0


def _coherence(members: Sequence[Follower], way: Sequence[int]) -> float:
    """Wheels of an axle come in one message, of one width, and equally late."""
    score = 0.0
    for left, right in ((0, 1), (2, 3)):
        one, other = members[way[left]].series.field, members[way[right]].series.field
        score += 1.0 * (one.key == other.key) + 1.0 * (one.place.length == other.place.length)
    lags = [members[i].lag_s for i in way]
    stds = [np.hypot(members[i].lag_std_s, 0.006) for i in way]
    mean = float(np.mean(lags))
    return score - 0.5 * float(
        sum(min(((lag - mean) / std) ** 2, 50.0) for lag, std in zip(lags, stds, strict=True))
    )


def _best_pair(members: Sequence[Follower], scores: FloatArray, settings: Settings) -> Assignment | None:
    """The rear pair alone: the only pair that can be monitored."""
    ways, weights = [], []
    side = np.logaddexp(scores[:, (0, 1)], scores[:, (2, 3)]) - np.log(2.0)
    for way in itertools.permutations(range(len(members)), 2):
        ways.append(way)
        weights.append(side[way[0], 0] + side[way[1], 1] + _named(members, way, ("rl", "rr")))
    weight = np.exp(np.array(weights) - max(weights))
    weight /= weight.sum()
    best = ways[int(np.argmax(weight))]
    left, right = members[best[0]], members[best[1]]
    apart = abs(left.lateral_m - right.lateral_m)
    if apart < 0.5 and max(weights) < 0.0:
        return None
    roles = []
    for k, wheel in enumerate(("rl", "rr")):
        share: dict[int, float] = {}
        for w, way in zip(weight, ways, strict=True):
            share[way[k]] = share.get(way[k], 0.0) + float(w)
        roles.append(_role(wheel, members, best[k], share, settings))
    sides = float(sum(w for w, way in zip(weight, ways, strict=True) if way == best))
    return Assignment(_kind(left), tuple(roles), True, sides, 1.0)


def _role(
    wheel: str, members: Sequence[Follower], best: int, share: dict[int, float], settings: Settings
) -> Role:
    rivals = sorted(
        ((members[i].series.field.signal, p) for i, p in share.items() if i != best and p > 1e-4),
        key=lambda rival: -rival[1],
    )
    probability = min(share[best], settings.max_probability)
    return Role(wheel, members[best], probability, tuple(rivals[:3]))


def _kind(member: Follower) -> str:
    return "counts" if member.series.kind == "count" else "speeds"
