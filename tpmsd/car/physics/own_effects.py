"""Effects that users bring: Python files in a folder, and entry points of installed packages.

In: folders named by `use_folder` (commands call it for `--effects-path` and `[physics] effects_path`) or by
the environment variable `TPMSD_EFFECTS_PATH`, and entry points of the group `tpmsd.effects` (each a class, or
a module with classes). Out: classes of effects, each checked on a short motion, or a `ConfigError` with one
line that names the file. The code is run with all rights of the program: who may write such a folder is
trusted as who may write the program (SECURITY.md), so a file that anybody may write is refused.
"""

from __future__ import annotations

import dataclasses
import hashlib
import importlib.util
import os
import re
import stat
import sys
from collections.abc import Iterable, Iterator, Mapping
from importlib.metadata import EntryPoint, entry_points
from operator import attrgetter
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from tpmsd.car.physics.effect import Effect, Kind
from tpmsd.car.physics.kinematics import WheelPositions
from tpmsd.car.physics.motion import Car, Motion, driven_mask
from tpmsd.car.physics.parameters import Parameter, TextParameter, VectorParameter, WheelParameter
from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.wheels import FloatArray

GROUP = "tpmsd.effects"
VARIABLE = "TPMSD_EFFECTS_PATH"
"""Folders, with the system's separator between them; processes that are started inherit them."""
CATALOGUE = "tpmsd.car.physics.catalogue"
DYNAMICS_CATALOGUE = "tpmsd.car.physics.dynamics_catalogue"
DYNAMICS_BASE = "tpmsd.car.physics.dynamics_effect"
NAME = re.compile(r"[a-z][a-z0-9_]{2,59}")
RESERVED = (
    *("nonlinear.ramp", "nonlinear.span", "identification.by_teeth", "identification.at_walking_pace"),
    *("identification.by_ripple", "identification.always_fitted", "confounding.mirror_of"),
    *("shortens", "in_calibration", "common_to_all_drives"),
)
"""Marks by which the program knows effects of its own that it looks for apart: others cannot have them."""
PARAMETERS = (Parameter, WheelParameter, TextParameter, VectorParameter)
WRITABLE_BY_ALL = stat.S_IWOTH
SAMPLES = 12
PARTS: dict[str, tuple[int, ...]] = {
    "radius_change_m": (SAMPLES, 4),
    "wheel_slip": (SAMPLES, 4),
    "yaw_rate_error_radps": (SAMPLES,),
    "accel_error_mps2": (SAMPLES, 2),
    "steering_error_rad": (SAMPLES,),
    "gnss_speed_error_mps": (SAMPLES,),
    "gnss_course_error_rad": (SAMPLES,),
}
"""Hooks of a motion and a car, and the shapes that they return."""
OF_MOTION: dict[str, tuple[int, ...]] = {"axle_course_rad": (SAMPLES,), "horizontal_factor": (SAMPLES,)}


def use_folder(folder: Path) -> None:
    """Add the effects in a folder to the catalogue; ConfigError if it is no folder."""
    if not folder.is_dir():
        raise ConfigError(f"{folder}: no folder of effects")
    known = effect_folders()
    if folder.resolve() not in known:
        os.environ[VARIABLE] = os.pathsep.join(str(one) for one in (*known, folder.resolve()))
    for catalogue in (CATALOGUE, DYNAMICS_CATALOGUE):
        if catalogue in sys.modules:
            sys.modules[catalogue].register_external_effects()


def effect_folders() -> tuple[Path, ...]:
    """Return the folders that were named so far."""
    words = os.environ.get(VARIABLE, "").split(os.pathsep)
    return tuple(dict.fromkeys(Path(word).resolve() for word in words if word))


def external_effects(known: Mapping[str, type[Effect]]) -> Iterator[type[Effect]]:
    """Yield the effects of folders and entry points that are not yet `known`; ConfigError on a broken one."""
    taken = dict(known)
    for folder in effect_folders():
        for path in files_of(folder):
            for effect in effects_of_file(path):
                if _is_new(effect, taken, str(path)):
                    taken[effect.name] = effect
                    yield effect
    for point in entry_points(group=GROUP):
        for effect in effects_of_entry_point(point):
            if _is_new(effect, taken, f"entry point {point.name}"):
                taken[effect.name] = effect
                yield effect


