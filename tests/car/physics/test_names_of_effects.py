"""Effects own their knowledge: nothing of the program but their files names one."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from tpmsd.car.physics.catalogue import EFFECTS, NONPARAMETRIC

REPO = Path(__file__).resolve().parents[3]
PACKAGE = REPO / "tpmsd"
HOMES = [PACKAGE / "car" / "physics" / folder for folder in ("effects", "dynamics_effects")]
EXAMPLES = {
    "tpmsd/interfaces/cli/simulate.py",
    "tpmsd/interfaces/cli/effects.py",
    "tpmsd/interfaces/cli/plan.py",
}
"""Help texts whose examples name effects as a user types them."""
NOT_NAMES = {NONPARAMETRIC.name, *(name for name in EFFECTS if "_" not in name)}
"""Words of the language that stand for other things as well."""


ANY = re.compile("|".join((r"tpmsd\.car\.physics\.effects\.", *sorted(set(EFFECTS) - NOT_NAMES))))
JOINT = re.compile(r"""["']\s*[rfbu]*["']""")
"""Between two strings that stand side by side, and are one."""


def named(source: str) -> list[str]:
    """Effects that a module imports or names in a string that is no docstring."""
    if not ANY.search(JOINT.sub("", source)):
        return []
    tree = ast.parse(source)
    docs = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    out = []
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("tpmsd.car.physics.effects."):
            out.append(f"{node.lineno}: import of {node.module}")
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docs:
            words = set(re.findall(r"[a-z_]+", node.value))
            out += [f"{node.lineno}: {name}" for name in sorted(words & (set(EFFECTS) - NOT_NAMES))]
    return out


def test_no_module_but_its_own_names_an_effect() -> None:
    """Neither an import nor a string outside the folder of the effects."""
    faults = [
        f"{path.relative_to(REPO)}:{fault}"
        for path in sorted(PACKAGE.rglob("*.py"))
        if not set(HOMES) & set(path.parents) and path.relative_to(REPO).as_posix() not in EXAMPLES
        for fault in named(path.read_text(encoding="utf-8"))
    ]

    assert [] == faults


@pytest.mark.parametrize(
    ("source", "faults"),
    [
        ("from tpmsd.car.physics.effects.road_grade import RoadGrade", 1),
        ("if term.effect == 'gnss_latency': pass", 1),
        ("x = f'radius_change {wheel}'", 1),
        ("x = ('road_' \n    'grade')", 1),
        ("x = {'road_grades': 1}", 0),
        ('def f():\n    """Like `road_grade`."""', 0),
        ("from tpmsd.car.physics.catalogue import FAULT", 0),
    ],
)
def test_the_watch_over_names_sees(source: str, faults: int) -> None:
    """Imports, strings and parts of formatted strings are found; documentation is let through."""
    assert faults == len(named(source))
