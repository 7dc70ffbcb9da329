"""The form of a model file, of rolling wheels and of vehicle dynamics: effects as TOML tables.

In: text. Out: its `[[effect]]` tables; and the other way round, lines of the file for effects and values.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.toml_text import check_integers, parse_toml

MAX_EFFECTS = 200
"""A model of all effects there are, for each wheel where they have one, has fewer."""
LONGEST_WORD = 60
"""Characters of a name, and of what is shown of a longer one."""

Number = float | Sequence[float]


def effect_tables(text: str) -> list[dict[str, Any]]:
    """Return a model file's tables of effects; ConfigError with the reason if the text has none."""
    try:
        document = parse_toml(text)
        check_integers(document)
    except ValueError as error:
        raise ConfigError(f"not TOML: {error}") from None
    for key in document:
        if key != "effect":
            raise ConfigError(f"unknown key {quoted_word(key)}: a model file holds [[effect]] tables only")
    tables = document.get("effect", [])
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        raise ConfigError("'effect' must be written as [[effect]] tables")
    if len(tables) > MAX_EFFECTS:
        raise ConfigError(f"{len(tables)} effects: a model has at most {MAX_EFFECTS}")
    return [dict(table) for table in tables]


def take_name(table: dict[str, Any], number: int) -> str:
    """Take the name out of an effect's table, the `number`th of its file; ConfigError where it or a key is
    no name."""
    name = table.pop("name", None)
    if not isinstance(name, str):
        raise ConfigError(f"effect {number} has no name")
    for word in (name, *table):
        if len(word) > LONGEST_WORD:
            raise ConfigError(f"effect {number}: {quoted_word(word)} is no name of an effect or a parameter")
    return name


def is_std(value: object) -> bool:
    """Return True for a number that can be a standard deviation."""
    return not isinstance(value, bool) and isinstance(value, (int, float)) and 0 <= value < math.inf


def quoted_word(word: str) -> str:
    """Return a word in quotes, cut where it is too long for a line."""
    return repr(word if len(word) <= LONGEST_WORD else word[: LONGEST_WORD - 3] + "...")


def comment_lines(comment: str) -> list[str]:
    """Return a comment as lines of TOML, which allows no control characters even there."""
    printable = ("".join(c if c.isprintable() else " " for c in line) for line in comment.splitlines())
    return [f"# {line}".rstrip() for line in printable]


def value_lines(values: Mapping[str, Number | str], unit_of: Callable[[str], str]) -> list[str]:
    """Return an effect's values as lines of TOML, each with its unit."""
    return [
        f"{key} = {_toml_value(value)}" + (f"  # {unit}" if (unit := unit_of(key)) else "")
        for key, value in values.items()
    ]


def std_lines(std: Mapping[str, Number]) -> list[str]:
    """Return the table of an effect's standard deviations, empty where none is known."""
    return ["[effect.std]", *(f"{key} = {_toml_value(value)}" for key, value in std.items())] if std else []


def _toml_value(value: Number | str) -> str:
    """Return a number, a sequence of numbers or a text as TOML."""
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, Sequence):
        return "[" + ", ".join(repr(float(entry)) for entry in value) + "]"
    return repr(float(value))
