"""All that states a version states the same one, and `tpmsd[all]` holds every extra for users."""

from __future__ import annotations

import argparse
import re
import tomllib

from packaging.requirements import Requirement

from tests.conftest import REPO
from tools.make_man import page
from tpmsd.foundation.version import __version__

FOR_DEVELOPERS = {"all", "bench", "dev", "docs", "fuzz", "mutation", "proof", "release"}
"""Extras that no user of the program needs."""


def test_changelog_citation_and_notes_are_of_this_version() -> None:
    """The first entry of the changelog, `CITATION.cff` and the notes for the tag name the version."""
    first = re.search(r"^## \[(.+)\]$", (REPO / "CHANGELOG.md").read_text("utf-8"), re.MULTILINE)
    cited = re.search(r"^version: (.+)$", (REPO / "CITATION.cff").read_text("utf-8"), re.MULTILINE)
    notes = (REPO / "docs" / "releases" / f"{__version__}.md").read_text("utf-8")

    assert first and cited
    assert (__version__, __version__) == (first[1], cited[1])
    assert notes.startswith(f"# {__version__}\n") and f"git tag -a v{__version__} " in notes


def test_manual_pages_are_of_this_version() -> None:
    """The heading of a manual page names the version."""
    (heading, *_) = page("tpmsd", "finds soft tyres", argparse.ArgumentParser()).splitlines()

    assert f'"tpmsd {__version__}"' in heading


def test_the_extra_all_is_every_extra_for_users() -> None:
    """`tpmsd[all]` asks for each other extra, and each that is asked for exists."""
    extras = tomllib.loads((REPO / "pyproject.toml").read_text("utf-8"))["project"]["optional-dependencies"]
    asked = {name for each in extras["all"] for name in Requirement(each).extras}
    own = [Requirement(each) for one in extras.values() for each in one if each.startswith("tpmsd[")]

    assert set(extras) - FOR_DEVELOPERS == asked
    assert {name for each in own for name in each.extras} <= set(extras)


def test_the_extra_of_the_proof_holds_what_it_draws_with() -> None:
    """A fresh clone's page has pictures: `make proof` asks for what the bench draws with."""
    extras = tomllib.loads((REPO / "pyproject.toml").read_text("utf-8"))["project"]["optional-dependencies"]
    asked = {Requirement(one).name for one in extras["proof"]}
    recipe = (REPO / "Makefile").read_text("utf-8").partition("\nproof:")[2]
    imported = set(re.findall(r"import ([\w, ]+)'", recipe)[0].split(", "))

    assert {"pysindy", "gplearn", "matplotlib"} == asked == imported
