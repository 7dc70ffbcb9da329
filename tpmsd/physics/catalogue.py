"""The catalogue of effects by name.

In: an effect's name and its parameters. Out: the `Effect`. To add one: write its file in
`tpmsd/physics/effects`; simulator, model files, compensation, diagnosis and reports then know it.
"""

from __future__ import annotations

import difflib
import importlib
import pkgutil
from collections.abc import Iterable
from dataclasses import MISSING, fields

from tpmsd.errors import ConfigError
from tpmsd.physics import effects
from tpmsd.physics.effect import AnyParameter, Effect, Parameter, Value


def _found() -> dict[str, type[Effect]]:
    """Every effect that a module of `tpmsd.physics.effects` defines, by name; the order is the alphabet's."""
    out: dict[str, type[Effect]] = {}
    for module in sorted(one.name for one in pkgutil.iter_modules(effects.__path__)):
        full = f"{effects.__name__}.{module}"
        for value in vars(importlib.import_module(full)).values():
            if isinstance(value, type) and issubclass(value, Effect) and value.__module__ == full:
                out[value.name] = value
    return out


EFFECTS: dict[str, type[Effect]] = _found()


def sentence_of(name: str) -> str:
    """What an effect is, as a clause; its own name if there is no such effect."""
    effect = EFFECTS.get(name)
    if effect is None:
        return name
    first = (effect.__doc__ or name).strip().splitlines()[0].rstrip(".")
    return effect.sentence or first[:1].lower() + first[1:]


def probes() -> tuple[tuple[str, str, float, float], ...]:
    """What the diagnosis may fit: (effect, parameter, a value at which to take its response, neutral value).

    The parameter is empty for effects that have none: they act or do not.
    """
    out = []
    for name, effect in EFFECTS.items():
        if not effect.parameters:
            out.append((name, "", 1.0, 0.0))
        for p in effect.parameters:
            if isinstance(p, Parameter) and p.probe > 0.0:
                out.append((name, p.name, p.neutral + p.probe, p.neutral))
    return tuple(out)


def probed_with(name: str, parameter: str) -> dict[str, float]:
    """Values of an effect's further required parameters while one is probed."""
    return {
        p.name: p.neutral if p.probe > 0.0 else p.typical
        for p in EFFECTS[name].parameters
        if isinstance(p, Parameter) and p.name != parameter and p.name in _required(EFFECTS[name])
    }


def groups() -> tuple[tuple[str, tuple[str, ...]], ...]:
    """Sets of an effect's probed parameters that make sense together: each that needs no other, and all."""
    by_effect: dict[str, list[str]] = {}
    for name, parameter, _, _ in probes():
        by_effect.setdefault(name, []).append(parameter)
    out: list[tuple[str, tuple[str, ...]]] = []
    for name, free in by_effect.items():
        required = _required(EFFECTS[name]) & set(free)
        out += [(name, (parameter,)) for parameter in free if required <= {parameter}]
        if len(free) > 1:
            out.append((name, tuple(free)))
    return tuple(out)


def _required(effect: type[Effect]) -> set[str]:
    return {one.name for one in fields(effect) if one.default is MISSING and one.default_factory is MISSING}


def parameters_of(name: str) -> dict[str, AnyParameter]:
    """The parameters of an effect by name; ConfigError if there is no such effect."""
    if name not in EFFECTS:
        raise ConfigError(f"unknown effect {name!r}{_did_you_mean(name, EFFECTS)}")
    return {parameter.name: parameter for parameter in EFFECTS[name].parameters}


def make_effect(name: str, **params: object) -> Effect:
    """Build an effect; numbers may come as text. One-line ConfigError on what is unknown or out of bounds."""
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
        params[key.strip()] = value.strip()
    return make_effect(name.strip(), **params)


def _did_you_mean(word: str, known: Iterable[str]) -> str:
    close = difflib.get_close_matches(word, list(known), n=1)
    return f", did you mean {close[0]!r}?" if close else ""
