"""JSON and progress output."""

from __future__ import annotations

import enum
import io
import json
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tpmsd.foundation.errors import TpmsdError
from tpmsd.foundation.plain import plain
from tpmsd.interfaces.cli.output import Progress, dumps, write_json
from tpmsd.interfaces.cli.output_files import Outputs
from tpmsd.interfaces.cli.terminal_lines import fitted_to


class _Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


class _Clock:
    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


class _Colour(enum.Enum):
    RED = "red"


@dataclass(frozen=True)
class _Record:
    radius_m: float
    file: Path


def test_records_arrays_and_odd_numbers() -> None:
    """Records become objects, arrays lists, and what JSON cannot hold null."""
    value = {
        "record": _Record(math.nan, Path("a/b")),
        "array": np.array([[1.0, np.inf], [np.nan, 2.0]]),
        "scalars": (np.float64(0.5), np.int32(7), np.bool_(True), np.float32(-np.inf)),
        "colour": _Colour.RED,
        3: None,
    }
    expected = {
        "record": {"radius_m": None, "file": "a/b"},
        "array": [[1.0, None], [None, 2.0]],
        "scalars": [0.5, 7, True, None],
        "colour": "red",
        "3": None,
    }
    assert expected == json.loads(dumps(value))


def test_refuses_what_is_no_data() -> None:
    """An object of no known kind is a defect, not silently a text."""
    with pytest.raises(TypeError, match="object"):
        plain(object())


@given(st.recursive(st.floats() | st.integers() | st.text(), lambda inner: st.lists(inner, max_size=4)))
@settings(derandomize=True, deadline=None)
def test_always_strict_json(value: object) -> None:
    """Whatever the numbers, a strict parser reads the text."""

    def refuse(constant: str) -> None:
        raise AssertionError(constant)

    json.loads(dumps(value), parse_constant=refuse)


def test_write_to_file_and_stdout(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A name is a file, '-' is standard output; both end with a line end."""
    write_json({"a": 1}, str(tmp_path / "a.json"))
    write_json({"a": 1}, "-")
    out = capsys.readouterr().out
    assert '{\n  "a": 1\n}\n' == out == (tmp_path / "a.json").read_text()


def test_a_failed_report_leaves_the_old_file(tmp_path: Path) -> None:
    """What cannot be made JSON does not empty the file that was there."""
    file = tmp_path / "a.json"
    file.write_text("old")
    with pytest.raises(TypeError):
        write_json(object(), str(file))
    assert file.read_text() == "old"


def test_write_errors(tmp_path: Path) -> None:
    """A target that cannot be written is one line with the system's reason."""
    with pytest.raises(TpmsdError, match="a folder; the name of a file is wanted") as caught:
        write_json({}, str(tmp_path))
    assert caught.value.exit_code == 1


def test_progress_on_a_terminal() -> None:
    """The bar shows share and speed, redraws ten times a second at most, and goes away."""
    terminal, clock = _Terminal(), _Clock()
    with Progress(100.0, "replay", terminal, clock) as progress:
        progress.update(0.0)
        clock.now += 0.05
        progress.update(10.0)  # too soon
        clock.now += 1.95
        progress.update(50.0)
    lines = terminal.getvalue().split("\r")
    assert lines[1] == f"replay [{'.' * 28}]   0%"
    assert lines[2] == f"replay [{'#' * 14}{'.' * 14}]  50%  25x real time, 0:02 left"
    assert (lines[3].strip(), lines[4], len(lines)) == ("", "", 5)


@pytest.mark.parametrize("columns", [40, 70, 200])
def test_text_and_bar_fit_into_the_terminal(columns: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Lines end between words, rows hang below their second column, colours run on; the bar is one line."""
    monkeypatch.setenv("COLUMNS", str(columns))
    words = " ".join(f"word{k}" for k in range(40))
    text = f"\x1b[32m{words}\x1b[0m\n\n  fl       {words}\n  a-long-name-of-a-key-beyond-half: {words}"
    lines = fitted_to(_Terminal(), text).split("\n")
    plain = [line.replace("\x1b[32m", "").replace("\x1b[0m", "") for line in lines]
    assert max(map(len, plain)) <= columns
    assert text.replace("\x1b[32m", "").replace("\x1b[0m", "").split() == " ".join(plain).split()
    assert (1, 1) == ("\n".join(lines).count("\x1b[32m"), "\n".join(lines).count("\x1b[0m"))
    row = plain.index("") + 1
    assert plain[row].startswith("  fl       word0")
    assert plain[row + 1].startswith(" " * 11 + "word")
    assert text == fitted_to(io.StringIO(), text)

    terminal, clock = _Terminal(), _Clock()
    with Progress(1000.0, "a drive with a long name", terminal, clock) as progress:
        clock.now += 10.0
        progress.update(500.0)
    assert max(map(len, terminal.getvalue().split("\r"))) < columns


def test_reports_of_all_commands_fit_into_the_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    """`diagnose`, `replay`, `explain` and `calibrate` print through `Outputs.say`."""
    monkeypatch.setenv("COLUMNS", "40")
    terminal = _Terminal()
    monkeypatch.setattr("sys.stdout", terminal)
    Outputs(("--json", None)).say("\n".join(["a sentence that is longer than forty columns are"] * 2))
    lines = terminal.getvalue().splitlines()
    assert 4 == len(lines)
    assert max(map(len, lines)) <= 40


def test_progress_of_a_share_states_no_rate() -> None:
    """Work that is no drive shows its share alone; a drive slower than real time shows no rate of zero."""
    assert f"diagnose [{'#' * 14}{'.' * 14}]  50%" == Progress(1.0, "diagnose", rate=False).text(0.5, 40.0)
    assert Progress(1000.0, "replay").text(10.0, 40.0).endswith("0.25x real time, 66:00 left")


def test_progress_off_a_terminal() -> None:
    """Nothing is drawn into files and pipes."""
    stream = io.StringIO()
    with Progress(100.0, "replay", stream) as progress:
        progress.update(50.0)
    assert stream.getvalue() == ""


@pytest.mark.parametrize(
    ("total", "done", "share"),
    [(0.0, 5.0, "  0%"), (math.nan, 5.0, "  0%"), (10.0, 12.0, "100%"), (10.0, -1.0, "  0%")],
)
def test_progress_of_odd_totals(total: float, done: float, share: str) -> None:
    """A total that is unknown or wrong makes no bar run over."""
    line = Progress(total, "x", _Terminal()).text(done, 0.0)
    assert line.endswith(share)
    assert line.count("#") + line.count(".") == 28


def test_progress_on_a_terminal_that_went_away() -> None:
    """A closed terminal ends the bar, not the work."""
    terminal = _Terminal()
    progress = Progress(10.0, "x", terminal)
    terminal.close()
    progress.update(1.0)
    progress.close()
