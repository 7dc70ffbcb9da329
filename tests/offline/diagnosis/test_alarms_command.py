"""`tpmsd diagnose --alarms` from folder to document."""

from __future__ import annotations

import json
from typing import Any

import pytest

from bench.worlds.folder import write_folder
from bench.worlds.kinematic import Spec, drive
from tpmsd.interfaces.cli.main import main

LEAK = {"wheel": "rl", "deviation_m": -2e-3, "onset_s": 200.0, "duration_s": 30.0}


@pytest.fixture(scope="module")
def document(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Seven minutes of a car whose tyres feel bends and speed, and of which one loses air."""
    path = tmp_path_factory.mktemp("drives")
    physics = {
        "load_transfer_lateral": {"coefficient": 6e-4},
        "centrifugal_growth": {"coefficient": 3e-6},
        "radius_change": dict(LEAK),
    }
    write_folder(drive(Spec(duration_s=420.0, road="rural", physics=physics), 22), path / "leak")
    out = path / "d.json"
    assert 0 == main(
        ["diagnose", str(path / "leak"), "--alarms", "--json", str(out), "--html", str(path / "d.html")]
    )
    assert "What it means for the alarms: leak" in (path / "d.html").read_text(encoding="utf-8")
    found: dict[str, Any] = json.loads(out.read_text(encoding="utf-8"))
    return found


def test_the_fault_stays_and_the_physics_goes(document: dict[str, Any]) -> None:
    """The leak is found and named as what is not compensated; its alarm is active in the compensated
    replay."""
    (alarms,) = document["alarms"]
    effects = {finding["effect"] for finding in document["findings"]}
    after = [(one["kind"], one["wheel"]) for one in alarms["after"] if one["state"] == "raised"]

    assert {"radius_change", "load_transfer_lateral"} <= effects
    assert "leak" == alarms["drive"]
    assert ("deflation", "rl") in after
    assert any(note.startswith("radius_change is not compensated") for note in alarms["not_compensated"])


def test_radii_stray_less_with_the_model(document: dict[str, Any]) -> None:
    """The sum of the wheels' biases shrinks once growth is compensated; the filter itself takes out the load
    of bends."""
    biases = document["alarms"][0]["radius_bias_mm"].values()

    assert 4 == len(biases)
    assert sum(one["after"] for one in biases) < sum(one["before"] for one in biases)
