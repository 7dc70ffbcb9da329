"""What is said of an effect: the command that tries it out."""

from __future__ import annotations

import shlex
from pathlib import Path

import numpy as np
import pytest

from tpmsd.car.physics.catalogue import EFFECTS, parse_effect
from tpmsd.car.physics.effect import Kind, Parameter
from tpmsd.interfaces.cli.main import main
from tpmsd.offline.report.effects_reference import dynamics_effect_document, ready_command

WORLDLY = [name for name, effect in EFFECTS.items() if effect.kind is not Kind.NUISANCE]


@pytest.mark.parametrize("name", WORLDLY)
def test_every_effect_has_a_command_that_makes_it_act(name: str) -> None:
    """The effect is one that the command line takes, with a value that differs from neutral."""
    words = shlex.split(ready_command(EFFECTS[name]))
    effect = parse_effect(words[words.index("--effect") + 1])

    numbers = [p for p in effect.parameters if isinstance(p, Parameter)]
    values = effect.values()
    assert name == effect.name
    assert not numbers or any(values.get(p.name, p.neutral) != p.neutral for p in numbers)


def test_usual_sizes_are_those_of_the_priors() -> None:
    """Growth by its mean, a gyro's scale by its spread around 1, the fault by what a typical one is."""
    said = {
        name: ready_command(EFFECTS[name]) for name in ("centrifugal_growth", "yaw_rate_scale", "road_grade")
    }

    for name, parameter in (("centrifugal_growth", "coefficient"), ("yaw_rate_scale", "scale")):
        (known,) = EFFECTS[name].parameters
        assert isinstance(known, Parameter)
        assert known.prior is not None
        value = float(said[name].rpartition(f"{parameter}=")[2])
        size = max(abs(known.prior.mean - known.neutral), known.prior.std)
        assert np.isclose(abs(value - known.neutral), size, rtol=6e-3)
    assert "tpmsd simulate drives/try --effect road_grade" == said["road_grade"]


@pytest.mark.parametrize("name", ["gnss_latency", "speed_rounding_offset", "radius_change", "unknown"])
def test_the_command_that_is_printed_runs(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """As it stands, but for a shorter drive."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "drives").mkdir()
    assert 0 == main(["effects", name])
    line = capsys.readouterr().out.splitlines()[-1]

    assert line.startswith("  to try it: tpmsd simulate drives/try")
    assert 0 == main([*shlex.split(line)[4:], "--duration", "20"])
    assert f"  {name}" in capsys.readouterr().out


def test_an_effect_of_vehicle_dynamics_is_described_too(capsys: pytest.CaptureFixture[str]) -> None:
    """Drag is no effect of the rolling model: its text says with which baseline it is looked for."""
    assert 0 == main(["effects", "aero_drag"])
    said = capsys.readouterr().out
    assert "aero_drag (" in said and "drag_area_m2 (m2)" in said
    assert "to look for it: tpmsd diagnose DRIVE --baseline three-dof" in said
    assert {"name", "formula", "parameters", "try"} <= set(
        dynamics_effect_document("aero_drag")["effects"][0]
    )
