"""Takes out of a block what repeats with the wheel's rotation.

That are uneven teeth, a ring off its centre, unbalance. In: a `SpeedBlock`. Out: its speed without the mean
and without harmonics of the rotation.

    speed = polynomial + sum over h <= H of (a_h cos(h phi) + b_h sin(h phi)) + what is looked for

with phi the angle turned since the block began; a and b by least squares. A line at h times the rotation is
a tenth of a hertz wide, a resonance ten hertz, so little of it is lost. A speed signal is scaled by a radius
that need not be the configured one, and a harmonic is missed if phi is off by a thousandth: the scale is
searched for once, by the energy that the harmonics explain over the first blocks.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from tpmsd.foundation.median import median
from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.resonance.wheel_stream import SpeedBlock

HARMONICS = 48
"""Steps of 48 uneven teeth have nine tenths of their power below this order."""
SEARCHED = 6
"""Harmonics by which the scale is found."""
SCALE_RANGE, SCALE_STEP = 0.02, 2.5e-4
SEARCH_BLOCKS = 12
CLEAR = 1.35
"""The scale is moved only if it explains so much more energy than the median one does."""
POLYNOMIAL = 3


class RingErrors:
    """Removes the errors of one wheel's ring."""

    def __init__(self) -> None:
        count = round(SCALE_RANGE / SCALE_STEP)
        self._scales = 1.0 + SCALE_STEP * np.arange(-count, count + 1)
        self._score = np.zeros(self._scales.size)
        self._searched = 0
        self.scale = 1.0
        """True angle over the angle by the configured radius."""

    def remove(self, block: SpeedBlock) -> FloatArray:
        """Return the block's speed without trend and harmonics, (n,) rad/s."""
        speed = block.speed_radps
        angle = (np.cumsum(speed) - 0.5 * speed) / block.rate_hz
        abscissa = np.linspace(-1.0, 1.0, speed.size)
        trend = np.polynomial.legendre.legvander(abscissa, POLYNOMIAL)
        flat = speed - trend @ np.linalg.lstsq(trend, speed, rcond=None)[0]
        if not block.counted and self._searched < SEARCH_BLOCKS:
            self._search_scale(flat, angle)
        terms = np.empty((POLYNOMIAL + 1 + 2 * HARMONICS, speed.size))
        terms[: POLYNOMIAL + 1] = trend.T
        turn = np.exp(1j * self.scale * angle)
        harmonics = np.empty((HARMONICS, speed.size), dtype=np.complex128)
        harmonics[0] = turn
        for before, harmonic in pairwise(harmonics):
            np.multiply(before, turn, out=harmonic)
        cosines, sines = terms[POLYNOMIAL + 1 :].reshape(2, HARMONICS, speed.size)
        cosines[:], sines[:] = harmonics.real, harmonics.imag
        # A ridge far below any noise: at some speeds two aliased harmonics are one and the same.
        gram = terms @ terms.T + 1e-9 * speed.size * np.eye(len(terms))
        return np.asarray(flat - np.linalg.solve(gram, terms @ flat) @ terms)

    def _search_scale(self, flat: FloatArray, angle: FloatArray) -> None:
        """Add a block to the score of each angle scale, and set `scale` to the best if it stands out, else
        1."""
        self._searched += 1
        turn = np.exp(1j * np.outer(self._scales, angle))
        harmonic = np.ones_like(turn)
        energy = np.zeros(self._scales.size)
        for _ in range(SEARCHED):
            harmonic *= turn
            energy += np.abs(harmonic @ flat) ** 2
        self._score += energy / (float(flat @ flat) * flat.size)
        best = int(np.argmax(self._score))
        clear = self._score[best] > CLEAR * float(median(self._score))
        self.scale = float(self._scales[best]) if clear else 1.0

    def to_json(self) -> float:
        """Return the scale found, for the state file."""
        return self.scale

    def restore(self, scale: float) -> None:
        """Restore a scale found before; ValueError if it is none."""
        if not (math.isfinite(scale) and abs(scale - 1.0) <= SCALE_RANGE + SCALE_STEP):
            raise ValueError(f"the saved scale of a ring is absurd: {scale}")
        self.scale, self._searched = scale, SEARCH_BLOCKS
