"""A recording against the user's own simulation of the same drive."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import pytest

from bench.worlds.folder import write_folder
from bench.worlds.kinematic import Spec, drive
from tests.offline.diagnosis.recorded import recording_of
from tpmsd.car.physics.model_file import load_model
from tpmsd.foundation.errors import ConfigError
from tpmsd.interfaces.cli.main import main
from tpmsd.offline.diagnosis.diagnose import diagnose_against
from tpmsd.offline.inference.recording import Recording

GROWTH = {"centrifugal_growth": {"coefficient": 3e-6}}
TRANSFER = {"load_transfer_lateral": {"coefficient": 1e-4}}
SLIP = {"longitudinal_slip": {"slip_per_accel": 2e-3, "slip_per_speed2": 1e-6}}
UNNAMED: dict[str, dict[str, Any]] = {
    "speed": {
        "strange_speed_step": {"size_m": 1.2e-3, "at_mps": 20.0, "width_mps": 4.0, "wheels": [2, 3]},
    },
    "one wheel": {"strange_camber": {"size_m": 1.5e-3, "wheels": [1]}},
    "gyro": {"strange_gyro_square": {"per_rad": 1.5}},
}
"""Physics of no catalogue."""
PERFECT: dict[str, Any] = {
    "position_slow_m": 1e-6,
    "position_white_m": 1e-6,
    "doppler_mps": 1e-6,
    "gyro_std": 1e-7,
    "gyro_drift": 0.0,
    "accel_std": 1e-6,
    "rough": 1e-7,
    "frame_jitter_s": 0.0,
    "radius_spread_m": 0.0,
}
"""What a simulator without any noise writes."""


def spec(physics: dict[str, Any], **changed: Any) -> Spec:
    """Four minutes of mixed driving."""
    return Spec(**{"duration_s": 240.0, "physics": physics, **changed})


def recorded(seed: int, physics: dict[str, Any], **changed: Any) -> Recording:
    """A drive over the road that belongs to the seed."""
    return recording_of(drive(spec(physics, **changed), seed))


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of growth and load transfer, and a noise-free simulation that holds only the growth."""
    path = tmp_path_factory.mktemp("against")
    write_folder(drive(spec(GROWTH | TRANSFER), 76), path / "recording")
    write_folder(drive(spec(GROWTH, **PERFECT), 76), path / "simulation")
    return path


