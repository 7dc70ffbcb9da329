"""The estimators that are compared, and how each is set.

In: a method's name, a number of particles, a seed. Out: an `Estimator`, built the way the daemon builds it.

No method is starved: `python -m bench run estimators --tune` plays each over the grid in
`tune` (memory or random walk of the radii, and a factor on the receiver's stated error, which buys off
the whiteness that all but the Gaussian sum take for granted), for each receiver, on a seed that no table
uses; `TUNED` holds the best.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from bench.worlds.paper_drive import RADIUS_M, TEETH, TICK_S
from bench.worlds.paper_route import TRACK_M, WHEELBASE_M
from tpmsd.car.config.model import CanConfig, Config, FilterConfig, VehicleConfig
from tpmsd.onboard.estimators.base import Estimator
from tpmsd.onboard.estimators.build import build_filter, monitored_wheels
from tpmsd.onboard.estimators.table import TABLE, row_of
from tpmsd.onboard.timeline.tick import Tick

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
WANTED = (DEFAULT, TEXTBOOK, "mpf-pn", "mpf-pn-niw", "aug-pf", "aug-ekf", "aug-ukf", "mpf-mn")
"""In the order of the tables."""
SAMPLED = (TEXTBOOK, "mpf-pn", "mpf-pn-niw", "aug-pf", "mpf-mn")
"""Methods whose number of particles is the paper's N."""


@dataclass(frozen=True)
class Setting:
    """What a method is tuned by."""

    window_s: float = 60.0
    """Memory of the forgetting, where a method forgets."""
    receiver_factor: float = 1.0
    """On the stated error of a position."""
    options: tuple[tuple[str, float], ...] = ()
    """Fields of the method's pieces that differ from the table's."""


_WALK = (("drift_std_m", 0.06e-3),)
TUNED: dict[tuple[str, str], Setting] = {
    (TEXTBOOK, "white"): Setting(10.0, 3.0),
    (TEXTBOOK, "correlated"): Setting(20.0, 3.0),
    ("mpf-pn-niw", "white"): Setting(10.0, 3.0),
    ("mpf-pn-niw", "correlated"): Setting(20.0, 3.0),
    ("aug-pf", "white"): Setting(60.0, 3.0, _WALK),
    ("aug-pf", "correlated"): Setting(60.0, 3.0, _WALK),
    ("aug-ekf", "white"): Setting(60.0, 3.0, _WALK),
    ("aug-ekf", "correlated"): Setting(60.0, 3.0, _WALK),
    ("aug-ukf", "white"): Setting(60.0, 1.0, _WALK),
    ("aug-ukf", "correlated"): Setting(60.0, 1.0, _WALK),
    ("mpf-mn", "white"): Setting(180.0, 3.0, (("yaw_accel_std_radps2", 0.1),)),
    ("mpf-mn", "correlated"): Setting(20.0, 3.0, (("yaw_accel_std_radps2", 0.25),)),
}
"""(method, receiver) -> setting. MPF-MN loses its way with white errors in nearly all of the grid."""


def setting_of(method: str, receiver: str) -> Setting:
    """The tuned setting; the program's own defaults where nothing was tuned."""
    return TUNED.get((method, receiver), Setting())


def available() -> tuple[list[str], list[str]]:
    """Methods to compare that this program has, and those that it has not."""
    have = [name for name in WANTED if name in TABLE]
    return have, [name for name in WANTED if name not in have]


def config_of(method: str, setting: Setting, particles: int | None, front: bool = False) -> Config:
    """A configuration as a file would give it."""
    wheels = ("fl", "fr", "rl", "rr") if front else ("rl", "rr")
    return Config(
        vehicle=VEHICLE,
        can=CanConfig(signals={f"wheel_count_{w}": f"W.{w}" for w in wheels}, dbc=Path("bus.dbc")),
        filter=FilterConfig(
            method=method,
            rate_hz=1.0 / TICK_S,
            particles=particles,
            window_s=setting.window_s,
        ),
    )


def build(
    method: str,
    setting: Setting,
    particles: int | None,
    seed: int,
    front: bool = False,
    config: Config | None = None,
) -> Estimator:
    """An estimator of the rear pair, or of all wheels; `config` None: of the bench's own car."""
    config = config_of(method, setting, particles, front) if config is None else config
    rng = np.random.default_rng([seed, 7])
    row = row_of(config.filter.method)
    if row is not None and setting.options:
        row = replace(row, pieces=_tuned(row.pieces, dict(setting.options)))
    all_wheels = len(monitored_wheels(config)) == 4
    return build_filter(config.vehicle, config.gnss, config.filter, rng, all_wheels, row)


def _tuned(pieces: Any, options: dict[str, float]) -> Any:
    """The pieces with these fields, wherever among them they are."""
    own = {field.name for field in fields(pieces)}
    here = {name: value for name, value in options.items() if name in own}
    deeper = {
        field.name: _tuned(part, options)
        for field in fields(pieces)
        if is_dataclass(part := getattr(pieces, field.name))
    }
    return replace(pieces, **deeper, **here)


def heard(ticks: list[Tick], setting: Setting) -> list[Tick]:
    """The ticks as a method with this setting takes them."""
    if setting.receiver_factor == 1.0:
        return ticks
    return [
        replace(
            tick,
            fixes=tuple(
                replace(fix, position_std_m=fix.position_std_m * setting.receiver_factor)
                for fix in tick.fixes
            ),
        )
        if tick.fixes
        else tick
        for tick in ticks
    ]
