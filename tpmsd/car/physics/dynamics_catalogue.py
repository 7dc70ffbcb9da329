"""The catalogue of effects of vehicle dynamics by name.

In: an effect's name and its parameters. Out: the `DynamicsEffect`. To add one: write its file in
`tpmsd/car/physics/dynamics_effects`; model files, simulation and diagnosis then know it. Users bring files
of their own with `--effects-path` (`own_dynamics`).
"""

from __future__ import annotations

import difflib
import importlib
import pkgutil

from tpmsd.car.physics import dynamics_effects
from tpmsd.car.physics.dynamics_effect import DynamicsEffect
from tpmsd.car.physics.own_dynamics import external_dynamics_effects
from tpmsd.foundation.errors import ConfigError


def _built_in_effects() -> dict[str, type[DynamicsEffect]]:
    """Return every effect that a module of `tpmsd.car.physics.dynamics_effects` defines, in the alphabet's
    order."""
    out: dict[str, type[DynamicsEffect]] = {}
    for module in sorted(one.name for one in pkgutil.iter_modules(dynamics_effects.__path__)):
        full = f"{dynamics_effects.__name__}.{module}"
        for value in vars(importlib.import_module(full)).values():
            own = isinstance(value, type) and issubclass(value, DynamicsEffect) and value.__module__ == full
            if own and "name" in vars(value):
                out[value.name] = value
    return dict(sorted(out.items()))


DYNAMICS_EFFECTS: dict[str, type[DynamicsEffect]] = _built_in_effects()


def register_external_effects() -> None:
    """Add the effects of folders and entry points to the catalogue; ConfigError on a broken one."""
    for effect in external_dynamics_effects(DYNAMICS_EFFECTS):
        DYNAMICS_EFFECTS[effect.name] = effect


register_external_effects()


def make_dynamics_effect(name: str, **values: object) -> DynamicsEffect:
    """Return an effect with its parameters; ConfigError with one line if there is no such one."""
    if name not in DYNAMICS_EFFECTS:
        near = difflib.get_close_matches(name, DYNAMICS_EFFECTS, 1)
        hint = f"; did you mean {near[0]}?" if near else ""
        raise ConfigError(f"no effect of vehicle dynamics is called {name!r}{hint}")
    cls = DYNAMICS_EFFECTS[name]
    known = [p.name for p in cls.parameters]
    for key in values:
        if key not in known:
            raise ConfigError(f"effect {name} has no parameter {key!r}; it has {' '.join(known)}")
    return cls(**values)
