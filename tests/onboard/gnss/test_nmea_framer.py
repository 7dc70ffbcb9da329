from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from tests.onboard.gnss.sentences import gga, rmc, vtg
from tpmsd.onboard.sources.gnss.nmea_framer import NmeaFramer

T = 1720716104.3
LINES = [rmc(T), gga(T), vtg(20.0)]

# Streams with more of what matters than blind chance would give.
PIECES = st.one_of(
    st.sampled_from([*LINES, b"\r\n", b"\n", b"\r", b"$", b"$GNRMC,", b"*", b"\xb5b\x01\x07", b"A" * 300]),
    st.binary(max_size=20),
)


def test_lines_come_out_as_they_went_in():
    """Complete lines come out in order and without their line ends."""
    assert LINES == NmeaFramer().feed(b"\r\n".join(LINES) + b"\r\n")


def test_line_in_pieces():
    """A line that arrives byte by byte comes out once, when its end is there."""
    framer = NmeaFramer()
    out = [framer.feed(bytes([byte])) for byte in LINES[0] + b"\r\n"]
    assert [LINES[0]] == [line for lines in out for line in lines]
    assert [LINES[0]] == out[len(LINES[0])]


def test_garbage_around_lines():
    """Binary messages and noise before, between and after lines are skipped and counted."""
    framer = NmeaFramer()
    stream = (
        b"\x00\xff$\x01\n" + LINES[0] + b"\n\xb5b\x01\x07\x5c" + LINES[1] + b"\r\njunk\r\n" + LINES[2] + b"\n"
    )
    assert LINES == framer.feed(stream)
    assert {"lines": 3, "overlong": 0, "skipped_bytes": 4 + 5 + 4} == framer.counts


def test_cut_line_followed_by_a_whole_one():
    """Where a line was cut and the next follows without a line end, the last dollar starts the sentence."""
    assert [LINES[1]] == NmeaFramer().feed(LINES[0][:30] + LINES[1] + b"\r\n")


def test_overlong_line():
    """A line beyond 256 bytes is given up, and the next is taken again."""
    framer = NmeaFramer()
    assert [] == framer.feed(b"$GNTXT," + b"x" * 300)
    assert [LINES[0]] == framer.feed(b"x" * 500 + b"\r\n" + LINES[0] + b"\r\n")
    assert {"lines": 1, "overlong": 1, "skipped_bytes": 807} == framer.counts


def test_wrong_baud_is_suspected():
    """Two thousand bytes without a sentence point to a wrong baud rate, until one is found."""
    framer = NmeaFramer()
    framer.feed(bytes(range(128, 256)) * 15)
    assert framer.wrong_baud is False
    framer.feed(bytes(range(128, 256)))
    assert framer.wrong_baud is True
    framer.feed(LINES[0] + b"\r\n")
    assert framer.wrong_baud is False


def test_reset_forgets_the_unfinished_line():
    """After a receiver was unplugged in mid-line, its rest does not spoil the first new line."""
    framer = NmeaFramer()
    framer.feed(LINES[0][:20])
    framer.reset()
    assert [LINES[1]] == framer.feed(LINES[1] + b"\r\n")
    assert 20 == framer.counts["skipped_bytes"]


@settings(derandomize=True, deadline=None)
@given(st.lists(PIECES, max_size=20), st.data())
def test_any_stream_any_cut(pieces: list[bytes], data: st.DataObject):
    """The lines and counts of any byte stream do not depend on how it was cut, and memory stays bounded."""
    stream = b"".join(pieces)
    whole, cut = NmeaFramer(), NmeaFramer()
    at_once = whole.feed(stream + b"\n")
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=8)))
    in_pieces = []
    for begin, end in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        in_pieces += cut.feed(stream[begin:end])
        assert len(cut._partial) <= 256
    in_pieces += cut.feed(b"\n")
    assert at_once == in_pieces
    assert whole.counts == cut.counts
    assert all(line.startswith(b"$") and b"$" not in line[1:] and len(line) <= 256 for line in at_once)


@settings(derandomize=True, deadline=None)
@given(st.lists(st.binary(max_size=40), max_size=5), st.sampled_from(LINES))
def test_a_whole_line_survives_any_noise_before_it(noise: list[bytes], line: bytes):
    """A sound line after any noise and a line end is always found."""
    assert line == NmeaFramer().feed(b"".join(noise) + b"\n" + line + b"\n")[-1]
