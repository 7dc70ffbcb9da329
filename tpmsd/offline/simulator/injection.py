"""Effects injected into a recording: the changed readings, by the time at which they were taken.

In: a `Recording`, its configuration, an `ExtendedModel`. Out: `Injection`, which gives changed readings of
wheels, gyro, accelerometers, steering wheel and receiver at times of the host's clock. Pure. The motion on
which effects depend is the recording's own, smoothed as the diagnosis smooths it: a recording holds no other.
Roads, noise and instruments are those of the recording.
"""

from __future__ import annotations

import numpy as np

from tpmsd.car.config.model import Config
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.car.physics.reading_change import (
    AntennaChange,
    FixChange,
    acts_by_road_slope,
    indicated_angle,
    indicated_rate_factor,
    wheel_rotation_factors,
)
from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.inference.recording import Recording
from tpmsd.offline.inference.trajectory import reference

FINER_S = 0.08
"""Width (s) of the Gaussian by which the part of a reading that rounding took away is estimated: at 3 m/s2 it
is off by 10 mm of a wheel's path, a quarter of a tooth of 48, and it holds some readings of every bus."""
MARGIN = 1e-6
"""Distance of a finer reading from its ends, in steps of rounding: sums in floating point stay within, and
changes below it are none."""


class Injection:
    """A model's effects on one recording.

    Raises:
        ConfigError: an effect cannot be injected: it is in every recording already.
    """

    def __init__(
        self, recording: Recording, config: Config, model: ExtendedModel, latency_s: float = 0.0
    ) -> None:
        """`latency_s` is the recording's GNSS latency beyond the configured one: effects on a fix are those
        of the motion at which it was valid.
        """
        for effect in model:
            if acts_by_road_slope(effect):
                raise ConfigError(f"{effect.name} cannot be injected: slopes are in every recording already")
        about = reference(recording)
        self._model = model
        self._car, self._motion = about.car, about.motion
        self._start_s = recording.start_s
        self._known_latency_s = config.gnss.latency_s + latency_s
        self._edges_s = recording.edges_s
        self._factor = wheel_rotation_factors(self._motion, self._car, model)
        middle = 0.5 * (self._factor[1:] + self._factor[:-1])
        rates = self._motion.speed_mps[:, None] / self._car.radius_m
        rolled = 0.5 * (rates[1:] + rates[:-1]) * recording.dt_s
        turned = np.where(np.isfinite(recording.rotation_rad), recording.rotation_rad, rolled)
        self._angle_rad = _cumulative_sums(turned)
        self._more_rad = _cumulative_sums((middle - 1.0) * turned)
        self._more_unsigned_rad = _cumulative_sums((middle - 1.0) * np.abs(turned))
        zero, one = model.read_yaw_rate(np.array([0.0, 1.0]))
        self._gyro_bias, self._gyro_scale = float(zero), float(one - zero)
        self._yaw_error = model.yaw_rate_error_radps(self._motion, self._car)
        self._accel_error = model.accel_error_mps2(self._motion, self._car)
        self._steering_error = model.steering_error_rad(self._motion, self._car)
        self._antenna = AntennaChange(self._motion, self._car, model)

    def since_start_s(self, host_s: FloatArray) -> FloatArray:
        """Return seconds since the drive's start of times on the host's clock; same shape."""
        return np.asarray(host_s - self._start_s)

    def added_angle_rad(self, wheel: int, host_s: FloatArray, unsigned: bool = False) -> FloatArray:
        """Return the (m,) angle that effects add to a wheel's counter; `unsigned` for a counter that also
        rises while the wheel turns backward.
        """
        time_s = self.since_start_s(host_s)
        more = self._more_unsigned_rad if unsigned else self._more_rad
        true = np.interp(time_s, self._edges_s, self._angle_rad[:, wheel])
        angle = true + np.interp(time_s, self._edges_s, more[:, wheel])
        return np.asarray(indicated_angle(angle, wheel, self._car, self._model) - true)

    def speed_factor(self, wheel: int, host_s: FloatArray) -> FloatArray:
        """Return the (m,) factor by which effects change a wheel's speed."""
        time_s = self.since_start_s(host_s)
        both = self._angle_rad[:, wheel] + self._more_rad[:, wheel]
        angle = np.interp(time_s, self._edges_s, both)
        rate = indicated_rate_factor(angle, wheel, self._car, self._model)
        return np.asarray(np.interp(time_s, self._edges_s, self._factor[:, wheel]) * rate)

    def changed_sensor_values(self, role: str, host_s: FloatArray, values: FloatArray) -> FloatArray:
        """Return the (m,) values with effects of the sensor of this role, SI units; unchanged where no effect
        acts on it.
        """
        if role == "yaw_rate":
            read = self._gyro_scale * values + self._gyro_bias
            changed = values if (self._gyro_scale, self._gyro_bias) == (1.0, 0.0) else read
            return np.asarray(changed + self._at_host_times(self._yaw_error, host_s))
        if role in ("accel_long", "accel_lat"):
            return np.asarray(
                values + self._at_host_times(self._accel_error[:, int(role == "accel_lat")], host_s)
            )
        if role == "steering_wheel_angle":
            return np.asarray(values + self._at_host_times(self._steering_error, host_s))
        return values

    def fix_changes(self, host_s: FloatArray) -> FixChange:
        """Return the changes of position and velocity of fixes that arrived at these times (m,)."""
        return self._antenna.at(self.since_start_s(host_s) - self._known_latency_s)

    @property
    def fix_age_s(self) -> float:
        """Additional GNSS latency by the effects, s."""
        return self._model.fix_age_s()

    def clock_error_s(self, host_s: FloatArray) -> FloatArray:
        """Return the (m,) lead of the changed host clock over the recorded one, s."""
        return self._model.clock_error_s(self.since_start_s(host_s))

    def _at_host_times(self, values: FloatArray, host_s: FloatArray) -> FloatArray:
        """Return the values on the ticks' edges interpolated at times on the host's clock."""
        return np.asarray(np.interp(self.since_start_s(host_s), self._edges_s, values))


