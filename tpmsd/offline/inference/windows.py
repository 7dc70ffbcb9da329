"""Every measured channel over windows of a second, and what a model predicts for it.

In: `Recording`, `ReferenceTrajectory`, a model of the catalogue. Out: `Windows` (what is compared where) and
the prediction of all channels by the catalogue's own forward model, so that recording minus prediction is the
residual and the difference of two predictions is an effect's response.

Channels of a window, in this order: ways of the four wheels (m), mean yaw rate (rad/s), mean GNSS speed
(m/s), mean GNSS course (rad), mean GNSS east and north (m).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from tpmsd.car.physics.covariates import COVARIATES, covariate
from tpmsd.car.physics.effect import Effect
from tpmsd.car.physics.forward import (
    GYRO_READ,
    RECEIVER_READ,
    WHEELS_READ,
    Rolling,
    acts_by_radius_or_slip,
    acts_on_tooth_angles,
    affected_channels,
    antenna_truth,
    gyro_rates,
    wheel_angles,
    wheel_radii,
    wheel_rates,
)
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.car.physics.motion import Motion
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.inference.recording import Recording
from tpmsd.offline.inference.rounding import repeated_rounding_variance
from tpmsd.offline.inference.trajectory import WINDOW_S, ReferenceTrajectory, before_low_pass, moved

MAX_YAW_RATE_RADPS = 0.4
"""Beyond, tyres scrub, and a second is too long to be linear in."""
MAX_WINDOWS = 7200
"""Two hours of driving, so that memory is bounded; of more, stretches spread over the drive are taken."""
STRETCH = 300
"""Windows of one such stretch."""
CHANNELS = 9
WHEEL, GYRO, SPEED, COURSE, EAST, NORTH = 0, 4, 5, 6, 7, 8
CHANNEL_NAMES = ("wheel_ratio",) * 4 + (
    "yaw_rate",
    "gnss_speed",
    "gnss_course",
    "gnss_position",
    "gnss_position",
)


@dataclass(frozen=True)
class Linearised:
    """Linearised view of w windows' channels on the errors of a reference motion."""

    index: np.ndarray
    """(w,) number of the window since the drive's start: neighbours differ by one."""
    fixes: FloatArray
    """(w, 3) how many fixes gave a speed, a course and a position."""
    after_fixes: FloatArray
    """(w, 3) share of the window that follows these, in the mean."""
    covariates: dict[str, FloatArray]
    """(w,) each: what an effect may depend on, in SI units; `speed`, `yaw_rate` and `accel_kinematic` at
    least."""
    design: FloatArray
    """(w, 9, 3) response of the channels to an error of the reference's speed, yaw rate and heading."""
    to_east_north: FloatArray
    """(w, 2, 3) growth of the position's error by errors of speed, yaw rate and heading."""
    repeated_rounding_m2: FloatArray = field(default_factory=lambda: np.zeros((1, 4)), kw_only=True)
    """(w, 4) or (1, 4) variance of the wheels' ways by rounding that stays the same."""

    def __len__(self) -> int:
        return len(self.index)

    @property
    def time_s(self) -> FloatArray:
        """Return the (w,) middle of each window, seconds since the drive's start."""
        return (self.index + 0.5) * WINDOW_S


@dataclass(frozen=True)
class Windows(Linearised):
    """The windows of a drive in which it moved and its wheels were read."""

    measured: FloatArray
    """(w, 9); NaN where not measured."""


