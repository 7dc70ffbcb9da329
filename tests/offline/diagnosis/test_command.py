"""`tpmsd diagnose` from folder to report."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from bench.worlds.folder import write_folder
from bench.worlds.kinematic import Spec, drive
from tests.offline.report.pages import Page
from tpmsd.car.physics.model_file import load_model
from tpmsd.interfaces.cli.main import main

PHYSICS = {"load_transfer_lateral": {"coefficient": 2e-4}}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five minutes of a car whose tyres feel the bends."""
    path = tmp_path_factory.mktemp("drives") / "bends"
    write_folder(drive(Spec(duration_s=300.0, road="rural", physics=dict(PHYSICS)), 21), path)
    return path


@pytest.fixture(scope="module")
def out(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder with all that the command writes."""
    path = tmp_path_factory.mktemp("out")
    arguments = ["diagnose", str(folder), "--json", str(path / "d.json"), "--html", str(path / "d.html")]
    assert 0 == main([*arguments, "--model-out", str(path / "model.toml")])
    return path


def test_the_document_has_the_form_that_others_rely_on(out: Path) -> None:
    """Keys, names and units are those of the public format."""
    document = json.loads((out / "d.json").read_text(encoding="utf-8"))
    finding = document["findings"][0]

    assert ("mismatch", ["rolling"]) == (document["verdict"], document["baseline"]["model"])
    assert {"heldout_rms", "heldout_loglik_per_s"} < set(document["baseline"])
    assert "load_transfer_lateral" == finding["effect"]
    assert finding["parameters"]["coefficient"]["value"] == pytest.approx(2e-4, rel=0.1)
    assert "s2" == finding["parameters"]["coefficient"]["unit"]
    assert ("wheel_ratio", "accel_lat") == (finding["where"]["channel"], finding["where"]["covariate"])
    assert finding["heldout"]["rms_after"] < finding["heldout"]["rms_before"]
    assert {"significant", "where", "radius_drift"} == set(document["unexplained"])


def test_the_extended_model_can_be_taken_up_again(out: Path) -> None:
    """The model file beside the report holds the finding with its standard deviation."""
    model = load_model(json.loads((out / "d.json").read_text(encoding="utf-8"))["model_file"])

    assert ["load_transfer_lateral"] == [effect.name for effect in model]
    assert 0.0 < model.stds[0]["coefficient"] < 2e-5


def test_the_page_stands_alone(out: Path) -> None:
    """It has pictures, loads nothing from elsewhere, and says what it was made of."""
    text = (out / "d.html").read_text(encoding="utf-8")
    page = Page(text)
    read = json.loads((out / "d.json").read_text(encoding="utf-8"))["input"]

    assert page.tags["svg"] >= 3
    assert [] == page.loaded
    assert len(text) < 3_000_000
    assert f"Configuration hash|{read['configuration_hash']}" in page.text


def test_nothing_is_written_but_what_was_asked_for(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without --model-out no model file appears, neither beside the JSON file nor in the present folder."""
    here = tmp_path / "here"
    here.mkdir()
    monkeypatch.chdir(here)

    assert 0 == main(["diagnose", str(folder.resolve()), "--json", str(tmp_path / "d.json")])
    assert None is json.loads((tmp_path / "d.json").read_text(encoding="utf-8"))["model_file"]
    assert [] == list(here.iterdir())
    assert ["d.json", "here"] == sorted(path.name for path in tmp_path.iterdir())


def test_a_folder_that_is_not_there_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Unusable input ends with code 3 and the folder's name."""
    assert 3 == main(["diagnose", str(tmp_path / "none")])
    assert f"tpmsd: {tmp_path / 'none'}: no such drive folder\n" == capsys.readouterr().err


def test_too_little_data_is_one_line_and_code_3(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A minute of driving: the reason in one line, code 3, and a document that states the verdict."""
    short = tmp_path / "short"
    write_folder(drive(Spec(duration_s=60.0, road="rural"), 21), short)

    assert 3 == main(["diagnose", str(short), "--json", str(tmp_path / "d.json")])
    reported = capsys.readouterr()
    assert "tpmsd: insufficient data: the drive is shorter than 90 s" == reported.err.splitlines()[-1]
    assert "" == reported.out
    assert "insufficient_data" == json.loads((tmp_path / "d.json").read_text(encoding="utf-8"))["verdict"]


def test_a_configuration_that_cannot_be_used_is_one_line_and_code_2(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A signal that the DBC lacks is the configuration's fault, told once with the file."""
    broken = tmp_path / "broken"
    shutil.copytree(folder, broken)
    config = broken / "vehicle.toml"
    config.write_text(config.read_text(encoding="utf-8").replace('.RL"', '.NOWHERE"'), encoding="utf-8")

    assert 2 == main(["diagnose", str(broken)])
    line = capsys.readouterr().err.strip().splitlines()[-1]
    assert 1 == line.count(str(broken))
    assert "NOWHERE" in line


def test_two_can_logs_are_one_line_and_code_3(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The folder is named once."""
    twofold = tmp_path / "twofold"
    shutil.copytree(folder, twofold)
    (twofold / "can.asc").write_text("", encoding="utf-8")

    assert 3 == main(["diagnose", str(twofold)])
    assert 1 == capsys.readouterr().err.strip().splitlines()[-1].count(str(twofold))
