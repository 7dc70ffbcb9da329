"""The table of the paper's equations: none is left out, and every row is held by a test that there is."""

from __future__ import annotations

import inspect
import re
from pathlib import Path

import pytest

from tests.conftest import REPO
from tpmsd.onboard.estimators.belief import Belief

PAGE = (REPO / "docs" / "explanation" / "estimators.md").read_text(encoding="utf-8")
HERE = Path("tests/onboard/estimators")
HEAD = "| in the paper | where | how | test |"


def rows() -> list[list[str]]:
    """The cells of the table's rows."""
    lines = PAGE.split(HEAD)[1].splitlines()[2:]
    table = lines[: next(k for k, line in enumerate(lines) if not line.startswith("|"))]
    return [[cell.strip() for cell in line.strip("| ").split(" | ")] for line in table]


def numbers(title: str) -> set[int]:
    """Equations that a row is of: single ones, and those from one to another."""
    out = set()
    for first, last in re.findall(r"\((\d+)[a-z]?\)(?:-\((\d+)[a-z]?\))?", title):
        out |= set(range(int(first), int(last or first) + 1))
    return out


def test_no_equation_table_or_figure_is_left_out() -> None:
    """Equations 1 to 41, Tables I to III, Figures 3 to 10; each figure is there and shown."""
    titles = [row[0] for row in rows()]
    assert set(range(1, 42)) == set().union(*map(numbers, titles))
    assert {"Table I", "Table II", "Table III", "Figures 3 to 10"} <= set(titles)
    for number in range(3, 11):
        assert f"](../images/paper-fig{number}.svg)" in PAGE
        assert (REPO / "docs" / "images" / f"paper-fig{number}.svg").stat().st_size > 1000


@pytest.mark.parametrize("row", rows(), ids=lambda row: row[0])
def test_every_row_is_held_by_a_test(row: list[str]) -> None:
    """The file and the function that the row names exist; only what is absent has none."""
    title, where, _, reported = row
    named = re.findall(r"`([\w/]+\.py)` `(test_\w+)`", reported)
    assert bool(named) != (where == "absent"), title
    for file, function in named:
        path = REPO / (file if "/" in file else HERE / file)
        assert f"\ndef {function}(" in path.read_text(encoding="utf-8"), f"{title}: {file} {function}"


def test_the_verbs_of_a_belief_are_those_of_the_page() -> None:
    """Who writes a filter finds the methods that it needs, by their names."""
    stated = re.search(r"`Belief` \(`belief\.py`\): `([a-z_\s]+)`", PAGE)

    assert stated
    verbs = {name for name, member in vars(Belief).items() if inspect.isfunction(member) and name[0] != "_"}
    assert verbs == set(stated[1].split())