def add_counts(counts: FloatArray, more: FloatArray, sigma: float, modulus: int) -> FloatArray:
    """Return the (m,) readings of a counter with `more` (m,) counts added, modulo its number of values.

    A count is the angle rounded down. The part that was lost is estimated by smoothing over `sigma` readings,
    within the count, so that the changed angle is rounded once and not twice. Where nothing is added the
    counts stay what they are.
    """
    steps = np.diff(counts, prepend=counts[:1])
    steps = (steps + modulus // 2) % modulus - modulus // 2
    unrolled = np.cumsum(steps) + counts[:1]
    smooth = _smooth_reflected(unrolled, sigma) + 0.5
    finer = np.clip(smooth, unrolled + MARGIN, unrolled + 1.0 - MARGIN)
    return np.asarray(np.floor(finer + _drop_negligible(more)) - unrolled + counts) % modulus


def add_to_rounded_readings(readings: FloatArray, more: FloatArray) -> FloatArray:
    """Return the (m,) whole numbers of a rounded reading with `more` (m,) steps added.

    What rounding leaves over is put into the next reading (error diffusion): sums are right to half a step,
    so that a change below the last digit has its mean. Where nothing is added the readings stay.
    """
    whole = np.floor(np.cumsum(_drop_negligible(more)) + 0.5)
    return np.asarray(readings + np.diff(whole, prepend=0.0))


def _smooth_reflected(values: FloatArray, sigma: float) -> FloatArray:
    """Return (m,) the values smoothed by a Gaussian kernel of `sigma` samples. They are continued at both
    ends by reflection in the end point, which keeps a slope."""
    from scipy.ndimage import gaussian_filter1d

    width = min(int(4.0 * sigma + 1.0), len(values) - 1)
    before = 2.0 * values[0] - values[width:0:-1]
    after = 2.0 * values[-1] - values[-2 : -width - 2 : -1]
    whole = np.concatenate([before, values, after])
    return np.asarray(gaussian_filter1d(whole, sigma, mode="nearest")[width : width + len(values)])


def smoothing_readings(host_s: FloatArray) -> float:
    """Return the smoothing width `FINER_S` as a number of readings."""
    steps = np.diff(host_s)
    steps = steps[steps > 0.0]
    return FINER_S / max(float(np.median(steps)), 1e-4) if len(steps) else 1.0


def _cumulative_sums(per_tick: FloatArray) -> FloatArray:
    """Return the (n + 1, 4) cumulative sums at the ticks' edges."""
    return np.concatenate([np.zeros((1, per_tick.shape[1])), np.cumsum(per_tick, axis=0)])


def _drop_negligible(more: FloatArray) -> FloatArray:
    """Return the values with those that are rounding errors set to 0."""
    return np.where(np.abs(more) < MARGIN / 2.0, 0.0, more)
