"""Mistakes that one makes at a terminal: each ends in one line that says what to do, its exit code,
and no loss."""

from __future__ import annotations

import io
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from tpmsd.foundation import text_file
from tpmsd.interfaces.cli.main import main

Setup = Callable[[Path], None]


@dataclass(frozen=True)
class Mistake:
    """What is typed, in which situation, and what must come of it."""

    name: str
    command: str
    code: int
    says: str
    setup: Setup = lambda here: None


def edit(file: str, old: str, new: str) -> Setup:
    """Replaces a text in a file of the drive."""

    def change(here: Path) -> None:
        path = here / file
        text = path.read_text(encoding="utf-8")
        assert old in text
        path.write_text(text.replace(old, new), encoding="utf-8")

    return change


def write(file: str, data: bytes = b"") -> Setup:
    """Puts a file there."""
    return lambda here: (here / file).write_bytes(data) and None


def remove(file: str) -> Setup:
    """Takes one away."""
    return lambda here: (here / file).unlink()


def link(to: str) -> Setup:
    """Puts a symbolic link there."""
    return lambda here: (here / "link").symlink_to(here / to)


def cut(file: str, length: int) -> Setup:
    """Leaves the first bytes alone."""
    return lambda here: (here / file).write_bytes((here / file).read_bytes()[:length]) and None


def folder(file: str) -> Setup:
    """Puts an empty folder in a file's place."""

    def change(here: Path) -> None:
        (here / file).unlink()
        (here / file).mkdir()

    return change


def loop(file: str) -> Setup:
    """Puts a link to itself in a file's place."""

    def change(here: Path) -> None:
        (here / file).unlink()
        (here / file).symlink_to(Path(file).name)

    return change


def pipe(file: str) -> Setup:
    """Puts a named pipe in a file's place, into which nobody writes."""

    def change(here: Path) -> None:
        (here / file).unlink(missing_ok=True)
        os.mkfifo(here / file)

    return change


def recoded(file: str, encoding: str) -> Setup:
    """The same text in other bytes."""
    return lambda here: (here / file).write_bytes((here / file).read_text().encode(encoding)) and None


def latin_1_comment(here: Path) -> None:
    """A comment behind the last line as editors of old write it."""
    with (here / TOML).open("ab") as file:
        file.write("\n# Straße\n".encode("latin-1"))


def _exchanged(here: Path) -> None:
    (here / LOG).rename(here / "log")
    (here / NMEA).rename(here / LOG)
    (here / "log").rename(here / NMEA)


def _renamed_gz(here: Path) -> None:
    (here / LOG).rename(here / f"{LOG}.gz")


