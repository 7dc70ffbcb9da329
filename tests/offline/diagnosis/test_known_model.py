"""`tpmsd diagnose --model`: effects found before are part of the baseline."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import tpmsd
from bench.worlds.folder import write_folder
from bench.worlds.kinematic import Spec, drive
from tpmsd.car.physics.catalogue import make_effect
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.car.physics.model_file import load_model
from tpmsd.interfaces.cli.main import main
from tpmsd.offline.diagnosis.assessment.result import (
    CONSISTENT,
    MISMATCH,
    Finding,
    Quantity,
    RollingDiagnosis,
    Where,
)
from tpmsd.offline.diagnosis.reporting.with_known import with_known

SPEC = Spec(
    duration_s=420.0,
    road="rural",
    doppler_mps=0.03,
    doppler_tau_s=0.5,
    position_slow_m=0.6,
    physics={"centrifugal_growth": {"coefficient": 2.5e-6}, "gnss_latency": {"latency_s": 0.2}},
)


def report(folder: Path, *words: str) -> dict[str, Any]:
    """The JSON of a diagnosis."""
    file = folder.parent / f"{folder.name}.json"
    assert 0 == main(["diagnose", str(folder), "--certify", "0", "--json", str(file), *words])
    document: dict[str, Any] = json.loads(file.read_text())
    return document


def names(document: dict[str, Any]) -> list[str]:
    """What was found, suspicions included."""
    return sorted(finding["effect"] for finding in document["findings"])


def test_with_the_model_that_was_found_nothing_is_left(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """On the drive itself and on another one of the same car, by option and by `[filter] model`."""
    model = tmp_path / "model.toml"
    write_folder(drive(SPEC, 12), tmp_path / "monday")
    write_folder(drive(SPEC, 13), tmp_path / "friday")

    first = report(tmp_path / "monday", "--model-out", str(model))
    assert ["centrifugal_growth", "gnss_latency"] == names(first)
    assert "mismatch" == first["verdict"]

    again = report(tmp_path / "monday", "--model", str(model))
    assert [] == again["findings"]
    assert "consistent" == again["verdict"]
    assert {"rolling", "centrifugal_growth", "gnss_latency"} == set(again["baseline"]["model"])
    assert str(model) in again["input"]["paths"]
    assert again["baseline"]["heldout_rms"] < first["baseline"]["heldout_rms"]
    assert "with this model nothing is left" in capsys.readouterr().out

    assert ["centrifugal_growth", "gnss_latency"] == names(report(tmp_path / "friday"))
    configured = tmp_path / "friday" / "vehicle.toml"
    configured.write_text(configured.read_text() + '\n[filter]\nmodel = "../model.toml"\n')
    other = report(tmp_path / "friday")
    assert ("consistent", []) == (other["verdict"], other["findings"])
    assert "consistent" == tpmsd.diagnose(tmp_path / "friday", certify=0).verdict


def test_what_the_model_does_not_hold_is_found_beside_it(tmp_path: Path) -> None:
    """With growth alone known, the latency is found; the model that is written holds both."""
    write_folder(drive(SPEC, 12), tmp_path / "monday")
    known, whole = tmp_path / "known.toml", tmp_path / "whole.toml"
    known.write_text('[[effect]]\nname = "centrifugal_growth"\ncoefficient = 2.5e-6\n')

    document = report(tmp_path / "monday", "--model", str(known), "--model-out", str(whole))

    (found,) = document["findings"]
    assert "gnss_latency" == found["effect"]
    value = found["parameters"]["latency_s"]
    assert abs(value["value"] - 0.2) < 3.0 * value["std"]
    assert ["centrifugal_growth", "gnss_latency"] == [effect.name for effect in load_model(whole)]


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["--model", "none.toml"], "none.toml"),
        (["--model", "model.toml", "--simulation", "sim"], "--model: the baseline is the simulation"),
    ],
)
def test_what_makes_no_sense_is_one_line(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    words: list[str],
    reason: str,
) -> None:
    """A model that is not there, and one beside a simulation."""
    monkeypatch.chdir(tmp_path)
    write_folder(drive(replace(SPEC, duration_s=30.0), 1), tmp_path / "sim")

    assert 2 == main(["diagnose", "sim", *words])
    assert 1 == sum(reason in line for line in capsys.readouterr().err.splitlines())


def ripple(amplitude_rad: float, wheel: str) -> Finding:
    """An uneven ring, as it is reported."""
    values = {"amplitude_rad": Quantity(amplitude_rad, 1e-4, "rad"), "wheel": Quantity(wheel, None, "")}
    where = Where((wheel,), "wheel_ratio", "wheel_angle", None)
    return Finding("tone_ring_error", 1.0, values, where, 1.0, 0.9, 0.1, 50.0, ())


@pytest.mark.parametrize(
    ("amplitude_rad", "wheel", "left"), [(5e-3, "rl", 0), (7e-3, "rl", 1), (5e-3, "rr", 1)]
)
def test_a_known_ripple_is_no_finding_whatever_its_phase(amplitude_rad: float, wheel: str, left: int) -> None:
    """The ripple of the model's size on the model's wheel; a larger one and another wheel's are findings."""
    known = ExtendedModel((make_effect("tone_ring_error", wheel="rl", amplitude_rad=5.1e-3),))
    found = make_effect("tone_ring_error", wheel=wheel, amplitude_rad=amplitude_rad)
    rest = RollingDiagnosis(
        MISMATCH, "", (ripple(amplitude_rad, wheel),), 100.0, 1.0, 0.0, 1.0, None, ExtendedModel((found,))
    )

    made = with_known(known, rest)

    assert left == len(made.findings)
    assert (CONSISTENT, MISMATCH)[left] == made.verdict
    assert 1 + left == len(made.model)
    assert ("rolling", "tone_ring_error") == made.baseline
