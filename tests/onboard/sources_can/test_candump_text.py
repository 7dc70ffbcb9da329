"""Blocks of candump lines against the line parser, which reads one line at a time."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tpmsd.onboard.sources.can import candump_text
from tpmsd.onboard.sources.can.candump_line import parse_candump_line
from tpmsd.onboard.sources.can.candump_text import parse_lines
from tpmsd.onboard.sources.can.frame import CanFrame
from tpmsd.onboard.sources.can.log import read_can_log
from tpmsd.onboard.sources.can.log_candump import MAX_LINE_CHARS

Read = tuple[list[CanFrame], list[tuple[int, str]]]

STAMPS = st.one_of(
    st.from_regex(r"[0-9]{10}\.[0-9]{6}", fullmatch=True),
    st.from_regex(r"[0-9]{1,12}\.[0-9]{1,9}", fullmatch=True),
)
DATA = st.one_of(
    st.from_regex(r"#[0-9A-Fa-f]{16}", fullmatch=True),
    st.from_regex(r"#([0-9A-F]{2}){0,8}(_[0-9A-F])?", fullmatch=True),
    st.from_regex(r"##[0-9A-F]([0-9A-F]{2}){0,64}", fullmatch=True),
    st.from_regex(r"#R[0-9A-F]?", fullmatch=True),
)
IDENTIFIERS = st.from_regex(r"[0-9A-Fa-f]{3}|[0-9A-Fa-f]{8}", fullmatch=True)
GOOD = st.builds(
    lambda stamp, channel, identifier, data, tail: f"({stamp}) {channel} {identifier}{data}{tail}",
    STAMPS,
    st.sampled_from(["can0", "can1", "vcan10", "a#b"]),
    IDENTIFIERS,
    DATA,
    st.sampled_from(["", "", " R", " T", "  "]),
)
DAMAGED = st.builds(
    lambda line, place, character: line[: place % len(line)] + character + line[place % len(line) + 1 :],
    GOOD,
    st.integers(0, 400),
    st.characters(max_codepoint=255, exclude_characters="\n\r"),
)
LINES = st.lists(st.one_of(GOOD, GOOD, DAMAGED, st.text(max_size=12, alphabet="(). #0aR\t\x0c")), max_size=30)


def one_by_one(lines: list[str]) -> Read:
    """By the line parser."""
    frames, bad = [], []
    for number, line in enumerate(lines, 1):
        frame = parse_candump_line(line, number)
        if frame is not None:
            frames.append(frame)
        elif line.strip():
            bad.append((number, line))
    return frames, bad


def by_templates(lines: list[str]) -> Read:
    """All of them by templates and the line parser, as where nothing is compiled."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(candump_text, "compiled", None)
        return at_once(lines)


def at_once(lines: list[str]) -> Read:
    """By compiled code where it was built, by templates, by the line parser."""
    bad: list[tuple[int, str]] = []
    text = "".join(f"{line}\n" for line in lines)
    return list(parse_lines(text, 1, lambda number, line: bad.append((number, line))).frames()), bad


@settings(derandomize=True, deadline=None)
@given(LINES)
def test_lines_at_once_are_lines_one_by_one(lines: list[str]) -> None:
    """Whatever the lines are, frames, line numbers and lines that are none are the line parser's."""
    if lines:
        assert one_by_one(lines) == at_once(lines) == by_templates(lines)


@settings(derandomize=True, deadline=None)
@given(GOOD, st.lists(st.tuples(st.integers(0, 400), st.characters(max_codepoint=127)), max_size=20))
def test_lines_equal_but_for_one_character(line: str, changes: list[tuple[int, str]]) -> None:
    """Of many lines of one shape those that differ in a place that matters are told apart."""
    lines = [line] * 3
    for place, character in changes:
        if character not in "\n\r":
            at = place % len(line)
            lines.append(line[:at] + character + line[at + 1 :])
    assert one_by_one(lines) == at_once(lines) == by_templates(lines)


