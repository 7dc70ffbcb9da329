"""The frame of the command line: exit codes, one-line errors, start-up."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tpmsd import __version__
from tpmsd.foundation.kernels import kernel
from tpmsd.interfaces.cli import main as frame
from tpmsd.interfaces.cli.main import main

REPO = Path(__file__).resolve().parents[3]
WRONG_TOML = "[vehicle]\nwheel_radious_m = 0.3\n"


RAISING: frame.Commands = (("raise", "tests.interfaces.cli.raising", "raises"),)
DEFECT = "internal error: ZeroDivisionError: division by zero (set TPMSD_DEBUG=1 for the traceback)"


@pytest.mark.parametrize(
    ("kind", "code", "lines"),
    [
        ("plain", 1, ["tpmsd: disk full"]),
        ("input", 3, ["tpmsd: can.log:7: no frame"]),
        ("interrupt", 130, ["tpmsd: interrupted"]),
        ("pipe", 0, []),
        ("defect", 1, [f"tpmsd: {DEFECT}"]),
    ],
)
def test_errors(kind: str, code: int, lines: list[str]) -> None:
    """Every error ends in its exit code and at most one line."""
    script = (
        "import sys; from tests.interfaces.cli.test_main import RAISING, main; "
        "sys.exit(main(sys.argv[1:], RAISING))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, "raise", kind], capture_output=True, text=True, check=False, cwd=REPO
    )
    assert (code, "", lines) == (done.returncode, done.stdout, done.stderr.splitlines())


def test_traceback_on_request(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """TPMSD_DEBUG=1 shows the traceback of an internal error."""
    monkeypatch.setenv("TPMSD_DEBUG", "1")
    assert main(["raise", "defect"], RAISING) == 1
    assert "Traceback (most recent call last)" in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments", [["nonsense"], [], ["check"], ["check", "--colour", "x"], ["--nonsense"]]
)
def test_wrong_usage(capsys: pytest.CaptureFixture[str], arguments: list[str]) -> None:
    """Wrong usage is exit code 2 with the way to the usage on standard error."""
    assert main(arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "usage: tpmsd" in captured.err


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (
            ["replay", "--polt", "a.png", "d"],
            "tpmsd: unrecognized argument: --polt; did you mean --plot? (usage: tpmsd replay --help)",
        ),
        (
            ["rplay", "d"],
            "tpmsd: no such command: rplay; did you mean replay? (usage: tpmsd --help)",
        ),
        (
            ["replay"],
            "tpmsd: the following arguments are required: DRIVE (usage: tpmsd replay --help)",
        ),
        (
            ["simulate", "d", "--route", "moon"],
            "tpmsd: argument --route: invalid choice: 'moon' (choose from",
        ),
    ],
)
def test_wrong_usage_of_a_command_is_one_line(
    capsys: pytest.CaptureFixture[str], arguments: list[str], line: str
) -> None:
    """The line names the command, what is wrong and the nearest option; no block of usage buries it."""
    assert 2 == main(arguments)
    (said,) = capsys.readouterr().err.splitlines()
    assert said.startswith(line)


@pytest.mark.parametrize("width", [60, 80, 120])
@pytest.mark.parametrize("command", ["", *(name for name, _, _ in frame.COMMANDS)])
def test_help_fits_the_terminal_and_has_exit_codes(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, command: str, width: int
) -> None:
    """No line of any command's help is wider than the terminal, from 60 columns on."""
    monkeypatch.setenv("COLUMNS", str(width))
    assert 0 == main([*([command] if command else []), "--help"])
    text = capsys.readouterr().out
    assert [] == [line for line in text.splitlines() if len(line) > width]
    assert "exit codes:" in text


def test_help(capsys: pytest.CaptureFixture[str]) -> None:
    """The help names the commands that are there, two examples and the exit codes."""
    assert main(["--help"]) == 0
    text = capsys.readouterr().out
    assert "check a configuration and say what would be monitored with what" in text
    assert text.count("\n  tpmsd ") == 2
    assert all(f"\n  {code}  " in text for code in range(4))


def test_help_of_a_command(capsys: pytest.CaptureFixture[str]) -> None:
    """A command's own help is that of its module."""
    assert main(["check", "--help"]) == 0
    assert "--dbc FILE" in capsys.readouterr().out


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    """The version is that of the package, with the kernel in use."""
    assert main(["--version"]) == 0
    assert f"tpmsd {__version__} (kernel: {kernel()})\n" == capsys.readouterr().out


def test_listed_commands_are_those_that_exist(capsys: pytest.CaptureFixture[str]) -> None:
    """A command whose module is not there is neither listed nor accepted."""
    folder = Path(frame.__file__).parent
    main(["--help"])
    text = capsys.readouterr().out
    for name, module, summary in frame.COMMANDS:
        exists = (folder / f"{module.rpartition('.')[2]}.py").is_file()
        assert exists == (summary in " ".join(text.split()))
        assert exists == (main([name, "--help"]) == 0)


