"""Model files of vehicle dynamics: effects as TOML, the same form as for the rolling model.

In: text. Out: `DynamicsModel`; ConfigError with one line where the text describes none.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from tpmsd.car.physics.dynamics_catalogue import make_dynamics_effect
from tpmsd.car.physics.dynamics_effect import DynamicsEffect
from tpmsd.car.physics.effect_tables import (
    comment_lines,
    effect_tables,
    is_std,
    quoted_word,
    std_lines,
    take_name,
    value_lines,
)
from tpmsd.foundation.errors import ConfigError


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
    found = [_effect_of(table, number) for number, table in enumerate(effect_tables(text), start=1)]
    return DynamicsModel(
        tuple(one for one, _, _ in found),
        tuple(std for _, std, _ in found),
        tuple(key for _, _, key in found),
    )


def _effect_of(table: dict[str, Any], number: int) -> tuple[DynamicsEffect, dict[str, float], str]:
    name = take_name(table, number)
    std, drive = table.pop("std", {}), table.pop("drive", "")
    if not isinstance(std, dict) or not all(is_std(value) for value in std.values()):
        raise ConfigError(f"effect {quoted_word(name)}: std must be a table of numbers of at least 0")
    if not isinstance(drive, str):
        raise ConfigError(f"effect {quoted_word(name)}: drive = {quoted_word(str(drive))} is no text")
    effect = make_dynamics_effect(name, **table)
    _check_limits(effect)
    for key in std:
        if key not in effect.values():
            raise ConfigError(f"effect {name}: std of {quoted_word(key)}, which it does not have")
    return effect, {key: float(value) for key, value in std.items()}, drive


def _check_limits(effect: DynamicsEffect) -> None:
    """Raise ConfigError for a value out of limits, which effects accept as a probe, files do not."""
    try:
        for parameter in effect.parameters:
            parameter.check(getattr(effect, parameter.name))
    except ValueError as error:
        raise ConfigError(f"effect {effect.name}: {error}") from None


def format_dynamics_model(model: DynamicsModel, comment: str = "") -> str:
    """Return the model as TOML that `parse_dynamics_model` reads back exactly."""
    lines = comment_lines(comment)
    for k, effect in enumerate(model.effects):
        lines += ["", "[[effect]]", f'name = "{effect.name}"']
        if k < len(model.drives) and model.drives[k]:
            lines.append(f'drive = "{model.drives[k]}"  # belongs to the time of this drive alone')
        lines += value_lines(effect.values(), effect.unit_of)
        lines += std_lines(model.stds[k]) if k < len(model.stds) else []
    return "\n".join(lines).lstrip("\n") + "\n"


def belongs_to_one_drive(effect: DynamicsEffect) -> bool:
    """Return True if an effect holds for one drive only: it has an onset, or knots over time."""
    return hasattr(effect, "onset_s") or (
        hasattr(effect, "knots") and getattr(effect, "over", "time") == "time"
    )
