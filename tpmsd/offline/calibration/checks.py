"""Drives from which a calibration cannot be had.

In: `Recording`s, and the `JointFit` where one was made. Out: nothing, or `RefusedError` with the drive and
the reason in words.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.calibration.equations import CHANGES, COLUMNS, PIECES
from tpmsd.offline.calibration.joint import PRIOR, JointFit, WhitenedEquations, whiten_equations
from tpmsd.offline.calibration.nominal import Vehicle, calibrated_wheels, nominal_motion
from tpmsd.offline.inference.recording import Recording

MOVING_MPS = 3.0
MIN_MOVING_S = 45.0
MIN_FIXES = 30
MIN_COVERED = 0.3
"""Share of the moving time that lies within `FIX_REACH_S` of a fix."""
FIX_REACH_S = 2.0
MIN_READ = 0.5
STRAIGHT_RADIUS_M = 300.0
MIN_STRAIGHT_S = 15.0
MAX_TRACK_STD = 0.1
"""Relative standard deviation of the track: half of the prior one."""
MIN_TURN_RAD = math.radians(60.0)
TURNING_RADPS = 0.03
CHANGE_SIGMA = 5.0
CHANGE_CLUSTER_S, FEWEST_CLUSTERS = 40.0, 15
CALM_MPS2 = 0.7
"""Lateral acceleration up to which a wheel's radius is held against the others: in bends load transfer
rules."""
CALM_FROM_MPS, CALM_YAW_RADPS = 6.0, 0.05
MIN_CHANGE = 1e-3
"""Relative change of one wheel's radius within a drive that is taken for a loss of pressure."""
MIN_COMMON_LOSS, COMMON_SIGMA = 2.5e-3, 4.0
"""Relative loss of all radii together against the receiver. Tyres that cool down lose half as much."""


class RefusedError(ValueError):
    """A calibration cannot be had; `drive` is the one to blame, None for all of them together."""

    def __init__(self, reason: str, drive: int | None = None) -> None:
        super().__init__(reason)
        self.drive = drive


@dataclass(frozen=True)
class ChangeWithinDrive:
    """A change of one wheel's radius within a drive, or of all of them."""

    wheel: int | None
    """Index of the wheel; None: all together."""
    relative: float
    """Change relative to the other wheels; of all together: relative to the receiver."""
    sigmas: float
    time_s: float
    """Time at which the change is complete, s."""

    @property
    def is_pressure_loss(self) -> bool:
        """True if the change is large and significant enough to be taken for a loss of pressure."""
        if self.wheel is None:  # tyres that warm up grow
            return self.sigmas > COMMON_SIGMA and self.relative < -MIN_COMMON_LOSS
        return self.sigmas > CHANGE_SIGMA and abs(self.relative) > MIN_CHANGE

    @property
    def words(self) -> str:
        """Sentence on which radius changes and by how much."""
        if self.wheel is None:
            return f"the radii of all wheels change by {self.relative:+.2%}"
        return f"the radius of wheel {WHEELS[self.wheel]} changes by {self.relative:+.2%} against the others"