class Reader:
    """Compares one recording with models."""

    def __init__(
        self,
        recording: Recording,
        reference: ReferenceTrajectory,
        limit: int = MAX_WINDOWS,
        kept: np.ndarray | None = None,
        base: ExtendedModel | None = None,
    ) -> None:
        """`limit` windows at most are compared, or those `kept` (w,); `left_out` counts the others. `base` is
        the model where the windows' design is taken."""
        self.recording = recording
        self.reference = reference
        self._per = round(WINDOW_S / recording.dt_s)
        count = recording.ticks // self._per
        self._count = count
        driven = self._usable_windows() if kept is None else kept
        self._kept = spread(driven, limit)
        self.left_out = len(driven) - len(self._kept)
        self._repeated_rounding_m2 = repeated_rounding_variance(recording)
        self._window_of_fix = np.floor(recording.fix_time_s / WINDOW_S).astype(int)
        self.windows = self._linearised_windows(ExtendedModel() if base is None else base)
        self._rolled: FloatArray | None = None
        self._turning: tuple[ExtendedModel, FloatArray] | None = None
        self._base: tuple[ExtendedModel, FloatArray] | None = None
        self._wheels: tuple[ExtendedModel, Rolling | None] | None = None
        self._restored: tuple[float, Motion] | None = None

    def _usable_windows(self) -> np.ndarray:
        """Return the (d,) indices of the windows with all wheels read, fast enough and without a tight
        bend."""
        count, motion = self._count, self.reference.motion
        whole = self.reference.valid[: count * self._per].reshape(count, self._per).all(axis=1)
        fast = self._mean_edges(motion.speed_mps, count) > self.reference.min_mps
        turning = self._mean_edges(np.abs(motion.yaw_rate_radps), count)
        return np.flatnonzero(whole & fast & (turning < MAX_YAW_RATE_RADPS))

    @property
    def rolled_m(self) -> FloatArray:
        """Return the (w, 4) distances of the wheels by the reference motion."""
        if self._rolled is None:
            self._rolled = self._distances(self.reference.motion, ExtendedModel())
        return self._rolled

    def recalibrate(self, radii_m: FloatArray, base: ExtendedModel, errors: FloatArray) -> None:
        """Relinearise with other radii (4,) of the car, at a model, and with the reference motion corrected
        by the errors (w, 3) of its speed, its yaw rate and its heading at the windows' ends."""
        car = replace(self.reference.car, radius_m=radii_m)
        end_s = (self.windows.index + 1.0) * WINDOW_S
        self.reference = moved(self.recording, replace(self.reference, car=car), end_s, errors)
        self._rolled = self._turning = self._base = self._wheels = self._restored = None
        self.windows = self._linearised_windows(base)

    def predicted(self, base: ExtendedModel) -> FloatArray:
        """Return the (w, 9) prediction of a model; that of the last model is cached."""
        if self._base is None or self._base[0] is not base:
            self._base = base, self.predict(base)
        return self._base[1]

    def by_radius(self, wheel: int, share: FloatArray, base: ExtendedModel) -> FloatArray:
        """Return the (w,) change of a wheel's distance per metre of radius times a share (n + 1,) at the
        ticks' edges, at a model: rate is speed over radius, so its derivative is minus rate over radius."""
        motion, car = self.felt(base), self.reference.car
        if self._turning is None or self._turning[0] is not base:
            rates = wheel_rates(motion, car, base) / wheel_radii(motion, car, base)
            self._turning = base, rates * car.radius_m * WINDOW_S
        return -self.over_windows(share * self._turning[1][:, wheel])

    def predict(self, model: ExtendedModel, radii_m: FloatArray | None = None) -> FloatArray:
        """Return (w, 9) expected readings of the channels if the car moved as the reference does and the
        model acted."""
        motion, car = self.felt(model), self.reference.car
        out = np.empty((len(self._kept), CHANNELS))
        base = None if radii_m is None else radii_m + model.radius_change_m(motion, car)
        out[:, :GYRO] = self._distances(motion, model, base)
        out[:, GYRO] = self._gyro(motion, model)
        out[:, SPEED:] = self._fixes(motion, model)
        return out

    def change(self, base: ExtendedModel, effect: Effect) -> FloatArray:
        """Return the (w, 9) change of the channels if an effect is added to a model; zero where unmeasured.

        Only the channels are predicted on which the effect acts.
        """
        before, model = self.predicted(base), base.plus(effect)
        motion, acting = self.felt(model), affected_channels(effect)
        out = np.zeros((len(self._kept), CHANNELS))
        rolling = self._rolling_at(base)
        if WHEELS_READ in acting and rolling is not None and acts_by_radius_or_slip(effect):
            rates = rolling.rates_with_effect(effect, motion, self.reference.car) - rolling.rates
            out[:, :GYRO] = self.over_windows(rates) * self.reference.car.radius_m * WINDOW_S
        elif WHEELS_READ in acting:
            out[:, :GYRO] = self._distances(motion, model) - before[:, :GYRO]
        if GYRO_READ in acting:
            out[:, GYRO] = self._gyro(motion, model) - before[:, GYRO]
        if RECEIVER_READ in acting:
            out[:, SPEED:] = self._fixes(motion, model) - before[:, SPEED:]
        return np.nan_to_num(out, copy=False)

    def _rolling_at(self, base: ExtendedModel) -> Rolling | None:
        """Return the wheels' rolling at a model; None where it holds errors of teeth."""
        if self._wheels is None or self._wheels[0] is not base:
            teeth = any(acts_on_tooth_angles(effect) for effect in base)
            made = None if teeth else Rolling.evaluate(self.felt(base), self.reference.car, base)
            self._wheels = base, made
        return self._wheels[1]

    def felt(self, model: ExtendedModel) -> Motion:
        """Return the reference's motion before the low-pass of the wheels' speeds, on the slopes that the
        wheels feel."""
        motion = self.reference.motion
        if (constant_s := model.wheels_time_constant_s()) > 0.0:
            if self._restored is None or self._restored[0] != constant_s:
                self._restored = constant_s, before_low_pass(self.recording, self.reference, constant_s)
            motion = self._restored[1]
        if (felt := model.grade_factor()) == 1.0:
            return motion
        return replace(motion, grade_rad=felt * motion.grade_rad)

    def _distances(
        self, motion: Motion, model: ExtendedModel, radii_m: FloatArray | None = None
    ) -> FloatArray:
        """Return the (w, 4) distances of the wheels (m) by their counters."""
        car = self.reference.car
        angles = wheel_angles(motion, car, model, radii_m)
        shown = angles.copy()
        for wheel in range(4):
            shown[:, wheel] += model.tooth_angle_error_rad(angles[:, wheel], wheel)
            shown[:, wheel] *= model.true_teeth_per_rev(wheel, car.teeth_per_rev) / car.teeth_per_rev
        turned = np.diff(shown[:: self._per][: self._count + 1], axis=0)
        return np.asarray(turned[self._kept] * car.radius_m)

    def _gyro(self, motion: Motion, model: ExtendedModel) -> FloatArray:
        """Return the (w,) mean yaw rate that the gyro reads (rad/s)."""
        return self.over_windows(gyro_rates(motion, self.reference.car, model))

    def _fixes(self, motion: Motion, model: ExtendedModel) -> FloatArray:
        """Return the (w, 4) mean speed (m/s), course (rad), east and north (m) of the fixes; NaN without
        any."""
        recording = self.recording
        antenna = antenna_truth(motion, self.reference.car, model)
        when = recording.fix_time_s - model.fix_age_s()

        def at(values: FloatArray, age_s: float = 0.0) -> FloatArray:
            return np.interp(when - age_s, motion.time_s, values)

        lag = model.velocity_age_s()
        ve, vn = at(antenna.shown_east_mps, lag), at(antenna.shown_north_mps, lag)
        heading = at(motion.heading_rad, lag)
        course = heading + np.remainder(np.arctan2(vn, ve) - heading + np.pi, 2 * np.pi) - np.pi
        placed = np.isfinite(recording.east_m)
        read = (
            (np.hypot(ve, vn), np.isfinite(recording.speed_mps)),
            (course, np.isfinite(recording.course_rad)),
            (at(antenna.east_m), placed),
            (at(antenna.north_m), placed),
        )
        return np.stack([self._mean_fixes(values, known) for values, known in read], axis=1)

    def over_windows(self, values: FloatArray) -> FloatArray:
        """Return the (w, ...) mean over each compared window of a quantity (n + 1, ...) at the ticks'
        edges."""
        return np.asarray(self._mean_edges(values, self._count)[self._kept])

    def _mean_edges(self, values: FloatArray, count: int) -> FloatArray:
        """Return the (count, ...) mean over each window of a quantity given at the ticks' edges."""
        middle = 0.5 * (values[1:] + values[:-1])
        by_window = middle[: count * self._per].reshape(count, self._per, *values.shape[1:])
        if values.ndim == 1:
            return np.asarray(by_window.mean(axis=1))
        # Of many short columns a product takes a tenth of the time of a mean.
        return np.asarray(np.full(self._per, 1.0 / self._per) @ by_window)

    def _mean_fixes(self, values: FloatArray, known: np.ndarray) -> FloatArray:
        """Return the (w,) mean over the fixes of each kept window; NaN where it has none."""
        inside = (
            known & (self._window_of_fix >= 0) & (self._window_of_fix < self._count) & np.isfinite(values)
        )
        where = self._window_of_fix[inside]
        total = np.bincount(where, values[inside], self._count)
        number = np.bincount(where, minlength=self._count)
        mean = np.divide(total, number, out=np.full(self._count, np.nan), where=number > 0)
        return np.asarray(mean[self._kept])

    def _fixes_per_window(self, known: np.ndarray) -> FloatArray:
        """Return the (w,) number of the known fixes in each window that is kept."""
        inside = known & (self._window_of_fix >= 0) & (self._window_of_fix < self._count)
        number = np.bincount(self._window_of_fix[inside], minlength=self._count)
        return np.asarray(number[self._kept], dtype=np.float64)

    def _linearised_windows(self, base: ExtendedModel) -> Windows:
        """Return the windows, linearised at the reference motion where a model acts."""
        recording, motion, car = self.recording, self.reference.motion, self.reference.car
        kept, per, count = self._kept, self._per, self._count
        measured = np.full((len(kept), CHANNELS), np.nan)
        turned = recording.rotation_rad[: count * per].reshape(count, per, 4).sum(axis=1)
        measured[:, :4] = turned[kept] * car.radius_m
        gyro = recording.inertial["yaw_rate_radps"][: count * per].reshape(count, per)
        measured[:, GYRO] = gyro.mean(axis=1)[kept]
        predicted = np.interp(recording.fix_time_s, motion.time_s, motion.heading_rad)
        course = predicted + np.remainder(recording.course_rad - predicted + np.pi, 2 * np.pi) - np.pi
        for channel, values in (
            (SPEED, recording.speed_mps),
            (COURSE, course),
            (EAST, recording.east_m),
            (NORTH, recording.north_m),
        ):
            measured[:, channel] = self._mean_fixes(values, np.isfinite(values))
        numbers = [
            self._fixes_per_window(np.isfinite(v)) for v in (recording.speed_mps, course, recording.east_m)
        ]
        return Windows(
            index=kept,
            fixes=np.stack(numbers, axis=1),
            after_fixes=np.full((len(kept), 3), 0.5),
            covariates=self._covariates(),
            design=self._designs(base),
            to_east_north=self._position_growth(),
            measured=measured,
            repeated_rounding_m2=self._repeated_rounding_m2[kept],
        )

    def _covariates(self) -> dict[str, FloatArray]:
        """Return name -> (w,) mean of each covariate that the drive's readings give."""
        motion, car = self.reference.motion, self.reference.car
        untold = {"steering_rate", "torque", "temperature"} - set(motion.measured)
        if not self.reference.grade_known:
            untold.add("grade")
        edges = {name: covariate(motion, car, name) for name in COVARIATES if name not in untold}
        edges["accel_kinematic"] = motion.accel_long_mps2
        return {name: self._mean_edges(values, self._count)[self._kept] for name, values in edges.items()}

    def _designs(self, model: ExtendedModel) -> FloatArray:
        """Return the (w, 9, 3) response to errors of the reference's speed, yaw rate and heading where the
        model acts.

        At 30 m/s the load that a yaw rate shifts between left and right changes the wheels' ways as much as
        the track does, so that this is no matter of the rolling model alone.
        """
        design = np.zeros((len(self._kept), CHANNELS, 3))
        for state, (dv, dw) in enumerate(((1e-3, 0.0), (0.0, 1e-5))):
            up, down = (self._shifted_prediction(model, sign * dv, sign * dw) for sign in (1.0, -1.0))
            design[:, :EAST, state] = (up - down) / (2.0 * (dv + dw))
        design[:, COURSE, 2] = 1.0
        return design

    def _shifted_prediction(self, model: ExtendedModel, dv: float, dw: float) -> FloatArray:
        """Return (w, 7) predicted distances, yaw rate, GNSS speed and course with speed and yaw rate changed
        by `dv` and `dw`."""
        motion, car = self.reference.motion, self.reference.car
        speed, yaw = motion.speed_mps + dv, motion.yaw_rate_radps + dw
        moved = replace(motion, speed_mps=speed, yaw_rate_radps=yaw, accel_lat_mps2=speed * yaw)
        distances = wheel_rates(moved, car, model) * car.radius_m * WINDOW_S
        antenna = antenna_truth(moved, car, model)
        shown = antenna.shown_east_mps + 1j * antenna.shown_north_mps
        course = np.angle(shown * np.exp(-1j * motion.heading_rad))
        seen = [*distances.T, gyro_rates(moved, car, model), np.abs(shown), course]
        return np.stack([self._mean_edges(values, self._count)[self._kept] for values in seen], axis=1)

    def _position_growth(self) -> FloatArray:
        """Return the (w, 2, 3) growth of the position's error by errors of speed, yaw rate and heading."""
        motion, kept = self.reference.motion, self._kept
        v = self._mean_edges(motion.speed_mps, self._count)[kept]
        cos = self._mean_edges(np.cos(motion.heading_rad), self._count)[kept]
        sin = self._mean_edges(np.sin(motion.heading_rad), self._count)[kept]
        grow = np.zeros((len(kept), 2, 3))
        grow[:, 0] = np.stack([cos, -0.5 * v * sin * WINDOW_S, -v * sin], axis=1) * WINDOW_S
        grow[:, 1] = np.stack([sin, 0.5 * v * cos * WINDOW_S, v * cos], axis=1) * WINDOW_S
        return grow


def spread(windows: np.ndarray, limit: int) -> np.ndarray:
    """Return at most `limit` of the windows (w,), as stretches of five minutes at equal distances."""
    if len(windows) <= limit:
        return windows
    stretches = max(1, limit // STRETCH)
    length = limit // stretches
    starts = np.linspace(0, len(windows) - length, stretches).astype(int)
    return np.asarray(windows[(starts[:, None] + np.arange(length)).reshape(-1)])
