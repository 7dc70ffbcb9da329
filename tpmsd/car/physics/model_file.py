"""Model files: an `ExtendedModel` as TOML.

In: a path. Out: the model, or a file that holds it:

    # found on drive 7
    [[effect]]
    name = "centrifugal_growth"
    coefficient = 2.1e-06
    [effect.std]
    coefficient = 1e-07
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tpmsd.car.physics.effect import Effect, Std, Value
from tpmsd.car.physics.effect_tables import (
    comment_lines,
    effect_tables,
    is_std,
    quoted_word,
    std_lines,
    take_name,
    value_lines,
)
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.text_file import read_text

MAX_BYTES = 1 << 20


def load_model(path: str | Path) -> ExtendedModel:
    """Read a model file; ConfigError with one line that names the file and the reason if it is none."""
    text = read_text(Path(path), MAX_BYTES, "a model")
    try:
        return parse_model(text)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None


def parse_model(text: str) -> ExtendedModel:
    """Return the model that a file's text describes; ConfigError with the reason if it describes none."""
    found = [_effect_of(table, number) for number, table in enumerate(effect_tables(text), start=1)]
    return ExtendedModel(tuple(effect for effect, _ in found), tuple(std for _, std in found))


def _effect_of(table: dict[str, Any], number: int) -> tuple[Effect, dict[str, Std]]:
    name = take_name(table, number)
    std = table.pop("std", {})
    # Only here: it brings in every effect, and most runs have no model.
    from tpmsd.car.physics.catalogue import make_effect

    effect = make_effect(name, **table)
    if not isinstance(std, dict):
        raise ConfigError(f"effect {name}: std must be a table")
    known = effect.values()
    for key in std:
        if key not in known:
            raise ConfigError(f"effect {name}: std of {quoted_word(key)}, which it does not have")
        if isinstance(known[key], str):
            raise ConfigError(f"effect {name}: std of {key!r}, which is no number")
    return effect, {
        key: _std_of(f"effect {name}: std.{key}", value, known[key]) for key, value in std.items()
    }


def _std_of(what: str, std: object, value: Value) -> Std:
    """Return the standard deviation of a value: a number, or as many as the value has."""
    if not isinstance(value, tuple):
        if not is_std(std):
            raise ConfigError(f"{what} = {std!r} is not a number of at least 0")
        return float(std)  # type: ignore[arg-type]
    if not isinstance(std, list) or len(std) != len(value):
        raise ConfigError(f"{what} is not a list of {len(value)} numbers")
    for k, entry in enumerate(std):
        if not is_std(entry):
            raise ConfigError(f"{what}[{k}] = {entry!r} is not a number of at least 0")
    return tuple(float(entry) for entry in std)


def format_model(model: ExtendedModel, comment: str = "") -> str:
    """Return the model as TOML that `parse_model` reads back exactly."""
    lines = comment_lines(comment)
    for effect, std in zip(model.effects, model.stds, strict=True):
        lines += ["", "[[effect]]", f'name = "{effect.name}"']
        lines += [*value_lines(effect.values(), effect.unit_of), *std_lines(std)]
    return "\n".join(lines).lstrip("\n") + "\n"


def save_model(path: str | Path, model: ExtendedModel, comment: str = "") -> None:
    """Write a model file; ConfigError if it cannot be written."""
    try:
        Path(path).write_text(format_model(model, comment), encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written: {error.strerror}") from None
