"""The settings of the diagnosis: all in one place, each with its reason."""

from __future__ import annotations

import ast
import dataclasses
import inspect
from pathlib import Path

import pytest

from tpmsd.offline.diagnosis import settings
from tpmsd.offline.diagnosis.settings import SETTINGS
from tpmsd.offline.rings.settings import CounterSettings

HOME = Path(settings.__file__).parent
SOURCES = [
    ast.parse(Path(inspect.getfile(record)).read_text(encoding="utf-8"))
    for record in (settings.DiagnosisSettings, CounterSettings)
]


def has_number(value: ast.expr) -> bool:
    """Whether an expression holds a number that could be another one; places in an array and signs by name
    are structure."""
    if isinstance(value, ast.Dict):
        return False
    if isinstance(value, ast.Subscript):
        return has_number(value.value)
    if isinstance(value, ast.Constant):
        return isinstance(value.value, int | float) and not isinstance(value.value, bool)
    return any(has_number(part) for part in ast.iter_child_nodes(value) if isinstance(part, ast.expr))


def test_no_constant_with_a_number_stands_outside_the_settings() -> None:
    """What someone may tune has its unit and reason in one place, and is at the top of no other module."""
    outside = []
    for path in HOME.rglob("*.py"):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            value = node.value if isinstance(node, ast.Assign | ast.AnnAssign) else None
            if value is not None and path.name != "settings.py" and has_number(value):
                outside.append(f"{path.relative_to(HOME)}:{node.lineno}")

    assert [] == outside


def test_what_has_a_number_is_distinguished_from_what_has_none() -> None:
    """A sum and a call with numbers do; a subscript and a table of signs do not."""
    reported = [
        has_number(ast.parse(text, mode="eval").body) for text in ("2 * A", "f(0.1)", "P[0]", "{'a': 1}")
    ]

    assert [True, True, False, False] == reported


def test_every_setting_has_its_reason() -> None:
    """A docstring follows each field, or the last of up to three that belong together."""
    without = []
    for group in (node for source in SOURCES for node in source.body if isinstance(node, ast.ClassDef)):
        if group.name == "DiagnosisSettings":
            continue
        waiting: list[int] = []
        for node in group.body[1:]:
            waiting = [*waiting, node.lineno] if isinstance(node, ast.AnnAssign) else []
            if len(waiting) > 3:
                without.append(f"{group.name}:{waiting[0]}")
        without += [f"{group.name}:{line}" for line in waiting]

    assert [] == without


def test_nothing_changes_a_setting() -> None:
    """All records are frozen."""
    for group in dataclasses.fields(SETTINGS):
        record = getattr(SETTINGS, group.name)
        name = dataclasses.fields(record)[0].name
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(record, name, 0)
