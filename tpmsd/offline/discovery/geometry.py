"""Geometry of the car and position of the antenna, once the wheels are known.

In: the wheels' speeds, the receiver's reference. Out: tracks, wheelbase, counts per revolution, driven
axle, latency and lever arm, each with a standard deviation.

    course of the antenna = heading + x_a r / v - c v r
    its speed             = v - y_a r + x_a^2 r^2 / (2 v)       both late by tau

(rigid body to first order in r x / v; c is the rear axle's side slip per lateral acceleration). The heading's
rate is the wheels' difference over the track, whose noise is far below the receiver's: so the receiver is
regressed on the wheels (`course` for the course).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.stats import norm

from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.discovery.assign import Assignment
from tpmsd.offline.discovery.course import course_fit
from tpmsd.offline.discovery.reference import ReceiverMotion
from tpmsd.offline.discovery.regress import fit, with_prior
from tpmsd.offline.discovery.result import Estimate
from tpmsd.offline.discovery.settings import SETTINGS, Settings
from tpmsd.offline.discovery.wheels import Follower, drag_slip_std


def driven_axle(assignment: Assignment) -> tuple[str, float] | None:
    """Return the axle that turns faster under drive force, and its probability; None for a pair alone."""
    if assignment.pair_only:
        return None
    slip = [role.follower.slip for role in assignment.roles]
    stds = [role.follower.slip_std for role in assignment.roles]
    difference = 0.5 * (slip[0] + slip[1] - slip[2] - slip[3])
    std = math.hypot(0.5 * math.sqrt(sum(s * s for s in stds)), SETTINGS.slip_floor_s2pm)
    if not math.isfinite(std):
        return "front", 0.5
    front = float(norm.cdf(difference / std))
    return ("front", min(front, 0.999)) if front >= 0.5 else ("rear", min(1.0 - front, 0.999))


class CarGeometry:
    """Regressions of the receiver on the wheels."""

    def __init__(
        self,
        assignment: Assignment,
        reference: ReceiverMotion,
        gyro: FloatArray | None = None,
        settings: Settings = SETTINGS,
    ) -> None:
        self._reference, self._settings = reference, settings
        self._by_wheel = {role.wheel: role.follower for role in assignment.roles}
        left, right = self._by_wheel["rl"], self._by_wheel["rr"]
        self._speed = 0.5 * (left.speed + right.speed)
        self._difference = right.speed - left.speed
        self.geometry: dict[str, Estimate] = {}
        self.gnss: dict[str, Estimate] = {}
        self.square_m2: Estimate | None = None
        """Square of the wheelbase; negative where the axles are exchanged. None if it is not seen."""
        self._speed_fit()
        self._course = course_fit(
            self._speed, self._difference, reference, self.gnss.get("latency_s"), settings
        )
        self._add_track_widths(gyro)
        if self._course is not None:
            forward = Estimate(float(self._course.value[3]), math.hypot(self._course.std(3), 0.1))
            if abs(forward.value) < settings.antenna_farthest_m and forward.std < settings.antenna_farthest_m:
                self.gnss["antenna_forward_m"] = forward
        if "antenna_left_m" in self.gnss and "track_rear_m" in self.geometry:
            # The speed's regression had yaw rates by the usual track.
            antenna, share = (
                self.gnss["antenna_left_m"],
                self.geometry["track_rear_m"].value / settings.track_m,
            )
            self.gnss["antenna_left_m"] = Estimate(antenna.value * share, antenna.std * share)

    def motion(self) -> tuple[FloatArray, FloatArray]:
        """Return the speed (m/s) and yaw rate (rad/s) by the rear wheels, (n,) over the cells."""
        track = self.geometry.get("track_rear_m")
        difference = self._difference
        if self._course is not None and track is not None:
            # Unequal tyres make a straight road look like a bend.
            difference = difference + self._course.value[1] / self._course.value[0] * self._speed
        return self._speed, difference / (track.value if track else self._settings.track_m)

    def _add_track_widths(self, gyro: FloatArray | None) -> None:
        """Add the rear track by the course, and front track and wheelbase where the front wheels are read."""
        course, geometry = self._course, self.geometry
        if course is not None and course.value[0] > 0:
            track = 1.0 / float(course.value[0])
            std = math.hypot(course.std(0) * track**2, SETTINGS.track_floor * track)
            if std < 0.5:
                geometry["track_rear_m"] = Estimate(track, std)
        if "fl" in self._by_wheel and "track_rear_m" in geometry:
            self._fit_front_axle(geometry["track_rear_m"])

    def _fit_front_axle(self, rear: Estimate) -> None:
        """Fit front track and wheelbase, exact for rolling wheels.

        With u^2 = (v -+ r T / 2)^2 + (r x)^2 the difference of an axle's squares is 2 v r T, and the sum
        of the front's less the rear's is 2 r^2 L^2 (tracks alike).
        """
        square = {wheel: one.speed**2 for wheel, one in self._by_wheel.items()}
        speed = self._speed
        yaw = self._difference / rear.value
        accel = np.full(len(speed), np.nan)
        accel[1:-1] = (speed[2:] - speed[:-2]) / (2 * self._settings.cell_s)
        usable = (speed > self._settings.min_speed_mps) & (np.abs(yaw) < 0.5 * speed)
        blocks = np.floor(self._reference.edge_s[:-1] / self._settings.block_s)
        # The error of a square goes with the speed; unweighted, slow tight bends pass for outliers.
        weight = np.where(usable, 1.0 / np.maximum(speed, self._settings.min_speed_mps), np.nan)
        # A speed's number at standstill is known to some centimetres per second; a counter has none.
        offset = [] if self._by_wheel["fl"].series.kind == "count" else [speed]
        # The receiver's yaw rate as instrument: its noise is not that of the counts and cancels.
        across = np.column_stack([self._reference.yaw_radps * speed, speed**2, *offset]) * weight[:, None]
        spans = [
            fit(across, (square[right] - square[left]) * weight, blocks)
            for left, right in (("fl", "fr"), ("rl", "rr"))
        ]
        if spans[0] is not None and spans[1] is not None and spans[1].value[0] > 0.5:
            ratio = float(spans[0].value[0] / spans[1].value[0])
            own = [one.std(0) / float(one.value[0]) / 3 for one in spans if one is not None]
            share = math.hypot(rear.std / rear.value, 0.008, *own)
            if 0.7 < ratio < 1.4:
                self.geometry["track_front_m"] = Estimate(rear.value * ratio, rear.value * ratio * share)
        along = [2.0 * yaw**2, speed**2, speed * yaw, accel * speed**2, accel * speed, speed**4, *offset]
        sums = square["fl"] + square["fr"] - square["rl"] - square["rr"]
        base = fit(np.column_stack(along) * weight[:, None], sums * weight, blocks)
        if base is not None and np.isfinite(base.cov).all():
            prior = np.full(len(along), np.inf)
            prior[5] = 8.0 * drag_slip_std()  # of four wheels, twice in each square
            base = with_prior(base, np.zeros(len(along)), prior)
        if base is not None:
            self.square_m2 = Estimate(float(base.value[0]), base.std(0))
        if base is not None and base.value[0] > 2.0 and base.std(0) < 0.5 * base.value[0]:
            length = math.sqrt(float(base.value[0]))
            std = math.hypot(0.5 * base.std(0) / length, 0.02 * length)
            self.geometry["wheelbase_m"] = Estimate(length, std)

    def _speed_fit(self) -> None:
        """Fit latency and the antenna's lateral position, by the receiver's speed."""
        reference, settings, gnss = self._reference, self._settings, self.gnss
        speed = self._speed
        yaw = self._difference / settings.track_m
        accel = np.full(len(speed), np.nan)
        accel[1:-1] = (speed[2:] - speed[:-2]) / (2 * settings.cell_s)
        with np.errstate(divide="ignore", invalid="ignore"):
            columns = [speed, yaw, accel, yaw**2 / speed, accel * speed]
        usable = (speed > settings.min_speed_mps) & (np.abs(yaw) < 0.5 * speed)
        blocks = np.floor(reference.edge_s[:-1] / settings.block_s)
        made = fit(np.column_stack(columns), np.where(usable, reference.speed_mps, np.nan), blocks)
        if made is None:
            return
        gnss["latency_s"] = Estimate(-float(made.value[2]), math.hypot(made.std(2), 0.006))
        left = Estimate(-float(made.value[1]), math.hypot(made.std(1), 0.05))
        if abs(left.value) < SETTINGS.antenna_widest_m and left.std < SETTINGS.antenna_widest_m:
            gnss["antenna_left_m"] = left


def per_metre(followers: Sequence[Follower]) -> tuple[float, float]:
    """Return the mean counts (as the DBC scales them) per metre over wheels, and the standard deviation of
    the mean."""
    values = np.array([one.per_mps * abs(one.series.field.scale) for one in followers])
    spread = float(values.std(ddof=1)) if len(values) > 1 else 0.0
    return float(values.mean()), max(spread / math.sqrt(len(values)), 1e-3 * float(values.mean()))
