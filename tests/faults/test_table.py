"""The tables of faults (docs/reference/faults.md) and attacks (SECURITY.md) name tests that are there."""

from __future__ import annotations

import re
from pathlib import Path

from tests.conftest import REPO

FAULTS, ATTACKS = REPO / "docs" / "reference" / "faults.md", REPO / "SECURITY.md"
NAME = re.compile(r"`(tests/[\w/]+\.py)::(test_\w+)`")


def rows(document: Path = FAULTS, columns: int = 3) -> list[list[str]]:
    """The cells of each row of the tables of so many columns, their heads left out."""
    lines = [line for line in document.read_text("utf-8").splitlines() if line.startswith("| ")]
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    heads = {"fault", "who", "from", "attacker"}
    return [
        row for row in cells if len(row) == columns and row[0] not in heads and not set(row[0]) <= set("- ")
    ]


def missing_tests(table: list[list[str]]) -> list[str]:
    """Tests that a table names and that are not defined."""
    return [
        f"{file}::{name}"
        for row in table
        for file, name in NAME.findall(row[-1])
        if not (REPO / file).is_file() or f"def {name}(" not in (REPO / file).read_text("utf-8")
    ]


def test_every_fault_names_a_test_that_is_there() -> None:
    """Each row has a fault, what is done, and at least one test; each named test is defined in its file."""
    assert len(rows()) >= 45
    without = [row[0] for row in rows() if len(row) != 3 or not row[1] or not NAME.search(row[2])]
    assert [] == without
    assert [] == missing_tests(rows())


def test_every_attack_names_a_test_that_is_there() -> None:
    """At least 25 attacks; each says who, how, what is done, and names a test that is defined."""
    attacks = rows(ATTACKS, 5)
    assert len(attacks) >= 25
    assert [] == [row[1] for row in attacks if not (row[0] and row[1] and row[2] and NAME.search(row[4]))]
    assert [] == missing_tests(attacks)


def test_every_attacker_of_the_threat_model_names_a_test_that_is_there() -> None:
    """Bus, sky, local user, network, files, upstream packages: what is promised, what is not, which tests."""
    attackers = rows(ATTACKS, 4)
    kinds = {row[0].partition(":")[0] for row in attackers}
    assert {"bus", "sky", "local user", "network", "files", "upstream packages"} == kinds
    assert [] == [row[0] for row in attackers if not (row[1] and row[2] and NAME.search(row[3]))]
    assert [] == missing_tests(attackers)


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
