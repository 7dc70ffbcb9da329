"""Readings with effects in them: rounding, roll-over, bits of frames, numbers of sentences."""

from __future__ import annotations

import math

import cantools
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tpmsd.offline.simulator.inject_can import float_bits, put_bits
from tpmsd.offline.simulator.inject_nmea import NmeaRewriter
from tpmsd.offline.simulator.injection import add_counts, add_to_rounded_readings
from tpmsd.onboard.sources.can.signal_plan import bit_field, bit_position

QUIET = settings(derandomize=True, deadline=None, max_examples=60)


class Fixed:
    """An injection that moves fixes by so much, whenever they are."""

    def __init__(self, east_m: float = 0.0, north_m: float = 0.0, more_mps: complex = 0.0) -> None:
        self.change = (east_m, north_m, more_mps)
        self.fix_age_s = 0.0

    def of_line(self, line: str) -> str:
        """A line with it."""
        from tpmsd.car.physics.reading_change import FixChange

        east_m, north_m, more_mps = self.change
        one = FixChange(
            np.array([east_m]), np.array([north_m]), np.array([10.0 + 0j]), np.array([10.0 + more_mps])
        )
        rewriter = NmeaRewriter(self)  # type: ignore[arg-type]
        return rewriter._rewritten_sentence(line.encode("latin-1"), one).decode("latin-1")


def sentence(body: str) -> str:
    """With its checksum, by a loop of its own."""
    check = 0
    for letter in body:
        check ^= ord(letter)
    return f"${body}*{check:02X}\r\n"


RMC = "GNRMC,161448.299,A,3743.2598620,N,12228.3383180,W,15.2067,2.14,020818,,,A"


