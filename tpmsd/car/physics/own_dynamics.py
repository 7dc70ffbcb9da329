"""Effects of vehicle dynamics that users bring, in the same files and entry points as those of wheels.

In: the folders and entry points of `own_effects`. Out: classes of `DynamicsEffect`, each checked on both
baselines, or a `ConfigError` with one line that names the file.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from importlib.metadata import entry_points
from types import ModuleType
from typing import Any

import numpy as np

from tpmsd.car.physics.baselines.car import DynamicCar
from tpmsd.car.physics.baselines.inputs import make_inputs
from tpmsd.car.physics.baselines.single_track import SingleTrack
from tpmsd.car.physics.baselines.three_dof import ThreeDof
from tpmsd.car.physics.dynamics_effect import FREE, DynamicsEffect
from tpmsd.car.physics.own_effects import (
    GROUP,
    NAME,
    check_parameters,
    dynamics_classes_of,
    effect_folders,
    files_of,
    loaded_entry_point,
    module_of_file,
    reason_of,
)
from tpmsd.car.physics.parameters import Parameter
from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.wheels import FloatArray

SAMPLES = 12
_CAR = DynamicCar(
    mass_kg=1500.0,
    yaw_inertia_kgm2=2400.0,
    front_m=1.2,
    rear_m=1.4,
    cornering_front_n=1e5,
    cornering_rear_n=1.2e5,
)


def external_dynamics_effects(known: Mapping[str, type[DynamicsEffect]]) -> Iterator[type[DynamicsEffect]]:
    """Yield the effects of folders and entry points that are not yet `known`; ConfigError on a broken one."""
    taken = dict(known)
    for effect, where in _users_effects():
        other = taken.get(effect.name)
        if other is effect:
            continue
        if other is not None:
            raise ConfigError(f"{where}: there is another effect {effect.name!r} (in {other.__module__})")
        taken[effect.name] = effect
        yield effect


def _users_effects() -> Iterator[tuple[type[DynamicsEffect], str]]:
    """Yield each effect of folders and entry points, with the place that defines it."""
    for folder in effect_folders():
        for path in files_of(folder):
            for effect in dynamics_classes_of(module_of_file(path)):
                yield checked_effect(effect, str(path)), str(path)
    for point in entry_points(group=GROUP):
        loaded, where = loaded_entry_point(point), f"entry point {point.name}"
        made: list[Any] = dynamics_classes_of(loaded) if isinstance(loaded, ModuleType) else [loaded]
        for effect in made:
            if isinstance(effect, type) and issubclass(effect, DynamicsEffect):
                yield checked_effect(effect, where), where


def checked_effect(effect: type[DynamicsEffect], where: str) -> type[DynamicsEffect]:
    """Return the class, if the program can use it; ConfigError with one line that says why not."""
    name = getattr(effect, "name", None)
    if not isinstance(name, str) or not NAME.fullmatch(name):
        raise ConfigError(f"{where}: {effect.__name__} has no name of small letters, digits and _")
    where = f"{where}: {name}"
    made = vars(effect).get("__dataclass_params__")  # an inherited one is not this class's
    if made is None or not made.frozen:
        raise ConfigError(f"{where}: not a frozen dataclass")
    check_parameters(effect.parameters, {one.name for one in dataclasses.fields(effect)}, where)
    if effect.kind == FREE:
        raise ConfigError(f"{where}: an effect of one's own cannot be {FREE}")
    if any(one.prior is None or one.prior.std <= 0.0 for one in effect.numbers()):
        raise ConfigError(f"{where}: a parameter that is fitted needs a prior with a standard deviation")
    _try_out(effect, where)
    return effect


def _try_out(effect: type[DynamicsEffect], where: str) -> None:
    """Evaluate the effect on short drives of both baselines: ConfigError on an error, a shape or a NaN."""
    time_s: FloatArray = np.arange(SAMPLES, dtype=np.float64) * 0.02
    inputs = make_inputs(time_s, 0.02 * np.sin(time_s), np.full(SAMPLES, 20.0), np.full(SAMPLES, 0.5))
    values = {one.name: one.typical for one in effect.parameters if isinstance(one, Parameter)}
    try:
        theta = (effect(**values),)
        for baseline in (SingleTrack(_CAR), ThreeDof(_CAR), ThreeDof(_CAR, forces=True)):
            states = baseline.states(theta)
            x = np.full((SAMPLES, len(states)), 0.05)
            if baseline.forces:
                x[:, states.index("u")] = 20.0
            frame = baseline.frame(x, inputs, theta)
            for key, value in {**frame.rates, **frame.outputs}.items():
                wide = np.broadcast_to(value, (SAMPLES,))
                if not np.isfinite(wide).all():
                    raise ValueError(f"{key} is no finite number on a plain drive")
    except Exception as error:
        raise ConfigError(f"{where}: {reason_of(error)}") from None