TOML, DBC, LOG, NMEA = "d/vehicle.toml", "d/bus.dbc", "d/can.log", "d/gnss.nmea"
FL = 'wheel_count_fl = "WHEELS.CNT_FL"'
MISTAKES = (
    # the command line
    Mistake("unknown command", "replai d", 2, "replay"),
    Mistake("unknown option", "replay d --jsn x", 2, "--jsn"),
    Mistake("option of another command", "check d --plot x.png", 2, "--plot"),
    Mistake("no argument", "replay", 2, "DRIVE"),
    Mistake("nothing to check", "check", 2, "give a configuration"),
    Mistake("two outputs on standard output", "replay d --json - --csv -", 1, "goes there already"),
    Mistake("a number that is none", "simulate x --duration long", 2, "--duration"),
    Mistake("a negative duration", "simulate x --duration -5", 2, "outside 10 to 86400 s"),
    Mistake("an unknown route", "simulate x --route moon", 2, "--route"),
    Mistake("an unknown wheel", "simulate x --puncture left", 2, "--puncture"),
    Mistake("a fault after the end", "simulate x --duration 20 --puncture rl --at 100", 2, "100"),
    Mistake(
        "an unknown effect", "simulate x --effect centrifugal_growt:coefficient=1e-6", 2, "centrifugal_growth"
    ),
    Mistake("a parameter without a value", "simulate x --effect gnss_latency", 2, "latency_s"),
    Mistake("an unknown parameter", "simulate x --effect gnss_latency:latency=0.1", 2, "latency_s"),
    Mistake("a value beyond all bounds", "simulate x --effect gnss_latency:latency_s=1000", 2, "outside"),
    Mistake("an unknown shell", "completion tcsh", 2, "bash"),
    Mistake(
        "a parameter given twice",
        "simulate x --duration 20 --effect gnss_latency:latency_s=0.1,latency_s=0.2",
        2,
        "latency_s is given twice",
    ),
    Mistake("a fault before the drive", "simulate x --duration 20 --puncture rl --at -4", 2, "--at -4"),
    Mistake("a gain for a loss", "simulate x --duration 20 --leak rl --loss-percent -3", 2, "negative"),
    Mistake("a pace for a folder", "simulate x --duration 20 --speed-up 4", 2, "--live"),
    Mistake("a terminal for a folder", "simulate x --duration 20 --pty p", 2, "--live"),
    Mistake("a drive and a daemon", "explain d --socket s", 2, "not both"),
    Mistake("a configuration of no car", "init --write x.toml", 2, "--car"),
    Mistake("a misspelt interface to record", "record r --interface sokcetcan", 2, "socketcan"),
    Mistake("a negative baud rate", "record r --interface virtual --baud -9600", 2, "--baud -9600"),
    Mistake("a misspelt drive for a fleet", "fleet add store nowhere", 3, "nowhere: no drive folder"),
    Mistake("a fleet that is none", "fleet status d", 2, "no store of tpmsd fleet"),
    Mistake("an unknown effect asked for", "effects centrifugal", 2, "centrifugal_growth"),
    Mistake("an unknown method", "replay d --method kalman", 2, "kalman"),
    # files that are not there, or others than meant
    Mistake("no such drive", "replay nowhere", 3, "no such drive folder"),
    Mistake("a file for a folder", f"replay {LOG}", 3, "not a folder"),
    Mistake(
        "an empty folder",
        "replay empty",
        2,
        "a drive folder holds its vehicle.toml",
        lambda here: (here / "empty").mkdir(),
    ),
    Mistake("no configuration", "replay d", 2, "vehicle.toml", remove(TOML)),
    Mistake("no DBC", "replay d", 2, "bus.dbc", remove(DBC)),
    Mistake("a folder for the DBC", "check d", 2, "not a file", folder(DBC)),
    Mistake("a folder for the CAN log", "replay d", 3, "d/can.log: not a file", folder(LOG)),
    Mistake("a folder for the receiver's log", "replay d", 3, "d/gnss.nmea: not a file", folder(NMEA)),
    Mistake("the same to discover", "discover d", 3, "d/gnss.nmea: not a file", folder(NMEA)),
    Mistake("a receiver's log that leads to itself", "replay d", 3, "d/gnss.nmea: not a file", loop(NMEA)),
    Mistake("a pipe for the receiver's log", "replay d", 3, "d/gnss.nmea: not a file", pipe(NMEA)),
    Mistake(
        "a pipe for the configuration", "check d", 2, "d/vehicle.toml: cannot be read: a pipe", pipe(TOML)
    ),
    Mistake(
        "a pipe for the model", "replay d --model m.toml", 2, "m.toml: cannot be read: a pipe", pipe("m.toml")
    ),
    Mistake("a DBC in UTF-16", "check d", 2, "not a bus description", recoded(DBC, "utf-16")),
    Mistake("a CAN log in UTF-16", "replay d", 3, "no CAN frame in it", recoded(LOG, "utf-16")),
    Mistake("a configuration in Latin-1", "check d", 2, ":35: not UTF-8", latin_1_comment),
    Mistake("logs exchanged", "replay d", 3, "d/can.log:1: no CAN frame", lambda here: _exchanged(here)),
    Mistake("a plain log named .gz", "replay d", 3, "Not a gzipped file", lambda here: _renamed_gz(here)),
    Mistake("two drives to replay", "replay d d", 2, "unrecognized argument: d"),
    Mistake("a drive twice", "diagnose d d", 2, "given twice"),
    Mistake("no CAN log", "replay d", 3, "no CAN log", remove(LOG)),
    Mistake("two CAN logs", "replay d", 3, "more than one CAN log", write("d/can.asc", b"x")),
    Mistake("an empty CAN log", "replay d", 3, "empty", write(LOG)),
    Mistake("a picture for a CAN log", "replay d", 3, "no CAN frame", write(LOG, b"\x89PNG\r\n\x1a\n" * 50)),
    Mistake("a DBC that is none", "check d", 2, "bus.dbc", write(DBC, b"{}")),
    Mistake("a model that is none", "replay d --model m.toml", 2, "m.toml", write("m.toml", b"x = 1\n")),
    Mistake("no such model", "replay d --model m.toml", 2, "m.toml"),
    Mistake("a drive as configuration of nothing", "calibrate d --config nowhere.toml", 2, "nowhere.toml"),
    # configurations
    Mistake("TOML with a slip of the pen", "check d", 2, "vehicle.toml:", edit(TOML, "[can]", "[can")),
    Mistake(
        "millimetres for metres",
        "check d",
        2,
        "m, not mm",
        edit(TOML, "wheel_radius_m = 0.316", "wheel_radius_m = 316"),
    ),
    Mistake(
        "a key twice", "check d", 2, ":5: ", edit(TOML, "wheelbase_m", "track_rear_m = 1.5\nwheelbase_m")
    ),
    Mistake("a signal for two wheels", "check d", 2, "already", edit(TOML, "WHEELS.CNT_FR", "WHEELS.CNT_FL")),
    Mistake("an endless number", "check d", 2, "thousands of digits", edit(TOML, "1.52", "9" * 5000)),
    Mistake("a negative radius", "check d", 2, "-0.316", edit(TOML, "= 0.316", "= -0.316")),
    Mistake("a misspelt key", "check d", 2, "wheelbase_m", edit(TOML, "wheelbase_m", "weelbase_m")),
    Mistake("a misspelt signal", "check d", 2, "CNT_FL", edit(TOML, "WHEELS.CNT_FL", "WHEELS.CNT_F")),
    Mistake(
        "a message that is not there", "check d", 2, "WHEELS", edit(TOML, "WHEELS.CNT_FL", "WHEEL.CNT_FL")
    ),
    Mistake("a missing table", "check d", 2, "[vehicle]", edit(TOML, "[vehicle]", "[vehicel]")),
    Mistake("front wheels alone", "check d", 2, "rl and rr alone", lambda here: _front_alone(here)),
    Mistake(
        "an interface that is not there", "check d", 2, "socketcan", edit(TOML, '"socketcan"', '"soketcan"')
    ),
    Mistake(
        "a quoted number",
        "check d",
        2,
        "without quotes",
        edit(TOML, "track_rear_m = 1.52", 'track_rear_m = "1.52"'),
    ),
    Mistake("an address as a device", "check d", 2, "source", edit(TOML, "/dev/ttyACM0", "gpsd://localhost")),
    Mistake(
        "a speed without a known unit",
        "check d",
        2,
        "furlong",
        edit(
            TOML,
            FL,
            FL.replace('"WHEELS.CNT_FL"', '{ signal = "WHEELS.CNT_FL", unit = "furlong" }').replace(
                "count", "speed"
            ),
        ),
    ),
    # outputs
    Mistake("a JSON into no folder", "replay d --json nowhere/x.json", 1, "there is no folder nowhere"),
    Mistake("a JSON where a folder is", "replay d --json d", 1, "a folder"),
    Mistake("a picture of an unknown kind", "replay d --plot x.bmp", 2, ".png"),
    Mistake(
        "an output where no file can be made",
        "calibrate d --write /proc/x",
        1,
        "--write /proc/x: cannot be written",
    ),
    Mistake("a full disk", "replay d --json /dev/full", 1, "/dev/full"),
    Mistake("a table over the recording", f"replay d --csv {LOG}", 1, "a recording is there"),
    Mistake("a report over the receiver's log", f"replay d --json {NMEA}", 1, "a recording is there"),
    Mistake("a report over the configuration", f"check d --json {TOML}", 1, "a configuration is there"),
    Mistake("a model over a configuration", f"diagnose d --model-out {TOML}", 1, "a configuration is there"),
    Mistake("a page over the DBC", f"replay d --html {DBC}", 1, "a DBC is there"),
    Mistake("a folder for a configuration", "discover d --force --write d", 2, "d: a folder; the name"),
    Mistake("a file in no folder", "discover d --write no/v.toml", 2, "no/v.toml: there is no folder no"),
    Mistake("a folder for a car's file", "init --car vw_mqb --force --write d", 2, "d: a folder; the name"),
    Mistake("a folder for the state", "run --config d --state d --duration 1", 2, "d: a folder"),
    Mistake("a drive where another is", "simulate d --duration 20", 2, "--force"),
    Mistake(
        "a folder of somebody's",
        "simulate mine --duration 20 --force",
        2,
        "mine",
        lambda here: _somebodys(here),
    ),
    # drives that cannot do what is wanted
    Mistake("too short to calibrate", "calibrate d", 3, "45 s"),
    Mistake("no fix at all", "calibrate d", 3, "fix", write(NMEA, b"(1719820800.000000) $GNZDA\n")),
    Mistake("no daemon", "status --socket nowhere.sock", 1, "is tpmsd running?"),
    Mistake("no daemon to reset", "reset --socket nowhere.sock", 1, "is tpmsd running?"),
    # names and links
    Mistake("a name too long", f"replay {'x' * 5000}", 1, "File name too long"),
    Mistake("a name with a line end", "replay no\x01such", 2, r"'no\x01such': names and values"),
    Mistake("a link that leads nowhere", "replay link", 3, "link: no such drive folder", link("nowhere")),
    Mistake("a link that leads to itself", "replay link", 3, "link: no such drive folder", link("link")),
    Mistake("a link to a file", "replay link", 3, "not a folder", link(LOG)),
    Mistake("a file where the new drive goes", f"simulate {LOG} --duration 20", 2, "not a folder"),
    Mistake("a drive below a file", f"simulate {LOG}/x --duration 20", 1, "Not a directory"),
    Mistake("an empty receiver's log", "replay d", 3, "gnss.nmea: holds no line", write(NMEA)),
    Mistake("an empty configuration", "replay d", 2, "no wheel signals", write(TOML)),
    Mistake("an empty DBC", "replay d", 2, "not a bus description", write(DBC)),
    Mistake("one file for two outputs", "replay d --json x --csv x", 1, "goes there already"),
    Mistake("a table that is none", "import d/can.log out", 3, "not a known kind of table"),
    Mistake("an effect to plan that is none", "plan gnss_latenzy", 2, "gnss_latency"),
    Mistake("a port that is none", "web d --port 99999", 2, "0 to 65535"),
)


