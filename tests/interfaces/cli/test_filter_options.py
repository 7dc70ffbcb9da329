"""`--method`, `--seed` and `--model` say to every command what the configuration would say."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from starlette.testclient import TestClient

from tpmsd.car.physics.catalogue import make_effect
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.car.physics.model_file import save_model
from tpmsd.interfaces.cli.main import full_parser, main
from tpmsd.interfaces.cli.run import configuration
from tpmsd.interfaces.cli.web import _make_app, settings_of
from tpmsd.offline.simulator.drive import DriveSpec, simulate_drive
from tpmsd.offline.simulator.drive_writer import write_drive

METHODS = ("gaussian-sum", "mpf-pn")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A drive of 80 s."""
    made = simulate_drive(DriveSpec(route="motorway", duration_s=80.0, seed=3))
    return write_drive(tmp_path_factory.mktemp("drives") / "short", made)


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A receiver that is late by half a second more than is configured."""
    file = tmp_path_factory.mktemp("model") / "model.toml"
    effect = make_effect("gnss_latency", latency_s=0.5)
    save_model(file, ExtendedModel((effect,), ({"latency_s": 0.01},)))
    return file


def explained(capsys: pytest.CaptureFixture[str], folder: Path, *options: str) -> Any:
    assert 0 == main(["explain", str(folder), "--json", "-", *options])
    return json.loads(capsys.readouterr().out)["wheels"]


def replayed(capsys: pytest.CaptureFixture[str], folder: Path, *options: str) -> Any:
    assert 0 == main(["replay", str(folder), "--json", "-", *options])
    return json.loads(capsys.readouterr().out)["wheels"]


def page(capsys: pytest.CaptureFixture[str], folder: Path, *options: str) -> Any:
    args = full_parser().parse_args(["web", str(folder), *options])
    app = _make_app(args, settings_of(args))
    assert "" == capsys.readouterr().out
    with TestClient(app, base_url="http://127.0.0.1:8377") as web:
        return web.get("/api/drive").json()["wheels"]


COMMANDS = [explained, replayed, page]


@pytest.mark.parametrize("shown", COMMANDS, ids=["explain", "replay", "web"])
def test_an_option_does_what_the_configuration_does(
    shown: Callable[..., Any], folder: Path, model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Method, seed and model on the command line give the numbers of a configuration that names them, and
    each changes the numbers; no wheel is left without any."""
    written = tmp_path / "same"
    written.mkdir()
    for file in folder.iterdir():
        if file.name != "vehicle.toml":
            (written / file.name).symlink_to(file)
    text = (folder / "vehicle.toml").read_text("utf-8")
    assert "[filter]" not in text
    seen = []
    for options in ({}, {"method": "mpf-pn"}, {"method": "mpf-pn", "seed": 5}, {"model": str(model)}):
        table = "".join(f"{name} = {json.dumps(value)}\n" for name, value in options.items())
        (written / "vehicle.toml").write_text(f"{text}\n[filter]\n{table}", encoding="utf-8")
        given = [word for name, value in options.items() for word in (f"--{name}", str(value))]
        wheels = shown(capsys, folder, *given)
        assert shown(capsys, written) == wheels
        assert {"fl", "fr", "rl", "rr"} == set(wheels)
        seen.append(json.dumps(wheels))
    assert len(seen) == len(set(seen))


@pytest.mark.parametrize("method", METHODS)
def test_the_daemon_runs_with_the_filter_that_is_asked_for(folder: Path, method: str) -> None:
    """`tpmsd run --method` takes the place of `[filter] method`, and `--seed` likewise."""
    asked = ["run", "--config", str(folder), "--method", method, "--seed", "7"]
    config, _ = configuration(full_parser().parse_args(asked))
    assert (method, 7) == (config.filter.method, config.filter.seed)


@pytest.mark.parametrize("command", ["explain", "replay", "web", "run --config"])
@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ("--method kalman", "--method: unknown 'kalman'; known: gaussian-sum, mpf-pn-paper, mpf-pn, "),
        ("--seed -1", "--seed -1: a seed is 0 or more"),
        ("--model nowhere.toml", "nowhere.toml: cannot be read: No such file or directory"),
    ],
    ids=lambda text: text.split()[0],
)
def test_what_does_not_exist_is_one_line(
    command: str, options: str, reason: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """An unknown method, a negative seed and a model that is not there: exit code 2."""
    assert main([*command.split(), str(folder), *options.split()]) in (2, 3)
    reported = [line for line in capsys.readouterr().err.splitlines() if reason in line]
    assert 1 == len(reported)


@pytest.mark.parametrize("command", ["explain", "web"])
def test_the_running_daemon_keeps_its_filter(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Without a drive the daemon is asked, which has its own filter."""
    assert 2 == main([command, "--method", "mpf-pn"])
    reported = "tpmsd: --method goes with a DRIVE: the daemon has the filter of its configuration\n"
    assert reported == capsys.readouterr().err
