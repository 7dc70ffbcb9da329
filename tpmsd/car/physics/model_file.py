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

import math
from pathlib import Path
from typing import Any

from tpmsd.car.physics.effect import Effect, Std, Value
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.text_file import read_text
from tpmsd.foundation.toml_text import check_integers, parse_toml

MAX_BYTES = 1 << 20
MAX_EFFECTS = 200
"""A model of all effects there are, for each wheel where they have one, has fewer."""
LONGEST_WORD = 60
"""Characters of a name, and of what is shown of a longer one."""


def load_model(path: str | Path) -> ExtendedModel:
    """Read a model file; ConfigError with one line that names the file and the reason if it is none."""
    text = read_text(Path(path), MAX_BYTES, "a model")
    try:
        return parse_model(text)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None


def parse_model(text: str) -> ExtendedModel:
    """Return the model that a file's text describes; ConfigError with the reason if it describes none."""
    try:
        document = parse_toml(text)
        check_integers(document)
    except ValueError as error:
        raise ConfigError(f"not TOML: {error}") from None
    for key in document:
        if key != "effect":
            raise ConfigError(f"unknown key {shown(key)}: a model file holds [[effect]] tables only")
    tables = document.get("effect", [])
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        raise ConfigError("'effect' must be written as [[effect]] tables")
    if len(tables) > MAX_EFFECTS:
        raise ConfigError(f"{len(tables)} effects: a model has at most {MAX_EFFECTS}")
    effects: list[Effect] = []
    stds: list[dict[str, Std]] = []
    for number, table in enumerate(tables, start=1):
        effect, std = _effect_of(dict(table), number)
        effects.append(effect)
        stds.append(std)
    return ExtendedModel(tuple(effects), tuple(stds))


def shown(word: str) -> str:
    """Return a word in quotes, cut where it is too long for a line."""
    return repr(word if len(word) <= LONGEST_WORD else word[: LONGEST_WORD - 3] + "...")


def _effect_of(table: dict[str, Any], number: int) -> tuple[Effect, dict[str, Std]]:
    name = table.pop("name", None)
    if not isinstance(name, str):
        raise ConfigError(f"effect {number} has no name")
    for word in (name, *table):
        if len(word) > LONGEST_WORD:
            raise ConfigError(f"effect {number}: {shown(word)} is no name of an effect or a parameter")
    std = table.pop("std", {})
    # Only here: it brings in every effect, and most runs have no model.
    from tpmsd.car.physics.catalogue import make_effect

    effect = make_effect(name, **table)
    if not isinstance(std, dict):
        raise ConfigError(f"effect {name}: std must be a table")
    known = effect.values()
    for key in std:
        if key not in known:
            raise ConfigError(f"effect {name}: std of {key!r}, which it does not have")
        if isinstance(known[key], str):
            raise ConfigError(f"effect {name}: std of {key!r}, which is no number")
    return effect, {
        key: _std_of(f"effect {name}: std.{key}", value, known[key]) for key, value in std.items()
    }


def _std_of(what: str, std: object, value: Value) -> Std:
    """Return the standard deviation of a value: a number, or as many as the value has."""
    if not isinstance(value, tuple):
        if not _is_std(std):
            raise ConfigError(f"{what} = {std!r} is not a number of at least 0")
        return float(std)  # type: ignore[arg-type]
    if not isinstance(std, list) or len(std) != len(value):
        raise ConfigError(f"{what} is not a list of {len(value)} numbers")
    for k, entry in enumerate(std):
        if not _is_std(entry):
            raise ConfigError(f"{what}[{k}] = {entry!r} is not a number of at least 0")
    return tuple(float(entry) for entry in std)


def _is_std(value: object) -> bool:
    return not isinstance(value, bool) and isinstance(value, (int, float)) and 0 <= value < math.inf


def format_model(model: ExtendedModel, comment: str = "") -> str:
    """Return the model as TOML that `parse_model` reads back exactly."""
    # TOML allows no control characters, not even in comments.
    printable = ("".join(c if c.isprintable() else " " for c in line) for line in comment.splitlines())
    lines = [f"# {line}".rstrip() for line in printable]
    for effect, std in zip(model.effects, model.stds, strict=True):
        lines += ["", "[[effect]]", f'name = "{effect.name}"']
        for key, value in effect.values().items():
            unit = effect.unit_of(key)
            lines.append(f"{key} = {_toml(value)}" + (f"  # {unit}" if unit else ""))
        if std:
            lines.append("[effect.std]")
            lines += [f"{key} = {_toml(value)}" for key, value in std.items()]
    return "\n".join(lines).lstrip("\n") + "\n"


def _toml(value: Value) -> str:
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, tuple):
        return "[" + ", ".join(repr(float(entry)) for entry in value) + "]"
    return repr(float(value))


def save_model(path: str | Path, model: ExtendedModel, comment: str = "") -> None:
    """Write a model file; ConfigError if it cannot be written."""
    try:
        Path(path).write_text(format_model(model, comment), encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written: {error.strerror}") from None