def test_help_imports_nothing_heavy() -> None:
    """The help starts without numpy, cantools and python-can."""
    code = (
        "import sys; from tpmsd.interfaces.cli.main import main; main(['--help']); main(['check', '--help']);"
        "print(sorted({'numpy', 'scipy', 'cantools', 'can', 'serial'} & set(sys.modules)), file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr == "[]\n"


def test_closed_pipe() -> None:
    """A reader that leaves early is no error."""
    code = "import sys; from tpmsd.interfaces.cli.main import main; sys.exit(main(['--help']))"
    reading, writing = os.pipe()
    os.close(reading)
    done = subprocess.run([sys.executable, "-c", code], stdout=writing, stderr=subprocess.PIPE, check=False)
    os.close(writing)
    assert (done.returncode, done.stderr) == (0, b"")


def test_check_of_a_wrong_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Problems go to standard error, one per line, and the exit code is 2."""
    file = tmp_path / "vehicle.toml"
    file.write_text(WRONG_TOML)
    assert main(["check", str(file)]) == 2
    captured = capsys.readouterr()
    lines = captured.err.splitlines()
    assert captured.out == ""
    assert f"{file}:2: [vehicle] wheel_radious_m: unknown key; did you mean wheel_radius_m?" in lines
    assert f"{file}: {len(lines) - 1} problems" == lines[-1]


def test_check_of_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A configuration that is not there is exit code 2 and says so."""
    file = tmp_path / "gone.toml"
    assert main(["check", str(file)]) == 2
    assert capsys.readouterr().err.splitlines() == [f"{file}: no such file", f"{file}: 1 problem"]


def test_check_json_of_a_wrong_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The JSON carries each problem's parts for programs; standard output is JSON alone."""
    (tmp_path / "vehicle.toml").write_text(WRONG_TOML)
    assert main(["check", str(tmp_path), "--json", "-"]) == 2
    report = json.loads(capsys.readouterr().out)
    assert (report["ok"], report["plan"], report["warnings"]) == (False, None, [])
    (typo,) = [problem for problem in report["problems"] if problem["line"] == 2]
    assert (typo["key"], typo["suggestion"]) == ("[vehicle] wheel_radious_m", "wheel_radius_m")


def test_check_json_that_cannot_be_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A report that cannot be written is exit code 1 and one line."""
    (tmp_path / "vehicle.toml").write_text(WRONG_TOML)
    target = tmp_path / "no" / "such" / "folder.json"
    assert main(["check", str(tmp_path), "--json", str(target)]) == 1
    expected = f"tpmsd: --json {target}: there is no folder {target.parent}"
    assert expected == capsys.readouterr().err.splitlines()[-1]


@pytest.mark.parametrize("name", ["rav4-suburb-60s", "van-motorway-a", "van-motorway-b", "van-oval"])
def test_check_of_recordings(recordings: Path, capsys: pytest.CaptureFixture[str], name: str) -> None:
    """The real drives pass, and the summary names their signals, identifiers and what is lost."""
    assert main(["check", str(recordings / name)]) == 0
    captured = capsys.readouterr()
    assert captured.err == ""
    if name.startswith("rav4"):
        assert "WHEEL_SPEEDS.FL (id 0x0AA), 16-bit speed in km/h" in captured.out
    else:
        assert "ENCODERS.COUNT_RR (id 0x120" in captured.out
        assert "0.0496 mm of road per step, rolls over every 212.9 km" in captured.out
        assert "the daemon monitors the rear axle only" in captured.out
    assert "alarm frame 0x6F1" in captured.out


def test_check_dbc_override(recordings: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Another car's DBC does not hold the signals, and is named by --dbc."""
    dbc = recordings / "van-oval" / "bus.dbc"
    assert main(["check", str(recordings / "rav4-suburb-60s"), "--dbc", str(dbc)]) == 2
    assert "[can.signals] wheel_speed_fl: no message WHEEL_SPEEDS in the DBC" in capsys.readouterr().err


def test_check_json_of_a_recording(recordings: Path, tmp_path: Path) -> None:
    """The plan in the JSON has the numbers of the summary."""
    target = tmp_path / "report.json"
    assert main(["check", str(recordings / "van-oval"), "--json", str(target)]) == 0
    plan = json.loads(target.read_text())["plan"]
    assert [wheel["wheel"] for wheel in plan["wheels"]] == ["rl", "rr"]
    assert plan["wheels"][0]["source"]["frame_id"] == 0x120
    assert plan["config"]["gnss"]["antenna_left_m"] == -0.74
