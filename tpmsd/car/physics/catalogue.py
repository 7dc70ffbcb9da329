"""The catalogue of effects by name.

In: an effect's name and its parameters. Out: the `Effect`. To add one: write its file in
`tpmsd/car/physics/effects`, or anywhere else (`tpmsd.car.physics.own_effects`); simulator, model files,
compensation, diagnosis and reports then know it.
"""

from __future__ import annotations

import difflib
import importlib
import math
import pkgutil
from collections.abc import Callable, Iterable
from dataclasses import MISSING, dataclass, fields

from tpmsd.car.physics import effects, own_effects
from tpmsd.car.physics.effect import (
    AnyParameter,
    Effect,
    Kind,
    Parameter,
    TextParameter,
    Value,
    WheelParameter,
)
from tpmsd.foundation.errors import ConfigError


def _built_in_effects() -> dict[str, type[Effect]]:
    """Return every effect that a module of `tpmsd.car.physics.effects` defines, by name, alphabetically."""
    out: dict[str, type[Effect]] = {}
    for module in sorted(one.name for one in pkgutil.iter_modules(effects.__path__)):
        full = f"{effects.__name__}.{module}"
        for value in vars(importlib.import_module(full)).values():
            if isinstance(value, type) and issubclass(value, Effect) and value.__module__ == full:
                out[value.name] = value
    return out


EFFECTS: dict[str, type[Effect]] = _built_in_effects()


def register_external_effects() -> None:
    """Add the effects of folders and entry points to the catalogue; ConfigError on a broken one."""
    for effect in own_effects.external_effects(EFFECTS):
        EFFECTS[effect.name] = effect


def sentence_of(name: str) -> str:
    """Return the clause that describes an effect; its name if there is no such effect."""
    effect = EFFECTS.get(name)
    if effect is None:
        return name
    first = (effect.__doc__ or name).strip().splitlines()[0].rstrip(".")
    return effect.wording.sentence or first[:1].lower() + first[1:]


@dataclass(frozen=True, slots=True)
class FittedParameter:
    """One number that a fit may find: an effect's parameter, at a place, at a value of the grid."""

    effect: str
    parameter: str
    """Empty for effects that have none: they act or do not."""
    value: float
    """At which to take the response."""
    neutral: float
    wheel_pattern: str = ""
    at: float | None = None
    """Value of the parameter that enters nonlinearly."""
    second: float | None = None
    """Value of a second nonlinear parameter; None where it is typical."""

    @property
    def key(self) -> tuple[str, ...]:
        """Return its name among the columns of a design."""
        grid = () if self.at is None else (f"{self.at:g}",)
        return (self.effect, self.parameter, *((self.wheel_pattern,) if self.wheel_pattern else ()), *grid)

    def probing_effect(self) -> Effect:
        """Return the effect with this parameter at its probing value, others neutral or typical."""
        cls = EFFECTS[self.effect]
        values: dict[str, object] = {self.parameter: self.value} if self.parameter else {}
        for p in cls.parameters:
            if isinstance(p, WheelParameter | TextParameter):
                if self.wheel_pattern:
                    values[p.name] = self.wheel_pattern
            elif isinstance(p, Parameter) and p.name != self.parameter and p.name in _required_fields(cls):
                values[p.name] = p.neutral if p.probe > 0.0 else p.typical
        if cls.nonlinear.grid is not None and self.at is not None:
            values[cls.nonlinear.grid.parameter] = self.at
            if cls.nonlinear.grid.second is not None and self.second is not None:
                values[cls.nonlinear.grid.second.parameter] = self.second
        return make_effect(self.effect, **values)


def _linear_parameters(effect: type[Effect]) -> list[Parameter]:
    """Return the parameters that enter linearly: those with a probe."""
    return [p for p in effect.parameters if isinstance(p, Parameter) and p.probe > 0.0]


def probes() -> tuple[FittedParameter, ...]:
    """Return the fit's candidates for effects that the windows of a drive show: one for each parameter, wheel
    pattern and grid value. Ramps, time spans, tooth counts and other sensors are fitted elsewhere.
    """
    out = []
    for name, effect in EFFECTS.items():
        if (
            effect.nonlinear.ramp
            or effect.nonlinear.span
            or effect.identification.by_teeth
            or effect.identification.at_walking_pace
            or effect.identification.reads
        ):
            continue
        if effect.kind is Kind.NONPARAMETRIC:
            continue
        for wheel_pattern in effect.identification.wheel_patterns or ("",):
            if not effect.parameters:
                out.append(FittedParameter(name, "", 1.0, 0.0, wheel_pattern))
            for p in _linear_parameters(effect):
                for at in (None,) if effect.nonlinear.grid is None else effect.nonlinear.grid.values:
                    out.append(
                        FittedParameter(name, p.name, p.neutral + p.probe, p.neutral, wheel_pattern, at)
                    )
    return tuple(out)


