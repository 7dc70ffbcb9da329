"""The packages of the diagnosis: which may import which, and that all of them are tested."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

from tpmsd.offline.diagnosis.stages import (
    STAGES,
    choose,
    choose_for_verdict,
    down_weight,
    first_noise,
    other_noise,
)

REPO = Path(__file__).resolve().parents[3]
HOME = REPO / "tpmsd" / "offline" / "diagnosis"
LEVELS = 6


def imported(path: Path) -> set[str]:
    """Modules that a file imports, in full, and names that it imports from them."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    found = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    whole = {node.module or "" for node in found}
    return whole | {f"{node.module}.{alias.name}" for node in found for alias in node.names}


def package_of(module: str) -> str:
    """`tpmsd.offline.diagnosis.selection.chosen` -> `selection`; `...diagnosis.stages` -> `stages`."""
    return module.split(".")[3]


def modules() -> dict[str, Path]:
    """All modules of the diagnosis by name."""
    paths = [path for path in HOME.rglob("*.py") if path.name != "__init__.py"]
    return {".".join(path.relative_to(REPO).with_suffix("").parts): path for path in paths}


def test_packages_form_at_most_six_levels() -> None:
    """A package imports packages of lower levels alone, so that there is no cycle; the settings are
    below them all."""
    below: dict[str, set[str]] = {}
    for name, path in modules().items():
        others = {
            package_of(module) for module in imported(path) if module.startswith("tpmsd.offline.diagnosis.")
        }
        below.setdefault(package_of(name), set()).update(others - {package_of(name), "settings"})

    @cache
    def level(package: str, depth: int = 0) -> int:
        assert depth <= len(below), f"{package} is imported in a cycle"
        return 1 + max((level(other, depth + 1) for other in below[package]), default=0)

    assert max(level(package) for package in below) <= LEVELS


def test_every_module_is_imported_by_a_test() -> None:
    """No module of the diagnosis is without a test that names it."""
    tested = set().union(*(imported(path) for path in (REPO / "tests").rglob("*.py")))

    assert set() == set(modules()) - tested


def test_outliers_are_weighed_after_events_were_looked_for_and_the_verdict_comes_before_other_noise() -> None:
    """The order that the rules of the diagnosis rest on."""
    order = list(STAGES)

    assert first_noise is order[0]
    assert order.index(choose) < order.index(down_weight)
    assert [choose_for_verdict, other_noise] == order[-2:]
