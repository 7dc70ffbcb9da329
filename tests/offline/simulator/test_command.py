"""`tpmsd simulate` from the command line."""

from __future__ import annotations

import argparse
import itertools
import json
import re
import threading
from pathlib import Path

import can
import pytest

from tpmsd.car.config.load import load_config
from tpmsd.car.config.model import Config
from tpmsd.car.physics.catalogue import make_effect
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.car.physics.model_file import save_model
from tpmsd.foundation.errors import TpmsdError
from tpmsd.interfaces.cli import simulate
from tpmsd.interfaces.cli.main import main

_channels = itertools.count()


def truth_of(folder: Path) -> dict[str, object]:
    """What truth.json says."""
    return json.loads((folder / "truth.json").read_text())


def test_a_puncture_to_a_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The folder holds the drive and its truth; the summary names the fault."""
    arguments = ["--duration", "60", "--route", "oval", "--seed", "4", "--puncture", "rl"]
    arguments += ["--loss-percent", "2", "--over", "20", "--at", "30"]

    assert 0 == main(["simulate", str(tmp_path / "d"), *arguments])
    (fault,) = truth_of(tmp_path / "d")["faults"]
    assert {
        "kind": "puncture",
        "size": 2.0,
        "size_unit": "percent",
        "wheel": "rl",
        "onset_s": 30.0,
        "duration_s": 20.0,
    } == fault
    out = capsys.readouterr().out.splitlines()
    assert out[0].startswith("oval drive of 60 s and ")
    fault_said = "wheel = rl, deviation_m = -0.00632, onset_s = 30, duration_s = 20, course = ramp"
    assert f"  radius_change: {fault_said}" == out[1]
    assert f"written to {tmp_path / 'd'} (the truth is in truth.json)" == out[-1]


def test_json_on_standard_output_is_json_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`--json -` leaves nothing else there; what it reports is the truth's."""
    arguments = ["--duration", "30", "--route", "oval", "--radius-offset-mm=1,-1,0,0.5", "--json", "-"]

    assert 0 == main(["simulate", str(tmp_path / "d"), *arguments])
    document = json.loads(capsys.readouterr().out)
    assert pytest.approx({"fl": 1.0, "fr": -1.0, "rl": 0.0, "rr": 0.5}) == document["final_deviation_mm"]
    assert (30.0, str(tmp_path / "d")) == (document["duration_s"], document["folder"])


def test_effects_and_models_add_up(tmp_path: Path) -> None:
    """A model file's effects come first, those of the command line after them."""
    save_model(tmp_path / "m.toml", ExtendedModel((make_effect("gnss_latency", latency_s=0.1),)))
    arguments = ["--model", str(tmp_path / "m.toml"), "--effect", "yaw_rate_bias:bias=0.001"]

    assert 0 == main(["simulate", str(tmp_path / "d"), "--duration", "20", "--route", "oval", *arguments])
    assert [
        {"name": "gnss_latency", "parameters": {"latency_s": 0.1}},
        {"name": "yaw_rate_bias", "parameters": {"bias": 0.001}},
    ] == truth_of(tmp_path / "d")["effects"]


