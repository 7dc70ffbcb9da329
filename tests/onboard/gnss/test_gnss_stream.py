"""From bytes to stamped sentences, and from these to fixes."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.onboard.gnss import sentences as nmea
from tests.onboard.gnss.test_gpsd_json import TPV
from tests.onboard.gnss.test_ubx import frame
from tpmsd.onboard.sources.events import GnssFix
from tpmsd.onboard.sources.gnss.nmea_epoch import NmeaAssembler
from tpmsd.onboard.sources.gnss.solution import Solution, sentences
from tpmsd.onboard.sources.gnss.stream import NMEA_AFTER_PVT, GnssStream, GpsdStream, NmeaStream
from tpmsd.onboard.sources.gnss.ubx import checksum

UTC_S = 1774778400.123456
SOLUTION = Solution(
    UTC_S, 2, -48.0 - 59.99999999 / 60, 11.5, 500.25, 12, 0.9, 0.6, 0.8, 1.5, 27.2525, 0.075, 359.99996
)


def fix_of(lines: list[tuple[float, bytes]]) -> GnssFix:
    assembler = NmeaAssembler()
    events = [event for time_s, line in lines for event in assembler.feed(time_s, line)] + assembler.flush()
    (fix,) = (event for event in events if isinstance(event, GnssFix))
    assert events == [fix]
    return fix


def test_a_solution_survives_the_way_through_nmea() -> None:
    """What becomes of a solution in the assembler is what it was, to less than a millimetre."""
    fix = fix_of([(9.0, line) for line in sentences(SOLUTION)])

    assert (9.0, 2, 0.9) == (fix.arrival_s, fix.quality, fix.hdop)
    assert UTC_S == pytest.approx(fix.utc_s, abs=1e-6)
    assert (SOLUTION.latitude_deg, 11.5) == pytest.approx((fix.latitude_deg, fix.longitude_deg), abs=3e-9)
    assert (27.2525, 0.075, 500.25) == pytest.approx(
        (fix.speed_mps, fix.speed_std_mps, fix.altitude_m), abs=1e-5
    )
    assert 0.0 == pytest.approx(
        math.remainder(fix.course_rad - math.radians(359.99996), 2 * math.pi), abs=2e-6
    )
    assert math.sqrt((0.6**2 + 0.8**2) / 2) == pytest.approx(fix.position_std_m)


def test_no_solution_is_said_too() -> None:
    """A receiver without a fix still says that it lives; one without a time says nothing."""
    assert [nmea.nmea("GNRMC,100000.123456,V,,,,,,,290326,,,N")] == sentences(Solution(UTC_S))
    assert [] == sentences(replace(SOLUTION, utc_s=math.nan))
    assert [] == sentences(replace(SOLUTION, utc_s=1e18))


@settings(derandomize=True, deadline=None, max_examples=200)
@given(st.builds(
    Solution, *(st.floats() for _ in range(1)), st.integers(0, 9), *(st.floats() for _ in range(3)),
    st.one_of(st.none(), st.integers(0, 99)), *(st.floats() for _ in range(7)),
))  # fmt: skip
def test_whatever_a_solution_holds_its_sentences_are_sound(solution: Solution) -> None:
    """No number makes a sentence that the assembler calls broken."""
    assembler = NmeaAssembler()
    for line in sentences(solution):
        assembler.feed(1.0, line)

    assert (0, 0) == (assembler.counts["garbage"], assembler.counts["checksum"])


def stream_of(kind: str) -> GnssStream:
    return GpsdStream() if kind == "gpsd" else NmeaStream()


MESSAGES = {
    "gpsd": 2 * [json.dumps(TPV).encode() + b"\n"],
    "ubx": 2 * [frame()],
    "nmea": [nmea.rmc(UTC_S) + b"\r\n", nmea.rmc(UTC_S + 0.1) + b"\r\n"],
}


@pytest.mark.parametrize("kind", sorted(MESSAGES))
def test_a_message_bears_the_time_of_its_first_byte(kind: str) -> None:
    """A message in three pieces is stamped with the first, one that begins in the last piece with that."""
    (message, following), stream = MESSAGES[kind], stream_of(kind)
    lines = stream.feed(message[:10], 1.0)
    lines += stream.feed(message[10:20], 2.0)
    lines += stream.feed(message[20:] + following + message[:5], 3.0)
    lines += stream.feed(message[5:], 4.0)
    stamps = [stamp_s for stamp_s, line in lines if b"RMC" in line]

    assert [1.0, 3.0, 3.0] == stamps


def test_nmea_beside_nav_pvt_is_left_out() -> None:
    """A receiver that says each epoch twice is heard once; when NAV-PVT ceases, NMEA is heard again."""
    stream = NmeaStream()
    epoch = nmea.rmc(UTC_S) + b"\r\n" + nmea.gga(UTC_S) + b"\r\n"
    before = stream.feed(epoch, 0.0)
    beside = [line for k in range(20) for line in stream.feed(frame() + epoch, 1.0 + k)]
    after = [len(stream.feed(epoch, 30.0 + k)) for k in range(NMEA_AFTER_PVT // 2 + 3)]

    assert (2, 20 * 4) == (len(before), len(beside))
    assert [0] * 99 + [2] * 4 == after


def test_ubx_without_the_wanted_message_is_said() -> None:
    """A receiver that speaks UBX alone and never sends NAV-PVT gets a hint; one that does gets none."""
    stream = NmeaStream()
    other = bytearray(frame())
    other[3] = 0x12
    other[-2:] = checksum(bytes(other[2:-2]))
    for k in range(60):
        assert [] == stream.feed(bytes(other), float(k))
    reported = stream.hint
    stream.feed(frame(), 61.0)

    assert ("UBX without NAV-PVT: the receiver must be told to send it", "") == (reported, stream.hint)
