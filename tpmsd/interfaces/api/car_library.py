"""The car library's files: `cars/*.toml`, part of the package.

In: nothing. Out: `CarPlatform`s.
"""

from __future__ import annotations

import tomllib
from importlib.resources import files

from tpmsd.foundation.errors import ConfigError
from tpmsd.offline.discovery.library import CarPlatform, car_from


def load_cars() -> list[CarPlatform]:
    """Return all entries, sorted by name; ConfigError names a file that is not a valid entry."""
    cars = []
    for entry in sorted(files("tpmsd.car.cars").iterdir(), key=lambda one: one.name):
        if not entry.name.endswith(".toml"):
            continue
        try:
            data = tomllib.loads(entry.read_text(encoding="utf-8"))
        except tomllib.TOMLDecodeError as error:
            raise ConfigError(f"car library, {entry.name}: {error}") from None
        cars.append(car_from(entry.name.removesuffix(".toml"), data))
    return cars
