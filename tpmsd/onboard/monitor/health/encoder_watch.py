"""Watch for a wheel's encoder that loses counts, distinguished from a larger tyre by its ring's ripple.

In: ticks. Out: the wheels whose ripple comes after fewer counts than that of the other wheel of the axle, and
by which share.

Both wheels of an axle are heard in their rapid difference. Each minute of fast driving says how well the
ripple of each repeats if a share of its counts is missing (`car.rings.ripple`); the last minutes are added
up. Only fine encoders are watched: on a ring of 48 teeth a usual ripple is far below a count.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from tpmsd.car.config.model import VehicleConfig
from tpmsd.car.rings.ring import REVOLUTION_RAD
from tpmsd.car.rings.ripple import LOST_SHARES, OUTLIER_STDS, common_amplitude_gain, ripple_gain, robust_std
from tpmsd.foundation.median import median
from tpmsd.foundation.wheels import AXLES, FloatArray
from tpmsd.onboard.monitor.settings import ENCODERS
from tpmsd.onboard.timeline.tick import Tick

_SHARES = LOST_SHARES.values


class EncoderWatch:
    """All axles of one car whose rings are fine enough."""

    def __init__(self, vehicle: VehicleConfig, wheels: list[int]) -> None:
        fine = {wheel for wheel in wheels if vehicle.teeth(wheel) >= ENCODERS.min_counts}
        self._axles = [_Axle(*pair) for pair in AXLES if set(pair) <= fine]
        self.losing: dict[int, float] = {}
        """Wheels whose encoder loses counts, and which share of them."""

    def update(self, tick: Tick) -> None:
        """Update `losing` by one tick, once a minute."""
        for axle in self._axles:
            if axle.update(tick):
                already_losing = {wheel for wheel in axle.wheels if self.losing.pop(wheel, None) is not None}
                self.losing |= axle.lost_shares(already_losing)


class _Axle:
    """Two wheels of an axle, and the gains of their ripples over the last minutes."""

    def __init__(self, left: int, right: int) -> None:
        self.wheels = (left, right)
        self._angles: list[tuple[float, float]] = []
        """Angles of the ticks of the current minute, rad."""
        self._lasted_s = 0.0
        self._gains: deque[FloatArray] = deque(maxlen=ENCODERS.kept)
        """(2, shares) of each minute."""

    def update(self, tick: Tick) -> bool:
        """Add one tick; return whether it completes a minute."""
        turned = tick.rotation_rad.tolist()
        left, right = turned[self.wheels[0]], turned[self.wheels[1]]
        if not min(left, right) >= REVOLUTION_RAD * ENCODERS.from_hz * tick.dt_s:  # false for NaN, too
            self._angles.clear()
            self._lasted_s = 0.0
            return False
        self._angles.append((left, right))
        self._lasted_s += tick.dt_s
        if self._lasted_s < ENCODERS.block_s:
            return False
        angles, width = np.array(self._angles), ENCODERS.high_pass_s * len(self._angles) / self._lasted_s
        self._gains.append(_ripple_gains(np.cumsum(angles, axis=0), width))
        self._angles.clear()
        self._lasted_s = 0.0
        return True

    def lost_shares(self, already_losing: set[int]) -> dict[int, float]:
        """Return the wheels that lose counts since any of the last minutes, with the share by the minutes
        that show it best; for those that are `already_losing` less evidence is enough."""
        out: dict[int, float] = {}
        limits = {
            wheel: ENCODERS.clear_nats if wheel in already_losing else ENCODERS.raise_nats
            for wheel in self.wheels
        }
        shown = dict(limits)
        for minutes, gains in enumerate(np.cumsum(list(self._gains)[::-1], axis=0), 1):
            if minutes < ENCODERS.min_blocks:
                continue
            since = common_amplitude_gain(gains, minutes)
            for side, wheel in enumerate(self.wheels):
                share, gain = _lost_share(since[side], since[1 - side], limits[wheel])
                if gain >= shown[wheel]:
                    out[wheel], shown[wheel] = share, gain
        return out


def _lost_share(own: FloatArray, other: FloatArray, limit: float) -> tuple[float, float]:
    """Return the fraction of its counts that a wheel loses by the gains (shares,) of its own ripple and of
    the other wheel's, and the gain over its having as many per turn as the other ring or as are configured;
    (0, 0) where a ripple does not show by `limit`.

    The ripple of one wheel shows in the angle of the other, too, at the share by which they turned unlike
    each other: so what the other ring shows is no proof that this one should.
    """
    if min(gains.max() - median(gains) for gains in (own, other)) < limit:
        return 0.0, 0.0
    at, whole = int(own.argmax()), float(_SHARES[other.argmax()])
    share = float(_SHARES[at]) - whole
    if at == len(_SHARES) - 1 or share < ENCODERS.min_stds * math.sqrt(2.0) * LOST_SHARES.ring_error:
        return 0.0, 0.0
    off = np.minimum(np.abs(_SHARES - whole), np.abs(_SHARES))
    return share, float(own[at] - own[off <= LOST_SHARES.ring_error + 0.5 * LOST_SHARES.step].max())


def _ripple_gains(angle_rad: FloatArray, width: float) -> FloatArray:
    """Return the (2, shares) gains of both ripples in a minute's angles (n, 2); `width` of the high-pass in
    ticks."""
    between = angle_rad[:, 0] - angle_rad[:, 1]
    reach = round(ENCODERS.edge_widths * width)
    kernel = np.exp(-0.5 * np.square(np.arange(-reach, reach + 1) / width))
    inside = slice(reach, len(between) - reach)
    rapid = between[inside] - np.convolve(between, kernel / kernel.sum(), mode="valid")
    limit = OUTLIER_STDS * robust_std(rapid)
    return np.stack(
        [
            ripple_gain(angle, np.clip(rapid, -limit, limit), _SHARES, float(rapid.var()))
            for angle in angle_rad[inside].T
        ]
    )
