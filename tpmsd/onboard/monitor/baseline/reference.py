"""The radii this car has while its tyres are in order, as a function of how it is driven.

In: estimates with their covariance and conditions, while nothing is suspected. Out: the radii to expect under
any conditions, with their covariance.

A Bayesian linear regression (Kalman filter without measurement lag), relative to the nominal radii. What acts
is taken from the physics catalogue, each with a prior of what cars have:

    OWN         each wheel's radius, warm, extrapolated to standstill
    GROWTH      centrifugal_growth of all wheels, GROWTH_OWN what one wheel grows more, both per v^2
    DRAG        longitudinal_slip of the driven axle by air drag, per v^2
    SPEED       what all wheels do else by speed, learned per range of speed
    WARM        thermal_growth, two time constants; WARM_AXLE: front more than rear
    HILL        longitudinal_slip and load_transfer_longitudinal on slopes, for each axle
    AGE         of the receiver's speed, s: no radius, but what looks like slip where all wheels are driven
    LOAD        load of each axle: another after the car has stood
    DAY         temperature and pressure of the air: another on another day
    DRIFT       fluctuations within a drive, of all wheels; DRIFT_OWN of one wheel

All but the last three belong to the car and are learned once, each range of speed for itself, then frozen:
what followed the radii would follow a slow leak too. The last three belong to the drive; they are learned in
its first minutes and forgotten with it. So nothing that a leak does can be taken for longer than a drive, nor
for more than load and weather can do.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tpmsd.car.config.model import VehicleConfig
from tpmsd.car.physics.priors import DRAG_SLIP_S2PM2, DRIVE_SLIP_S2PM, GROWTH_S2PM, SPEED_AGE_S, WARMTH_M
from tpmsd.foundation.bounds import covariance, vector, whole
from tpmsd.foundation.wheels import IS_FRONT, FloatArray
from tpmsd.onboard.monitor.drive_settings import DriveModel
from tpmsd.onboard.monitor.sampling.conditions import Conditions
from tpmsd.onboard.monitor.sampling.slip_sums import Slope
from tpmsd.onboard.monitor.settings import REFERENCE

OWN, GROWTH_OWN, SPEED = slice(0, 4), slice(4, 8), slice(8, 13)
GROWTH, DRAG = 13, 14
WARM, WARM_AXLE, HILL, AGE = slice(15, 17), 17, slice(18, 20), 20
CAR = 21
"""So many parameters belong to the car; the rest to the drive."""
LOAD, DAY, DRIFT, DRIFT_OWN = slice(21, 23), 23, 24, slice(25, 29)
SIZE = 29

KNOTS_MPS = np.array(REFERENCE.knots_mps)
_INDICES = np.arange(float(KNOTS_MPS.size))


@dataclass(frozen=True, slots=True)
class Innovation:
    """Innovation of one measurement update, relative to the radii."""

    value: FloatArray
    """(d,) measured minus expected."""
    spread: FloatArray
    """(d, d) its covariance."""
    gain: FloatArray
    """(SIZE, d) Kalman's gain."""


