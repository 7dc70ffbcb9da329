"""The vehicle state from tick to tick: speeds at the centre of gravity, side slip and yaw rate with their
standard deviations, by one of the filters.

In: of each tick its length, longitudinal and lateral acceleration, yaw rate, road-wheel angle and speed, NaN
where there is no reading. Out: `VehicleState`, or None where nothing is known. Pure: `UPF` and `ARUPF` draw
from the generator they are given.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from tpmsd.car.config.model import VEHICLE_STATE_METHODS
from tpmsd.car.vehicle_state import model
from tpmsd.car.vehicle_state.adaptive import RobustSettings
from tpmsd.car.vehicle_state.car import CarDynamics
from tpmsd.car.vehicle_state.kalman import Ekf, FilterNoise, GaussianState, StateFilter, Ukf
from tpmsd.car.vehicle_state.model import MIN_SPEED_MPS, R, StepInputs, U, V
from tpmsd.car.vehicle_state.particle import DEFAULT_PARTICLES, UnscentedParticleFilter
from tpmsd.car.vehicle_state.record import VehicleState
from tpmsd.foundation.wheels import FloatArray

FILTERS = VEHICLE_STATE_METHODS


@dataclass(frozen=True, slots=True)
class VehicleStateAssumptions:
    """Assumptions about sensors and model, each with its unit and reason."""

    noise: FilterNoise = field(
        default_factory=lambda: FilterNoise(process=(0.5, 0.3, 0.3), readings=(0.6, 0.02, 0.3))
    )
    """Process: what a tyre model of a car known by its data sheet leaves, per square root of a second.
    Readings: a body-fixed accelerometer rolls with the body (0.6 m/s2 at 6 m/s2 and 6 degrees per g), a
    production gyro has a bias of 1 deg/s at most, wheel speeds are within 1 % of 30 m/s."""
    correlated_s: float = 0.1
    """Correlation time of the errors of lateral acceleration and speed (roll, tyres), s: at shorter ticks
    their variances are those above times this over the tick."""
    start_side_slip_rad: float = 0.05
    """Standard deviation of the side slip where an estimate begins, in a bend or out of one."""
    start_speed_mps: float = 0.3
    """Standard deviation of the speed there, m/s."""
    start_yaw_rate_radps: float = 0.05
    """Standard deviation of the yaw rate there, rad/s."""
    hold_s: float = 1.0
    """For so long the last steering angle and acceleration stand in for missing ones."""
    rejection_timeout_s: float = 2.0
    """A reading rejected by the robust weights for so long is right and the state wrong: start again."""
    rejection_weight: float = 0.01
    """Equivalent weight below which a reading counts as rejected."""


SETTINGS = VehicleStateAssumptions()


def make_filter(
    method: str,
    car: CarDynamics,
    noise: FilterNoise,
    start: GaussianState,
    rng: np.random.Generator,
    particles: int = DEFAULT_PARTICLES,
) -> StateFilter:
    """Return one of `FILTERS`; ValueError for another name."""
    if method == "ekf":
        return Ekf(car, noise, start)
    if method == "ukf":
        return Ukf(car, noise, start)
    if method not in FILTERS:
        raise ValueError(f"{method!r} is none of {' '.join(FILTERS)}")
    robust = RobustSettings() if method == "arupf" else None
    return UnscentedParticleFilter(car, noise, start, rng, robust, particles)


class VehicleStateEstimator:
    """Keeps a filter from tick to tick; begins again behind pauses, standstills and lost inputs."""

    def __init__(
        self,
        car: CarDynamics,
        method: str,
        rng: np.random.Generator,
        particles: int = DEFAULT_PARTICLES,
        settings: VehicleStateAssumptions = SETTINGS,
        means: bool = False,
    ) -> None:
        """`means`: readings are means over their tick, as those of the timeline, not values at its end."""
        if method not in FILTERS:
            raise ValueError(f"{method!r} is none of {' '.join(FILTERS)}")
        self._car, self._method, self._rng = car, method, rng
        self._particles, self._settings, self._means = particles, settings, means
        self.reset()

    def reset(self) -> None:
        """Discard the motion so far (after a pause)."""
        self._filter: StateFilter | None = None
        self._rejected_s = np.zeros(3)
        self._steer_rad = self._ahead_mps2 = self._speed_mps = math.nan
        self._steer_age_s = self._ahead_age_s = 0.0
        self._before: StepInputs | None = None

    def step(
        self,
        dt_s: float,
        accel_long_mps2: float,
        accel_lat_mps2: float,
        yaw_rate_radps: float,
        steer_rad: float,
        speed_mps: float,
    ) -> VehicleState | None:
        """Update by one tick and return the state, None while it is unknown; each reading may be NaN.

        The estimate begins with the first tick that has steering, yaw rate and a speed of at least
        `MIN_SPEED_MPS`, and ends where the car is slower or the steering is lost. Without longitudinal
        acceleration the change of the speed stands in.
        """
        if dt_s <= 0.0 or speed_mps < MIN_SPEED_MPS:
            self.reset()
            return None
        steer_rad = self._held_steer(dt_s, steer_rad)
        ahead_mps2 = self._held_accel_long(dt_s, accel_long_mps2, speed_mps)
        if self._filter is None:
            if not all(map(math.isfinite, (steer_rad, yaw_rate_radps, speed_mps))):
                return None
            self._filter = self._start_filter(dt_s, yaw_rate_radps, speed_mps)
        elif not math.isfinite(steer_rad):
            self.reset()
            return None
        reading = np.array([accel_lat_mps2, yaw_rate_radps, speed_mps], dtype=np.float64)
        try:
            with np.errstate(all="ignore"):  # what overflows is found below
                belief = self._belief(self._filter, StepInputs(dt_s, ahead_mps2, steer_rad), reading)
        except np.linalg.LinAlgError:
            self.reset()
            return None
        if not self._is_plausible(belief, dt_s):
            self.reset()
            return None
        return state_of(belief)

    def _belief(self, filter_: StateFilter, now: StepInputs, reading: FloatArray) -> GaussianState:
        """Return the belief at the end of a tick.

        Means over a tick are the readings of its middle: there the filter's belief holds, and the model takes
        it half a tick on, with the steering angle that the change since the last tick lets expect there.
        """
        belief = filter_.step(now, reading)
        if not self._means:
            return belief
        before, self._before = self._before or now, now
        steer_rad = now.steer_rad + (now.steer_rad - before.steer_rad) / 4
        half = StepInputs(now.dt_s / 2, now.accel_long_mps2, steer_rad)
        growth = self._settings.noise.process_covariance(half.dt_s)
        return GaussianState(model.advance(self._car, belief.mean, half), belief.covariance + growth)

    def _start_filter(self, dt_s: float, yaw_rate_radps: float, speed_mps: float) -> StateFilter:
        settings = self._settings
        mean = np.array([self._car.rear_m * yaw_rate_radps, speed_mps, yaw_rate_radps])
        stds = (
            settings.start_side_slip_rad * speed_mps,
            settings.start_speed_mps,
            settings.start_yaw_rate_radps,
        )
        start = GaussianState(mean, np.diag(np.square(stds)))
        lateral, yaw, speed = settings.noise.readings
        longer = math.sqrt(max(settings.correlated_s / dt_s, 1.0))
        noise = FilterNoise(settings.noise.process, (lateral * longer, yaw, speed * longer))
        return make_filter(self._method, self._car, noise, start, self._rng, self._particles)

    def _held_steer(self, dt_s: float, steer_rad: float) -> float:
        """Return the steering angle; without a reading the last one for at most `hold_s`, then NaN."""
        if math.isfinite(steer_rad):
            self._steer_rad, self._steer_age_s = steer_rad, 0.0
        else:
            self._steer_age_s += dt_s
        return self._steer_rad if self._steer_age_s <= self._settings.hold_s else math.nan

    def _held_accel_long(self, dt_s: float, accel_long_mps2: float, speed_mps: float) -> float:
        """Return the longitudinal acceleration: measured, else held up to `hold_s`, else from the speed, else
        0."""
        before, self._speed_mps = self._speed_mps, speed_mps
        if math.isfinite(accel_long_mps2):
            self._ahead_mps2, self._ahead_age_s = accel_long_mps2, 0.0
            return accel_long_mps2
        self._ahead_age_s += dt_s
        if math.isfinite(self._ahead_mps2) and self._ahead_age_s <= self._settings.hold_s:
            return self._ahead_mps2
        by_speed = (speed_mps - before) / dt_s
        return by_speed if math.isfinite(by_speed) else 0.0

    def _is_plausible(self, belief: GaussianState, dt_s: float) -> bool:
        """Return whether the state is finite, drives forward, and has rejected no reading beyond
        `rejection_timeout_s`."""
        if not (np.isfinite(belief.mean).all() and np.isfinite(belief.covariance).all()):
            return False
        if belief.mean[U] < MIN_SPEED_MPS or (np.diag(belief.covariance) < 0.0).any():
            return False
        weights: FloatArray | None = getattr(self._filter, "weights", None)
        if weights is None:
            return True
        self._rejected_s = np.where(weights < self._settings.rejection_weight, self._rejected_s + dt_s, 0.0)
        return bool(self._rejected_s.max() <= self._settings.rejection_timeout_s)


def state_of(belief: GaussianState) -> VehicleState:
    """Return speeds, side slip beta = atan2(v, u) and yaw rate of a Gaussian with their standard deviations.

    The side slip's is that to first order: d beta = (u dv - v du) / (u^2 + v^2).
    """
    v, u, r = (float(value) for value in belief.mean)
    by_state = np.array([u, -v]) / (u * u + v * v)
    planar = belief.covariance[np.ix_((V, U), (V, U))]
    stds = np.sqrt(np.diag(belief.covariance))
    return VehicleState(
        velocity_long_mps=u,
        velocity_long_std_mps=float(stds[U]),
        velocity_lat_mps=v,
        velocity_lat_std_mps=float(stds[V]),
        side_slip_rad=math.atan2(v, u),
        side_slip_std_rad=math.sqrt(max(float(by_state @ planar @ by_state), 0.0)),
        yaw_rate_estimate_radps=r,
        yaw_rate_estimate_std_radps=float(stds[R]),
    )