def test_another_car(tmp_path: Path) -> None:
    """The car of a drive folder can be driven again."""
    assert 0 == main(["simulate", str(tmp_path / "a"), "--duration", "20"])
    text = (tmp_path / "a" / "vehicle.toml").read_text()
    text = text.replace(
        "wheel_radius_m = 0.316", "wheel_radius_m = { fl = 0.3, fr = 0.3, rl = 0.31, rr = 0.31 }"
    )
    (tmp_path / "a" / "vehicle.toml").write_text(
        text.replace("antenna_left_m = 0.0", "antenna_left_m = -0.4")
    )

    assert 0 == main(["simulate", str(tmp_path / "b"), "--duration", "20", "--vehicle", str(tmp_path / "a")])
    assert {"fl": 0.3, "fr": 0.3, "rl": 0.31, "rr": 0.31} == truth_of(tmp_path / "b")["nominal_radius_m"]
    assert "antenna_left_m = -0.4" in (tmp_path / "b" / "vehicle.toml").read_text()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "tpmsd simulate: give a folder OUT, or --live CHANNEL, or both"),
        (["d", "--effect", "warp_drive:factor=9"], "unknown effect 'warp_drive'"),
        (["d", "--at", "5"], "a size, --over or --at without --puncture, --leak, --step or --diffusion"),
        (
            ["d", "--puncture", "rl", "--at", "100", "--duration", "20"],
            "--at 100: the fault would not begin within the drive (--duration 20)",
        ),
        (["d", "--outage", "9:3"], "--outage 9:3: FROM:TO in seconds is wanted, FROM before TO"),
        (["d", "--outage", "soon"], "--outage soon: FROM:TO in seconds is wanted, FROM before TO"),
        (["d", "--radius-offset-mm", "1,2"], "--radius-offset-mm 1,2: four numbers FL,FR,RL,RR are wanted"),
        (["d", "--radius-offset-mm", "1,2,3,nan"], "--radius-offset-mm 1,2,3,nan: more than 50 mm"),
        (["d", "--lost-percent", "101"], "--lost-percent 101 is outside 0 to 100"),
        (["d", "--latency=-1"], "--latency -1 is not a number of at least 0"),
        (["d", "--duration", "1"], "duration 1 s is outside 10 to 86400 s"),
        (
            ["d", "--leak", "fl", "--pressure-percent", "200"],
            "pressure loss of 200 % is outside -50 to 100 %",
        ),
        (["d", "--model", "none.toml"], "none.toml: cannot be read: No such file or directory"),
        (["--live", "x", "--interface", "virtual", "--speed-up", "0"], "speed-up 0 is outside 0.01 to 10000"),
    ],
)
def test_wrong_usage_is_one_line_and_exit_code_2(
    arguments: list[str], message: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """The line says what is wrong; nothing is written to standard output."""
    arguments = [str(tmp_path / "d") if argument == "d" else argument for argument in arguments]

    assert 2 == main(["simulate", *arguments])
    captured = capsys.readouterr()
    assert ("", message) == (captured.out, captured.err.splitlines()[-1].removeprefix("tpmsd: "))
    assert not (tmp_path / "d").exists()


def test_a_folder_that_is_not_empty_is_left_as_it_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A simulated drive is replaced with --force alone; a recording, or one beside it, with nothing."""
    folder = tmp_path / "d"
    arguments = ["simulate", str(folder), "--duration", "20", "--route", "oval"]
    recording = tmp_path / "mine"
    recording.mkdir()
    (recording / "vehicle.toml").write_text("# mine")

    assert 0 == main(arguments)
    before = (folder / "can.log").read_bytes()
    assert 2 == main([*arguments, "--seed", "9"])
    assert "holds a simulated drive already; --force replaces it" in capsys.readouterr().err
    assert before == (folder / "can.log").read_bytes()
    assert 0 == main([*arguments, "--seed", "9", "--force"])
    assert before != (folder / "can.log").read_bytes()
    (folder / "can.asc").write_text("converted by hand")
    assert 2 == main([*arguments, "--force"])
    assert "holds can.asc beside a simulated drive" in capsys.readouterr().err
    assert 2 == main(["simulate", str(recording), "--duration", "20", "--force"])
    assert "holds files that tpmsd simulate did not write" in capsys.readouterr().err
    assert {"vehicle.toml": "# mine"} == {path.name: path.read_text() for path in recording.iterdir()}


def test_a_bus_that_cannot_be_opened(capsys: pytest.CaptureFixture[str]) -> None:
    """An unknown interface is one line and exit code 1."""
    assert 1 == main(["simulate", "--live", "c", "--interface", "nope", "--duration", "10"])
    assert 'nope c: cannot be opened: Unknown interface type "nope"' in capsys.readouterr().err


def test_live_writes_the_configuration_before_it_simulates(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A daemon can be started while the drive is simulated: its configuration stands by then, and is said."""
    folder = tmp_path / "d"
    found: list[Config] = []

    def stopped(*_: object) -> None:
        found.append(load_config(folder))
        raise TpmsdError("stopped")

    monkeypatch.setattr("tpmsd.offline.simulator.drive.simulate_drive", stopped)
    command = ["simulate", str(folder), "--live", f"early-{next(_channels)}", "--interface", "virtual"]
    assert 1 == main([*command, "--duration", "20"])
    said = capsys.readouterr().err
    assert [folder / "bus.dbc"] == [config.can.dbc for config in found]
    assert said.index("vehicle.toml") < said.index("simulating 20 s of driving")
    monkeypatch.undo()
    assert 0 == main(["simulate", str(folder), "--duration", "20", "--force"]), "a cut-short run is replaced"


def test_live_onto_a_bus_and_a_terminal(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Frames arrive on the bus, and the folder's configuration names bus and terminal for a daemon."""
    channel = f"command-{next(_channels)}"
    code: list[int] = []
    arguments = ["--live", channel, "--interface", "virtual", "--speed-up", "50", "--duration", "20"]
    arguments += ["--pty", str(tmp_path / "gnss"), "--json", str(tmp_path / "report.json")]
    with can.Bus(interface="virtual", channel=channel) as bus:
        thread = threading.Thread(
            target=lambda: code.append(main(["simulate", str(tmp_path / "d"), *arguments]))
        )
        thread.start()
        thread.join(120.0)
        assert not thread.is_alive()
        frames = list(iter(lambda: bus.recv(0), None))
    report = json.loads((tmp_path / "report.json").read_text())
    config = (tmp_path / "d" / "vehicle.toml").read_text()

    assert [0] == code
    live = report["live"]
    assert len(frames) == live["frames"] > 0
    assert live["frames"] + live["overtaken"] == report["frames"], (
        "a machine that held it up left out what was overtaken"
    )
    assert f'channel = "{channel}"' in config
    assert f'device = "{tmp_path / "gnss"}"' in config
    assert f"receiver on {tmp_path / 'gnss'}, bus on virtual {channel}" in capsys.readouterr().err


def test_the_examples_of_the_help_are_right(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each example of --help is a command line that the command understands."""
    save_model(tmp_path / "model.toml", ExtendedModel())
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")  # no line is wrapped
    assert 0 == main(["simulate", "--help"])
    text = capsys.readouterr().out.replace("\\\n", " ")
    examples = [
        re.split(r" {4,}(?!-)", line)[0].split()[2:]
        for line in map(str.strip, text.splitlines())
        if line.startswith("tpmsd simulate")
    ]
    parser = argparse.ArgumentParser()
    simulate.add_parser(parser.add_subparsers())
    specs = [simulate.spec_of(parser.parse_args(["simulate", *example])) for example in examples]

    assert 10 == len(specs)
    assert ["puncture", "leak", "diffusion", "puncture"] == [
        spec.faults[0].kind for spec in specs if spec.faults
    ]
