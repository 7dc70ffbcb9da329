"""The bytes that ask a car for its speed over OBD-II, and those of its answers."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from tpmsd.onboard.sources.obd_speed import SPEED_REQUEST, speed_answer_kmh


def test_the_request_is_the_one_of_the_standards() -> None:
    """A single frame of two bytes, service 01, PID 0D, filled up to eight (SAE J1979, ISO 15765-4)."""
    assert bytes.fromhex("02010d") == SPEED_REQUEST[:3]
    assert 8 == len(SPEED_REQUEST)


def test_an_answer_states_whole_kilometres_per_hour() -> None:
    """`03 41 0D 32` is 50 km/h, whatever fills the frame; all values of the byte are speeds."""
    assert 50 == speed_answer_kmh(bytes.fromhex("03410d32aaaaaaaa"))
    assert list(range(256)) == [speed_answer_kmh(bytes([3, 0x41, 0x0D, kmh])) for kmh in range(256)]


def test_what_is_no_answer_states_nothing() -> None:
    """A refusal, another PID, several frames, a request, a length beyond the frame: no speed."""
    others = (
        *("037f0112", "03410c32aaaaaaaa", "1014410d32aaaaaa", "02010d5555555555", "02410d3255555555"),
        *("07410d32", "03410d", "", "00410d3255555555", "08410d3255555555", "03420d3255555555"),
    )
    assert [None] * len(others) == [speed_answer_kmh(bytes.fromhex(data)) for data in others]


@given(st.binary(max_size=64))
def test_any_bytes_are_a_speed_or_none(data: bytes) -> None:
    """Whatever stands in a frame: the byte behind `41 0D` of a single frame, or nothing."""
    kmh = speed_answer_kmh(data)
    if kmh is not None:
        assert (bytes([0x41, 0x0D, kmh]), True) == (data[1:4], 3 <= data[0] <= 7)