def _front_alone(here: Path) -> None:
    text = (here / TOML).read_text()
    lines = [line for line in text.splitlines() if not line.startswith(("wheel_count_rl", "wheel_count_rr"))]
    (here / TOML).write_text("\n".join(lines) + "\n")


def _somebodys(here: Path) -> None:
    (here / "mine").mkdir()
    (here / "mine" / "thesis.txt").write_text("years of work")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A drive of 30 s."""
    folder = tmp_path_factory.mktemp("made") / "d"
    assert 0 == main(["simulate", str(folder), "--duration", "30"])
    return folder


def contents(folder: Path) -> dict[str, bytes]:
    """Every file below, by its path."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_there_are_a_hundred() -> None:
    """And no two have one name."""
    assert len({mistake.name for mistake in MISTAKES}) == len(MISTAKES) >= 100


@pytest.mark.parametrize("mistake", MISTAKES, ids=lambda mistake: mistake.name)
def test_a_mistake_ends_in_one_line_and_loses_nothing(
    mistake: Mistake,
    made: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The exit code, a line that says what it is about, no traceback, and every file as it was."""
    shutil.copytree(made, tmp_path / "d")
    mistake.setup(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(text_file, "PIPE_PATIENCE_S", 0.2)
    before = contents(tmp_path)
    code = main(mistake.command.split())
    said = capsys.readouterr()

    assert (mistake.code, True) == (code, mistake.says in said.err), said.err
    assert "Traceback" not in said.err + said.out
    assert "internal error" not in said.err
    assert before == contents(tmp_path)
    assert not (tmp_path / "store").exists()


def tpmsd(*arguments: str, **more: object) -> subprocess.CompletedProcess[str]:
    """A process of its own, where the terminal matters."""
    return subprocess.run([sys.executable, "-m", "tpmsd", *arguments], text=True, **more)  # type: ignore[call-overload,no-any-return]


def test_head_closes_the_pipe_without_a_word(made: Path) -> None:
    """`tpmsd check d | head -1`: exit code 0 and nothing on standard error."""
    script = f"{sys.executable} -m tpmsd check {made} | head -n 1; echo ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True)

    assert ("0", "") == (done.stdout.splitlines()[-1], done.stderr)


@pytest.mark.parametrize("command", ["check {}", "replay {} --json -"])
def test_a_full_disk_under_standard_output_is_one_line(made: Path, command: str) -> None:
    """`tpmsd check d > /dev/full`: exit code 1, and that it is the output that could not be written."""
    with Path("/dev/full").open("w") as full:
        done = tpmsd(*command.format(made).split(), stdout=full, stderr=subprocess.PIPE)

    assert (1, "tpmsd: standard output: No space left on device\n") == (done.returncode, done.stderr)


@pytest.mark.parametrize("columns", ["20", "40", "60"])
def test_a_narrow_terminal_wraps_the_help(
    columns: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Help and usage of a wrong option fit into 60 columns; narrower ones are no error."""
    monkeypatch.setenv("COLUMNS", columns)
    assert 0 == main(["check", "--help"])
    text = capsys.readouterr().out

    assert columns != "60" or [] == [line for line in text.splitlines() if len(line) > 60]


def test_no_standard_output_and_no_terminal(made: Path) -> None:
    """Closed standard output and input are no traceback."""
    done = subprocess.run(
        ["bash", "-c", f"{sys.executable} -m tpmsd check {made} <&- >&-"], capture_output=True, text=True
    )

    assert "Traceback" not in done.stderr
    assert done.returncode in (0, 1)


def test_a_locale_without_the_characters(made: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An ASCII terminal shows what it can."""
    environment = {**os.environ, "LC_ALL": "C", "PYTHONIOENCODING": "ascii", "PYTHONUTF8": "0"}
    done = tpmsd("replay", str(made), env=environment, capture_output=True)

    assert 0 == done.returncode, done.stderr


def test_control_c_is_exit_code_130(monkeypatch: pytest.MonkeyPatch, made: Path) -> None:
    """An interrupt in the middle of a command: no traceback, the shells' code, nothing half written."""

    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("tpmsd.interfaces.cli.check.run", interrupted)
    said = io.StringIO()
    monkeypatch.setattr(sys, "stderr", said)

    assert 130 == main(["check", str(made)])
    assert "tpmsd: interrupted\n" == said.getvalue()
