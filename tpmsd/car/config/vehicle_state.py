"""Needs of `[vehicle_state] method` and `replay --vehicle-state` on a configuration.

In: the keys and roles that are given. Out: the names of what is missing, or ConfigError in one line.
"""

from __future__ import annotations

from collections.abc import Collection

from tpmsd.car.config.dynamics import NEEDED
from tpmsd.car.config.model import Config
from tpmsd.foundation.errors import ConfigError

SIGNALS = ("steering_wheel_angle", "yaw_rate", "accel_lat")
"""Roles of the bus without which no filter of the vehicle state runs."""


def missing_keys(dynamics: Collection[str], vehicle: Collection[str], roles: Collection[str]) -> str:
    """Return the missing keys of `[dynamics]` and `[vehicle]` and the missing roles, as TOML names them;
    empty if none."""
    wanted = (
        ("dynamics", [key for key in NEEDED if key not in dynamics]),
        ("vehicle", [] if "steering_ratio" in vehicle else ["steering_ratio"]),
        ("can.signals", [role for role in SIGNALS if role not in roles]),
    )
    return ", ".join(f"[{table}] {' '.join(keys)}" for table, keys in wanted if keys)


def check_vehicle_state(config: Config) -> None:
    """Raise ConfigError with one line if a filter of the vehicle state cannot run on this configuration."""
    given = [key for key in NEEDED if getattr(config.dynamics, key) is not None]
    ratio = [] if config.vehicle.steering_ratio is None else ["steering_ratio"]
    if missing := missing_keys(given, ratio, config.can.signals):
        raise ConfigError(f"{config.file or 'configuration'}: the vehicle state needs {missing}")
