"""Reading of CAN logs: every format, and what is left of damaged ones."""

from __future__ import annotations

import gzip
import math
import sys
from collections.abc import Callable
from datetime import datetime
from pathlib import Path

import can
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tpmsd.foundation.errors import InputError
from tpmsd.onboard.sources.can.candump_line import parse_candump_line
from tpmsd.onboard.sources.can.log import CanFrame, find_can_log, read_can_log
from tpmsd.onboard.sources.can.log_lines import asc_date_s

START_S = 1719820800.012

Bad = list[tuple[int, str]]


def read(path: Path) -> tuple[list[CanFrame], Bad]:
    """All frames of a log, and what was said of bad lines."""
    bad: Bad = []
    frames = list(read_can_log(path, lambda line, reason: bad.append((line, reason))))
    return frames, bad


def messages() -> list[can.Message]:
    """Standard, extended, remote and empty frames, 10 ms apart."""
    out = []
    for step in range(20):
        out.append(can.Message(timestamp=START_S + 0.01 * step, arbitration_id=0xB0, data=bytes([step] * 8)))
        out[-1].is_extended_id = False
    out.append(can.Message(timestamp=START_S + 0.2, arbitration_id=0x18FEF100, data=b"\x01\x02\x03"))
    out.append(can.Message(timestamp=START_S + 0.21, arbitration_id=0x123, is_extended_id=False, data=b""))
    for message in out:
        message.channel = 0
    return out


def write(path: Path, content: list[can.Message]) -> None:
    with can.Logger(str(path)) as logger:
        for message in content:
            logger(message)


@pytest.mark.parametrize("suffix", [".log", ".log.gz", ".asc", ".blf", ".trc", ".mf4"])
def test_every_format_gives_back_what_was_written(tmp_path: Path, suffix: str) -> None:
    """Identifiers, kinds and data are those written; times agree to a microsecond up to a constant."""
    if suffix == ".mf4":
        pytest.importorskip("asammdf")
    path = tmp_path / f"can{suffix}"
    write(path, messages())
    frames, bad = read(path)

    assert [] == bad
    assert [(m.arbitration_id, m.is_extended_id, bytes(m.data)) for m in messages()] == [
        (f.arbitration_id, f.is_extended, f.data) for f in frames
    ]
    expected = [m.timestamp - START_S for m in messages()]
    assert expected == pytest.approx([f.time_s - frames[0].time_s for f in frames], abs=2e-6)
    assert not any(f.is_fd or f.is_error or f.is_remote for f in frames)
    # The starts of ASC and BLF are in milliseconds.
    assert START_S == pytest.approx(frames[0].time_s, abs=1e-3)


@pytest.mark.parametrize("suffix", [".log", ".asc", ".blf", ".trc", ".mf4"])
def test_can_fd_frames_survive_in_every_format(tmp_path: Path, suffix: str) -> None:
    """64 bytes and the FD mark come back."""
    if suffix == ".mf4":
        pytest.importorskip("asammdf")
    path = tmp_path / f"can{suffix}"
    data = bytes(range(64))
    message = can.Message(
        timestamp=START_S, arbitration_id=0x1FFFFFFF, data=data, is_fd=True, bitrate_switch=True
    )
    if suffix == ".trc":
        # python-can's TRC writer knows no FD, so the file is PEAK's own form (file version 2.1).
        path.write_text(
            ";$FILEVERSION=2.1\n;$STARTTIME=45474.3333334722\n;$COLUMNS=N,O,T,B,I,d,R,L,D\n"
            f"1 0.000 FB 1 1FFFFFFF Rx - 15 {data.hex(' ')}\n"
        )
    else:
        write(path, [message])
    (frame,), bad = read(path)

    assert [] == bad
    assert (0x1FFFFFFF, True, True, data) == (
        frame.arbitration_id,
        frame.is_extended,
        frame.is_fd,
        frame.data,
    )


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        (
            "(1719820800.012345) can0 0B0#1122334455667788",
            CanFrame(
                1719820800.012345,
                "can0",
                0xB0,
                False,
                False,
                False,
                False,
                bytes.fromhex("1122334455667788"),
                1,
            ),
        ),
        ("(0.000000) vcan1 18FEF100#", CanFrame(0.0, "vcan1", 0x18FEF100, True, False, False, False, b"", 1)),
        ("(1.5) can0 123##1AABB T", CanFrame(1.5, "can0", 0x123, False, True, False, False, b"\xaa\xbb", 1)),
        ("(1.5) can0 123#R8", CanFrame(1.5, "can0", 0x123, False, False, False, True, b"", 1)),
        ("(1.5) can0 123#R", CanFrame(1.5, "can0", 0x123, False, False, False, True, b"", 1)),
        (
            "(1.5) can0 123#1122334455667788_E R",
            CanFrame(1.5, "can0", 0x123, False, False, False, False, bytes.fromhex("1122334455667788"), 1),
        ),
        (
            "(1.5) can0 20000080#00 ",
            CanFrame(1.5, "can0", 0x80, False, False, True, False, b"\0", 1)[:2] and None,
        ),
    ],
)
def test_candump_lines(line: str, expected: CanFrame | None) -> None:
    """Each form that candump -L writes is understood."""
    frame = parse_candump_line(line, 1)
    assert frame is not None
    if expected is None:
        assert (True, False, b"\0") == (frame.is_error, frame.is_extended, frame.data)
    else:
        assert expected == frame