def check_recordings(recordings: list[Recording], car: Vehicle) -> None:
    """Raise RefusedError for recordings that are unusable by their contents alone, before a fit."""
    straight = turned = 0.0
    for at, recording in enumerate(recordings):
        wheels = calibrated_wheels(recording)
        read = np.isfinite(recording.rotation_rad[:, wheels]).mean(axis=0)
        missing = [WHEELS[k] for k, share in zip(wheels, read, strict=True) if share < MIN_READ]
        if missing:
            raise RefusedError(f"no readings of wheel {' '.join(missing)} in most of it", at)
        known = np.isfinite(recording.east_m)
        if known.sum() == 0:
            raise RefusedError("no position fixes of the receiver fall into the readings of the bus", at)
        motion = nominal_motion(recording, car)
        moving = motion.speed_mps > MOVING_MPS
        moving_s = float(moving.sum()) * recording.dt_s
        if moving_s < MIN_MOVING_S:
            raise RefusedError(f"too short: {moving_s:.0f} s of driving, {MIN_MOVING_S:.0f} s are needed", at)
        near = _fraction_near_fixes(motion.time_s[moving], recording.fix_time_s[known])
        if known.sum() < MIN_FIXES or near < MIN_COVERED:
            raise RefusedError(
                f"too few fixes: {int(known.sum())}, near {near:.0%} of the driving; {MIN_FIXES} near "
                f"{MIN_COVERED:.0%} are needed",
                at,
            )
        bent = np.abs(motion.yaw_rate_radps) * STRAIGHT_RADIUS_M > motion.speed_mps
        straight += float((moving & ~bent).sum()) * recording.dt_s
        turning = moving & (np.abs(motion.yaw_rate_radps) > TURNING_RADPS)
        turned += float(np.abs(motion.yaw_rate_radps[turning]).sum()) * recording.dt_s
    if straight < MIN_STRAIGHT_S:
        raise RefusedError(
            f"never straight: {straight:.0f} s on bends wider than {STRAIGHT_RADIUS_M:.0f} m, "
            f"{MIN_STRAIGHT_S:.0f} s are needed to tell left from right"
        )
    if turned < MIN_TURN_RAD:
        raise RefusedError(
            f"never turning: bends of {math.degrees(turned):.0f} degrees in all, "
            f"{math.degrees(MIN_TURN_RAD):.0f} are needed for the track"
        )


def _fraction_near_fixes(times_s: FloatArray, fixes_s: FloatArray) -> float:
    """Return the fraction of times that are within `FIX_REACH_S` of a fix; 0 without fixes."""
    after = np.clip(np.searchsorted(fixes_s, times_s), 1, max(len(fixes_s) - 1, 1))
    if len(fixes_s) < 2 or not len(times_s):
        return 0.0
    gap = np.minimum(np.abs(times_s - fixes_s[after - 1]), np.abs(times_s - fixes_s[after]))
    return float((gap < FIX_REACH_S).mean())


def check_fit(recordings: list[Recording], fit: JointFit) -> None:
    """Raise RefusedError for recordings that the fit shows to be unusable."""
    for at, (recording, rows) in enumerate(zip(recordings, fit.rows, strict=True)):
        change = worst_change(recording, rows)
        if change.is_pressure_loss:
            raise RefusedError(
                f"{change.words} within {change.time_s:.0f} s ({change.sigmas:.0f} standard deviations): "
                "a tyre that loses pressure cannot be calibrated",
                at,
            )
    if fit.std("track_rear") > MAX_TRACK_STD:
        raise RefusedError(
            f"turns too little for the track: known to {fit.std('track_rear'):.0%}, "
            f"{MAX_TRACK_STD:.0%} are needed"
        )


