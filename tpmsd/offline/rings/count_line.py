"""Counts per revolution by the wheel's own irregularity.

In: the wheels' counters, candidates of counts per revolution. Out: the log evidence of each.

No ring is cut, glued or mounted perfectly, and no tyre is round: the counts of a wheel run ahead of its mean
turning and fall behind it once per revolution (0.1 mm off centre on a ring of 50 mm is 2e-3 rad, 0.015
counts of 48). Against the counts themselves as abscissa this is a line at one cycle per revolution, whatever
the speed; over thousands of revolutions it stands out of the rounding of the counts, which is no multiple of
a revolution. Each candidate is a frequency. Its power, over the noise at frequencies between the candidates,
is exponential where there is no line and (1 + s) times that where there is one (Schuster 1898; the amplitude
a complex Gaussian), so the evidence is the mean over sizes s of the product over wheels and blocks. A ring's
line is in every block. In some of them other lines stand: at a constant speed the rounding of the counts
beats against the frames. So each block's power may also be that of another line, whatever its size (a
contaminated likelihood; Box and Tiao 1968), and no block alone decides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from tpmsd.car.rings.ring import REVOLUTION_RAD
from tpmsd.car.rings.ripple import OUTLIER_STDS, line_power, noise_power, robust_std
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.rings.counter import Counter
from tpmsd.offline.rings.settings import TOOTH_COUNTS, ToothCountSettings

_SIZES = (0.0, *(float(s) for s in np.geomspace(0.03, 3000.0, 16)))
"""Power of the line over that of the noise, per block; 0: a ring without fault."""


@dataclass(frozen=True, slots=True)
class Blocks:
    """Residuals of the counters against smooth turning, cut in blocks."""

    counts: tuple[FloatArray, ...]
    """Per block and wheel: counts at the samples, as the DBC scales them."""
    residual: tuple[FloatArray, ...]
    """Per block and wheel: counts ahead of smooth turning."""

    @property
    def longest_counts(self) -> float:
        """Number of counts in the longest block; 0 without blocks."""
        return max((float(np.ptp(one)) for one in self.counts), default=0.0)


def residual_blocks(
    wheels: Sequence[tuple[Counter, float]], expected: float, settings: ToothCountSettings = TOOTH_COUNTS
) -> Blocks:
    """Return the residuals of the wheels in blocks: `wheels` has counter and scale of each, `expected` the
    approximate counts per revolution.

    Only where the wheel turns so fast that a revolution is shorter than the smoothing.
    """
    counts: list[FloatArray] = []
    residual: list[FloatArray] = []
    for counter, scale in wheels:
        number, ahead = counter.counts * scale, _residual_counts(counter, settings) * scale
        rate = np.gradient(number, counter.time_s)
        usable = np.isfinite(ahead) & (rate > settings.ripple_min_hz * expected)
        block = _block_numbers(counter, settings)
        for index in np.unique(block[usable]):
            rows = usable & (block == index)
            if rows.sum() < settings.ripple_min_rows:
                continue
            counts.append(number[rows] - number[rows][0])
            residual.append(ahead[rows] - ahead[rows].mean())
    return Blocks(tuple(counts), tuple(residual))


def _block_numbers(counter: Counter, settings: ToothCountSettings) -> NDArray[np.int64]:
    """Return the (n,) block number of each sample; a counter that jumps begins another block."""
    step = np.diff(counter.counts, prepend=counter.counts[0])
    jump = (step < 0) | (step > settings.ripple_jump * max(float(np.median(step[step > 0])), 1.0))
    period = np.floor((counter.time_s - counter.time_s[0]) / settings.ripple_block_s)
    begins = jump | (np.diff(period, prepend=0.0) > 0)
    return np.cumsum(begins, dtype=np.int64)


def _residual_counts(counter: Counter, settings: ToothCountSettings) -> FloatArray:
    """Return the (n,) residual counts about a local cubic (Savitzky, Golay 1964); NaN at lost frames and with
    too few samples.
    """
    from scipy.signal import savgol_filter

    if len(counter.time_s) < 4 * settings.ripple_min_window:
        return np.full(len(counter.time_s), np.nan)
    period = float(np.median(np.diff(counter.time_s)))
    window = max(2 * int(0.5 * settings.ripple_window_s / period) + 1, settings.ripple_min_window)
    if window > len(counter.counts):
        return np.full(len(counter.time_s), np.nan)
    ahead = counter.counts - savgol_filter(counter.counts, window, 3)
    return np.where(np.abs(ahead) <= OUTLIER_STDS * robust_std(ahead), ahead, np.nan)


def binned_powers(blocks: Blocks, counts_per_rev: FloatArray) -> FloatArray:
    """Return the (blocks, k) power at one cycle per `counts_per_rev` (k,) counts, from binned spectra; of
    mean 1 for white noise.

    By a Fourier transform over the counts, gathered in bins of a small part of a cycle.
    """
    out = np.empty((len(blocks.counts), len(counts_per_rev)))
    width = float(counts_per_rev.min()) / TOOTH_COUNTS.bins_per_cycle
    for row, (counts, residual) in enumerate(zip(blocks.counts, blocks.residual, strict=True)):
        binned = np.bincount(np.rint(counts / width).astype(np.int64), weights=residual)
        size = 1 << int(np.ceil(np.log2(TOOTH_COUNTS.oversampled * len(binned))))
        spectrum = np.fft.rfft(binned, size)
        at = np.rint(size * width / counts_per_rev).astype(np.int64)
        out[row] = np.abs(spectrum[at]) ** 2 / max(float(residual @ residual), 1e-300)
    return out


def exact_powers(blocks: Blocks, counts_per_rev: FloatArray) -> FloatArray:
    """Return the (blocks, k) power at one cycle per `counts_per_rev` (k,) counts, without bins."""
    out = np.empty((len(blocks.counts), len(counts_per_rev)))
    for row, (counts, residual) in enumerate(zip(blocks.counts, blocks.residual, strict=True)):
        power = line_power(counts, residual, REVOLUTION_RAD / counts_per_rev)
        out[row] = power / max(float(residual @ residual), 1e-300)
    return out


def log_evidence(
    blocks: Blocks, candidates: FloatArray, between: FloatArray, other_lines: float
) -> FloatArray:
    """Return the (k,) log evidence of `candidates` (k,), up to a constant; `between` are numbers at which
    there is noise alone.

    `other_lines`: share of the blocks that may hold another line; 0 to find where an encoder's line is.
    """
    if not blocks.counts:
        return np.zeros(len(candidates))
    noise = noise_power(binned_powers(blocks, between))
    return _log_likelihood_ratios(binned_powers(blocks, candidates) / np.maximum(noise, 1e-12), other_lines)


def _log_likelihood_ratios(power: FloatArray, other_lines: float) -> FloatArray:
    """Return the (k,) log of the likelihood ratio, averaged over sizes of the line; `power` (blocks, k)
    relative to the noise.
    """
    size = np.array(_SIZES)[:, None, None]
    other = np.log(max(other_lines, 1e-300)) - 2.0 * np.log1p(power)
    noise, line = -power, -power / (1.0 + size) - np.log1p(size)
    own = np.log1p(-other_lines)
    ratio = (np.logaddexp(own + line, other) - np.logaddexp(own + noise, other)).sum(axis=1)
    prior = np.full(len(_SIZES), (1.0 - TOOTH_COUNTS.faultless) / (len(_SIZES) - 1))
    prior[0] = TOOTH_COUNTS.faultless
    return np.asarray(logsumexp(ratio, axis=0, b=prior[:, None]))
