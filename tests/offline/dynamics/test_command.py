"""`tpmsd diagnose --baseline` and `tpmsd simulate --baseline` from the command line."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from bench.worlds.lively_car import SensorSpec
from tests.offline.dynamics.drives import folder, hidden
from tpmsd.car.physics.dynamics_catalogue import make_dynamics_effect
from tpmsd.car.physics.dynamics_model import DynamicsModel, format_dynamics_model, parse_dynamics_model
from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.schemas import schema_of
from tpmsd.interfaces.cli.main import main
from tpmsd.offline.signals.read import read_signals
from tpmsd.offline.signals.write import signals_text


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A car that weighs more than configured, with a gyro of its own scale."""
    where = tmp_path_factory.mktemp("command") / "drive"
    return folder(where, hidden(yaw_inertia_error={"relative": 0.25}), duration_s=60.0)


def test_a_diagnosis_answers_in_sentences_and_json(drive: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The first sentence names what is left out; the JSON is as its schema says, no key beside it."""
    document, model = drive.parent / "found.json", drive.parent / "model.toml"
    code = main(
        [
            "diagnose",
            str(drive),
            "--baseline",
            "single-track",
            "--json",
            str(document),
            "--model-out",
            str(model),
        ]
    )
    text = capsys.readouterr().out
    found = json.loads(document.read_text())
    schema = schema_of("tpmsd.diagnosis/2")

    assert code == 0
    assert text.startswith("The single-track model leaves out")
    assert "yaw inertia" in text.splitlines()[0]
    jsonschema.validate(found, schema)
    assert set() == found.keys() - schema["properties"].keys()
    assert found["verdict"] == "mismatch"
    assert found["baseline"]["name"] == "single-track"
    assert found["summary"].startswith("The single-track model")
    (one,) = found["findings"]
    assert one["effect"] == "yaw_inertia_error"
    assert one["where"]["channel"] in found["outputs"]
    assert one["parameters"]["relative"]["value"] == pytest.approx(0.25, abs=0.02)
    assert found["outputs"]["yaw_rate"]["rms_after"] < found["outputs"]["yaw_rate"]["rms_before"]
    assert {entry["effect"] for entry in found["not_detectable"]} >= {"aero_downforce"}
    assert [effect.name for effect in parse_dynamics_model(model.read_text()).effects] == [
        "yaw_inertia_error"
    ]


def test_page_picture_certificate_and_proposal_are_written(
    drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The options of the rolling baseline do the same here; the JSON is as its schema says."""
    page, plot, document = tmp_path / "d.html", tmp_path / "d.svg", tmp_path / "d.json"
    line = [
        "diagnose",
        str(drive),
        "--baseline",
        "single-track",
        "--certify",
        "7",
        "--propose",
        str(tmp_path),
    ]
    code = main([*line, "--html", str(page), "--plot", str(plot), "--json", str(document)])
    said = capsys.readouterr()
    found = json.loads(document.read_text())

    assert code == 0
    assert "yaw inertia" in page.read_text()
    assert "<svg" in plot.read_text()
    assert "7 replicates" in said.out
    assert "nothing to propose" in said.err
    jsonschema.validate(found, schema_of("tpmsd.diagnosis/2"))
    assert found["certificate"]["replicates"] == 7
    assert found["findings"][0]["p_value"] == pytest.approx(0.125)
    assert found["findings"][0]["p_value_is_bound"] is True


def test_a_simulation_on_the_inputs_comes_nearer_with_the_model(drive: Path, tmp_path: Path) -> None:
    """A folder of the same kind is written; with what was concealed its yaw rate is the recorded one."""
    model = tmp_path / "model.toml"
    effect = make_dynamics_effect("yaw_inertia_error", relative=0.25)
    model.write_text(format_dynamics_model(DynamicsModel((effect,))))
    errors = []
    for name, options in (("plain", []), ("with", ["--model", str(model)])):
        out = tmp_path / name
        line = ["simulate", "--baseline", "single-track", "--inputs", str(drive), *options, str(out)]
        assert 0 == main(line)
        one, other = read_signals(out), read_signals(drive)
        assert one.time_s == pytest.approx(other.time_s)
        errors.append(np.std(one.columns["yaw_rate_radps"] - other.columns["yaw_rate_radps"]))

    assert errors[1] < 0.0025 < errors[0]
    assert (tmp_path / "with" / "vehicle.toml").is_file()


def test_what_a_users_simulation_lacks_is_reported(drive: Path, tmp_path: Path) -> None:
    """Against a simulation by the plain baseline, the recording's difference is the concealed effect."""
    sim, document = tmp_path / "sim", tmp_path / "found.json"
    main(["simulate", "--baseline", "single-track", "--inputs", str(drive), str(sim)])
    line = ["diagnose", str(drive), "--baseline", "single-track", "--simulation", str(sim)]

    assert 0 == main([*line, "--json", str(document)])
    assert ["yaw_inertia_error"] == [one["effect"] for one in json.loads(document.read_text())["findings"]]


def test_what_is_left_out_is_that_of_the_simulation(tmp_path: Path) -> None:
    """The simulated car has stiffer front tyres and weighs less than configured, the recorded one 15 % less
    still and a centre of gravity ahead: that is found, about the simulation and not the configured car."""
    stiff = {"front": 0.3, "rear": 0.1}
    wrong = {"cornering_stiffness_error": stiff, "mass_error": {"relative": -0.1}}
    noiseless = SensorSpec(yaw=0.0, ay=0.0, ax=0.0, v=0.0, u=0.0)
    sim = folder(tmp_path / "sim", hidden(**wrong), duration_s=60.0, sensors=noiseless)
    more = {"mass_error": {"relative": 0.9 * 0.85 - 1.0}, "cg_position_error": {"forward_m": 0.1}}
    recorded = folder(tmp_path / "drive", hidden(**{**wrong, **more}), duration_s=60.0)
    document = tmp_path / "found.json"
    line = ["diagnose", str(recorded), "--baseline", "single-track", "--simulation", str(sim)]

    assert 0 == main([*line, "--json", str(document)])
    found = json.loads(document.read_text())
    jsonschema.validate(found, schema_of("tpmsd.diagnosis/2"))
    own, beyond = (
        {
            one["effect"]: {name: value["value"] for name, value in one["parameters"].items()}
            for one in entries
        }
        for entries in (found["simulation_effects"], found["findings"])
    )
    assert stiff == {key: pytest.approx(x, abs=0.03) for key, x in own["cornering_stiffness_error"].items()}
    assert {"relative": pytest.approx(-0.15, abs=0.01)} == beyond.pop("mass_error")
    assert {"cg_position_error": {"forward_m": pytest.approx(0.1, abs=0.01)}} == beyond
    assert found["summary"].startswith("Your simulation moves like the single-track model with ")


@pytest.mark.parametrize(
    ("column", "factor", "said"),
    [
        ("yaw_rate_radps", -1.0, "yaw_rate_radps moves against the recorded one: of the other sign?"),
        ("yaw_rate_radps", 180.0 / np.pi, "times the recorded one: in deg/s?"),
        ("accel_lat_mps2", 1.0 / 9.81, "accel_lat_mps2 is 0.1 times the recorded one: in g?"),
    ],
)
def test_a_simulation_of_another_sign_or_unit_is_told(
    drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], column: str, factor: float, said: str
) -> None:
    """No physics is fitted to it."""
    table = read_signals(drive)
    columns = {"time_s": table.time_s, **table.columns, column: factor * table.columns[column]}
    (tmp_path / "signals.csv").write_text(signals_text(columns), encoding="utf-8")

    line = ["diagnose", str(drive), "--baseline", "single-track", "--simulation", str(tmp_path)]
    assert 3 == main(line)
    assert said in capsys.readouterr().err