def files_of(folder: Path) -> list[Path]:
    """Return the Python files of a folder, but those whose name begins with `_`; ConfigError if they are no
    use.
    """
    try:
        if folder.stat().st_mode & WRITABLE_BY_ALL:
            raise ConfigError(f"{folder}: anybody may write to it: chmod o-w")
        found = sorted(path for path in folder.glob("*.py") if not path.name.startswith("_"))
        for path in found:
            if path.stat().st_mode & WRITABLE_BY_ALL:
                raise ConfigError(f"{path}: anybody may write to it: chmod o-w")
            if not path.is_file():
                raise ConfigError(f"{path}: not a file")
    except OSError as error:
        raise ConfigError(f"{error.filename or folder}: {error.strerror}") from None
    return found


def effects_of_file(path: Path) -> list[type[Effect]]:
    """Return the effects on rolling wheels that a file defines; ConfigError where it defines no effect of any
    kind.
    """
    module = module_of_file(path)
    made = _effects_of(module)
    if not made and not dynamics_classes_of(module):
        raise ConfigError(f"{path}: defines no effect (a frozen dataclass that is an Effect)")
    return [checked_effect(effect, str(path)) for effect in made]


def dynamics_classes_of(module: ModuleType) -> list[type]:
    """Return the effects of vehicle dynamics that a module defines; none where it cannot define any.

    Their base class is looked up, not imported: commands that know rolling wheels alone do without it.
    """
    base = getattr(sys.modules.get(DYNAMICS_BASE), "DynamicsEffect", None)
    if base is None:
        return []
    values: Iterable[object] = vars(module).values()
    return [
        value
        for value in values
        if isinstance(value, type) and issubclass(value, base) and value.__module__ == module.__name__
    ]


def module_of_file(path: Path) -> ModuleType:
    """Return a file as a module, run once; ConfigError with one line if it cannot be run."""
    name = f"tpmsd_own_{path.stem}_{hashlib.sha256(str(path).encode()).hexdigest()[:8]}"
    module = sys.modules.get(name)
    if module is None:
        spec = importlib.util.spec_from_file_location(name, path)
        if spec is None or spec.loader is None:
            raise ConfigError(f"{path}: no Python file")
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module  # dataclasses look it up
        try:
            spec.loader.exec_module(module)
        except BaseException as error:
            del sys.modules[name]
            if isinstance(error, KeyboardInterrupt):
                raise
            raise ConfigError(f"{path}: {reason_of(error)}") from None
    return module


def effects_of_entry_point(point: EntryPoint) -> list[type[Effect]]:
    """Return the effects that an installed package brings under one name; ConfigError with one line
    otherwise.
    """
    where = f"entry point {point.name} ({point.value})"
    loaded = loaded_entry_point(point)
    made = _effects_of(loaded) if isinstance(loaded, ModuleType) else [loaded]
    others = dynamics_classes_of(loaded) if isinstance(loaded, ModuleType) else []
    if not made and others:
        return []
    if not made or not all(isinstance(one, type) and issubclass(one, Effect) for one in made):
        raise ConfigError(f"{where}: no effect and no module of effects")
    return [checked_effect(effect, where) for effect in made]


def loaded_entry_point(point: EntryPoint) -> Any:
    """Return what an entry point names; ConfigError with one line if it cannot be loaded."""
    try:
        return point.load()
    except Exception as error:
        raise ConfigError(f"entry point {point.name} ({point.value}): {reason_of(error)}") from None