@QUIET
@given(
    st.sampled_from([256, 1001, 65536, 1 << 32]),
    st.floats(-0.02, 0.02),
    st.integers(0, 1 << 30),
)
def test_a_changed_count_is_the_changed_angle_rounded_down(modulus: int, share: float, start: int) -> None:
    """A counter that is a share ahead differs from the true angle's count by one at most, over roll-overs."""
    time = np.arange(400) * 0.01
    angle = start % modulus + 3.7 * np.cumsum(1.0 + 0.3 * np.sin(time))
    more = share * (angle - angle[0])
    counts = np.floor(angle) % modulus

    made = add_counts(counts, more, 8.0, modulus)

    off = (made - np.floor(angle + more) + modulus // 2) % modulus - modulus // 2
    assert np.abs(off).max() <= 1
    assert abs(off.mean()) < 0.2
    assert made.min() >= 0
    assert made.max() < modulus


@QUIET
@given(st.lists(st.integers(0, 65535), min_size=2, max_size=80))
def test_counts_to_which_nothing_is_added_stay(values: list[int]) -> None:
    """Whatever a counter did: resets, roll-overs, garbage."""
    counts = np.array(values, dtype=np.float64)

    assert values == add_counts(counts, np.zeros(len(values)), 3.0, 65536).tolist()


@QUIET
@given(st.lists(st.integers(-3000, 3000), min_size=2, max_size=80))
def test_readings_to_which_nothing_is_added_stay(values: list[int]) -> None:
    """A change of 1e-9 of a step is none."""
    readings = np.array(values, dtype=np.float64)

    for more in (0.0, 1e-9, -1e-9):
        assert values == add_to_rounded_readings(readings, np.full(len(values), more)).tolist()


def test_a_change_below_the_last_digit_has_its_mean() -> None:
    """A third of a step is one in the mean, not nothing, also on readings that stay the same."""
    readings = np.full(3000, 200.0)

    made = add_to_rounded_readings(readings, np.full(len(readings), 1.0 / 3.0))

    assert (made - readings).mean() == pytest.approx(1.0 / 3.0, abs=1e-3)
    assert set(np.unique(made - readings)) == {0.0, 1.0}


@QUIET
@given(st.booleans(), st.integers(0, 40), st.integers(1, 24), st.binary(min_size=8, max_size=8), st.data())
def test_only_the_bits_of_the_signal_change(
    big: bool, start: int, length: int, data: bytes, drawn: st.DataObject
) -> None:
    """What was put is what cantools reads, and every other bit of the frame stays, in both byte orders."""
    order = 0 if big else 1
    first = 8 * (start // 8) + 7 - start % 8 if big else start
    text = f'BO_ 1 M: 8 X\n SG_ S : {first}|{length}@{order}+ (1,0) [0|0] "" X\n'
    database = cantools.database.load_string(f'VERSION ""\n\nBU_: X\n\n{text}', "dbc", strict=True)
    message = database.get_message_by_name("M")
    wanted = drawn.draw(st.integers(0, (1 << length) - 1))
    field = bit_field(message.signals[0])
    made = bytearray(data)

    put_bits(made, field, wanted)

    assert wanted == message.decode(bytes(made))["S"]
    again = bytearray(made)
    put_bits(again, field, field.bits(data))
    assert data == bytes(again)


@pytest.mark.parametrize(("length", "number"), [(32, 1.25), (64, -math.pi), (16, 0.5)])
def test_floating_point_signals_are_written_as_they_are_read(length: int, number: float) -> None:
    """The bits of a number read as that number."""
    field = bit_position(0, length, False, is_float=True)

    assert number == field.number(float_bits(number, field))


def test_a_position_moves_by_metres_on_both_hemispheres() -> None:
    """50 m to the north and 30 m to the west, in the digits that were there; nothing else changes."""
    made = Fixed(-30.0, 50.0).of_line(sentence(RMC))
    fields = made.split(",")

    radians = math.radians(37.0 + 43.26 / 60.0)
    north = (float(fields[3][2:]) - 43.2598620) / 60.0 * math.pi / 180.0 * 6358982.0
    west = (float(fields[5][3:]) - 28.3383180) / 60.0 * math.pi / 180.0 * 6386143.0 * math.cos(radians)
    assert north == pytest.approx(50.0, rel=2e-3)
    assert west == pytest.approx(30.0, rel=2e-3)
    assert (len(RMC.split(",")[3]), len(RMC.split(",")[5])) == (len(fields[3]), len(fields[5]))
    assert RMC.split(",")[7:12] == fields[7:12]
    assert made == sentence(made[1 : made.index("*")])


def test_speed_and_course_change_as_a_vector() -> None:
    """1 m/s more to the east turns a car that drives north by atan(1 / v), clockwise."""
    body = "GNRMC,161448.299,A,,,,,20.000,0.00,020818,,,A"
    fields = Fixed(more_mps=1.0).of_line(sentence(body)).split(",")

    speed = 20.0 * 1852.0 / 3600.0
    assert float(fields[7]) == pytest.approx(math.hypot(speed, 1.0) * 3600.0 / 1852.0, abs=6e-4)
    assert float(fields[8]) == pytest.approx(math.degrees(math.atan2(1.0, speed)), abs=6e-3)


def test_without_a_course_the_speed_changes_along_the_way() -> None:
    """Knots and km/h of a VTG without course grow by what the antenna is faster; what is empty stays."""
    fields = Fixed(more_mps=0.5).of_line(sentence("GNVTG,,T,,M,10.000,N,18.520,K,A")).split(",")

    assert ["", "T", "", "M"] == fields[1:5]
    assert float(fields[5]) == pytest.approx(10.0 + 0.5 * 3600.0 / 1852.0, abs=6e-4)
    assert float(fields[7]) == pytest.approx(18.52 + 1.8, abs=6e-4)


@pytest.mark.parametrize(
    "line",
    [
        sentence(RMC).replace("*55", "*56"),
        sentence("GNRMC,161448.299,V,3743.2598620,N,12228.3383180,W,15.2067,2.14,020818,,,N"),
        "$GNRMC,161448.299,A,3743.25\r\n",
        sentence("GNGST,161448.299,1,1,1,0,1,1,1"),
        sentence("GNGGA,161448.299,,,,,0,02,,,M,,M,,"),
        "$PUBX,00,1,2,3*00\r\n",
        "\xff\x00garbage\r\n",
        "\n",
    ],
)
def test_what_is_damaged_or_tells_nothing_stays_as_it_is(line: str) -> None:
    """A wrong checksum, no fix, a line cut short, other sentences, noise."""
    assert line == Fixed(30.0, 30.0, 1.0).of_line(line)


@QUIET
@given(st.binary(max_size=120))
def test_no_line_ends_in_an_error(line: bytes) -> None:
    """Whatever bytes a receiver's log holds."""
    Fixed(3.0, 3.0, 0.2).of_line(line.decode("latin-1"))
    Fixed(3.0, 3.0, 0.2).of_line(f"$GNRMC,{line.decode('latin-1')}")


def test_changes_below_the_last_digit_of_a_sentence_have_their_mean() -> None:
    """0.02 km/h on a receiver that tells tenths is one tenth more in every fifth sentence."""
    from tpmsd.car.physics.reading_change import FixChange

    rewriter = NmeaRewriter(Fixed())  # type: ignore[arg-type]
    more = 0.02 / 3.6
    change = FixChange(np.zeros(1), np.zeros(1), np.array([10.0 + 0j]), np.array([10.0 + more + 0j]))
    line = sentence("GNVTG,,T,,M,,N,18.5,K,A").encode("ascii")

    speeds = [float(rewriter._rewritten_sentence(line, change).split(b",")[7]) for _ in range(50)]

    assert np.mean(speeds) == pytest.approx(18.52, abs=2e-3)
    assert {18.5, 18.6} == set(speeds)