class RadiusReference:
    """Knowledge of the car's radii: a Gaussian over the terms of the baseline."""

    def __init__(self, vehicle: VehicleConfig) -> None:
        self._radius = np.array(vehicle.wheel_radius_m)
        self._driven = np.array(
            [vehicle.driven_axle in ("front", "all"), vehicle.driven_axle in ("rear", "all")]
        )
        self._share = 1.0 / max(int(self._driven.sum()), 1)
        """Fraction of the force that each driven axle transmits."""
        self._acts = self._wheel_signs()
        self.mean, self.covariance = self._prior_moments()
        self.ranges = [0] * KNOTS_MPS.size
        """Samples learned in each range of speed, by its knot."""

    def _prior_moments(self) -> tuple[FloatArray, FloatArray]:
        """Return the prior mean (SIZE,) and covariance (SIZE, SIZE) of the parameters."""
        mean, std = np.zeros(SIZE), np.zeros(SIZE)
        radius_m = float(self._radius.mean())
        warmths = WARM.stop - WARM.start
        for index, prior, unit in (
            (GROWTH, GROWTH_S2PM, REFERENCE.per_speed2 / radius_m),
            (DRAG, DRAG_SLIP_S2PM2, REFERENCE.per_speed2),
            (WARM, WARMTH_M, 1.0 / warmths / radius_m),
            (AGE, SPEED_AGE_S, 1.0),
        ):
            mean[index], std[index] = prior.mean * unit, prior.std * unit
        std[GROWTH_OWN], std[SPEED] = REFERENCE.growth_own_std, REFERENCE.speed_std
        std[WARM_AXLE] = REFERENCE.warm_axle_std
        mean[HILL] = np.where(self._driven, -DRIVE_SLIP_S2PM.mean * self._share, 0.0)
        std[HILL] = np.where(self._driven, DRIVE_SLIP_S2PM.std, REFERENCE.hill_free_std)
        covariance = np.diag(std**2)
        # A guessed nominal is wrong for all wheels alike; wheels differ among themselves by half as much.
        covariance[OWN, OWN] = REFERENCE.own_std**2 * (0.75 + 0.25 * np.eye(4))
        covariance[CAR:, CAR:] = np.diag(_drive_std() ** 2)
        return mean, covariance

    def _wheel_signs(self) -> FloatArray:
        """Return (4, SIZE) the sign with which each parameter acts on each wheel, 0 where it does not."""
        out = np.zeros((4, SIZE))
        out[:, OWN] = out[:, GROWTH_OWN] = out[:, DRIFT_OWN] = np.eye(4)
        out[:, SPEED] = out[:, GROWTH] = out[:, DAY] = out[:, DRIFT] = 1.0
        out[:, DRAG] = np.where(np.where(IS_FRONT, *self._driven), -1.0, 0.0)
        out[:, WARM], out[:, WARM_AXLE] = -1.0, np.where(IS_FRONT, -1.0, 1.0)
        for axle, mask in enumerate((IS_FRONT, ~IS_FRONT)):
            out[mask, HILL.start + axle] = out[mask, LOAD.start + axle] = 1.0
        return out

    def features(self, at: Conditions) -> FloatArray:
        """Return the (4, SIZE) derivative of each wheel's relative radius by each parameter."""
        quantities = np.ones(SIZE)
        speed2 = at.speed2 / REFERENCE.per_speed2
        quantities[GROWTH_OWN] = quantities[GROWTH] = quantities[DRAG] = speed2
        quantities[SPEED] = speed_weights(math.sqrt(at.speed2))
        quantities[WARM], quantities[WARM_AXLE] = at.cold, at.cold[1]
        quantities[HILL] = at.slope_mps2
        return np.asarray(self._acts * quantities)

    def expected(self, at: Conditions) -> tuple[FloatArray, FloatArray]:
        """Return the expected deviation from the nominal radii (4,), m, and its covariance (4, 4), m2."""
        h = self.features(at)
        return h @ self.mean * self._radius, h @ self.covariance @ h.T * np.outer(self._radius, self._radius)

    def own_growth_m(self, at: Conditions) -> FloatArray:
        """Return the (4,) growth (m) of each wheel with speed beyond the others, less its slip against the
        drag, as far as it is learned."""
        slope = self.mean[GROWTH_OWN] + self._acts[:, DRAG] * self.mean[DRAG]
        return np.asarray(slope * at.speed2 / REFERENCE.per_speed2 * self._radius)

    def learn(
        self,
        deviation_m: FloatArray,
        covariance_m2: FloatArray,
        wheels: list[int],
        at: Conditions,
        *,
        car: bool,
    ) -> None:
        """Update by an estimate of these wheels, (d,) and (d, d), independent of those before.

        `car`: whether it may change what belongs to the car; else only what belongs to the drive (Schmidt's
        consider update: what is not taught keeps its mean and covariance).
        """
        radius = self._radius[wheels]
        noise = covariance_m2 / np.outer(radius, radius)
        self.correct(deviation_m / radius, noise, self.features(at)[wheels], car=car)
        if car:
            self.ranges[speed_range(at)] += 1

    def learn_calibration(self, std_m: FloatArray, speed_mps: float, wheels: list[int]) -> None:
        """Update by the nominal radii of these wheels, as other drives measured them at this speed with
        `std_m` (d,).

        Their load and weather are not those of any drive to come, and nobody noted how warm the tyres were:
        anything between cold and warm, uniformly.
        """
        radius = self._radius[wheels]
        at = Conditions(speed_mps**2, 0.0, (0.5, 0.5), 0.0, 0.0)
        h = self.features(at)[wheels]
        by_warmth = 2.0 * (self.features(replace(at, cold=(1.0, 1.0)))[wheels] - h)
        warmth = by_warmth @ (self.covariance + np.outer(self.mean, self.mean)) @ by_warmth.T / 12.0
        of_drives = h.copy()
        of_drives[:, :CAR] = 0.0
        h[:, CAR:] = 0.0
        noise = np.diag((std_m / radius) ** 2) + of_drives @ self.covariance @ of_drives.T + warmth
        self.correct(np.zeros(len(wheels)), noise, h)

    def learn_slip(self, slope: Slope, *, car: bool = True) -> tuple[Innovation, FloatArray]:
        """Update by a slip slope, `car` as in `learn`; return the innovation and the features (1, SIZE). The
        slip of the driven axle under the force of a slope is that under an acceleration. Where both are
        driven it is the mean of both."""
        h = np.zeros((1, SIZE))
        h[0, HILL] = -0.5 if self._driven.all() else np.where(self._driven, -1.0, 1.0)
        h[0, AGE] = slope.per_age
        value, variance = np.array([slope.slip_s2pm]), np.array([[slope.variance]])
        return self.correct(value, variance, h, car=car), h

    def correct(
        self, deviation: FloatArray, noise: FloatArray, h: FloatArray, *, car: bool = True
    ) -> Innovation:
        """Apply the Kalman filter's measurement update with relative deviations (d,), their covariance (d, d)
        and features (d, SIZE); return the innovation. `car` as in `learn`."""
        innovation = deviation - h @ self.mean
        spread = h @ self.covariance @ h.T + noise
        gain = np.asarray(np.linalg.solve(spread, h @ self.covariance).T)
        if not car:
            gain[:CAR] = 0.0
        self.mean = self.mean + gain @ innovation
        # Joseph's form: right for any gain.
        kept = np.eye(SIZE) - gain @ h
        out = kept @ self.covariance @ kept.T + gain @ noise @ gain.T
        self.covariance = (out + out.T) / 2
        return Innovation(innovation, spread, gain)

    def predict(self, seconds: float) -> FloatArray:
        """Apply the time update of so many seconds of driving, in which drift within the drive decays toward
        its prior; return the (SIZE,) factor by which each parameter decayed."""
        decay = math.exp(-seconds / REFERENCE.drift_time_constant_s)
        factor = np.ones(SIZE)
        factor[DRIFT] = factor[DRIFT_OWN] = decay
        self.mean = self.mean * factor
        self.covariance = self.covariance * np.outer(factor, factor)
        grown = (1.0 - decay**2) * _drive_std() ** 2
        for index in (DRIFT, *range(DRIFT_OWN.start, DRIFT_OWN.stop)):
            self.covariance[index, index] += grown[index - CAR]
        return factor

    def widened(self, model: DriveModel) -> RadiusReference:
        """Return a reference in which this drive may differ from those before as `model` allows."""
        out = self.copy()
        slip_std = np.where(self._driven, self._share * model.slip_std, 0.0)
        (hill, slip_slope_std), (drag, drag_std) = model.slip_slope_times, model.drag_times
        indices = {DRAG: math.hypot(model.drag_std, drag_std * self.mean[DRAG])}
        out.mean[DRAG] *= drag
        for axle in range(2):
            indices[LOAD.start + axle] = math.hypot(model.load_std[axle], slip_std[axle])
            if self._driven[axle]:
                index = HILL.start + axle
                indices[index] = math.hypot(model.slip_slope_std, slip_slope_std * self.mean[index])
                out.mean[index] *= hill
        for index, std in indices.items():
            out.covariance[index, index] += std**2
        return out

    def slip_covariance(self, model: DriveModel) -> FloatArray:
        """Return the (4, 4) relative covariance of the slip of driven axles by `model` all drive long."""
        return self._driven_axle_covariance(self._share * model.slip_std)

    def _driven_axle_covariance(self, std: float) -> FloatArray:
        """Return the (4, 4) covariance of changes that both wheels of a driven axle have in common."""
        driven = np.where(IS_FRONT, self._driven[0], self._driven[1])
        return np.asarray(np.where(driven[:, None], self._axle_covariance(std), 0.0))

    def _axle_covariance(self, std: float) -> FloatArray:
        """Return the (4, 4) covariance of changes that both wheels of an axle have in common."""
        return np.where(IS_FRONT[:, None] == IS_FRONT[None, :], std**2, 0.0)

    def scatter_covariance(self, model: DriveModel) -> FloatArray:
        """Return the (4, 4) relative covariance that `model` adds to every sample."""
        return self._axle_covariance(model.axle_scatter) + np.eye(4) * model.own_scatter**2

    def forget_drive(self, load_only: bool) -> None:
        """Reset the parameters that a stop may change to their priors: the load, and unless `load_only` the
        day and the drift."""
        std = _drive_std()
        indices = list(range(LOAD.start, LOAD.stop)) if load_only else list(range(CAR, SIZE))
        self.mean[indices] = 0.0
        self.covariance[indices, :] = 0.0
        self.covariance[:, indices] = 0.0
        for index in indices:
            self.covariance[index, index] = std[index - CAR] ** 2

    def copy(self) -> RadiusReference:
        """Return an independent copy."""
        out = RadiusReference.__new__(RadiusReference)
        out._radius, out._driven, out._share = self._radius, self._driven, self._share
        out._acts = self._acts
        out.mean, out.covariance, out.ranges = self.mean.copy(), self.covariance.copy(), list(self.ranges)
        return out

    def to_json(self) -> dict[str, Any]:
        """Return plain numbers for the state file."""
        return {
            "mean": self.mean.tolist(),
            "covariance": self.covariance.tolist(),
            "ranges": list(self.ranges),
        }

    @classmethod
    def from_json(cls, saved: dict[str, Any], vehicle: VehicleConfig) -> RadiusReference:
        """Restore from the state file; ValueError if it is no baseline.

        Learning only ever narrows the prior, so no variance may be much wider and no parameter far from it.
        """
        out = cls(vehicle)
        prior_mean, prior = out._prior_moments()
        std = np.sqrt(np.diag(prior))
        try:
            if len(saved["mean"]) == SIZE - 1:
                saved = _with_age(saved, prior_mean[AGE], prior[AGE, AGE])
            mean = vector(saved["mean"], SIZE, "baseline")
            spread = covariance(saved["covariance"], (REFERENCE.wider * std) ** 2, "baseline's covariance")
            ranges = [whole(n, 0, REFERENCE.max_samples, "number of samples") for n in saved["ranges"]]
        except (KeyError, TypeError) as error:
            raise ValueError(f"the saved baseline is not one: {error}") from error
        if len(ranges) != KNOTS_MPS.size:
            raise ValueError("the saved baseline has another shape")
        if np.any(np.abs(mean - prior_mean) > REFERENCE.far_stds * std):
            raise ValueError("the saved baseline is absurd (far from what any car has)")
        out.mean, out.covariance, out.ranges = mean, spread, ranges
        return out