@pytest.mark.parametrize(
    "stamp",
    ["1719820800.012345678", "999999999999.999999999", "9999999999.999999", "18446744073.709551616", "0.1"],
)
def test_stamps_are_those_of_float(stamp: str) -> None:
    """Nanoseconds since 1970 have more digits than a double: they are rounded as Python rounds them."""
    for read in (at_once, by_templates):
        ((frame,), bad) = read([f"({stamp}) can0 123#00"])
        assert ([], float(stamp)) == (bad, frame.time_s)


def test_more_shapes_and_templates_than_are_read_together() -> None:
    """Lines beyond the limits of what is read together are read all the same."""
    lines = [
        f"({'1' * k}.{'5' * d}) can{k} 123#{'AB' * n}" for k in range(1, 12) for d in (1, 9) for n in range(9)
    ]
    lines += [f"(1.5) c{letter} 123#11" for letter in "abcdefghijklmnopqrstuvwxyz"]
    assert one_by_one(lines) == at_once(lines) == by_templates(lines)


def test_compiled_code_reads_the_common_lines_alone() -> None:
    """Of the first line's channel it reads classic data frames; arrays that do not fit it refuses."""
    if candump_text.compiled is None:
        pytest.skip("it is not built here (no compiler, or no headers of Python)")
    others = ["(1.5) can1 123#11", "(1.5) can0 123##011", "(1.5) can0 20000001#00", "(1.5) can0 800#00", "x"]
    text = "".join(f"{line}\n" for line in ["(1.5) can0 1F3#aB01", *others, "(2.25) can0 1ABCDEF0#"])
    rows = candump_text._LineTable(7)
    arrays = (rows.found, rows.time_s, rows.identifier, rows.size, rows.data)
    assert 2 == candump_text.compiled.lines(text.encode(), b"can0", *arrays)
    assert ([0, 6], [1.5, 2.25]) == (np.flatnonzero(rows.found).tolist(), rows.time_s[rows.found].tolist())
    assert ([0x1F3, 0x9ABCDEF0], [2, 0]) == (
        rows.identifier[rows.found].tolist(),
        rows.size[rows.found].tolist(),
    )
    assert b"\xab\x01" == rows.data[0, :2].tobytes()
    with pytest.raises(ValueError, match="do not belong together"):
        candump_text.compiled.lines(text.encode(), b"can0", *arrays[:-1], rows.data[:6])


@pytest.mark.parametrize("ending", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("last", ["", "end"])
def test_line_ends_of_all_systems(tmp_path: Path, ending: str, last: str) -> None:
    """A file is read alike with the line ends of any system, with and without one behind the last line."""
    lines = [f"({k}.250000) can0 0B0#{k:02X}" for k in range(1, 99)]
    path = tmp_path / "can.log"
    path.write_bytes((ending.join(lines) + (ending if last else "")).encode("ascii"))
    assert one_by_one(lines)[0] == list(read_can_log(path))


@pytest.mark.parametrize("blanks", [0, MAX_LINE_CHARS - 40, MAX_LINE_CHARS, 3 * MAX_LINE_CHARS])
def test_long_lines_are_cut_where_the_line_reader_cuts_them(tmp_path: Path, blanks: int) -> None:
    """Frames before and behind a line longer than the limit are read; its number is one."""
    path = tmp_path / "can.log"
    good = "(1.000000) can0 0B0#11\n"
    path.write_text(good * 3 + "x" * blanks + "\n" + good * 2, "ascii")
    bad: list[int] = []
    frames = list(read_can_log(path, lambda number, _: bad.append(number)))
    assert ([1, 2, 3, 5, 6], [4] if blanks else []) == ([frame.line for frame in frames], bad)


def test_a_damaged_archive_gives_what_stands_before_the_damage(tmp_path: Path) -> None:
    """Of a compressed log that is cut short the same lines are read as one by one, and the cut is noted."""
    text = "".join(f"({k}.000000) can0 0B0#{k % 251:02X}{k * 7919 % 65536:04X}\n" for k in range(120_000))
    path = tmp_path / "can.log.gz"
    path.write_bytes(gzip.compress(text.encode("ascii"))[:400_000])
    bad: list[tuple[int, str]] = []
    frames = list(read_can_log(path, lambda *said: bad.append(said)))
    expected, _ = one_by_one(text.splitlines()[: len(frames)])
    assert expected == frames and len(frames) > 50_000
    assert "the compressed file is cut short" == bad[-1][1]