def worst_change(recording: Recording, rows: WhitenedEquations) -> ChangeWithinDrive:
    """Return the most significant change within a drive: of one wheel against the others, or of all together.

    All wheels may change piecewise linearly over the drive; what is judged is how far one of them has come
    from the others at the end of each piece. Bends are left out: load transfer rules there. Against the
    receiver, which is far less exact than wheels among each other, all wheels together may change by one ramp
    over the whole drive, bends and all.
    """
    equations, wheels = rows.equations, calibrated_wheels(recording)
    inflate = rows.inflate.copy()
    speed, yaw = equations.covariates["speed"], np.abs(equations.covariates["yaw_rate"])
    uneven = (speed * yaw > CALM_MPS2) | (speed < CALM_FROM_MPS) | (yaw > CALM_YAW_RADPS)
    inflate[uneven, :4] *= 1e4
    white = whiten_equations(equations, rows.noise, inflate)
    y, X = white[:, :, 0], white[:, :, 1:]
    mean, std = np.array([PRIOR[name] for name in COLUMNS]).T
    contrasts, wheel_of, piece_of = _change_contrasts(wheels)
    size, sigmas = _estimated_contrasts(y, X, (mean, std), contrasts, rows.time_s)
    # Of a pair that drifts apart, the one that shrinks is to blame.
    best = int(np.argmax(sigmas * (np.abs(size) > MIN_CHANGE) - 1e-3 * (size > 0)))
    end_s = float(rows.time_s[-1])
    one = ChangeWithinDrive(
        wheel_of[best], float(size[best]), float(sigmas[best]), (piece_of[best] + 1) / PIECES * end_s
    )
    steady = len(COLUMNS) - len(CHANGES)
    ramp = rows.X[:, :, steady:].sum(axis=2, keepdims=True) / PIECES
    priors = (np.append(mean[:steady], mean[-1]), np.append(std[:steady], std[-1]))
    columns = np.concatenate([rows.X[:, :, :steady], ramp], axis=2)
    size, sigmas = _estimated_contrasts(rows.y, columns, priors, np.eye(steady + 1)[-1:], rows.time_s)
    together = ChangeWithinDrive(None, float(size[0]), float(sigmas[0]), end_s)
    return together if together.is_pressure_loss and not one.is_pressure_loss else one


def _estimated_contrasts(
    y: FloatArray,
    X: FloatArray,
    prior: tuple[FloatArray, FloatArray],
    contrasts: FloatArray,
    time_s: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return (q,) estimates of contrasts (q, p) of the parameters by innovations (k, 9) and their columns (k,
    9, p), and (q,) their sizes in standard deviations.
    """
    mean, std = prior
    flat = X.reshape(-1, X.shape[2])
    covariance = np.linalg.inv(flat.T @ flat + np.diag(1.0 / np.square(std)))
    values = covariance @ (flat.T @ y.reshape(-1) + mean / np.square(std))
    size = contrasts @ values
    # Innovations of a stretch of odd road hang together: clusters, as in `joint`. A change that rests on a
    # few of them does not tell its own spread, which the factor `few` makes up for.
    score = np.einsum("kcp,kc->kp", X, y - X @ values) @ (contrasts @ covariance).T
    weight = np.square(np.einsum("kcp,qp->kcq", X, contrasts @ covariance)).sum(axis=1)
    span_s = min(CHANGE_CLUSTER_S, float(time_s[-1]) / FEWEST_CLUSTERS)
    cluster = (time_s / span_s).astype(int)
    sums, shares = np.zeros((cluster.max() + 1, len(size))), np.zeros((cluster.max() + 1, len(size)))
    np.add.at(sums, cluster, score)
    np.add.at(shares, cluster, weight)
    number = np.square(shares.sum(axis=0)) / np.maximum(np.square(shares).sum(axis=0), 1e-300)
    few = np.sqrt(number / np.maximum(number - 2.0, 0.1))
    by_model = np.sqrt(np.einsum("qp,pr,qr->q", contrasts, covariance, contrasts))
    return size, np.abs(size) / np.maximum(by_model, few * np.sqrt(np.square(sums).sum(axis=0)))


def _change_contrasts(wheels: list[int]) -> tuple[FloatArray, list[int], list[int]]:
    """Return (q, p) contrasts: one wheel's change up to the end of a piece minus the mean of the others'; and
    (q,) the wheel and the piece of each.
    """
    rows, wheel_of, piece_of = [], [], []
    for wheel in wheels:
        for piece in range(PIECES):
            row = np.zeros(len(COLUMNS))
            for other in wheels:
                share = 1.0 if other == wheel else -1.0 / (len(wheels) - 1)
                first = COLUMNS.index(f"change_{WHEELS[other]}_0")
                row[first : first + piece + 1] = share
            rows.append(row)
            wheel_of.append(wheel)
            piece_of.append(piece)
    return np.array(rows), wheel_of, piece_of
