"""Measurement models of the Gaussian-sum filter: measurement rows, predictions and variances.

In: fixes, blocks of rotation, the particles' means. Out: what `batched_kalman.scalar_update` takes. State
layout: `error_state`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.estimators.bank.error_state import (
    BE,
    BN,
    FWD,
    GAIN,
    GYRO,
    LAT,
    LATV,
    LOAD,
    MU,
    PSI,
    SLIP,
    TRK,
    E,
    N,
)
from tpmsd.onboard.estimators.odometry_block import Block, FrontResidual
from tpmsd.onboard.estimators.settings import SETTINGS
from tpmsd.onboard.timeline.tick import Fix, Tick


class Scalar(NamedTuple):
    """One scalar measurement of all particles."""

    innovation: FloatArray
    """(N,)"""
    row: FloatArray
    """(n,) or (N, n)"""
    variance: float


class Present(NamedTuple):
    """State of the moment that measurement models need."""

    speed_mps: float
    yaw_rate_radps: float
    antenna_forward_m: float
    antenna_left_m: float


def antenna_position(
    mean: FloatArray, fix: Fix, tick: Tick, now: Present
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the predicted antenna's east and north (N,), m, at the time of the fix, and their measurement
    rows (N, n)."""
    behind_s = (1.0 - fix.fraction) * tick.dt_s + mean[:, LAT]
    # Back along the arc: the chord has the heading halfway back, the lever arm that of the fix's own time.
    turned = now.yaw_rate_radps * behind_s
    cos, sin = np.cos(mean[:, PSI] - turned), np.sin(mean[:, PSI] - turned)
    chord_cos, chord_sin = np.cos(mean[:, PSI] - turned / 2), np.sin(mean[:, PSI] - turned / 2)
    forward, left = now.antenna_forward_m + mean[:, FWD], now.antenna_left_m
    back = now.speed_mps * behind_s
    east_off = forward * cos - left * sin - back * chord_cos
    north_off = forward * sin + left * cos - back * chord_sin
    east = mean[:, E] + mean[:, BE] + east_off
    north = mean[:, N] + mean[:, BN] + north_off
    east_row, north_row = np.zeros_like(mean), np.zeros_like(mean)
    east_row[:, E] = east_row[:, BE] = 1.0
    north_row[:, N] = north_row[:, BN] = 1.0
    east_row[:, PSI], north_row[:, PSI] = -north_off, east_off
    # By the age of the fix: the chord grows and swings by half of the turn, the lever arm by all of it.
    arm_east, arm_north = forward * cos - left * sin, forward * sin + left * cos
    rate = now.yaw_rate_radps
    east_row[:, LAT] = -now.speed_mps * chord_cos + rate * arm_north - rate * back / 2 * chord_sin
    north_row[:, LAT] = -now.speed_mps * chord_sin - rate * arm_east + rate * back / 2 * chord_cos
    east_row[:, FWD], north_row[:, FWD] = cos, sin
    return east, north, east_row, north_row


def position_variance(fix: Fix, now: Present) -> float:
    """Return the variance, m^2, of the part of a position that is new with every fix; the slow part is in the
    state."""
    white = min(SETTINGS.white_position_m, fix.position_std_m)
    return white**2 + (SETTINGS.timing_s * now.speed_mps) ** 2 + SETTINGS.resolution_m**2


def course(
    mean: FloatArray, fix: Fix, tick: Tick, now: Present, reading_rad: float, interval_s: float
) -> Scalar:
    """Return the measurement of the heading by the receiver's course; `reading_rad` is the counters' reading
    error as a heading."""
    behind_s = (1.0 - fix.fraction) * tick.dt_s + mean[:, LAT] + mean[:, LATV]
    along = max(now.speed_mps - now.yaw_rate_radps * now.antenna_left_m, 0.1)
    swing = np.arctan2(now.yaw_rate_radps * (now.antenna_forward_m + mean[:, FWD]), along)
    predicted = mean[:, PSI] - now.yaw_rate_radps * behind_s + swing
    off = np.remainder(fix.heading_rad - predicted + math.pi, 2 * math.pi) - math.pi
    row = np.zeros(mean.shape[1])
    row[PSI] = 1.0
    row[LAT] = row[LATV] = -now.yaw_rate_radps
    row[FWD] = now.yaw_rate_radps / along
    doppler = (fix.speed_noise * SETTINGS.doppler_mps / max(now.speed_mps, 0.5)) ** 2 * max(
        1.0, 2 * SETTINGS.doppler_tau_s / interval_s
    )
    timing = (SETTINGS.timing_s * now.yaw_rate_radps) ** 2
    return Scalar(off, row, doppler + timing + SETTINGS.course_floor_rad**2 + reading_rad**2)