def _with_age(saved: dict[str, Any], mean: float, variance: float) -> dict[str, Any]:
    """Return a baseline that was saved before `AGE` was learned (0.6 and earlier), with its prior."""
    rows = [[*row[:AGE], 0.0, *row[AGE:]] for row in saved["covariance"]]
    of_age = [variance if index == AGE else 0.0 for index in range(SIZE)]
    return {
        **saved,
        "mean": [*saved["mean"][:AGE], mean, *saved["mean"][AGE:]],
        "covariance": [*rows[:AGE], of_age, *rows[AGE:]],
    }


def _drive_std() -> FloatArray:
    """Return the (SIZE - CAR,) prior standard deviations of the drive's parameters."""
    out = np.empty(SIZE - CAR)
    out[LOAD.start - CAR : LOAD.stop - CAR] = REFERENCE.load_std
    out[DAY - CAR], out[DRIFT - CAR] = REFERENCE.day_std, REFERENCE.drift_std
    out[DRIFT_OWN.start - CAR :] = REFERENCE.drift_own_std
    return out


def speed_weights(speed_mps: float) -> FloatArray:
    """Return the (knots,) piecewise linear weights of the ranges of speed; their sum is 1."""
    index = float(np.interp(speed_mps, KNOTS_MPS, _INDICES))
    return np.asarray(np.maximum(1.0 - np.abs(_INDICES - index), 0.0))


def speed_range(at: Conditions) -> int:
    """Return the index of the range of speed of these conditions: the nearest knot."""
    return int(np.argmax(speed_weights(math.sqrt(at.speed2))))
