"""Numbers that someone may tune stand in a package's settings, each with its reason
(`tests/offline/diagnosis` has the same for the diagnosis)."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from tests.offline.diagnosis.test_settings import has_number

PACKAGE = Path(__file__).resolve().parents[1] / "tpmsd"
PACKAGES = {path.parent.name: path.parent for path in PACKAGE.glob("*/*/__init__.py")}
"""Every package of every layer."""
SETTLED = ("diagnosis", "fleet", "monitor")
"""Packages whose numbers are all in their settings."""
STRUCTURE = {
    "monitor.slow_leaks.filter.MIN_PROBABILITY": "keeps a logarithm finite",
    "monitor.slow_leaks.filter.NO_EVENT": "stands for none",
    "monitor.slow_leaks.filter.NO_WHEEL": "stands for none",
    "monitor.slow_leaks.history._FIRST": "how an earlier state is known",
    "monitor.slow_leaks.history._MERGED": "how an earlier state is known",
    "monitor.slow_leaks.noise.LEVEL_OF": "places",
    "monitor.slow_leaks.state.BASE": "a place, like the others of this line",
    "monitor.slow_leaks.state.CONTRASTS": "the contrasts, by their definition",
    "monitor.slow_leaks.state.FRONT_REAR": "a place",
    "monitor.slow_leaks.state.SEEN": "which values a reading shows",
    "monitor.slow_leaks.state.WEAR": "a place",
    "monitor.slow_leaks.state.WEEK_D": "a unit",
    "monitor.slow_leaks.state.WHEEL_SETS": "which wheels belong together",
    "monitor.evidence.posterior.LEAST": "keeps a division by a probability of zero finite",
    "monitor.evidence.probability.MAX_STEPS": "terms of a series, by which it has converged to the last bit",
    "monitor.baseline.reference.CAR": "a place in an array, like the others of this module",
    "monitor.baseline.reference.GROWTH": "a place",
    "monitor.baseline.reference.LOAD": "a place",
    "monitor.baseline.reference.OWN": "a place",
    "monitor.baseline.reference.SIZE": "a size",
    "monitor.baseline.reference.WARM": "a place",
    "monitor.health.signal_watch._ESTIMATED": "a code of NMEA 0183",
    "monitor.slow_leaks.watch.DAY_S": "a unit",
    "monitor.slow_leaks.watch._EPOCH": "the calendar",
    "monitor.slow_leaks.watch._LAST_DAY": "the calendar",
    "fleet.discoveries.DAYS_PER_WEEK": "a unit",
    "fleet.losses.DAY_S": "a unit",
    "fleet.parameters.RADII_OF_CONTRASTS": "radii of contrasts, by their definition",
    "fleet.parameters.PARAMETERS_OF_FLEET": "units in which the parameters are counted",
    "fleet.store._UMASK": "what the process has",
}
"""What is no setting, and why."""


def numbers_of(package: str) -> list[str]:
    """Names of module constants with a number, outside the package's settings."""
    out = []
    for path in sorted(PACKAGES[package].rglob("*.py")):
        if path.name == "settings.py":
            continue
        module = ".".join(path.relative_to(PACKAGES[package].parent).with_suffix("").parts)
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            value = node.value if isinstance(node, ast.Assign | ast.AnnAssign) else None
            if value is not None and has_number(value):
                target = node.targets[0] if isinstance(node, ast.Assign) else node.target
                first = target.elts[0] if isinstance(target, ast.Tuple) else target
                out.append(f"{module}.{ast.unparse(first)}")
    return out


@pytest.mark.parametrize("package", SETTLED)
def test_no_number_stands_outside_the_settings_of_a_package(package: str) -> None:
    """But what is structure, with its reason."""
    assert [] == sorted(set(numbers_of(package)) - set(STRUCTURE))


def test_nothing_is_excused_that_is_not_there() -> None:
    """The list of exceptions only shrinks."""
    there = {name for package in SETTLED for name in numbers_of(package)}

    assert set() == set(STRUCTURE) - there
