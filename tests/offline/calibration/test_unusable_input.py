"""Damaged recordings and wrong files: used where they can be, else refused with one line."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tpmsd.interfaces.cli.main import main

Damage = Callable[[Path], None]


def cut(name: str, share: float) -> Damage:
    """The file ends in the middle of a line."""

    def damage(folder: Path) -> None:
        data = (folder / name).read_bytes()
        (folder / name).write_bytes(data[: int(share * len(data))])

    return damage


def noise(name: str) -> Damage:
    """The file holds bytes without sense."""

    def damage(folder: Path) -> None:
        (folder / name).write_bytes(np.random.default_rng(1).bytes(20_000))

    return damage


def changed(name: str, pattern: str, by: str) -> Damage:
    """Every match in the file is replaced."""

    def damage(folder: Path) -> None:
        text = (folder / name).read_text()
        assert re.search(pattern, text, re.M)
        (folder / name).write_text(re.sub(pattern, by, text, flags=re.M))

    return damage


def gone(name: str) -> Damage:
    return lambda folder: (folder / name).unlink()


@pytest.mark.parametrize(
    ("damage", "code", "says"),
    [
        (cut("can.log", 0.2), 3, "no readings of wheel rl rr in most of it"),
        (cut("can.log", 0.0), 3, "can.log"),
        (noise("can.log"), 3, "can.log"),
        (gone("can.log"), 3, "no CAN log"),
        (cut("gnss.nmea", 0.0), 3, "holds no line"),
        (cut("gnss.nmea", 0.05), 3, "too few fixes"),
        (gone("gnss.nmea"), 3, "no position fixes"),
        (changed("gnss.nmea", r"\*..$", "*ZZ"), 3, "no position fixes"),
        (changed("bus.dbc", r"^BO_ (\d)", r"BO_ 1\1"), 3, "wrong DBC or log"),
        (changed("bus.dbc", "CNT_RL", "SOMETHING"), 2, "CNT_RL"),
        (noise("bus.dbc"), 2, "not a bus description"),
        (changed("vehicle.toml", r"^teeth_per_rev.*$", "teeth_per_rev = -1"), 2, "teeth_per_rev"),
        (cut("vehicle.toml", 0.1), 2, "vehicle.toml"),
    ],
)
def test_unusable_input_is_refused_in_one_line(
    town: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], damage: Damage, code: int, says: str
) -> None:
    """Exit code 3 for an unusable drive, 2 for a configuration; the last line says which and why."""
    folder = Path(shutil.copytree(town, tmp_path / "copy"))
    damage(folder)

    found = main(["calibrate", str(folder)])
    lines = capsys.readouterr().err.strip().splitlines()

    assert (code, True) == (found, bool(re.search(says, lines[-1])))
    assert lines[-1].startswith(f"tpmsd: {folder}")
    assert "Traceback" not in "".join(lines)


def test_bad_lines_in_between_do_no_harm(
    town: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Garbage, torn and repeated lines are skipped and said; the radii come out all the same."""
    folder = Path(shutil.copytree(town, tmp_path / "copy"))
    rng = np.random.default_rng(2)
    for name in ("can.log", "gnss.nmea"):
        lines = (folder / name).read_bytes().splitlines(keepends=True)
        for at in rng.choice(len(lines), len(lines) // 100, replace=False):
            kind = int(rng.integers(3))
            line = lines[at]
            lines[at] = (rng.bytes(30) + b"\n", line[: len(line) // 2] + b"\n", line * 2)[kind]
        (folder / name).write_bytes(b"".join(lines)[:-9])

    assert 0 == main(["calibrate", str(folder)])
    said = capsys.readouterr()
    radii = [float(x) for x in re.findall(r"mm +([0-9.]+) \+- ", said.out)]

    assert [318.0, 315.0] == pytest.approx(radii, abs=0.6)
    assert 2 == len(re.findall(r"bad lines? skipped, first", said.err))