@pytest.mark.parametrize(
    "line",
    [
        "(1719820800.012345) can0 0B0#112",
        "(1719820800.012345) can0 0B0",
        "(1719820800.012345) can0 8B0#00",
        "(1719820800.012345) can0 00B0#00",
        "(1719820800.012345) can0 0B0#112233445566778899",
        "(1719820800,012345) can0 0B0#00",
        "(17198x0800.012345) can0 0B0#00",
        "(-1.5) can0 0B0#00",
        "(nan) can0 0B0#00",
        "1719820800.012345 can0 0B0#00",
        "(1719820800.012345) 0B0#00",
        "(1719820800.012345) can0 0B0#00 (1719820800.022345) can0 0B0#00",
        "(1719820800.012345) can0 0B0#GG",
        "(1719820800.012345) can0 0B0#11 22",
        "(1719820800.012345) can0 \u0660\u0661\u0662#00",
    ],
)
def test_damaged_candump_lines_are_no_frames(line: str) -> None:
    """What is not exactly a frame is none, however near it comes."""
    assert parse_candump_line(line) is None


@settings(derandomize=True, deadline=None, max_examples=200)
@given(st.text(st.characters(max_codepoint=255), max_size=60))
def test_garbage_never_raises(line: str) -> None:
    """Any line is a frame or none."""
    frame = parse_candump_line(line)
    assert frame is None or math.isfinite(frame.time_s)


@settings(derandomize=True, deadline=None, max_examples=200)
@given(st.data())
def test_a_candump_line_with_one_wrong_character_is_no_worse_than_a_wrong_frame(data: st.DataObject) -> None:
    """One changed character gives no frame or one whose fields are all within CAN's limits."""
    line = "(1719820800.012345) can0 18FEF1B0#1122334455667788"
    place = data.draw(st.integers(0, len(line) - 1))
    character = data.draw(st.characters(max_codepoint=255))
    frame = parse_candump_line(line[:place] + character + line[place + 1 :])

    if frame is not None:
        assert 0 <= frame.arbitration_id <= 0x1FFFFFFF
        assert len(frame.data) <= 64
        assert 0.0 <= frame.time_s < 1e12


def test_bad_lines_are_skipped_and_named(tmp_path: Path) -> None:
    """Garbage, blank lines, mixed line ends and a cut last line cost only themselves."""
    path = tmp_path / "can.log"
    path.write_bytes(
        b"(1.0) can0 0B0#01\r\n"
        b"\n"
        b"\x00\xff\xfe binary \x1a\n"
        b"(2.0) can0 0B0#02\r"
        b"(3.0) can0 0B0#0Z\n"
        b"   \n"
        b"(4.0) can0 0B0#04\n"
        b"(5.0) can0 0B0#0"
    )
    frames, bad = read(path)

    assert [(1.0, 1), (2.0, 4), (4.0, 7)] == [(frame.time_s, frame.line) for frame in frames]
    assert [3, 5, 8] == [line for line, _ in bad]
    assert "not a candump line: '(3.0) can0 0B0#0Z'" == bad[1][1]


def test_the_last_line_needs_no_line_end(tmp_path: Path) -> None:
    """A log without a final newline is whole."""
    path = tmp_path / "can.log"
    path.write_text("(1.0) can0 0B0#01\n(2.0) can0 0B0#02")

    assert ([1.0, 2.0], []) == ([frame.time_s for frame in read(path)[0]], read(path)[1])


