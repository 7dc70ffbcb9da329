from __future__ import annotations

import gzip
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.onboard.gnss.sentences import gga, rmc, vtg
from tpmsd.foundation.errors import InputError
from tpmsd.onboard.sources.gnss.nmea_log import Entry, read_nmea_log

T = 1720716104.0


def read(path: Path) -> tuple[list[Entry], list[tuple[int, str]]]:
    bad: list[tuple[int, str]] = []
    return list(read_nmea_log(path, lambda number, reason: bad.append((number, reason)))), bad


def stamped(time_s: float, line: bytes) -> bytes:
    return f"({time_s:.6f}) ".encode() + line


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return tmp_path / "gnss.nmea"


def test_prefixed_lines(log: Path):
    """Each line gives the host's time, the sentence and its number."""
    log.write_bytes(stamped(T + 0.112233, rmc(T)) + b"\n" + stamped(T + 0.2, gga(T)) + b"\n")
    assert ([(T + 0.112233, rmc(T), 1), (T + 0.2, gga(T), 2)], []) == read(log)


def test_gzip(tmp_path: Path):
    """A name ending in .gz is read as gzip."""
    path = tmp_path / "gnss.nmea.gz"
    path.write_bytes(gzip.compress(stamped(T, rmc(T)) + b"\n"))
    assert ([(T, rmc(T), 1)], []) == read(path)


def test_truncated_gzip_gives_what_it_has(tmp_path: Path):
    """A gzip file that ends early gives its lines, and one report of where it ends."""
    path = tmp_path / "gnss.nmea.gz"
    text = b"".join(stamped(T + i, rmc(T + i)) + b"\n" for i in range(3000))
    path.write_bytes(gzip.compress(text)[:-2000])
    entries, bad = read(path)
    assert 1000 < len(entries) < 3000
    assert [number for number, _ in bad] == [entries[-1][2] + 1]
    assert bad[0][1].startswith("compressed data damaged: ")


def test_mixed_line_ends_and_blank_lines(log: Path):
    """Line ends may be mixed; every one of them counts for the number."""
    log.write_bytes(
        stamped(T, rmc(T)) + b"\r\n\r\n" + stamped(T + 1, rmc(T + 1)) + b"\r" + stamped(T + 2, rmc(T + 2))
    )
    assert [(T, 1), (T + 1, 3), (T + 2, 4)] == [(time, number) for time, _, number in read(log)[0]]


def test_bad_lines_are_reported_with_number_and_reason(log: Path):
    """What has no time in front, nothing behind it, or no end is told, and costs nothing else."""
    lines = [b"16104.521868) $GNGGA,cut", rmc(T), stamped(T, rmc(T)), b"(1720716105.0)", b"\xff" * 5000]
    log.write_bytes(b"\n".join([*lines, stamped(T + 9, gga(T))]))
    entries, bad = read(log)
    assert [(T, 3), (T + 9, 6)] == [(time, number) for time, _, number in entries]
    assert [
        (1, "no (time) in front"),
        (2, "no (time) in front"),
        (4, "nothing behind the time"),
        (5, "longer than 4096 bytes"),
    ] == bad


def test_broken_sentence_behind_a_time_is_handed_on(log: Path):
    """A sentence that is broken is for the assembler to count; junk before its dollar is taken off."""
    log.write_bytes(b"(1.5) $GNRMC,bro\xffken\n(2.5) junk\xb5$GNGGA,1\n(3.5) no dollar\n")
    assert [(1.5, b"$GNRMC,bro\xffken", 1), (2.5, b"$GNGGA,1", 2), (3.5, b"no dollar", 3)] == read(log)[0]


def test_plain_lines_bear_their_utc(log: Path):
    """Without times in front, the sentences' UTC is the clock, also for those before the first date."""
    lines = [gga(T), vtg(9.0), gga(T + 1), rmc(T + 1), vtg(9.5), gga(T + 2)]
    log.write_bytes(b"\n".join(lines))
    entries, bad = read(log)
    assert [T, T, T + 1, T + 1, T + 1, T + 2] == [time for time, _, _ in entries]
    assert lines == [line for _, line, _ in entries]
    assert [] == bad