def checked_effect(effect: type[Effect], where: str) -> type[Effect]:
    """Return the class, if the program can use it; ConfigError with one line that says why not."""
    name = getattr(effect, "name", None)
    if not isinstance(name, str) or not NAME.fullmatch(name):
        raise ConfigError(f"{where}: {effect.__name__} has no name of small letters, digits and _")
    where = f"{where}: {name}"
    made = vars(effect).get("__dataclass_params__")  # an inherited one is not this class's
    if made is None or not made.frozen:
        raise ConfigError(f"{where}: not a frozen dataclass")
    check_parameters(effect.parameters, {one.name for one in dataclasses.fields(effect)}, where)
    if effect.kind in (Kind.NONPARAMETRIC, Kind.NUISANCE):
        raise ConfigError(f"{where}: an effect of one's own cannot be {effect.kind.value}")
    for mark in RESERVED:
        if attrgetter(mark)(effect):
            raise ConfigError(f"{where}: {mark.rpartition('.')[2]} is for effects of the program alone")
    _try_out(effect, where)
    return effect


def check_parameters(given: object, fields: set[str], where: str) -> None:
    """Raise ConfigError unless a class's parameters are a tuple of them, named as its fields."""
    if not isinstance(given, tuple | list) or not all(isinstance(one, PARAMETERS) for one in given):
        raise ConfigError(f"{where}: parameters are no tuple of Parameter")
    if unmatched := {one.name for one in given} ^ fields:
        raise ConfigError(f"{where}: parameters and fields differ: {' '.join(sorted(unmatched))}")


def _try_out(effect: type[Effect], where: str) -> None:
    """Run what the effect overrides on a short motion: ConfigError on an error, a shape or a NaN."""
    time_s: FloatArray = np.arange(SAMPLES, dtype=np.float64) * 0.1
    motion = Motion.from_profiles(time_s, 10.0 + time_s, 0.1 * np.sin(time_s), wheelbase_m=2.6)
    car = Car(np.full(4, 0.3), WheelPositions(1.5, 1.5, 2.6), driven_mask("front"))
    values = {one.name: value for one in effect.parameters if (value := _trial_value(one)) is not None}
    hook = "its values"
    try:
        made = effect(**values)
        for hook, shape in PARTS.items():
            _check_shape(getattr(made, hook)(motion, car), shape)
        for hook, shape in OF_MOTION.items():
            _check_shape(getattr(made, hook)(motion), shape)
        hook = "read_yaw_rate"
        _check_shape(made.read_yaw_rate(time_s), (SAMPLES,))
        hook = "clock_error_s"
        _check_shape(made.clock_error_s(time_s), (SAMPLES,))
    except Exception as error:
        raise ConfigError(f"{where}: {hook}: {reason_of(error)}") from None


def _trial_value(one: object) -> object:
    """Return the value of a parameter with which a class is tried out; None leaves the field its default."""
    if isinstance(one, Parameter):
        return one.typical
    if isinstance(one, WheelParameter):
        return "rl"
    return one.typical if isinstance(one, TextParameter | VectorParameter) else None


def _check_shape(value: object, shape: tuple[int, ...]) -> None:
    """Raise ValueError unless the value is an array of this shape, all finite."""
    array = np.asarray(value, dtype=np.float64)
    if array.shape != shape:
        raise ValueError(f"has the shape {array.shape} for {shape[0]} instants, {shape} is wanted")
    if not np.isfinite(array).all():
        raise ValueError("is no finite number on a plain drive")


def _is_new(effect: type[Effect], taken: Mapping[str, type[Effect]], where: str) -> bool:
    """Return False if the effect is in the catalogue; ConfigError where another effect has its name."""
    other = taken.get(effect.name)
    if other is None:
        return True
    if other is effect:
        return False
    raise ConfigError(f"{where}: there is another effect {effect.name!r} (in {other.__module__})")


def _effects_of(module: ModuleType) -> list[type[Effect]]:
    """Return the effects on rolling wheels that a module itself defines."""
    values: Iterable[object] = vars(module).values()
    return [
        value
        for value in values
        if isinstance(value, type) and issubclass(value, Effect) and value.__module__ == module.__name__
    ]


def reason_of(error: BaseException) -> str:
    """Return an error in one line, with its line in the file where Python knows it."""
    if isinstance(error, SyntaxError):
        return f"line {error.lineno}: {error.msg}"
    try:
        return " ".join(f"{type(error).__name__}: {error}".split())
    except Exception:  # an error of its own whose text cannot be made
        return type(error).__name__
