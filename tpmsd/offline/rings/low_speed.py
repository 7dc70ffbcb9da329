"""Looks for counts that are lost at walking pace, below the speeds of the windows.

In: `Recording`. Out: `LowSpeedLosses` per drive: the wheels, the speed below which they lose counts, the
share, and what the receiver's speeds say for it. At every fix each wheel's speed about that instant is
compared with the receiver's: what differs is regressed on the speed (a radius), the acceleration (the age of
the fix) and the speed where it is below a limit (lost counts). Where the receiver is slow itself its speed is
mostly noise, so that the least speed looked at is several times its error.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.inference.recording import Recording
from tpmsd.offline.rings.settings import COUNTERS


@dataclass(frozen=True)
class LowSpeedLosses:
    """Counts lost by some wheels of a drive."""

    wheels: tuple[str, ...]
    below_mps: float
    below_std_mps: float
    share: float
    share_std: float
    gain: float
    speeds_mps: tuple[float, float]
    """Least speed that was looked at, and the limit."""


def low_speed_losses(recording: Recording, radii_m: FloatArray) -> LowSpeedLosses | None:
    """Return the counts that wheels lose below a speed; None where there are none, or too few slow fixes.
    `radii_m` (4,) are the car's.
    """
    use = np.isfinite(recording.speed_mps)
    time_s, speed = recording.fix_time_s[use], recording.speed_mps[use]
    if len(time_s) < 30:
        return None
    accel = np.gradient(speed, np.maximum.accumulate(time_s + 1e-6 * np.arange(len(time_s))))
    shown = _wheel_speeds(recording, radii_m, time_s)
    slow = speed < COUNTERS.lost_compared_to_mps
    found: list[tuple[int, float, float, float, float, float]] = []
    least_mps: dict[int, float] = {}
    for wheel in recording.wheels:
        y = shown[:, wheel] - speed
        here = slow & np.isfinite(y) & np.isfinite(accel)
        calm = here & (speed > COUNTERS.lost_limits_mps[-1])
        if calm.sum() < 3 * COUNTERS.lost_fewest:
            return None
        base = np.stack([speed, accel], axis=1)
        values = np.linalg.lstsq(base[calm], y[calm], rcond=None)[0]
        left = y - base @ values
        std = max(float(np.median(np.abs(left[calm]))) / 0.6745, 0.02)
        least_mps[wheel] = max(COUNTERS.lost_min_mps, COUNTERS.lost_min_stds * std)
        best = _best_limit(time_s, speed, left, here & (speed > least_mps[wheel]), std)
        if best is not None:
            found.append((wheel, *best))
    if not found:
        return None
    gains = np.array([gain for *_, gain in found])
    likeliest, below, below_std, share, share_std, _ = found[int(np.argmax(gains))]
    similar = [one for one in found if abs(one[1] - below) <= 0.5]
    return LowSpeedLosses(
        wheels=tuple(WHEELS[one[0]] for one in similar),
        below_mps=float(np.mean([one[1] for one in similar])),
        below_std_mps=below_std,
        share=float(np.clip(share, 0.0, 1.0)),
        share_std=share_std,
        gain=max(one[-1] for one in similar),  # what the receiver errs by is in every wheel
        speeds_mps=(least_mps[likeliest], below),
    )


def _best_limit(
    time_s: FloatArray, speed: FloatArray, left: FloatArray, use: np.ndarray, std: float
) -> tuple[float, float, float, float, float] | None:
    """Return the speed limit and the share lost below it, both with standard deviations in the order limit,
    its std, share, its std, then the gain; None where no loss is significant. `left` (n,) is the residual
    speed.
    """
    best: tuple[float, float, float, float] | None = None
    for limit in COUNTERS.lost_limits_mps:
        below = use & (speed < limit)
        if below.sum() < COUNTERS.lost_fewest:
            continue
        x, y, block = (
            -speed[below],
            left[below],
            (time_s[below] // COUNTERS.lost_block_s).astype(int),
        )
        size = float(x @ x)
        share = float(x @ y) / size
        # Fixes that follow each other err alike: blocks, mostly a stop each, tell how sure the share is
        # (White, 1980); a single one tells nothing of it.
        held, block = np.unique(block, return_inverse=True)
        if len(held) < 2:
            continue
        score = np.bincount(block, x * (y - share * x))
        spread = max(float(score @ score) * len(held) / (len(held) - 1.0), size * std**2)
        gain = 0.5 * (share * size) ** 2 / spread
        if (
            share > COUNTERS.lost_share
            and gain > COUNTERS.lost_admit_nats
            and (best is None or gain > best[3])
        ):
            best = (float(limit), share, float(np.sqrt(spread)) / size, gain)
    if best is None:
        return None
    limit, share, share_std, gain = best
    # About the limit a speed taken over half a second is half of either side.
    blurred = COUNTERS.lost_half_s * COUNTERS.lost_braking_mps2 / 2.0
    clear = use & (speed < limit - blurred)
    if clear.sum() >= COUNTERS.lost_fewest:
        share = float(np.median(-left[clear] / speed[clear]))
    gone = -left > 0.5 * share * speed
    lower = float(np.max(speed[use & gone & (speed < limit)], initial=COUNTERS.lost_min_mps))
    upper = float(np.min(speed[use & ~gone & (speed > lower)], initial=limit + 1.0))
    return (
        0.5 * (lower + upper),
        float(np.hypot(blurred, (upper - lower) / 12.0**0.5)),
        share,
        share_std,
        gain,
    )


def _wheel_speeds(recording: Recording, radii_m: FloatArray, time_s: FloatArray) -> FloatArray:
    """Return the (m, 4) wheel speeds at these times; NaN where they were not read."""
    edges = recording.edges_s
    out = np.full((len(time_s), 4), np.nan)
    for wheel in recording.wheels:
        turned = recording.rotation_rad[:, wheel]
        angle = np.concatenate([[0.0], np.cumsum(np.nan_to_num(turned))])
        unread = np.concatenate([[0.0], np.cumsum(~np.isfinite(turned))])
        ends = [
            np.interp(time_s + side, edges, angle) for side in (-COUNTERS.lost_half_s, COUNTERS.lost_half_s)
        ]
        gaps = [
            np.interp(time_s + side, edges, unread) for side in (-COUNTERS.lost_half_s, COUNTERS.lost_half_s)
        ]
        rate = (ends[1] - ends[0]) / (2.0 * COUNTERS.lost_half_s)
        inside = (
            (time_s > COUNTERS.lost_half_s)
            & (time_s < edges[-1] - COUNTERS.lost_half_s)
            & (gaps[1] == gaps[0])
        )
        out[:, wheel] = np.where(inside, rate * radii_m[wheel], np.nan)
    return out