def test_a_compressed_log_that_was_cut_gives_what_there_is(tmp_path: Path) -> None:
    """The frames before the cut are read, and the cut is told."""
    lines = "".join(f"({step / 100:.6f}) can0 0B0#{step % 65536:04X}\n" for step in range(20000))
    whole = gzip.compress(lines.encode())
    path = tmp_path / "can.log.gz"
    path.write_bytes(whole[: len(whole) // 2])
    frames, bad = read(path)

    assert 5000 < len(frames) < 15000
    assert [step / 100 for step in range(len(frames))] == pytest.approx([frame.time_s for frame in frames])
    assert "the compressed file is cut short" == bad[-1][1]
    assert len(frames) <= bad[-1][0] <= len(frames) + 2


def test_a_damaged_compressed_log_ends_where_it_is_damaged(tmp_path: Path) -> None:
    """Flipped bytes in the middle end the reading, with what came before kept."""
    lines = "".join(f"({step / 100:.6f}) can0 0B0#{(step * 7919) % 65536:04X}\n" for step in range(20000))
    whole = bytearray(gzip.compress(lines.encode()))
    for place in range(len(whole) // 2, len(whole) // 2 + 40):
        whole[place] ^= 0xFF
    path = tmp_path / "can.log.gz"
    path.write_bytes(bytes(whole))
    frames, bad = read(path)

    assert 1000 < len(frames) < 20000
    assert 1 <= len(bad)


@pytest.mark.parametrize("suffix", [".log", ".log.gz", ".asc", ".blf", ".trc", ".mf4"])
@pytest.mark.parametrize("content", [b"", b"\x00\xff\x1f\x8b no log at all\n" * 20, b"\n\n"])
def test_a_file_without_a_frame_is_an_input_error(tmp_path: Path, suffix: str, content: bytes) -> None:
    """Empty, blank and foreign files end in one line that names the file."""
    path = tmp_path / f"can{suffix}"
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        read(path)

    assert str(path) == caught.value.file
    assert "\n" not in str(caught.value)


def test_an_input_error_names_the_first_bad_line(tmp_path: Path) -> None:
    """File, line and reason."""
    path = tmp_path / "can.log"
    path.write_text("\nnothing\nof use\n")
    with pytest.raises(InputError) as caught:
        read(path)

    assert f"{path}:2: no CAN frame in it; not a candump line: 'nothing'" == str(caught.value)


@pytest.mark.parametrize("name", ["can.log", "can.csv", "folder.log"])
def test_what_cannot_be_opened_is_an_input_error_at_once(tmp_path: Path, name: str) -> None:
    """Missing files, unknown formats and folders are told before the first frame is asked for."""
    path = tmp_path / name
    if name == "folder.log":
        path.mkdir()
    with pytest.raises(InputError, match=r"No such file|not a known CAN log format|directory"):
        read_can_log(path)


ASC = """date Mon Jul 1 10:00:00.000 2024
base hex  timestamps {mode}
internal events logged
// version 9.0.0
{first} 1  B0              Rx   d 2 01 00
{second} 1  Statistic: D 0 R 0 XD 0 XR 0 E 0 O 0 B 0.00%
{third} 1  B0              Rx   d 2 02 00
{fourth} 1  ErrorFrame
{fourth} 1  B0              Rx   d 2 03 00
"""


def test_asc_times_since_the_line_before_are_summed_up(tmp_path: Path) -> None:
    """'timestamps relative' counts from the line before, whatever that line was."""
    absolute, relative = tmp_path / "can.asc", tmp_path / "relative.asc"
    absolute.write_text(ASC.format(mode="absolute", first="0.5", second="1.5", third="3.5", fourth="4.0"))
    text = ASC.format(mode="relative", first="0.5", second="1.0", third="2.0", fourth="0.5")
    relative.write_text(
        text.replace("0.5 1  B0              Rx   d 2 03", "0.0 1  B0              Rx   d 2 03")
    )

    assert [f.time_s for f in read(absolute)[0]] == pytest.approx([f.time_s for f in read(relative)[0]])
    assert [0.0, 3.0, 3.5, 3.5] == [f.time_s - read(absolute)[0][0].time_s for f in read(absolute)[0]]
    assert [False, False, True, False] == [f.is_error for f in read(absolute)[0]]


@pytest.mark.parametrize("suffix", [".asc", ".trc"])
def test_a_bad_line_in_a_text_log_costs_only_itself(tmp_path: Path, suffix: str) -> None:
    """python-can's readers stop at a damaged line; reading goes on behind it."""
    path = tmp_path / f"can{suffix}"
    write(path, messages()[:20])
    lines = path.read_text().splitlines(keepends=True)
    damaged = next(number for number, line in enumerate(lines) if "0B 0B 0B" in line)
    lines[damaged] = lines[damaged].replace("0B 0B 0B", "0B XX 0B")
    path.write_text("".join(lines))
    frames, bad = read(path)

    assert [step for step in range(20) if step != 11] == [frame.data[0] for frame in frames]
    assert [damaged + 1] == [line for line, _ in bad]
    assert all(lines[f.line - 1].rstrip().endswith(f.data[-1:].hex().upper()) for f in frames)


def test_an_asc_header_with_a_foreign_date_is_no_hindrance(tmp_path: Path) -> None:
    """Only the start is unknown then; the frames are read, and the header's base holds."""
    path = tmp_path / "can.asc"
    path.write_text(
        "date lunes 1 de julio\nbase dec  timestamps absolute\ninternal events logged\n"
        "0.5 1  176 Rx   d 2 16 17\n0.6 1  176 Rx   d 2 18 19\n"
    )
    frames, bad = read(path)

    assert [(0.5, 176, b"\x10\x11"), (0.6, 176, b"\x12\x13")] == [
        (pytest.approx(f.time_s), f.arbitration_id, f.data) for f in frames
    ]
    assert [] == bad


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("Mon Jul 1 10:00:00.250 2024", datetime(2024, 7, 1, 10, 0, 0, 250000)),
        ("Mon Jul 1 10:00:00.25 2024", datetime(2024, 7, 1, 10, 0, 0, 25000)),
        ("Sat Sep 30 03:06:13.191 PM 2017", datetime(2017, 9, 30, 15, 6, 13, 191000)),
        ("Sat Sep 30 12:06:13 am 2017", datetime(2017, 9, 30, 0, 6, 13)),
        ("Don Mär 07 10:00:01 2024", datetime(2024, 3, 7, 10, 0, 1)),
        ("mar. juil. 2 10:00:01 2024", datetime(2024, 7, 2, 10, 0, 1)),
        ("Mon Foo 1 10:00:00 2024", None),
        ("Mon Feb 30 10:00:00 2024", None),
        ("yesterday", None),
    ],
)
def test_asc_dates(text: str, expected: datetime | None) -> None:
    """Dates of CANalyzer, CANoe and python-can in several languages."""
    assert (None if expected is None else expected.timestamp()) == pytest.approx(asc_date_s(text))


@pytest.mark.parametrize("suffix", [".blf", ".mf4"])
def test_a_binary_log_that_was_cut_is_reported(tmp_path: Path, suffix: str) -> None:
    """Half a file gives the frames before the cut, or an error that names the file."""
    if suffix == ".mf4":
        pytest.importorskip("asammdf")
    path = tmp_path / f"can{suffix}"
    many = [
        can.Message(
            timestamp=START_S + 0.01 * step,
            arbitration_id=0xB0,
            is_extended_id=False,
            data=step.to_bytes(8, "big"),
        )
        for step in range(10000 if suffix == ".blf" else 50)
    ]
    write(path, many)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    try:
        frames, bad = read(path)
    except InputError as error:
        assert suffix == ".mf4"
        assert str(path) in str(error)
        return

    assert 0 < len(frames) < len(many)
    assert list(range(len(frames))) == [int.from_bytes(frame.data, "big") for frame in frames]
    assert 1 == len(bad)


def test_mf4_without_asammdf_says_what_to_install(tmp_path: Path, without: Callable[[str], None]) -> None:
    """One line names the extra."""
    path = tmp_path / "can.mf4"
    path.write_bytes(b"MDF     4.10    ")
    without("asammdf")

    with pytest.raises(InputError, match=r"pip install 'tpmsd\[mf4\]'"):
        read(path)


@pytest.fixture
def without(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """Makes a package look as if it were not installed (there is no other seam to an import)."""
    return lambda name: monkeypatch.setitem(sys.modules, name, None)


@pytest.mark.parametrize("name", ["can.log", "can.log.gz", "can.asc", "can.blf", "can.trc", "CAN.MF4"])
def test_the_log_of_a_drive_is_found_by_its_stem(tmp_path: Path, name: str) -> None:
    """can.* of a known format, beside whatever else is in the folder."""
    for other in ("can.txt", "can.log.bak", "bus.dbc", "gnss.log", "canoe.asc"):
        (tmp_path / other).touch()
    (tmp_path / name).touch()

    assert tmp_path / name == find_can_log(tmp_path)


def test_no_log_or_several_are_input_errors(tmp_path: Path) -> None:
    """The error names what was looked for, and what was found."""
    with pytest.raises(InputError, match=r"no CAN log; looked for can\.log can\.log\.gz can\.asc"):
        find_can_log(tmp_path)
    (tmp_path / "can.log").touch()
    (tmp_path / "can.blf").touch()
    with pytest.raises(InputError, match=r"more than one CAN log \(can\.blf can\.log\)"):
        find_can_log(tmp_path)
    with pytest.raises(InputError, match="No such file or directory"):
        find_can_log(tmp_path / "nowhere")
