"""The table of mutations speaks of the program as it is."""

from __future__ import annotations

import ast

import pytest

from tests.mutation.run import REPO, behaviour, shown
from tests.mutation.table import NAMED, ROOMS, Named


@pytest.mark.parametrize("one", NAMED, ids=lambda one: f"{one.module.rpartition('/')[2]}: {one.new[:40]}")
def test_a_mutation_by_name_changes_the_program_in_one_place(one: Named) -> None:
    """What is to be replaced stands there once, and what comes of it is another program."""
    source = (REPO / one.module).read_text("utf-8")
    assert 1 == source.count(one.old)
    mutant = source.replace(one.old, one.new)
    ast.parse(mutant)
    assert behaviour(mutant) not in ("", behaviour(source))
    assert shown(one.module, mutant).startswith(f"{one.module}:")


def test_modules_and_tests_of_the_rooms_exist() -> None:
    """Every path that the table names is there."""
    named = [path for room in ROOMS.values() for path in (*room.modules, *room.tests)]
    named += [path for one in NAMED for path in one.tests]
    assert [] == [path for path in named if not (REPO / path).exists()]


def test_what_is_no_behaviour_makes_no_mutant() -> None:
    """Annotations, docstrings and decorators are left out of the comparison; numbers and calls are not."""
    one = 'def f(a: int | None = 1) -> int:\n    """Adds."""\n    return a + 1\n'
    other = '@cached\ndef f(a: int & None = 1) -> str:\n    """Takes."""\n    return a + 1\n'
    assert behaviour(one) == behaviour(other)
    assert behaviour(one) != behaviour(one.replace("a + 1", "a - 1"))
    assert "" == behaviour("def")