def sensor_probes() -> tuple[tuple[FittedParameter, tuple[str, ...]], ...]:
    """Return the fit's candidates in sensors other than wheels, gyro and fixes, each with the readings that
    show it.
    """
    return tuple(
        (FittedParameter(name, p.name, p.neutral + p.probe, p.neutral), effect.identification.reads)
        for name, effect in EFFECTS.items()
        if effect.identification.reads
        for p in _linear_parameters(effect)
    )


def probe_groups() -> tuple[tuple[FittedParameter, ...], ...]:
    """Return the sets of `probes` to fit jointly: each that needs no other, and all of an effect."""
    by_effect: dict[tuple[str, str, float | None], list[FittedParameter]] = {}
    for probe in probes():
        by_effect.setdefault((probe.effect, probe.wheel_pattern, probe.at), []).append(probe)
    out: list[tuple[FittedParameter, ...]] = []
    for (name, _, _), free in by_effect.items():
        if EFFECTS[name].identification.always_fitted:
            continue
        required = _required_fields(EFFECTS[name]) & {probe.parameter for probe in free}
        out += [(probe,) for probe in free if required <= {probe.parameter}]
        if len(free) > 1:
            out.append(tuple(free))
    return tuple(out)


def _required_fields(effect: type[Effect]) -> set[str]:
    """Return the names of the fields that have no default."""
    return {one.name for one in fields(effect) if one.default is MISSING and one.default_factory is MISSING}


def _only_effect(what: str, rule: Callable[[type[Effect]], bool]) -> type[Effect]:
    """Return the one effect that meets the rule; RuntimeError if there are none or several."""
    found = [effect for effect in EFFECTS.values() if rule(effect)]
    if len(found) != 1:
        raise RuntimeError(f"{len(found)} effects in the catalogue are {what}, one is wanted")
    return found[0]


NONPARAMETRIC = _only_effect("free", lambda effect: effect.kind is Kind.NONPARAMETRIC)
"""The description without a formula."""
FAULT = _only_effect("a ramp of a radius", lambda effect: effect.nonlinear.ramp)
"""The tyre that changes."""
TEETH = _only_effect("of a ring's teeth", lambda effect: effect.identification.by_teeth)
LOST = _only_effect("of counts lost at walking pace", lambda effect: effect.identification.at_walking_pace)
MISSED = _only_effect("of counts found by the ripple", lambda effect: effect.identification.by_ripple)
ADDED = _only_effect("of counts that are added", lambda effect: effect.confounding.mirror_of == MISSED.name)
SLOPES = _only_effect("the shortening by slopes", lambda effect: effect.shortens)
RADIUS = _only_effect(
    "a constant of each wheel",
    lambda effect: effect.identification.always_fitted and bool(effect.identification.wheel_patterns),
)
"""Effects that a calibration estimates."""
ALWAYS = frozenset(name for name, effect in EFFECTS.items() if effect.identification.always_fitted)
"""Effects that are fitted along with every model."""
EVENTS = tuple(name for name, effect in EFFECTS.items() if effect.nonlinear.span)


def prior_rms(effect: type[Effect], parameter: str) -> float:
    """Return the rms difference of a parameter from neutral by its prior; ValueError if it has none."""
    known = parameters_of(effect.name)[parameter]
    if not isinstance(known, Parameter) or known.prior is None:
        raise ValueError(f"{effect.name}.{parameter} has no prior")
    return math.hypot(known.prior.mean - known.neutral, known.prior.std)


def parameters_of(name: str) -> dict[str, AnyParameter]:
    """Return the parameters of an effect by name; ConfigError if there is no such effect."""
    if name not in EFFECTS:
        raise ConfigError(f"unknown effect {name!r}{_did_you_mean(name, EFFECTS)}")
    return {parameter.name: parameter for parameter in EFFECTS[name].parameters}


def make_effect(name: str, **params: object) -> Effect:
    """Build an effect; numbers may come as text. ConfigError on unknown names and values out of bounds."""
    known = parameters_of(name)
    for key in params:
        if key not in known:
            listed = " ".join(known) or "it has none"
            raise ConfigError(
                f"effect {name}: unknown parameter {key!r}{_did_you_mean(key, known)} (parameters: {listed})"
            )
    try:
        return EFFECTS[name](**params)
    except TypeError:
        missing = " ".join(sorted(key for key in known if key not in params))
        raise ConfigError(f"effect {name}: a required parameter is missing (not given: {missing})") from None


def parse_effect(text: str) -> Effect:
    """Build an effect from `name:param=value,param=value`, as on the command line; else ConfigError."""
    name, _, rest = text.strip().partition(":")
    params: dict[str, Value] = {}
    for part in filter(None, (piece.strip() for piece in rest.split(","))):
        key, equals, value = part.partition("=")
        if not equals:
            raise ConfigError(f"effect {name}: {part!r} is not of the form parameter=value")
        if key.strip() in params:
            raise ConfigError(f"effect {name}: {key.strip()} is given twice")
        params[key.strip()] = value.strip()
    return make_effect(name.strip(), **params)


def _did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return a suggestion of the nearest known word, empty if none is near."""
    close = difflib.get_close_matches(word, list(known), n=1)
    return f", did you mean {close[0]!r}?" if close else ""


register_external_effects()