def test_named_is_what_the_simulation_lacks(folders: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Growth that both hold is no finding; the document, the summary and the model file say what is."""
    drives = [str(folders / "recording"), "--simulation", str(folders / "simulation")]
    assert 0 == main(
        ["diagnose", *drives, "--json", str(folders / "d.json"), "--model-out", str(folders / "model.toml")]
    )
    document = json.loads((folders / "d.json").read_text(encoding="utf-8"))
    said = capsys.readouterr().out
    (finding,) = document["findings"]

    assert ["simulation"] == document["baseline"]["model"]
    assert {"effects": ["centrifugal_growth"]} == document["simulation"]
    assert ("load_transfer_lateral", "recording") == (finding["effect"], finding["held_by"])
    assert finding["parameters"]["coefficient"]["value"] == pytest.approx(1e-4, rel=0.15)
    assert finding["simulation"]["coefficient"]["value"] == pytest.approx(0.0, abs=1e-5)
    assert "compared with your simulation. They differ: 1 finding" in said
    assert "the recording holds it, your simulation does not" in said
    assert "This drive would not show differences from your simulation below these sizes" in said
    sizes = {one["effect"]: one["smallest"] for one in document["not_detectable"]}
    assert "load_transfer_lateral" not in sizes
    assert sizes["thermal_growth"]["amplitude_m"]["value"] > 0.0
    model = load_model(document["model_file"])
    assert {"centrifugal_growth", "load_transfer_lateral"} == {effect.name for effect in model}


def test_what_only_the_simulation_holds_has_the_opposite_sign() -> None:
    """Slip of the simulation alone: the recording's less the simulation's is minus that."""
    diagnosis = diagnose_against(recorded(73, {}), recorded(73, SLIP, **PERFECT))
    (finding,) = diagnosis.findings

    assert ("longitudinal_slip", "simulation") == (finding.effect, finding.held_by)
    for name, value in SLIP["longitudinal_slip"].items():
        quantity = finding.parameters[name]
        assert quantity.value == pytest.approx(-value, rel=0.15)
        assert finding.simulated[name].value == pytest.approx(value, rel=0.05)
    assert () == diagnosis.model.effects


def test_what_both_hold_is_no_finding_however_faint() -> None:
    """Clear growth and a transfer at the edge of what can be seen, with a receiver's noise and without."""
    physics = GROWTH | {"load_transfer_lateral": {"coefficient": 1.2e-5}}
    diagnosis = diagnose_against(recorded(74, physics), recorded(74, physics, **PERFECT))

    assert ("consistent", ("simulation",), ()) == (diagnosis.verdict, diagnosis.baseline, diagnosis.findings)


def test_what_both_hold_at_different_values_is_reported_with_both() -> None:
    """The finding's value is the difference, the simulation's stands beside it, the model has the sum."""
    less = {"load_transfer_lateral": {"coefficient": 4e-5}}
    diagnosis = diagnose_against(recorded(79, TRANSFER), recorded(79, less, **PERFECT))
    (finding,) = diagnosis.findings
    (effect,) = diagnosis.model.effects

    assert ("load_transfer_lateral", "both") == (finding.effect, finding.held_by)
    assert finding.parameters["coefficient"].value == pytest.approx(6e-5, rel=0.15)
    assert finding.simulated["coefficient"].value == pytest.approx(4e-5, rel=0.1)
    assert effect.values()["coefficient"] == pytest.approx(1e-4, rel=0.1)


@pytest.mark.parametrize(
    ("physics", "channel", "wheels"),
    [
        ("speed", "wheel_ratio", {"rl", "rr"}),
        ("one wheel", "wheel_ratio", {"fr"}),
        ("gyro", "yaw_rate", set()),
    ],
)
def test_physics_without_a_name_that_the_simulation_lacks_is_located(
    physics: str, channel: str, wheels: set[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Through the command: what no catalogue holds is `unknown`, and closed forms are proposed for it."""
    write_folder(drive(spec(UNNAMED[physics]), 77), tmp_path / "recording")
    write_folder(drive(spec({}, **PERFECT), 77), tmp_path / "simulation")
    drives = [str(tmp_path / "recording"), "--simulation", str(tmp_path / "simulation")]

    assert 0 == main(["diagnose", *drives, "--propose", str(tmp_path / "proposed"), "--json", "-"])
    document = json.loads(capsys.readouterr().out)
    findings = document["findings"]
    assert [("unknown", "recording")] == [(one["effect"], one["held_by"]) for one in findings]
    assert channel == findings[0]["where"]["channel"]
    assert wheels <= set(findings[0]["where"]["wheels"])
    first = document["proposals"][0]
    assert (tmp_path / "proposed" / f"proposed_{first['name']}.py").is_file()
    if physics == "speed":  # a form of the recording alone brings what the finding does
        assert (["speed"], "rl rr") == (first["covariates"], first["on"])
        brought = findings[0]["heldout"]["loglik_gain_per_s"] * document["driving_s"]
        assert 0.8 * brought < first["heldout_gain"] < 1.2 * brought


@pytest.mark.parametrize(
    ("simulation", "reason"),
    [
        (lambda: recorded(71, {}, wheelbase_m=2.9), "another car: wheelbase_m = 2.7 and 2.9"),
        (lambda: recorded(71, {}, driven="rear"), "another car: driven wheels fl fr and rl rr"),
        (lambda: recorded(72, {}), r"another road: \d+ % of the recording lies beside it"),
        (lambda: recorded(71, {}, duration_s=60.0), "no use: the drive is shorter than 90 s"),
    ],
)
def test_a_simulation_of_something_else_is_refused(simulation: Any, reason: str) -> None:
    """Another car, another road or too little of it: one line says which."""
    with pytest.raises(ConfigError, match=f"^the simulation is of {reason}"):
        diagnose_against(recorded(71, {}), simulation())


def test_a_simulation_with_another_ring_is_the_same_car() -> None:
    """The simulator's own bus may count otherwise: teeth are no part of the comparison."""
    fine = recorded(71, {}, teeth=96.0)
    named = dataclasses.replace(recorded(71, {}), name="the drive")

    assert "consistent" == diagnose_against(named, fine).verdict


def test_a_simulation_that_cannot_be_read_is_unusable_input(
    folders: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A missing folder ends with code 3 and its name, two drives with a simulation with code 2."""
    recording, none = str(folders / "recording"), str(folders / "none")

    assert 3 == main(["diagnose", recording, "--simulation", none])
    assert f"tpmsd: {none}: no such drive folder\n" in capsys.readouterr().err
    assert 2 == main(["diagnose", recording, str(folders / "simulation"), "--simulation", recording])
    assert "--simulation is compared with one DRIVE" in capsys.readouterr().err