def test_plain_vtg_before_its_gga(log: Path):
    """Where each epoch begins with VTG, VTG bears the time of the sentence that follows."""
    lines = [line for i in range(3) for line in (vtg(9.0 + i), rmc(T + i))]
    log.write_bytes(b"\n".join(lines))
    assert [T, T, T + 1, T + 1, T + 2, T + 2] == [time for time, _, _ in read(log)[0]]


def test_plain_lines_over_midnight(log: Path):
    """The day before the first date is found back over midnight."""
    midnight = 1720742400.0
    log.write_bytes(b"\n".join([gga(midnight - 1), gga(midnight), rmc(midnight + 1), gga(midnight + 2)]))
    assert [midnight + i for i in (-1, 0, 1, 2)] == [time for time, _, _ in read(log)[0]]


def test_plain_lines_without_any_date(log: Path):
    """If no sentence has a date, times count from 1970-01-01, over midnight too, and that is told once."""
    log.write_bytes(b"\n".join([gga(T), gga(T + 1), gga(1720742400.0)]))
    entries, bad = read(log)
    assert [60104.0, 60105.0, 86400.0] == [time for time, _, _ in entries]
    assert [(1, "no sentence of the file has a date: times count from 1970-01-01")] == bad


@pytest.mark.parametrize(
    ("content", "line", "reason"),
    [
        (b"", None, "holds no line"),
        (b"\n\r\n  \n", None, "holds no line"),
        (b"hello\nworld\n", 1, "neither a (time) nor a $ sentence"),
        (b"\x00\xb5$" * 9000, 1, "longer than 4096 bytes"),
        (b"\n(17.5)\n", 2, "nothing behind the time"),
        (vtg(9.0) + b"\n", 1, "neither a (time) in front of the lines nor a sentence with a time"),
    ],
)
def test_no_usable_line(log: Path, content: bytes, line: int | None, reason: str):
    """A file without any usable line is an input error that names file, first bad line and reason."""
    log.write_bytes(content)
    with pytest.raises(InputError) as caught:
        list(read_nmea_log(log))
    where = f"{log}" if line is None else f"{log}:{line}"
    assert f"{where}: {reason}" == str(caught.value)
    assert 3 == caught.value.exit_code


def test_unreadable_files(tmp_path: Path):
    """A missing file, a folder and a false .gz are one clear line each."""
    with pytest.raises(InputError, match=r"none\.nmea: cannot be read: No such file or directory$"):
        list(read_nmea_log(tmp_path / "none.nmea"))
    with pytest.raises(InputError, match=r"cannot be read: Is a directory$"):
        list(read_nmea_log(tmp_path))
    false = tmp_path / "false.nmea.gz"
    false.write_bytes(b"$GNRMC,not gzip")
    with pytest.raises(InputError, match=r"false\.nmea\.gz:1: compressed data damaged"):
        list(read_nmea_log(false))


@settings(
    derandomize=True,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
    max_examples=150,
)
@given(
    st.lists(
        st.one_of(
            st.binary(max_size=40),
            st.sampled_from(
                [rmc(T), gga(T), vtg(9.0), stamped(T, rmc(T)), b"\r", b"$", b"(1.0)", b"$" + b"x" * 5000]
            ),
        ),
        max_size=12,
    )
)
def test_any_file(tmp_path: Path, pieces: list[bytes]):
    """Any file gives entries with rising line numbers, or an input error."""
    path = tmp_path / "any.nmea"
    path.write_bytes(b"\n".join(pieces))
    try:
        entries, _ = read(path)
    except InputError:
        return
    numbers = [number for _, _, number in entries]
    assert numbers == sorted(set(numbers))
    assert all(len(line) <= 4096 for _, line, _ in entries)
