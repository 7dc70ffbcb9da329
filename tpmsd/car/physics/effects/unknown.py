"""A spline term: physics that has been measured and located, but has no name."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from tpmsd.car.physics.covariates import COVARIATES, ROLES, covariate
from tpmsd.car.physics.effect import Effect, Kind, TextParameter, VectorParameter
from tpmsd.car.physics.effect_records import Wording
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.wheels import WHEELS, FloatArray

CHANNELS: dict[str, tuple[str, float]] = {
    "gnss_speed": ("m/s", 20.0),
    "gnss_course": ("rad", 1.0),
    "yaw_rate": ("rad/s", 1.0),
}
"""Readings that a term may act on beside wheels: unit, and the largest plausible size."""
MAX_RADIUS_CHANGE_M = 0.05


@dataclass(frozen=True)
class Unknown(Effect):
    """A piecewise linear function f of one covariate x, constant beyond its outer knots.

    `on` names what it acts on: wheels, each with its sign ("rl rr", "fl -fr rl -rr"), whose radii change by
    +-f(x) in metres; or a reading, which is larger by f(x): `gnss_speed` (m/s), `gnss_course` (rad,
    counter-clockwise) or `yaw_rate` (rad/s). `covariate` is one of `tpmsd.car.physics.covariates`. f goes
    through (knots[i], heights[i]). Where the covariate is not known, the term does not act. Source: none;
    it is a description. Linear splines of fixed knots: Hastie, Tibshirani and Friedman, The Elements of
    Statistical Learning, 2009, section 5.2.
    """

    name = "unknown"
    kind = Kind.NONPARAMETRIC
    wording = Wording(
        formula="delta_r, or a reading's error, = f(covariate), piecewise linear",
        sentence="something that no effect of the catalogue explains",
        noun="something without a name",
    )
    parameters = (
        TextParameter("on", "rl rr", "wheels with their signs, gnss_speed, gnss_course or yaw_rate"),
        TextParameter("covariate", "speed", "what the shape is a function of"),
        VectorParameter("knots", (10.0, 20.0, 30.0), "values of the covariate, increasing"),
        VectorParameter("heights", (0.0, -5e-4, 0.0), "the shape's height at each knot"),
    )
    on: str
    covariate: str
    knots: tuple[float, ...]
    heights: tuple[float, ...]

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.covariate not in COVARIATES:
            raise self._config_error(f"covariate = {self.covariate!r} is not one of {' '.join(COVARIATES)}")
        if len(self.heights) != len(self.knots):
            raise self._config_error(f"{len(self.knots)} knots, but {len(self.heights)} heights")
        for k, (low, high) in enumerate(pairwise(self.knots)):
            if not low < high:
                raise self._config_error(f"knots[{k + 1}] = {high:g} does not lie above knots[{k}] = {low:g}")
        unit, largest = CHANNELS.get(self.on, ("m", MAX_RADIUS_CHANGE_M))
        for k, height in enumerate(self.heights):
            if abs(height) > largest:
                raise self._config_error(
                    f"heights[{k}] = {height:g} is outside -{largest:g} to {largest:g} {unit}"
                )
        if self.on not in CHANNELS:
            self._check_wheels()

    def _config_error(self, why: str) -> ConfigError:
        """Return the error, with this effect's name."""
        return ConfigError(f"effect {self.name}: {why}")

    def _check_wheels(self) -> None:
        """Raise ConfigError if `on` names no wheel, or a wheel twice."""
        names = [word.removeprefix("-") for word in self.on.split()]
        for name in names:
            if name not in WHEELS:
                known = (
                    f"wheels ({' '.join(WHEELS)}, with - for the other sign) or one of {' '.join(CHANNELS)}"
                )
                raise self._config_error(f"on = {self.on!r} holds {name!r}, wanted are {known}")
        if len(set(names)) < len(names):
            raise self._config_error(f"on = {self.on!r} names a wheel twice")

    @property
    def signs(self) -> FloatArray:
        """Return the (4,) signs with which the spline acts on each wheel's radius; zeros if on a reading."""
        out = np.zeros(4)
        if self.on not in CHANNELS:
            for word in self.on.split():
                out[WHEELS.index(word.removeprefix("-"))] = -1.0 if word.startswith("-") else 1.0
        return out

    def unit_of(self, parameter: str) -> str:
        """Return the covariate's unit for the knots, that of wheels or reading for the heights."""
        if parameter == "knots":
            return COVARIATES[self.covariate]
        if parameter == "heights":
            return CHANNELS.get(self.on, ("m", 0.0))[0]
        return ""

    def height(self, motion: Motion, car: Car) -> FloatArray:
        """(n,) f(x); zero where x is not known."""
        x = covariate(motion, car, self.covariate)
        return np.where(np.isnan(x), 0.0, np.interp(x, self.knots, self.heights))

    def radius_change_m(self, motion: Motion, car: Car) -> FloatArray:
        """Return the (n, 4) spline with its signs on its wheels."""
        return self.height(motion, car)[:, None] * self.signs

    def gnss_speed_error_mps(self, motion: Motion, car: Car) -> FloatArray:
        """(n,) value of the spline where it acts on the receiver's speed; else zeros."""
        return self._spline_if_on("gnss_speed", motion, car)

    def gnss_course_error_rad(self, motion: Motion, car: Car) -> FloatArray:
        """Return the (n,) spline where it acts on the receiver's course; else zeros."""
        return self._spline_if_on("gnss_course", motion, car)

    def yaw_rate_error_radps(self, motion: Motion, car: Car) -> FloatArray:
        """Return the (n,) spline where it acts on the gyro; else zeros."""
        return self._spline_if_on("yaw_rate", motion, car)

    def _spline_if_on(self, channel: str, motion: Motion, car: Car) -> FloatArray:
        """Return the (n,) spline if it acts on this channel, else zeros."""
        return self.height(motion, car) if self.on == channel else np.zeros(len(motion))

    @classmethod
    def largest(cls, on: str) -> float:
        """Return the largest plausible value: metres on wheels, else in the reading's unit."""
        return CHANNELS.get(on, ("m", MAX_RADIUS_CHANGE_M))[1]

    def not_compensated(self, signals: frozenset[str]) -> str | None:
        """Return the reason: a term over time belongs to its drive, others need their covariate."""
        if self.covariate in ("time", "distance"):
            return f"a shape over {self.covariate} belongs to the drive on which it was found"
        role = ROLES.get(self.covariate)
        if role is not None and role not in signals:
            return f"it depends on {self.covariate}, and the bus has no {role}"
        return None
