"""Measurements that the frame of a filter takes and hands on to every belief alike.

In: ticks. Out: ticks without what [filter] measurements leaves out; blocks of rotation with the Doppler way
and the turn by the gyro less its bias. A belief that carries what confounds the radii (`mixture`) makes
blocks of its own, by its present radii.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from tpmsd.car.config.model import MEASUREMENTS
from tpmsd.car.physics.priors import GYRO_ZERO_RADPS
from tpmsd.onboard.estimators.belief import FilterCar, GatedTick
from tpmsd.onboard.estimators.odometry_block import Block, BlockBuilder
from tpmsd.onboard.estimators.settings import SETTINGS
from tpmsd.onboard.timeline.tick import NAN, Tick


class NamedMeasurements:
    """Removes the measurements that the configuration does not name from each tick."""

    def __init__(self, names: tuple[str, ...]) -> None:
        """`names`: of MEASUREMENTS."""
        self._lacks = {name for name in MEASUREMENTS if name not in names}
        self.position = "position" not in self._lacks
        """True if positions are measurements; a pose is found by them in any case."""
        self._fix_fields: dict[str, Any] = {
            field: NAN
            for name, field in (("speed", "speed_mps"), ("course", "heading_rad"))
            if name in self._lacks
        }
        self._tick_fields: dict[str, Any] = {
            field: NAN
            for name, field in (("yaw_rate", "yaw_rate_radps"), ("steering", "steering_wheel_angle_rad"))
            if name in self._lacks
        }

    def select(self, tick: Tick) -> Tick:
        """Return the tick with NaN for the measurements that are not used."""
        if self._tick_fields:
            tick = replace(tick, **self._tick_fields)
        if self._fix_fields and tick.fixes:
            tick = replace(tick, fixes=tuple(replace(fix, **self._fix_fields) for fix in tick.fixes))
        return tick


class GyroBias:
    """Bias of the bus's yaw rate against the receiver's courses: a Kalman filter of one state.

    Over T seconds the turn by the gyro less the change of course is T times the bias, but for the errors of
    two courses. Wheels have no part in it, so that no radius is taken for a bias.
    """

    def __init__(self) -> None:
        self.bias_radps, self._variance = GYRO_ZERO_RADPS.mean, GYRO_ZERO_RADPS.std**2
        self._anchor: tuple[float, float, float] | None = None
        """Time, course and its variance at which the sum begins."""
        self._heading_change_rad = 0.0

    @property
    def std_radps(self) -> float:
        """Standard deviation of the bias, rad/s."""
        return math.sqrt(self._variance)

    def update(self, tick: Tick) -> None:
        """Update the bias by a tick's yaw rate and the courses of its fixes."""
        if not math.isfinite(tick.yaw_rate_radps) or tick.gap_s > 0.0:
            self._anchor = None
            return
        self._variance += SETTINGS.gyro_drift**2 * tick.dt_s
        self._heading_change_rad += tick.yaw_rate_radps * tick.dt_s
        for fix in tick.fixes:
            if not (math.isfinite(fix.heading_rad) and fix.speed_mps > SETTINGS.course_speed_mps):
                continue
            # What the gyro turns after the fix within its tick is not part of the sum up to the fix.
            turn = self._heading_change_rad - (1.0 - fix.fraction) * tick.dt_s * tick.yaw_rate_radps
            noise = (fix.speed_noise * SETTINGS.doppler_mps / fix.speed_mps) ** 2
            noise += SETTINGS.course_floor_rad**2 + (SETTINGS.timing_s * tick.yaw_rate_radps) ** 2
            self._add_course(fix.time_s, fix.heading_rad, noise, turn)

    def _add_course(self, time_s: float, course_rad: float, noise: float, heading_change_rad: float) -> None:
        """Correct the bias by the change of course since the anchor, once that is long enough ago; this is
        the next anchor."""
        if self._anchor is None or time_s - self._anchor[0] > 2.0 * SETTINGS.gyro_span_s:
            self._anchor = time_s, course_rad, noise
            self._heading_change_rad -= heading_change_rad
            return
        since_s, before_rad, before = self._anchor
        span_s = time_s - since_s
        if span_s < SETTINGS.gyro_span_s:
            return
        residual = math.remainder(heading_change_rad - (course_rad - before_rad), 2 * math.pi) / span_s
        gain = self._variance / (self._variance + (noise + before) / span_s**2)
        self.bias_radps += gain * (residual - self.bias_radps)
        self._variance *= 1.0 - gain
        self._anchor = time_s, course_rad, noise
        self._heading_change_rad -= heading_change_rad


class FrameBlocks:
    """Blocks of the rear pair's rotation for beliefs that make none of their own."""

    def __init__(self, car: FilterCar) -> None:
        self._blocks = BlockBuilder(list(car.order[:2]), car.nominal_m[:2], car.geometry)
        self._radii = np.zeros(2)
        self._gyro = GyroBias()

    def reset(self) -> None:
        """Discard the unfinished block, for there was a gap."""
        self._blocks.reset()

    def update(self, gated: GatedTick) -> tuple[Block, float] | None:
        """Add a tick; return the block that it completes, by nominal radii, and the variance of its turn by
        the gyro that the bias leaves, else None. The gyro's turn is NaN unless the gyro is trusted."""
        tick = gated.tick
        self._gyro.update(tick)
        for fix in tick.fixes:
            self._blocks.add_fix(fix, tick)
        block = self._blocks.add(tick, gated.informative, self._radii, gated.accel_mps2)
        if block is None or not block.informative:
            return None
        turn = block.gyro_heading_change_rad - self._gyro.bias_radps * block.duration_s
        known = replace(block, gyro_heading_change_rad=turn if gated.gyro_trusted else NAN)
        return known, (self._gyro.std_radps * block.duration_s) ** 2
