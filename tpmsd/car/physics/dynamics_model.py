"""Model files of vehicle dynamics: effects as TOML, the same form as for the rolling model.

In: text. Out: `DynamicsModel`; ConfigError with one line where the text describes none.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from tpmsd.car.physics.dynamics_catalogue import make_dynamics_effect
from tpmsd.car.physics.dynamics_effect import DynamicsEffect
from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.toml_text import check_integers, parse_toml

MAX_EFFECTS = 200


@dataclass(frozen=True)
class DynamicsModel:
    """Effects, for each the standard deviations of its parameters where known, and the drive it belongs
    to."""

    effects: tuple[DynamicsEffect, ...] = ()
    stds: tuple[Mapping[str, float], ...] = ()
    drives: tuple[str, ...] = ()
    """Per effect the key of the drive to which a term over time belongs; empty: it holds on every drive."""


def parse_dynamics_model(text: str) -> DynamicsModel:
    """Return the model that a file's text describes."""
    try:
        document = parse_toml(text)
        check_integers(document)
    except ValueError as error:
        raise ConfigError(f"not TOML: {error}") from None
    for key in document:
        if key != "effect":
            raise ConfigError(f"unknown key {key[:60]!r}: a model file holds [[effect]] tables only")
    tables = document.get("effect", [])
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        raise ConfigError("'effect' must be written as [[effect]] tables")
    if len(tables) > MAX_EFFECTS:
        raise ConfigError(f"{len(tables)} effects: a model has at most {MAX_EFFECTS}")
    found = [_effect_of(dict(table), number) for number, table in enumerate(tables, start=1)]
    return DynamicsModel(
        tuple(one for one, _, _ in found),
        tuple(std for _, std, _ in found),
        tuple(key for _, _, key in found),
    )


def _effect_of(table: dict[str, Any], number: int) -> tuple[DynamicsEffect, dict[str, float], str]:
    name = table.pop("name", None)
    if not isinstance(name, str):
        raise ConfigError(f"effect {number} has no name")
    std, drive = table.pop("std", {}), table.pop("drive", "")
    if not isinstance(std, dict) or not all(_is_number(value) for value in std.values()):
        raise ConfigError(f"effect {name[:60]!r}: std must be a table of numbers of at least 0")
    if not isinstance(drive, str):
        raise ConfigError(f"effect {name[:60]!r}: drive = {str(drive)[:60]!r} is no text")
    effect = make_dynamics_effect(name[:60], **table)
    _check_limits(effect)
    for key in std:
        if key not in effect.values():
            raise ConfigError(f"effect {name}: std of {key[:60]!r}, which it does not have")
    return effect, {key: float(value) for key, value in std.items()}, drive


def _check_limits(effect: DynamicsEffect) -> None:
    """ConfigError for a value below the least: effects take such a one as a probe, a file has none."""
    try:
        for parameter in effect.parameters:
            parameter.check(getattr(effect, parameter.name))
    except ValueError as error:
        raise ConfigError(f"effect {effect.name}: {error}") from None


def _is_number(value: object) -> bool:
    return not isinstance(value, bool) and isinstance(value, int | float) and 0.0 <= value < float("inf")


def format_dynamics_model(model: DynamicsModel, comment: str = "") -> str:
    """Return the model as TOML that `parse_dynamics_model` reads back exactly."""
    printable = ("".join(c if c.isprintable() else " " for c in line) for line in comment.splitlines())
    lines = [f"# {line}".rstrip() for line in printable]
    for k, effect in enumerate(model.effects):
        lines += ["", "[[effect]]", f'name = "{effect.name}"']
        if k < len(model.drives) and model.drives[k]:
            lines.append(f'drive = "{model.drives[k]}"  # belongs to the time of this drive alone')
        for key, value in effect.values().items():
            unit = effect.unit_of(key)
            lines.append(f"{key} = {_toml(value)}" + (f"  # {unit}" if unit else ""))
        if k < len(model.stds) and model.stds[k]:
            lines.append("[effect.std]")
            lines += [f"{key} = {float(value)!r}" for key, value in model.stds[k].items()]
    return "\n".join(lines).lstrip("\n") + "\n"


def _toml(value: object) -> str:
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, tuple):
        return "[" + ", ".join(repr(float(entry)) for entry in value) + "]"
    return repr(float(value))  # type: ignore[arg-type]


def bound_to_time(effect: DynamicsEffect) -> bool:
    """Return True if an effect belongs to the time of one drive."""
    return hasattr(effect, "onset_s") or (
        hasattr(effect, "knots") and getattr(effect, "over", "time") == "time"
    )
