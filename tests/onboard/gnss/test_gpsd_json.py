"""gpsd's reports, as its manual and its own receivers have them."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tpmsd.onboard.sources.gnss.gpsd_json import MAX_LINE_BYTES, GpsdReports
from tpmsd.onboard.sources.gnss.solution import Solution

TPV: dict[str, Any] = {
    "class": "TPV", "device": "/dev/ttyACM0", "mode": 3, "time": "2026-03-29T10:00:00.100Z",
    "lat": 48.25, "lon": 11.5, "altHAE": 512.5, "altMSL": 465.0, "track": 90.5, "speed": 27.25, "eph": 1.0,
    "epv": 2.0, "eps": 0.08,
}  # fmt: skip
SKY = {"class": "SKY", "hdop": 0.8, "satellites": [{"PRN": 1, "used": True}, {"PRN": 2, "used": False}]}
GST = {"class": "GST", "time": "2026-03-29T10:00:00.000Z", "lat": 0.6, "lon": 0.4}


def line(report: object) -> bytes:
    return json.dumps(report).encode() + b"\r\n"


def last(*reports: object) -> Solution:
    got = GpsdReports().feed(b"".join(map(line, reports)))
    return got[-1][1]


def test_a_report_becomes_a_solution() -> None:
    """Time, place and motion of a TPV with what SKY says of satellites and dilution."""
    got = last(SKY, TPV)

    assert 1774778400.1 == pytest.approx(got.utc_s, abs=1e-6)
    assert (48.25, 11.5, 512.5, 27.25, 90.5) == (
        *(got.latitude_deg, got.longitude_deg, got.altitude_m, got.speed_mps, got.course_deg),
    )
    assert (1, 1, 0.8, 0.08) == (got.quality, got.satellites, got.hdop, got.speed_std_mps)
    assert math.sqrt(0.5) == pytest.approx(got.latitude_std_m)


def test_error_estimates_of_the_receiver_are_distinguished_from_those_that_gpsd_makes_up() -> None:
    """A radius that is the dilution times gpsd's constant, or a speed error of metres per second, goes."""
    assert (0.6, 0.4) == (last(SKY, GST, TPV).latitude_std_m, last(SKY, GST, TPV).longitude_std_m)
    made_up = last(SKY, TPV | {"eph": 12.0, "eps": 24.0})
    assert [True, True] == [math.isnan(made_up.latitude_std_m), math.isnan(made_up.speed_std_mps)]
    old = last(SKY, GST | {"time": "2026-03-29T09:59:00.000Z"}, TPV)
    assert math.sqrt(0.5) == pytest.approx(old.latitude_std_m)


@pytest.mark.parametrize(
    ("changed", "quality"),
    [({"mode": 1}, 0), ({"mode": 0}, 0), ({"status": 2}, 2), ({"status": 3}, 4), ({"status": 4}, 5)],
)
def test_mode_and_status_become_a_quality(changed: dict[str, int], quality: int) -> None:
    """Without a fix there is no position; corrections are told apart."""
    got = last(TPV | changed)

    assert (quality, quality > 0) == (got.quality, math.isfinite(got.latitude_deg))


def test_hints_say_what_is_wrong() -> None:
    """A server that is not gpsd, a gpsd without receiver and a refusal are said in words."""
    reports = GpsdReports()
    reports.feed(b"SSH-2.0-OpenSSH_9.2\r\n")
    hints = [reports.hint]
    for report in ({"class": "DEVICES", "devices": []}, {"class": "ERROR", "message": "no\x1b[31m"}, TPV):
        reports.feed(line(report))
        hints.append(reports.hint)

    assert ["what answers is not gpsd", "gpsd has no receiver", "gpsd refuses: no[31m", ""] == hints


def test_memory_is_bounded() -> None:
    """A line without end is given up, and the next one read."""
    reports = GpsdReports()
    for _ in range(20):
        reports.feed(b"x" * 4000)
        assert reports.held <= MAX_LINE_BYTES
    assert 1 == reports.counts["overlong"]
    assert [] == reports.feed(b"end\n")
    assert 1 == len(reports.feed(line(TPV)))


values = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=5), st.lists(st.integers()),
    st.sampled_from([TPV["time"], "2026-13-29T10:00:00Z", "9999-12-31T23:59:60.9Z"]),
)  # fmt: skip


@settings(derandomize=True, deadline=None, max_examples=200)
@given(
    st.sampled_from([TPV, SKY, GST]),
    st.dictionaries(st.sampled_from(sorted({*TPV, *SKY, "status"})), values),
    st.integers(1, 50),
)
def test_odd_values_are_borne(base: dict[str, Any], changed: dict[str, Any], cut: int) -> None:
    """Whatever stands where a number or a text belongs, positions are within the globe or unknown."""
    data = line(base | changed) + line(TPV)
    reports = GpsdReports()
    got = [one for at in range(0, len(data), cut) for one in reports.feed(data[at : at + cut])]

    assert got
    for _, solution in got:
        assert not abs(solution.latitude_deg) > 90.0 and not abs(solution.longitude_deg) > 180.0
        assert math.isnan(solution.speed_std_mps) or 0.0 < solution.speed_std_mps <= 1.0
