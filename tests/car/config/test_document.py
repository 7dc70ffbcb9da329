"""Files that cannot be read at all."""

from __future__ import annotations

import os
import threading
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.car.config.conftest import Make
from tests.car.config.test_load import problems_of
from tpmsd.car.config.document import read_document
from tpmsd.car.config.load import load_config
from tpmsd.car.config.problems import ConfigProblems


@pytest.mark.parametrize(
    ("content", "line", "text"),
    [
        (b"a = 1\nb = \n", 2, "not valid TOML: Invalid value (column 5)"),
        (b"[vehicle]\nx = 1\nx = 2\ny = 3\n", 3, "not valid TOML: Cannot overwrite a value (column 6)"),
        (b'[a]\nx = """\n\n', 3, "not valid TOML: Unterminated string (end of file)"),
        (b"[a]\n\n\xff\xfe = 1\n", 3, "not UTF-8 text (byte 0xFF)"),
        (bytes(range(256)), 2, "not UTF-8 text (byte 0x80)"),
        (b"\x00\x00\x00", 1, "not valid TOML: Invalid statement (column 1)"),
        (b"a = " + b"[" * 5000, None, "arrays or tables are nested too deeply"),
        (b"a = " + b"1" * 5000, None, "a number of thousands of digits"),
        (b"#" * (1 << 20) + b"\n", None, "longer than 1048576 bytes: this is no configuration"),
    ],
)  # fmt: skip
def test_unreadable_content(tmp_path: Path, content: bytes, line: int | None, text: str) -> None:
    """Content that is no TOML is one problem with the parser's own line."""
    path = tmp_path / "v.toml"
    path.write_bytes(content)
    (problem,) = problems_of(path)
    where = f"{path}:{line}" if line else str(path)
    assert f"{where}: {text}" == problem.text


def test_empty_file(tmp_path: Path) -> None:
    """An empty file says what a configuration needs."""
    path = tmp_path / "v.toml"
    path.write_bytes(b"")
    keys = {problem.key for problem in problems_of(path)}
    assert keys == {"[vehicle] wheel_radius_m", "[vehicle] track_rear_m", "[can.signals]", "[can] dbc"}


def test_missing_file(tmp_path: Path) -> None:
    """A file that is not there is one line."""
    (problem,) = problems_of(tmp_path / "gone.toml")
    assert f"{tmp_path / 'gone.toml'}: no such file" == problem.text


def test_folder_without_configuration(tmp_path: Path) -> None:
    """A folder that is no drive folder is told what it lacks."""
    (problem,) = problems_of(tmp_path)
    expected = f"{tmp_path / 'vehicle.toml'}: no such file (a drive folder holds its vehicle.toml)"
    assert expected == problem.text


def test_folder_named_as_the_file(tmp_path: Path) -> None:
    """A folder in the place of the file cannot be read as one."""
    (tmp_path / "vehicle.toml").mkdir()
    (problem,) = problems_of(tmp_path)
    assert problem.text == f"{tmp_path / 'vehicle.toml'}: cannot be read: Is a directory"


def test_drive_folder(make: Make) -> None:
    """A drive folder stands for its vehicle.toml."""
    path = make()
    assert load_config(path) == load_config(path.parent)


@pytest.mark.skipif(os.geteuid() == 0, reason="root reads everything")
def test_no_permission(make: Make) -> None:
    """A file that may not be read is one line with the system's reason."""
    path = make()
    path.chmod(0)
    (problem,) = problems_of(path)
    assert f"{path}: cannot be read: Permission denied" == problem.text


def test_device_without_end() -> None:
    """A device that never ends is given up after a megabyte."""
    (problem,) = problems_of(Path("/dev/zero"))
    assert problem.what == "longer than 1048576 bytes: this is no configuration"


def test_zero_byte_in_path() -> None:
    """A path that no system has is one line, its control character made visible."""
    (problem,) = problems_of(Path("a\0b"))
    assert problem.text == "a\\x00b: cannot be read: embedded null byte"


def test_pipe(make: Make, tmp_path: Path) -> None:
    """A configuration may come through a pipe, as shells' <(...) gives it."""
    content = make().read_bytes()
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    writer = threading.Thread(target=pipe.write_bytes, args=(content,))
    writer.start()
    config = load_config(pipe)
    writer.join()
    assert config.vehicle.wheelbase_m == 2.63


def test_byte_order_mark_and_windows_line_ends(make: Make) -> None:
    """What Windows editors add changes nothing, line numbers neither."""
    path = make(("0.316", "3.16"))
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes().replace(b"\n", b"\r\n"))
    (problem,) = problems_of(path)
    assert problem.line == 2


@given(st.binary(max_size=80))
@settings(
    derandomize=True,
    deadline=None,
    max_examples=300,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
def test_any_bytes(tmp_path: Path, content: bytes) -> None:
    """No content ends in anything but a document or problems."""
    path = tmp_path / "any.toml"
    path.write_bytes(content)
    try:
        read_document(path)
    except ConfigProblems as error:
        (problem,) = error.problems
        assert 1 <= (problem.line or 1) <= content.count(b"\n") + 1
