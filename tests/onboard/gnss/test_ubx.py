"""UBX frames in a stream, and NAV-PVT; the frames are made by another library."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pyubx2 import GET, UBXMessage

from tpmsd.onboard.sources.gnss.ubx import MAX_PAYLOAD_BYTES, UbxFramer, nav_pvt

PVT: dict[str, Any] = {
    "year": 2026, "month": 3, "day": 29, "hour": 9, "min": 59, "second": 60,
    "validDate": 1, "validTime": 1, "fullyResolved": 1, "tAcc": 25, "nano": -123456789,
    "fixType": 3, "gnssFixOk": 1, "numSV": 17,
    "lat": 48.1234567, "lon": -11.7654321, "height": 512345, "hMSL": 465000, "hAcc": 1414, "vAcc": 2300,
    "gSpeed": 27345, "headMot": 359.12345, "sAcc": 87, "headAcc": 0.5, "pDOP": 1.23,
}  # fmt: skip


def frame(**changed: Any) -> bytes:
    return bytes(UBXMessage("NAV", "NAV-PVT", GET, **(PVT | changed)).serialize())


def test_a_solution_is_decoded_to_the_last_digit() -> None:
    """Time to the nanosecond, position, speed and the receiver's own accuracies come out in SI units."""
    got = nav_pvt(frame())

    assert got is not None
    assert 1774778400.0 - 0.123456789 == pytest.approx(got.utc_s, abs=3e-7)
    assert (48.1234567, -11.7654321) == pytest.approx((got.latitude_deg, got.longitude_deg), abs=1e-9)
    assert (512.345, 27.345, 359.12345) == pytest.approx((got.altitude_m, got.speed_mps, got.course_deg))
    assert (0.087, 1.0, 1.0, 2.3) == pytest.approx(
        (got.speed_std_mps, got.latitude_std_m, got.longitude_std_m, got.altitude_std_m), rel=1e-3
    )
    assert (1, 17) == (got.quality, got.satellites)


@pytest.mark.parametrize(
    ("changed", "quality"),
    [
        ({"fixType": 0}, 0),
        ({"fixType": 5}, 0),
        ({"gnssFixOk": 0}, 0),
        ({"fixType": 1}, 6),
        ({"diffSoln": 1}, 2),
        ({"carrSoln": 1, "diffSoln": 1}, 5),
        ({"carrSoln": 2, "diffSoln": 1}, 4),
    ],
)
def test_the_kind_of_fix_becomes_a_quality(changed: dict[str, int], quality: int) -> None:
    """Fix type and flags map to GGA's numbers; without a good fix there is no position."""
    got = nav_pvt(frame(**changed))

    assert got is not None
    assert (quality, quality > 0) == (got.quality, math.isfinite(got.latitude_deg))


@pytest.mark.parametrize("changed", [{"validTime": 0}, {"validDate": 0}, {"month": 13}, {"hour": 24}])
def test_a_time_that_is_not_valid_is_none(changed: dict[str, int]) -> None:
    """A receiver that does not know the time yet, or says one that no clock has, gives none."""
    got = nav_pvt(frame(**changed))

    assert got is not None and math.isnan(got.utc_s)


def test_other_messages_are_left_alone() -> None:
    """A frame of another message, or a NAV-PVT that is too short, is no solution."""
    ack = UBXMessage("ACK", "ACK-ACK", GET, clsID=6, msgID=1).serialize()
    framed = UbxFramer().feed(ack)

    assert [(True, ack)] == framed
    assert nav_pvt(ack) is None
    assert nav_pvt(frame()[:60]) is None


@settings(derandomize=True, deadline=None, max_examples=150)
@given(
    st.lists(
        st.one_of(
            st.just(frame()),
            st.just(b"$GNRMC,1,2,3\r\n"),
            st.binary(max_size=40),
            st.just(frame()[:-1] + b"\0"),
            st.just(b"\xb5\x62\x01\x07\xff\xff"),
            st.just(b"\xb5"),
        ),
        max_size=8,
    ),
    st.lists(st.integers(1, 60), min_size=1, max_size=10),
)
def test_cuts_change_nothing_and_nothing_is_lost(pieces: list[bytes], cuts: list[int]) -> None:
    """However the stream is cut, the same frames come out, and all other bytes in their order."""
    stream = b"".join(pieces)
    whole, cut = UbxFramer(), UbxFramer()
    expected = whole.feed(stream)
    got: list[tuple[bool, bytes]] = []
    at = 0
    while at < len(stream):
        size = cuts[at % len(cuts)]
        got += cut.feed(stream[at : at + size])
        at += size
        assert cut.held <= MAX_PAYLOAD_BYTES + 8

    assert [f for is_frame, f in expected if is_frame] == [f for is_frame, f in got if is_frame]
    assert b"".join(f for _, f in expected) == b"".join(f for _, f in got)
    assert stream == b"".join(f for _, f in got) + stream[len(stream) - cut.held :]
