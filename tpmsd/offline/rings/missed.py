"""Counts that a wheel loses while it turns, distinguished from a larger radius by the wheel's own ripple.

In: `Recording`, `ReferenceTrajectory`. Out: `MissedCounts` per wheel that loses counts.

Fewer counts per distance are a larger radius or counts that are lost. The ripple that every ring has once per
turn (`car.rings.ripple`) goes with the wheel's true angle: of a larger tyre it comes after as many counts as
ever, of counts that are lost after fewer. So two models of a wheel's angle are compared by the power of the
ripple in them (Schuster 1898): the counts as they are; and the counts with a share put back that is the same
all the time, or that fluctuates as the other wheel of the axle shows. Phases are free in each block, so
that only the angle within a block counts, and nothing hangs on radii or on the receiver's scale.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.catalogue import TEETH
from tpmsd.car.physics.effect import Parameter
from tpmsd.car.physics.kinematics import wheel_speeds
from tpmsd.car.physics.motion import integrate
from tpmsd.car.rings.ring import REVOLUTION_RAD, turns_hz
from tpmsd.car.rings.ripple import (
    LOST_SHARES,
    MIN_STD_RAD,
    OUTLIER_STDS,
    common_amplitude_gain,
    ripple_gain,
    robust_std,
)
from tpmsd.foundation.wheels import AXLES, WHEELS, FloatArray
from tpmsd.offline.inference.recording import Recording
from tpmsd.offline.inference.smoothing import NEAREST, gaussian
from tpmsd.offline.inference.trajectory import ReferenceTrajectory
from tpmsd.offline.rings.settings import COUNTERS


@dataclass(frozen=True)
class MissedCounts:
    """Counts that one wheel loses."""

    wheel: str
    share: float
    """Fraction of its counts, in the mean."""
    share_std: float
    rate_per_s: float
    rate_std_per_s: float
    gain: float
    """Log-likelihood over that of a counter that loses none, nats."""
    counts_per_rev: float
    """Counts from one ripple to the next."""
    whole_per_revolution: float
    """Counts that the ring has."""


@dataclass(frozen=True)
class _Pair:
    """An axle's wheels at those of the ticks' edges where both turn fast enough."""

    angle: FloatArray
    """(n, 2) as counted, rad."""
    less: FloatArray
    """(n, 2) what each wheel counts less than the other one shows, rad: radii, and counts that are lost."""
    ripple: FloatArray
    """(n,) rapid difference of the two, rad."""
    blocks: np.ndarray
    """(n,)"""

    def turned_rad(self, side: int) -> float:
        """Return the angle by which a wheel turned, rad."""
        return float(np.ptp(self.angle[:, side]))

    def mean_missing_share(self, side: int) -> float:
        """Return the mean fraction by which a wheel counts less than the other one shows."""
        return float(self.less[-1, side] - self.less[0, side]) / self.turned_rad(side)

    def counts_per_s(self, recording: Recording, side: int) -> float:
        """Return the mean number of counts of a whole ring per second."""
        turns = self.turned_rad(side) / REVOLUTION_RAD
        return turns * recording.car.teeth_per_rev / (len(self.angle) * recording.dt_s)


def missed_counts(recording: Recording, reference: ReferenceTrajectory) -> list[MissedCounts]:
    """Return the wheels that lose counts; empty too where no usual ripple would show."""
    out = []
    for axle, pair in _pairs(recording, reference):
        found = [_missed_by_wheel(recording, pair, side, WHEELS[wheel]) for side, wheel in enumerate(axle)]
        out += [one for one in found if one is not None]
    return out


def plausible_loss_rates(
    recording: Recording, reference: ReferenceTrajectory, within_nats: float
) -> dict[str, tuple[float, float]]:
    """Return, by wheel whose ripple shows, the least and greatest rate of lost counts (1/s; of added ones
    negative) whose likelihood is within so many nats of the best; infinite at an end of what is tried."""
    shares, ring_error = LOST_SHARES.values, LOST_SHARES.ring_error
    out = {}
    for axle, pair in _pairs(recording, reference):
        for side, wheel in enumerate(axle):
            gains = [_ripple_gains(pair, side, come_and_go) for come_and_go in (False, True)]
            best = max(float(power.max()) for power in gains)
            if best < COUNTERS.lost_admit_nats:
                continue
            put_back, per_s = (0.0, pair.mean_missing_share(side)), pair.counts_per_s(recording, side)
            near = [np.flatnonzero(power > best - within_nats) for power in gains]
            ends = np.concatenate(near)
            mean = np.concatenate([shares[at] + more for at, more in zip(near, put_back, strict=True)])
            low = -math.inf if ends.min() == 0 else float(mean.min()) - ring_error
            high = math.inf if ends.max() == len(shares) - 1 else float(mean.max()) + ring_error
            out[WHEELS[wheel]] = (low * per_s, high * per_s)
    return out


def _pairs(recording: Recording, reference: ReferenceTrajectory) -> list[tuple[tuple[int, int], _Pair]]:
    """Return the axles with counters whose usual ripple would show."""
    counted = [
        axle
        for axle in AXLES
        if set(axle) <= set(recording.wheels) and bool((recording.quantum_rad[list(axle)] > 0.0).all())
    ]
    pairs = [(axle, _pair_of_axle(recording, reference, axle)) for axle in counted]
    return [(axle, pair) for axle, pair in pairs if pair is not None]


def _pair_of_axle(
    recording: Recording, reference: ReferenceTrajectory, axle: tuple[int, int]
) -> _Pair | None:
    """Return the axle's wheels where both turn fast enough; None where the ripple of a usual ring would not
    be seen.
    """
    motion, car, dt_s = reference.motion, reference.car, recording.dt_s
    wheels = list(axle)
    rotation = recording.rotation_rad[:, wheels]
    read = np.isfinite(rotation).all(axis=1)
    angle = np.concatenate([np.zeros((1, 2)), np.cumsum(np.nan_to_num(rotation), axis=0)])
    speeds = wheel_speeds(motion.speed_mps, motion.yaw_rate_radps, car.geometry)[:, wheels]
    rolled = integrate(speeds, motion.time_s) / car.radius_m[wheels]
    high_pass = COUNTERS.ripple_high_pass_s / dt_s
    by_motion: FloatArray = rolled[:, 0] - rolled[:, 1]
    if axle == AXLES[0]:
        # The motion has the ripple of the rear wheels, which would pass for one of the front's.
        by_motion = gaussian(by_motion, high_pass, NEAREST)
    between: FloatArray = angle[:, 0] - angle[:, 1] - by_motion
    rapid = between - gaussian(between, high_pass, NEAREST)
    slow = gaussian(between, COUNTERS.missed_smoothing_s / dt_s, NEAREST)
    unread = np.where(read, 0.0, 1.0)
    broken = gaussian(unread, COUNTERS.missed_smoothing_s / dt_s) > 0.02
    revolutions_hz = turns_hz(speeds.min(axis=1), float(car.radius_m[wheels].max()))
    use = np.concatenate([[False], ~broken]) & (revolutions_hz > COUNTERS.missed_from_hz)
    if not use.any():
        return None
    use &= np.abs(rapid) < OUTLIER_STDS * max(robust_std(rapid[use]), MIN_STD_RAD)
    (amplitude,) = (p for p in TEETH.parameters if isinstance(p, Parameter) and p.unit == "rad" and p.prior)
    assert amplitude.prior is not None
    usual = use.sum() * (0.5 * amplitude.prior.std) ** 2 / max(float(rapid[use].var()), 1e-30)
    if usual < COUNTERS.lost_admit_nats:
        return None
    block = np.arange(len(use)) // round(COUNTERS.missed_block_s / dt_s)
    return _Pair(angle[use], np.stack([-slow, slow], axis=1)[use], rapid[use], block[use])


def _missed_by_wheel(recording: Recording, pair: _Pair, side: int, wheel: str) -> MissedCounts | None:
    """Return the counts that a wheel loses; None where the loss is not significant."""
    shares = LOST_SHARES.values
    as_counted = _ripple_gains(pair, side, False)
    ring_error = LOST_SHARES.ring_error
    whole = np.where(_possible_without_loss(_ripple_gains(pair, 1 - side, False)), as_counted, -math.inf)
    of_ring = float(shares[int(np.argmax(whole))])
    if abs(of_ring) <= ring_error:
        of_ring = 0.0
    come_and_go = _ripple_gains(pair, side, True)
    which = max((as_counted, come_and_go), key=lambda power: float(power.max()))
    at = int(np.argmax(which))
    share = float(shares[at]) - of_ring
    if which is come_and_go:
        share += pair.mean_missing_share(side)
    gain = float(which[at] - whole.max())
    if gain < COUNTERS.lost_admit_nats or not 0 < at < len(shares) - 1:
        return None
    bend = -float(np.gradient(np.gradient(which, shares), shares)[at])
    std = math.hypot(ring_error, max(bend, 1e-12) ** -0.5)
    if share < COUNTERS.missed_stds * std:  # what follows the bends is load
        return None
    ring = recording.car.teeth_per_rev * (1.0 - of_ring)
    per_s = pair.counts_per_s(recording, side) * (1.0 - of_ring)
    return MissedCounts(wheel, share, std, share * per_s, std * per_s, gain, ring * (1.0 - share), ring)


def _possible_without_loss(other: FloatArray) -> np.ndarray:
    """Return (shares,) True for shares that a counter without losses can show: its ring has the configured
    counts, or those of the other wheel's ring, whose ripple has the power `other`, since two encoders do not
    lose alike.
    """
    shares, error = LOST_SHARES.values, LOST_SHARES.ring_error
    as_configured = np.abs(shares) <= error
    best = int(np.argmax(other))
    if other[best] < COUNTERS.lost_admit_nats:
        return np.asarray(as_configured)
    # At an end of what is tried the other wheel only says on which side of the configured count it lies.
    least = shares[best] - error if best < len(shares) - 1 else 0.0
    most = shares[best] + error if best > 0 else 0.0
    return np.asarray(as_configured | ((shares >= least) & (shares <= most)))


def _ripple_gains(pair: _Pair, side: int, come_and_go: bool) -> FloatArray:
    """Return the (shares,) log-likelihood gain of a once-per-revolution ripple for each tried share of lost
    counts.
    """
    shares = LOST_SHARES.values
    out = np.zeros(len(shares))
    variance = float(pair.ripple.var())
    blocks = np.unique(pair.blocks)
    for block in blocks:
        here = np.flatnonzero(pair.blocks == block)
        angle = pair.angle[here, side] - pair.angle[here[0], side]
        put_back = pair.less[here, side] if come_and_go else 0.0
        out += ripple_gain(angle, pair.ripple[here] * np.exp(-1j * put_back), shares, variance)
    return common_amplitude_gain(out, len(blocks))
