"""Faults: tyres that lose pressure, as changes of radius.

In: a kind (puncture, leak, diffusion, step), a wheel, a size in one of three units, an onset. Out: effects.
"""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.catalogue import FAULT, make_effect
from tpmsd.car.physics.effect import Effect
from tpmsd.car.physics.tyre import radius_change_for_pressure_loss
from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.wheels import WHEELS, FloatArray

FAULT_DURATION_S = {"puncture": 30.0, "leak": 600.0, "diffusion": 1800.0, "step": 0.0}
"""Duration of each kind of fault where nothing else is given, s."""
SIZE_UNITS = ("percent", "mm", "pressure-percent")


@dataclass(frozen=True, slots=True)
class Fault:
    """A loss of pressure: `puncture` in seconds, `leak` in minutes, `diffusion` slowly in all four tyres."""

    kind: str
    size: float
    """Size of the loss, positive for a loss."""
    size_unit: str = "percent"
    """`percent` of the radius, `mm` of radius, or `pressure-percent` of the pressure."""
    wheel: str | None = None
    """Wheel that loses pressure; None for diffusion alone."""
    onset_s: float = 0.0
    """Onset since the drive's start, s."""
    duration_s: float | None = None
    """Duration, s; None: as usual for the kind."""

    def __post_init__(self) -> None:
        if self.kind not in FAULT_DURATION_S:
            raise ConfigError(f"unknown fault {self.kind!r} (faults: {' '.join(FAULT_DURATION_S)})")
        if self.kind == "diffusion" and self.wheel is not None:
            raise ConfigError("diffusion concerns all four wheels and takes none")
        if self.kind != "diffusion" and self.wheel not in WHEELS:
            raise ConfigError(f"{self.kind}: wheel {self.wheel!r} is not one of {' '.join(WHEELS)}")

    def effects(self, nominal_radius_m: FloatArray) -> tuple[Effect, ...]:
        """Return the changes of radius, one effect per wheel concerned."""
        wheels = WHEELS if self.wheel is None else (self.wheel,)
        duration = FAULT_DURATION_S[self.kind] if self.duration_s is None else self.duration_s
        effects = []
        for wheel in wheels:
            radius = float(nominal_radius_m[WHEELS.index(wheel)])
            change = radius_change_m(self.size, self.size_unit, radius)
            values = {"deviation_m": change, "onset_s": self.onset_s, "duration_s": duration}
            effects.append(make_effect(FAULT.name, wheel=wheel, **values))
        return tuple(effects)


def radius_change_m(size: float, unit: str, radius_m: float) -> float:
    """Return the change of radius, m, negative for a loss of `size` (in `unit`) on a wheel of `radius_m`."""
    if unit == "percent":
        return -size / 100.0 * radius_m
    if unit == "mm":
        return -size / 1000.0
    if unit == "pressure-percent":
        return radius_change_for_pressure_loss(size / 100.0, radius_m)
    raise ConfigError(f"unknown unit of size {unit!r} (units: {' '.join(SIZE_UNITS)})")