def test_a_model_file_is_read_back_exactly() -> None:
    """Numbers, splines, standard deviations and the drive to which a term over time belongs."""
    effects = (
        make_dynamics_effect("mass_error", relative=0.123456789),
        make_dynamics_effect("road_bank", knots=(0.0, 12.5), heights=(0.01, -0.02)),
        make_dynamics_effect("unknown", on="moment", over="speed", knots=(5.0, 9.0), heights=(0.1, 0.2)),
    )
    model = DynamicsModel(effects, ({"relative": 0.01}, {}, {}), ("", "abc", ""))

    assert parse_dynamics_model(format_dynamics_model(model, "found\non a drive")) == model
    with pytest.raises(ConfigError, match=r"length_m = 1e-300 is outside 0\.05 to 5 m"):
        parse_dynamics_model('[[effect]]\nname = "tyre_relaxation"\nlength_m = 1e-300\n')
    with pytest.raises(ConfigError, match=r"^effect 'a.nb': std must be a table of numbers"):
        parse_dynamics_model('[[effect]]\nname = "a\\nb"\nstd = 1\n')


def test_a_term_over_time_stays_out_of_another_drive(
    drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It is named on standard error and left out."""
    model, out = tmp_path / "model.toml", tmp_path / "out"
    effect = make_dynamics_effect("side_wind", speed_mps=9.0, onset_s=1.0, duration_s=5.0)
    model.write_text(format_dynamics_model(DynamicsModel((effect,), (), ("another",))))
    line = ["simulate", "--baseline", "single-track", "--inputs", str(drive), "--model", str(model), str(out)]

    assert 0 == main(line)
    assert "side_wind belongs to the time of another drive" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["diagnose", "{drive}", "--baseline", "rolling"], 2, "can"),
        (["diagnose", "{drive}", "--baseline", "single-track", "--plot", "x.gif"], 2, ".png"),
        (["diagnose", "{drive}", "--baseline", "single-track", "--alarms"], 2, "--alarms"),
        (
            ["diagnose", "{drive}", "--baseline", "single-track", "--propose", "{drive}/vehicle.toml"],
            2,
            "a file",
        ),
        (["diagnose", "{empty}", "--baseline", "single-track"], 3, "no table of signals"),
        (["simulate", "--baseline", "single-track", "out"], 2, "--inputs"),
        (["simulate", "--baseline", "single-track", "--inputs", "{drive}", "{drive}"], 2, "not empty"),
    ],
)
def test_wrong_usage_is_one_line(
    drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], code: int, said: str
) -> None:
    """Exit codes 2 and 3 with the reason."""
    empty = tmp_path / "empty"
    empty.mkdir()
    shutil.copy(drive / "vehicle.toml", empty)

    assert code == main([word.format(drive=drive, empty=empty) for word in words])
    assert said in capsys.readouterr().err
