"""The table of faults in docs/reference/faults.md names tests that are there."""

from __future__ import annotations

import re

from tests.conftest import REPO

DOCUMENT = REPO / "docs" / "reference" / "faults.md"
NAME = re.compile(r"`(tests/[\w/]+\.py)::(test_\w+)`")


def rows() -> list[list[str]]:
    """The cells of each row of the tables, their heads left out."""
    lines = [line for line in DOCUMENT.read_text("utf-8").splitlines() if line.startswith("| ")]
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return [row for row in cells if row[0] != "fault" and not set(row[0]) <= set("- ")]


def test_every_fault_names_a_test_that_is_there() -> None:
    """Each row has a fault, what is done, and at least one test; each named test is defined in its file."""
    assert len(rows()) >= 45
    without = [row[0] for row in rows() if len(row) != 3 or not row[1] or not NAME.search(row[2])]
    assert [] == without
    missing = [
        f"{file}::{name}"
        for row in rows()
        for file, name in NAME.findall(row[2])
        if not (REPO / file).is_file() or f"def {name}(" not in (REPO / file).read_text("utf-8")
    ]
    assert [] == missing


def test_every_test_of_a_fault_is_named_in_the_table() -> None:
    """What tests/faults proves of the wheels, the receiver and the clock is in the table."""
    named = {name for row in rows() for _, name in NAME.findall(row[2])}
    defined = {
        name
        for file in ("test_wheels.py", "test_receiver.py", "test_clock.py")
        for name in re.findall(r"^def (test_\w+)\(", (REPO / "tests/faults" / file).read_text("utf-8"), re.M)
    }
    helpers = {
        "test_without_a_fault_the_loss_is_found",
        "test_the_drives_hold_what_the_tests_take_for_granted",
    }
    assert set() == defined - named - helpers
