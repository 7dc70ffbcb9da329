"""The power spectrum of a wheel's speed jitter, averaged over the driving of the last minutes.

In: blocks without ring errors. Out: density on fixed bins, and how many independent averages it holds.

Welch's method: segments of about 1.3 s, Hann window, half overlapped. A segment that is much rougher than
usual (a pothole, a joint of a bridge) is scaled down, for its few oscillations would stand for the whole
minute.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tpmsd.foundation.median import median
from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.resonance.wheel_stream import SpeedBlock

SEGMENT_S = 1.28
LOW_HZ, HIGH_HZ = 19.0, 75.0
"""Below 19 Hz the axle hops, above 75 Hz the belt swings in other ways."""
NYQUIST_SHARE = 0.97
ROUGHEST = 3.0
LEVEL_MEMORY = 0.9
ROUNDING_SHARE = 0.4
OVERLAP_VARIANCE = 1.06
"""Variance of a Welch average of K half-overlapped Hann segments, times K (Welch 1967)."""


def bins_hz(rate_hz: float) -> FloatArray:
    """Return the (bins,) frequencies (Hz) of spectra of this sampling rate; empty where it is too low."""
    size = segment_size(rate_hz)
    frequency = np.arange(size // 2 + 1) * rate_hz / size
    return frequency[(frequency >= LOW_HZ) & (frequency <= min(NYQUIST_SHARE * rate_hz / 2.0, HIGH_HZ))]


def segment_size(rate_hz: float) -> int:
    """Return the number of samples in a segment: even, about SEGMENT_S."""
    return 2 * max(round(0.5 * SEGMENT_S * rate_hz), 4)


def periodograms(block: SpeedBlock, jitter: FloatArray, rate_hz: float) -> FloatArray:
    """Return the (segments, bins) one-sided power densities, (rad/s)^2/Hz, divided by the block's
    `power_response`.

    `jitter`: what `RingErrors.remove` left of the block. `rate_hz` gives the bins; the block's own rate
    differs from it by no more than a sample or two in a thousand.
    """
    size = segment_size(rate_hz)
    starts = np.arange(0, jitter.size - size + 1, size // 2)
    window = np.hanning(size + 1)[:-1]
    pieces = (
        np.stack([jitter[start : start + size] for start in starts]) if starts.size else np.empty((0, size))
    )
    pieces = (pieces - pieces.mean(axis=1, keepdims=True)) * window
    power = np.abs(np.fft.rfft(pieces, axis=1)) ** 2 * (2.0 / (rate_hz * float(window @ window)))
    frequency = bins_hz(rate_hz)
    if not frequency.size:
        return np.empty((starts.size, 0))
    first = round(frequency[0] * size / rate_hz)
    return np.asarray(power[:, first : first + frequency.size] / block.power_response(frequency))


@dataclass(slots=True)
class Spectrum:
    """A running average of periodograms."""

    density: FloatArray
    """(bins,) weighted sum of densities."""
    weight: float = 0.0
    weight_squares: float = 0.0
    _level: float = field(default=math.nan)
    """Usual power of a segment, logarithmic mean."""

    @classmethod
    def empty(cls, bins: int) -> Spectrum:
        """Return an empty spectrum."""
        return cls(np.zeros(bins))

    @property
    def averages(self) -> float:
        """Effective number of segments in the mean; it falls while the spectrum only fades."""
        if self.weight_squares <= 0.0:
            return 0.0
        # Under steady fading the first is twice the weight; without fading it is the weight.
        return min(self.weight * self.weight / self.weight_squares, 2.0 * self.weight)

    def mean(self) -> FloatArray:
        """Return the (bins,) weighted mean density, (rad/s)^2/Hz."""
        return np.asarray(self.density / self.weight)

    def add(self, segments: FloatArray) -> None:
        """Add the periodograms (segments, bins) of a block; segments much rougher than usual are scaled
        down."""
        for segment in segments:
            power = float(segment.mean())
            if not (power > 0.0 and math.isfinite(power)):
                continue
            log = math.log(power)
            if math.isnan(self._level):
                self._level = log
            scale = min(1.0, ROUGHEST * math.exp(self._level - log))
            self._level = LEVEL_MEMORY * self._level + (1.0 - LEVEL_MEMORY) * log
            self.density += scale * segment
            self.weight += 1.0
            self.weight_squares += 1.0

    def is_rounding_limited(self, rounding_density: float) -> bool:
        """Return whether rounding makes up so much of the density that it may look like a resonance."""
        return rounding_density > ROUNDING_SHARE * float(median(self.mean()))

    def fade(self, share: float) -> None:
        """Multiply the weight of all segments so far by `share`."""
        self.density *= share
        self.weight *= share
        self.weight_squares *= share * share

    def to_json(self) -> dict[str, Any]:
        """Return plain numbers for the state file."""
        mean = [float(f"{density:.6g}") for density in self.mean()]
        return {"averages": round(self.averages, 3), "density": mean}

    @classmethod
    def from_json(cls, saved: Mapping[str, Any], bins: int) -> Spectrum:
        """Restore from the state file; ValueError if it is no spectrum of so many bins."""
        try:
            density: FloatArray = np.array([float(value) for value in saved["density"]])
            averages = float(saved["averages"])
        except (KeyError, TypeError, ValueError) as error:
            raise ValueError(f"the saved spectrum is none: {error}") from error
        sound = bool(np.all(np.isfinite(density)) and np.all(density > 0.0))
        if density.shape != (bins,) or not (sound and 0.0 < averages < math.inf):
            raise ValueError("the saved spectrum has another shape or is absurd")
        return cls(density * averages, averages, averages)