def doppler_distance(
    mean: FloatArray, block: Block, nominal: FloatArray, left_m: float, horizontal: float, driven_rear: bool
) -> Scalar:
    """Return the measurement of the rear wheels' distance by the receiver's speeds, which are horizontal."""
    slip = mean[:, SLIP] * block.accel_mps2 if driven_rear else np.zeros(mean.shape[0])
    predicted = (nominal[:2] + mean[:, MU : MU + 2]) @ block.angle_rad[:2] / 2
    predicted = predicted * horizontal * (1.0 - slip)
    predicted -= (mean[:, LAT] + mean[:, LATV]) * block.speed_change_mps + left_m * block.heading_change_rad
    row = np.zeros(mean.shape[1])
    row[MU : MU + 2] = block.angle_rad[:2] / 2 * horizontal
    row[LAT] = row[LATV] = -block.speed_change_mps
    row[SLIP] = -block.distance_m * block.accel_mps2 if driven_rear else 0.0
    doppler = (block.speed_noise * SETTINGS.doppler_mps) ** 2 * 2 * SETTINGS.doppler_tau_s * block.duration_s
    variance = doppler + (SETTINGS.timing_s * block.speed_swing_mps) ** 2 + block.reading_distance_m**2
    return Scalar(block.doppler_distance_m - predicted, row, variance)


def front_wheel(
    mean: FloatArray,
    block: Block,
    front: FrontResidual,
    index: int,
    driven_front_minus_rear: float,
    heading_change_rad: float,
) -> Scalar:
    """Return the measurement of a front wheel's radius by the hub path that the rear pair predicts; `index`
    is 2 (fl) or 3 (fr). `heading_change_rad` as for `gyro_turn`.

    A driven rear pair makes the predicted path shorter (omega r = v (1 + slip)), a driven front wheel its
    own. Lateral load transfer acts on both axles alike and cancels, so LOAD does not enter.
    """
    row = np.zeros(mean.shape[1])
    row[MU : MU + 2] = front.by_rear
    row[MU + index] = front.by_own
    row[TRK] = front.by_track_m * heading_change_rad
    row[SLIP] = driven_front_minus_rear * block.distance_m * block.accel_mps2
    residual = front.residual_m + (mean[:, MU:] - block.at_radii) @ row[MU:]
    residual += mean[:, TRK] * row[TRK] + mean[:, SLIP] * row[SLIP]
    rough = SETTINGS.roughness * math.sqrt(max(block.distance_m, 1.0) * 20.0)
    return Scalar(-residual, row, rough**2 + front.reading_m**2)


def gyro_turn(mean: FloatArray, block: Block, track_rear_m: float, heading_change_rad: float) -> Scalar:
    """Return the measurement of the rear wheels' turn by the bus's yaw rate over a block, its bias and gain
    being states.

    `heading_change_rad` is the block's turn as something other than these wheels in this second tells it. It
    is what gain, track, load and the radii's common part are multiplied by: with the wheels' own turn there,
    whose reading error is the innovation's too, that error would be taken for a gain (errors in variables)
    and on a straight road, where it is all there is, pull them away without end.
    """
    row = np.zeros(mean.shape[1])
    left_rad, right_rad = block.angle_rad[:2].tolist()
    # Nothing has turned where the car stands, or where the fixes that bound a block lie outside its ticks.
    per_m = 0.0 if block.distance_m == 0.0 else (left_rad + right_rad) / (2.0 * block.distance_m)
    misread_rad = 0.5 * track_rear_m * (block.heading_change_rad - heading_change_rad) * per_m
    row[MU : MU + 2] = np.array([-left_rad - misread_rad, right_rad - misread_rad]) / track_rear_m
    row[TRK] = row[GAIN] = heading_change_rad
    row[LOAD] = block.load_per_turn * heading_change_rad
    row[GYRO] = block.duration_s
    change = (mean[:, MU:] - block.at_radii) @ row[MU:]
    others = mean[:, [TRK, LOAD, GYRO, GAIN]] @ row[[TRK, LOAD, GYRO, GAIN]]
    noise = (
        SETTINGS.gyro_noise_radps**2 * block.duration_s + (SETTINGS.gyro_relative * heading_change_rad) ** 2
    )
    off = block.gyro_heading_change_rad - (block.heading_change_rad + change + others)
    return Scalar(off, row, noise + block.reading_heading_change_rad**2)
