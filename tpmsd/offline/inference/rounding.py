"""The rounding of wheel speeds while a car holds its speed: one error, read again and again.

In: a recording. Out: by window and wheel, the variance that this adds to a wheel's distance. Rounding is
noise from reading to reading where a signal moves by more than a step between them (Widrow, Kollar and Liu,
IEEE Transactions on Instrumentation and Measurement 45, 1996); a cruise on a bus with steps of 0.06 km/h
holds one and the same error of up to half a step for half a minute: 0.13 mm of a radius at 20 m/s. All
readings of such a run tell no more than one: their variances are that of one rounding times their number.

Steps are found as the common measure of the speeds that stayed, for a window each where enough of them did:
a tick is the mean of its readings, and two in a row may be alike anywhere between two steps. Speeds without
steps have none, nor have counts, whose rounding does not add up.
"""

from __future__ import annotations

import numpy as np

from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.inference.recording import Recording
from tpmsd.offline.inference.trajectory import WINDOW_S

SAME = 1e-5
"""Relative difference of two readings that are the same: stamps leave a quarter of it of a constant speed."""
FEWEST_STEPS, LARGEST_STEP = 5, 10
"""Differences that tell a step, each of at most so many steps: errors of larger ones are too large."""
WHOLE = 0.1
"""Share of a step by which they may miss its multiples."""


def repeated_rounding_variance(recording: Recording) -> FloatArray:
    """Return the (w, 4) variance in m2 of the wheels' distances by rounding that repeats while a speed is
    held."""
    per = round(WINDOW_S / recording.dt_s)
    count = recording.ticks // per
    out = np.zeros((count, 4))
    for wheel in np.flatnonzero(recording.quantum_rad == 0.0):
        distances = recording.rotation_rad[:, wheel] * recording.car.radius_m[wheel]
        ticks = distances[: count * per].reshape(count, per)
        still = np.ptp(ticks, axis=1) <= SAME * ticks.max(axis=1)
        step = _common_divisor(ticks[still & (ticks[:, 0] > 0.0), 0]) or _resolution_m(distances)
        if step > 0.0:
            run = _run_lengths(still, ticks.mean(axis=1))
            out[:, wheel] = run * (per * step) ** 2 / 12.0
    return out


def _resolution_m(distances: FloatArray) -> float:
    """Return the common divisor of distances that two consecutive ticks share; 0 where there is none."""
    same = (np.abs(np.diff(distances)) <= SAME * distances[1:]) & (distances[1:] > 0.0)
    return _common_divisor(distances[1:][same])


def _common_divisor(levels: FloatArray) -> float:
    """Return the common divisor of the levels of a wheel's distance; 0 where there is none."""
    levels = np.sort(levels)
    apart = np.diff(levels)
    apart = apart[apart > 2.0 * SAME * levels[1:]]
    if not len(apart):
        return 0.0
    near = apart[apart < LARGEST_STEP * apart.min()]
    step = float(np.median(near[near < 1.5 * apart.min()]))
    whole = np.abs(near / step - np.round(near / step)) < WHOLE
    return step if len(near) >= FEWEST_STEPS and bool(whole.all()) else 0.0


def _run_lengths(held: np.ndarray, levels: FloatArray) -> FloatArray:
    """Return the (w,) length of the run of windows with one reading that each belongs to; 0 where it
    changes."""
    again = held[1:] & held[:-1] & (np.abs(np.diff(levels)) <= SAME * levels[1:])
    run = np.concatenate([[0], np.cumsum(~again)])
    return np.asarray(np.where(held, np.bincount(run)[run], 0.0))
