"""Selection of the four wheels among speed-like series.

In: series, the receiver's reference. Out: `Assignment`: posterior probability of each role for each series.

Over a cell a wheel of a rolling car at lateral place y and longitudinal place x (from the middle of the
rear axle) runs

    u = v - y r + x^2 r^2 / (2 v)        (first order in r x / v; Lundquist 2013, ch. 5, for the rear axle)

so against the common speed a left wheel falls behind in a left turn by half a track, and a front wheel gains
by its longer path. Decoys that follow the car's speed have neither, or are late. Places and delays of all
series come from one regression each, and roles from their likelihoods.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from tpmsd.car.physics.priors import DRAG_SLIP_S2PM2
from tpmsd.foundation.plain import brief
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.discovery.reference import ReceiverMotion
from tpmsd.offline.discovery.regress import RegressionFit, fit, with_prior
from tpmsd.offline.discovery.series import Series
from tpmsd.offline.discovery.settings import SETTINGS, Settings


@brief
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


def drag_slip_std() -> float:
    """Return the standard deviation of a wheel's slip by air drag against the mean of four wheels, s2/m2.

    By what cars have, and some simulated ones have not. Left out, this slip passes for a longer path of the
    other axle in bends, for it is largest where nothing bends.
    """
    return 0.5 * math.hypot(DRAG_SLIP_S2PM2.mean, DRAG_SLIP_S2PM2.std)


def followers(
    series: Sequence[Series], reference: ReceiverMotion, settings: Settings = SETTINGS
) -> list[Follower]:
    """Return the series that follow the receiver's speed, best first."""
    moving = reference.moving
    speed, accel = reference.speed_mps, reference.accel_mps2
    blocks = np.floor(reference.edge_s[:-1] / settings.block_s)
    found = []
    use = np.isfinite(speed) & np.isfinite(accel)
    # Without it bends to one side more than to the other pass for scale and base. A car that stands has none.
    yaw = np.where(np.isfinite(reference.yaw_radps), reference.yaw_radps, 0.0)
    for one in series:
        rows = use & np.isfinite(one.rate)
        if rows.sum() < 40 or not np.ptp(one.rate[rows]) > 0:
            continue
        # A quick look before the full regression: most fields have nothing to do with the speed.
        if not _rank_correlation(one.rate[rows], speed[rows]) > 0.8:
            continue
        columns = [speed, accel, yaw] + ([] if one.kind == "count" else [np.ones_like(speed)])
        made = fit(np.column_stack(columns), np.where(use, one.rate, np.nan), blocks)
        if made is None or made.r2 < settings.speed_r2 or made.value[0] <= 0:
            continue
        per_mps = float(made.value[0])
        base = 0.0 if one.kind == "count" else float(made.value[3])
        lag = -float(made.value[1]) / per_mps
        if abs(lag) > settings.max_lag_s:
            continue
        found.append(Follower(one, per_mps, base, made.r2, lag_s=lag, speed=(one.rate - base) / per_mps))
    return [f for f in sorted(found, key=lambda f: -f.r2) if (moving & np.isfinite(f.speed)).sum() > 40]


def _rank_correlation(x: FloatArray, y: FloatArray) -> float:
    """Return Spearman's rank correlation over at most 500 cells; single wild cells do not matter."""
    every = max(1, len(x) // 500)
    ranks = [np.argsort(np.argsort(values[::every])) for values in (x, y)]
    return float(np.corrcoef(ranks[0], ranks[1])[0, 1])


def clusters(found: Sequence[Follower], settings: Settings = SETTINGS) -> list[list[Follower]]:
    """Return groups of followers of one kind whose scales agree, the largest group first."""
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
    """Return counts per metre, or units of the signal per m/s, as the DBC scales them."""
    return one.per_mps * abs(one.series.field.scale)


def with_positions(
    group: Sequence[Follower],
    reference: ReceiverMotion,
    gyro: FloatArray | None = None,
    settings: Settings = SETTINGS,
) -> list[Follower]:
    """Return the cluster's members with their lateral and curvature positions, slips and delays; `gyro`: a
    better yaw rate than the receiver's.
    """
    # Not the wheels' own difference: its rounding is in the contrasts, too, and would favour its own pair.
    yaw = reference.yaw_radps if gyro is None else gyro
    return [_with_position(one, group, reference, yaw, settings) for one in group]


def groups_by_lag(members: Sequence[Follower], settings: Settings = SETTINGS) -> list[list[Follower]]:
    """Return groups of members that are equally late, the earliest group first: a copy by another unit comes
    later as a whole.
    """
    groups: list[list[Follower]] = []
    for one in sorted(members, key=lambda m: m.lag_s):
        last = groups[-1][-1] if groups else None
        if last is not None:
            apart = one.lag_s - last.lag_s
            if apart < max(settings.lag_gap_s, 3.0 * float(np.hypot(one.lag_std_s, last.lag_std_s))):
                groups[-1].append(one)
                continue
        groups.append([one])
    return groups


def _common_speed(group: Sequence[Follower]) -> FloatArray:
    """Return the (n,) mean speed of the members."""
    # The mean, not the median: contrasts against it are linear, and add up to nothing.
    return np.asarray(np.mean(np.vstack([one.speed for one in group]), axis=0))


def _with_position(
    one: Follower,
    group: Sequence[Follower],
    reference: ReceiverMotion,
    yaw: FloatArray,
    settings: Settings,
) -> Follower:
    """Return the member with its position, slip and delay; unchanged where they cannot be estimated."""
    common = _common_speed(group) if len(group) > 2 else reference.speed_mps
    fitted = _position_fit(one.speed, common, yaw, reference, settings)
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


def _position_fit(
    speed: FloatArray, common: FloatArray, yaw: FloatArray, reference: ReceiverMotion, settings: Settings
) -> RegressionFit | None:
    """Regress a speed less the common one on yaw rate, its square over speed, acceleration, and slip; None
    where too few cells are known.
    """
    cell = settings.cell_s
    accel = np.full(len(common), np.nan)
    accel[1:-1] = (common[2:] - common[:-2]) / (2 * cell)
    usable = (common > settings.min_speed_mps) & np.isfinite(yaw) & (np.abs(yaw) < 0.6 * common)
    with np.errstate(divide="ignore", invalid="ignore"):
        columns = [yaw, yaw**2 / common, accel, accel * common, common, common**3]
    blocks = np.floor(reference.edge_s[:-1] / settings.block_s)
    if len(np.unique(blocks[usable])) < settings.blocks_per_column * len(columns):
        columns.pop()
    design = np.column_stack(columns)
    design[~usable] = np.nan
    made = fit(design, speed - common, blocks)
    if made is None or len(columns) < 6:
        return made
    std = np.full(len(columns), np.inf)
    std[5] = drag_slip_std()
    return with_prior(made, np.zeros(len(columns)), std)


def receiver_position_fit(
    group: Sequence[Follower], reference: ReceiverMotion, settings: Settings = SETTINGS
) -> RegressionFit | None:
    """Return the regression of the receiver's speed on the cluster's, whose first value is minus the
    antenna's lateral position; None for at most two members, whose common speed is the receiver's.
    """
    if len(group) <= 2:
        return None
    return _position_fit(reference.speed_mps, _common_speed(group), reference.yaw_radps, reference, settings)
