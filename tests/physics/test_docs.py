"""docs/physics.md keeps what it promises."""

from __future__ import annotations

import re
import sys
import types
from pathlib import Path

import numpy as np
import pytest

from tests.physics.motions import car, steady
from tpmsd.errors import ConfigError
from tpmsd.physics.catalogue import EFFECTS, parse_effect
from tpmsd.physics.effect import Effect
from tpmsd.physics.model_file import parse_model

TEXT = (Path(__file__).resolve().parents[2] / "docs" / "physics.md").read_text(encoding="utf-8")


def block(language: str) -> str:
    """The first block of this language."""
    found = re.search(rf"```{language}\n(.*?)```", TEXT, re.DOTALL)
    assert found is not None
    return found[1]


def test_the_table_has_every_effect_with_its_parameters() -> None:
    """One row per effect of the catalogue, in its order, naming every parameter."""
    rows = re.findall(r"^\| `(\w+)` \| .*$", TEXT.split("## The effects")[1].split("The class of")[0], re.M)
    lines = {row: line for row in rows for line in TEXT.splitlines() if line.startswith(f"| `{row}` |")}

    assert list(EFFECTS) == rows
    for name, effect in EFFECTS.items():
        for parameter in effect.parameters:
            assert f"`{parameter.name}`" in lines[name]


def test_the_table_of_hooks_is_complete() -> None:
    """Every hook of the base class is explained."""
    hooks = [name for name, value in vars(Effect).items() if callable(value) and not name.startswith("_")]

    assert [] == [hook for hook in hooks if hook not in ("values", "unit_of") and f"| `{hook}(" not in TEXT]


def test_the_example_of_an_effect_works(monkeypatch: pytest.MonkeyPatch) -> None:
    """The code as printed is an effect: -A at the start, -A/e after its length."""
    module = types.ModuleType("flat_spot")
    monkeypatch.setitem(sys.modules, "flat_spot", module)
    exec(compile(block("python"), "flat_spot", "exec"), module.__dict__)
    change = module.FlatSpot(amplitude_m=3e-4, length_m=200.0).radius_change_m(steady(20.0), car())

    assert pytest.approx([-3e-4] * 4) == change[0]
    assert pytest.approx([-3e-4 * np.exp(-1)] * 4) == change[-1]


def test_the_example_of_a_model_file_is_one() -> None:
    """The TOML as printed loads, standard deviation and all."""
    model = parse_model(block("toml"))

    assert ["centrifugal_growth", "road_grade"] == [effect.name for effect in model]
    assert {"coefficient": 1e-7} == model.stds[0]


def test_the_error_that_is_shown_is_the_error_that_comes() -> None:
    """The line under the refused command is the message."""
    shown = re.search(r"--effect (\S+)\ntpmsd: (.*)\n", TEXT)
    assert shown is not None
    with pytest.raises(ConfigError) as caught:
        parse_effect(shown[1])

    assert shown[2] == str(caught.value)
