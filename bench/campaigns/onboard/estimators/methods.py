"""The estimators that are compared, and how each is set.

In: a method's name, a number of particles, what it hears. Out: an `Estimator`, built as the daemon builds it
from a configuration that names method, particles and measurements: every other setting is the product's
default, the same for all, and no method hears what another does not (`INPUTS`). MPF-PN as published takes
positions alone whatever it is given.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from bench.worlds.paper_drive import RADIUS_M, TEETH, TICK_S
from bench.worlds.paper_route import TRACK_M, WHEELBASE_M
from tpmsd.car.config.model import CanConfig, Config, FilterConfig, VehicleConfig
from tpmsd.onboard.estimators.base import Estimator
from tpmsd.onboard.estimators.build import build_estimator
from tpmsd.onboard.estimators.table import TABLE

VEHICLE = VehicleConfig(
    wheel_radius_m=(RADIUS_M,) * 4,
    track_rear_m=TRACK_M,
    track_front_m=TRACK_M,
    wheelbase_m=WHEELBASE_M,
    driven_axle="front",
    teeth_per_rev=float(TEETH),
)
DEFAULT = "gaussian-sum"
"""The product's default method."""
TEXTBOOK = "mpf-pn-paper"
"""MPF-PN as Table I prints it (`tpmsd.onboard.estimators.table`)."""
WANTED = (DEFAULT, "mpf-pn", TEXTBOOK, "aug-pf", "aug-ekf", "aug-ukf", "mpf-mn")
"""In the order of the tables."""
SAMPLED = ("mpf-pn", TEXTBOOK, "aug-pf", "mpf-mn")
"""Methods whose number of particles is the paper's N."""


POSITIONS, ALL = "positions", "all"
INPUTS: dict[str, tuple[str, ...]] = {
    POSITIONS: ("position",),
    "and speed": ("position", "speed"),
    "and course": ("position", "course"),
    ALL: ("position", "speed", "course"),
}
"""Measurements used beside the wheels, as [filter] measurements names it; the drive has neither gyro nor
steering, so the last is all there is."""


def available() -> tuple[list[str], list[str]]:
    """Methods to compare that this program has, and those that it has not."""
    have = [name for name in WANTED if name in TABLE]
    return have, [name for name in WANTED if name not in have]


def config_of(
    method: str, particles: int | None = None, front: bool = False, inputs: str = POSITIONS
) -> Config:
    """A configuration as a file would give it."""
    wheels = ("fl", "fr", "rl", "rr") if front else ("rl", "rr")
    return Config(
        vehicle=VEHICLE,
        can=CanConfig(signals={f"wheel_count_{w}": f"W.{w}" for w in wheels}, dbc=Path("bus.dbc")),
        filter=FilterConfig(
            method=method, rate_hz=1.0 / TICK_S, particles=particles, measurements=INPUTS[inputs]
        ),
    )


def build(
    method: str,
    particles: int | None,
    seed: int,
    front: bool = False,
    inputs: str = POSITIONS,
    config: Config | None = None,
) -> Estimator:
    """An estimator of the rear pair, or of all wheels; `config` None: of the bench's own car."""
    config = config_of(method, particles, front, inputs) if config is None else config
    return build_estimator(config, np.random.default_rng([seed, 7]))
