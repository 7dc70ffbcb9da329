"""Estimators as configurations ask for them.

In: a `Config` and a random generator. Out: an `Estimator`. What there is stands in `table`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tpmsd.car.config.model import Config, FilterConfig, GnssConfig, VehicleConfig
from tpmsd.car.physics.kinematics import WheelPositions
from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.wheels import FL, FR, RL, RR
from tpmsd.onboard.estimators.bank.marginal import MarginalBelief, MarginalPieces
from tpmsd.onboard.estimators.bank.mixture import MixtureBelief, MixturePieces
from tpmsd.onboard.estimators.belief import Belief, FilterCar
from tpmsd.onboard.estimators.gates.fix_gate import FIX_WEIGHTS
from tpmsd.onboard.estimators.gates.motion_gate import MotionGate
from tpmsd.onboard.estimators.gates.slip_gate import make_gate
from tpmsd.onboard.estimators.published.front_contrast import FourWheelBelief
from tpmsd.onboard.estimators.published.gaussian import GaussianBelief, GaussianPieces
from tpmsd.onboard.estimators.published.samples import SampledBelief
from tpmsd.onboard.estimators.radius_filter import RadiusFilter
from tpmsd.onboard.estimators.settings import SETTINGS
from tpmsd.onboard.estimators.table import ALIASES, TABLE, Row, row_of

if TYPE_CHECKING:
    Randomness = np.random.Generator | Callable[[], np.random.Generator]
    """Generator, or a function that makes one: NumPy's take 2 MB, which the default filter does without."""


def monitored_wheels(config: Config) -> tuple[int, ...]:
    """Return the indices of the wheels whose signals the configuration names: all four, or the rear pair."""
    roles = config.can.signals
    known = {
        i
        for i, w in enumerate(("fl", "fr", "rl", "rr"))
        if f"wheel_count_{w}" in roles or f"wheel_speed_{w}" in roles
    }
    if not {RL, RR} <= known:
        raise ConfigError(
            "the signals of both rear wheels are needed: wheel_count_rl/rr or wheel_speed_rl/rr"
        )
    return (FL, FR, RL, RR) if {FL, FR} <= known else (RL, RR)


def build_estimator(config: Config, rng: Randomness) -> RadiusFilter:
    """Return the estimator that [filter] method names; ConfigError if there is none of that name."""
    front = len(monitored_wheels(config)) == 4
    return build_filter(config.vehicle, config.gnss, config.filter, rng, front)


def build_filter(
    vehicle: VehicleConfig,
    gnss: GnssConfig,
    settings: FilterConfig,
    rng: Randomness,
    front: bool,
    row: Row | None = None,
    gate: MotionGate | None = None,
) -> RadiusFilter:
    """Return an estimator of the rear pair, or of all wheels with `front`; `row` None: the one that
    `settings` name; `gate` None likewise. ConfigError if there is none of that name.
    """
    row = row or row_of(settings.method)
    if row is None:
        known = ", ".join([*TABLE, *ALIASES])
        raise ConfigError(f"[filter] method: unknown {settings.method!r}; known: {known}")
    car = filter_car(vehicle, gnss, front)
    return RadiusFilter(
        *(car, vehicle, settings, gate or make_gate(settings, vehicle), row.gates),
        begin_belief(row, car, settings, rng),
    )


def _generator(rng: Randomness) -> np.random.Generator:
    """Return the generator itself, made now where a function that makes it was given."""
    return rng() if callable(rng) else rng


def filter_car(vehicle: VehicleConfig, gnss: GnssConfig, front: bool) -> FilterCar:
    """Return the geometry and radii that a filter of the rear pair, or of all wheels with `front`, needs of
    the car."""
    order = (RL, RR, FL, FR) if front else (RL, RR)
    return FilterCar(
        order=order,
        nominal_m=np.array([vehicle.wheel_radius_m[i] for i in order]),
        geometry=WheelPositions(vehicle.track_front_m, vehicle.track_rear_m, vehicle.wheelbase_m),
        antenna_m=(gnss.antenna_forward_m, gnss.antenna_left_m),
        driven_front=vehicle.driven_axle in ("front", "all"),
        driven_rear=vehicle.driven_axle in ("rear", "all"),
    )


def begin_belief(row: Row, car: FilterCar, settings: FilterConfig, rng: Randomness) -> Belief:
    """Return a row's belief before the first tick; a random generator is made only for filters that draw."""
    pieces = row.pieces
    if isinstance(pieces, MixturePieces):
        chosen = replace(pieces, fix_weights=FIX_WEIGHTS[settings.fix_weights])
        return MixtureBelief(car, chosen, settings.particles or SETTINGS.hypotheses)
    if isinstance(pieces, MarginalPieces):
        weighed = replace(pieces.mixture, fix_weights=FIX_WEIGHTS[settings.fix_weights])
        count = settings.particles or SETTINGS.marginal_particles
        return MarginalBelief(car, replace(pieces, mixture=weighed), count, _generator(rng))
    forgetting = 1.0 - 1.0 / max(settings.window_s * settings.rate_hz, 2.0)
    rear: Belief
    if isinstance(pieces, GaussianPieces):
        rear = GaussianBelief(car, pieces)
    else:
        noise = pieces.position_noise
        sampled = replace(
            pieces,
            radii=pieces.radii.remembering(forgetting),
            position_noise=None if noise is None else noise.remembering(settings.window_s),
        )
        rear = SampledBelief(car, sampled, settings.particles or SETTINGS.particles, _generator(rng))
    return FourWheelBelief(rear, car, forgetting) if len(car.order) == 4 else rear
