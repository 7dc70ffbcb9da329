"""One wheel's rotation samples as blocks of evenly sampled speed.

In: `RotationSample`s as they come. Out: a `SpeedBlock` for every ten seconds without a gap.

A control unit samples evenly; the stamps jitter by up to a period, for they are of the bus and the
host. So the samples' order is trusted, and of the stamps only their mean rate.

Counters give the mean speed between two samples, which passes a frequency f by sinc(f / rate). Of speed
signals the samples bear the integral by the trapezoid, (w_k + w_k-1) / 2 times the interval; from these
means the readings w_k come back by w_k = 2 m_k - w_k-1, but for a constant with alternating sign, which is
at half the sampling rate.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from operator import sub

import numpy as np

from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.sources.events import RotationSample

BLOCK_S = 10.24
GAP_PERIODS = 2.6
"""Interval, in periods, beyond which frames are lost: the block begins again. Stamps may be off by a
period."""
MIN_GAP_S = 0.03
MAX_SPREAD = 1.35
"""Greatest over least speed in a block: harder braking than that is no steady rolling."""
MAX_SAMPLES = 8192
SAME_RADPS = 1e-5
"""Speeds closer than this are the same reading (what is left of subtracting long angles)."""


@dataclass(frozen=True, slots=True)
class SpeedBlock:
    """Even samples of one wheel's speed."""

    rate_hz: float
    speed_radps: FloatArray
    """(n,) mean speeds between two samples (counters), or the readings themselves."""
    quantum_radps: float
    """The signal's resolution: of a count per period, or the least step between two speeds."""
    counted: bool
    """True if from a counter; else from a speed signal."""

    def rounding_density(self) -> float:
        """Return the density that rounding alone adds, mean over all frequencies, (rad/s)^2/Hz.

        That of a speed is white; that of an angle is differentiated, which doubles it.
        """
        return (2.0 if self.counted else 1.0) * self.quantum_radps**2 / 12.0 / (0.5 * self.rate_hz)

    def power_response(self, frequency_hz: FloatArray) -> FloatArray:
        """Return the (n,) share of a frequency's power that the averaging between two samples passes."""
        if not self.counted:
            return np.ones_like(frequency_hz)
        return np.asarray(np.sinc(frequency_hz / self.rate_hz) ** 2)


class WheelStream:
    """Gathers the samples of one wheel."""

    def __init__(self) -> None:
        self._angle_rad: list[float] = []
        self._time_s: list[float] = []
        self._segment = -1
        self._quantum_rad = 0.0
        self.rate_hz = math.nan
        """Sampling rate of the last block, Hz, be it used or not; NaN before there is one."""

    def add(self, sample: RotationSample) -> SpeedBlock | None:
        """Add a sample; return the block that it completes, None if it completes none or not of steady
        rolling."""
        times = self._time_s
        if times and (
            sample.segment != self._segment or not 0.0 < sample.time_s - times[-1] <= self._max_interval_s()
        ):
            times.clear()
            self._angle_rad.clear()
        self._segment, self._quantum_rad = sample.segment, sample.quantum_rad
        times.append(sample.time_s)
        self._angle_rad.append(sample.angle_rad)
        if times[-1] - times[0] < BLOCK_S and len(times) < MAX_SAMPLES:
            return None
        block = self._make_block()
        del times[:-1]
        del self._angle_rad[:-1]
        return block

    def extend(self, times_s: list[float], angles_rad: list[float], segment: int, quantum_rad: float) -> bool:
        """Add samples, one at least, that follow without a gap and complete no block, and return True; else
        return False and add none: then each is to be added by `add`."""
        times = self._time_s
        if not times or segment != self._segment or not math.isfinite(self.rate_hz):
            return False
        if times_s[-1] - times[0] >= BLOCK_S or len(times) + len(times_s) >= MAX_SAMPLES:
            return False
        steps_s = list(map(sub, times_s, (times[-1], *times_s)))
        if min(steps_s) <= 0.0 or max(steps_s) > self._max_interval_s():
            return False
        self._quantum_rad = quantum_rad
        times += times_s
        self._angle_rad += angles_rad
        return True

    def _max_interval_s(self) -> float:
        """Return the longest interval between samples (s) that is not a gap."""
        times = self._time_s
        if math.isfinite(self.rate_hz):
            return max(GAP_PERIODS / self.rate_hz, MIN_GAP_S)
        if len(times) < 8:
            return 1.0
        return max(GAP_PERIODS * (times[-1] - times[0]) / (len(times) - 1), MIN_GAP_S)

    def _make_block(self) -> SpeedBlock | None:
        """Return the block of the samples gathered; None if they are not of steady rolling. Sets
        `rate_hz`."""
        time_s, angle_rad = np.array(self._time_s), np.array(self._angle_rad)
        intervals = time_s.size - 1
        self.rate_hz = rate_hz = float(intervals / (time_s[-1] - time_s[0]))
        counted = self._quantum_rad > 0.0
        step_rad = np.diff(angle_rad)
        speed = step_rad * rate_hz if counted else readings_from_means(step_rad / np.diff(time_s))
        least, mean = float(np.min(speed)), float(np.mean(speed))
        smooth = np.convolve(speed, np.full(16, 1.0 / 16), "valid") if intervals >= 16 else speed
        if least <= 0.0 or float(smooth.max()) > MAX_SPREAD * float(smooth.min()) or mean <= 0.0:
            return None
        quantum = self._quantum_rad * rate_hz if counted else _resolution(speed[::2])
        return SpeedBlock(rate_hz, speed, quantum, counted)


def readings_from_means(means: FloatArray) -> FloatArray:
    """Return the (n,) readings of a speed signal from the (n,) means of adjoining ones; the oldest reading is
    left out."""
    sign = np.where(np.arange(means.size) % 2 == 0, 1.0, -1.0)
    found = sign * np.cumsum(2.0 * sign * means) - sign * means[0]
    # What is left is one unknown with alternating sign: the one that makes neighbours alike.
    steps = np.diff(found)
    return np.asarray(found + 0.5 * sign * float(np.mean(sign[:-1] * steps)))


def _resolution(speed: FloatArray) -> float:
    """Return the least step between two distinct readings (rad/s); infinite if they are all the same."""
    steps = np.diff(np.sort(speed))
    steps = steps[steps > SAME_RADPS]
    return float(steps.min()) if steps.size else math.inf
