"""The real drives, from file to fixes. The expected counts were taken with grep."""

from __future__ import annotations

import functools
import math
import re
from pathlib import Path

import numpy as np
import pytest

from tpmsd.onboard.sources.events import Event, GnssFix
from tpmsd.onboard.sources.gnss.nmea_epoch import NmeaAssembler
from tpmsd.onboard.sources.gnss.nmea_framer import NmeaFramer
from tpmsd.onboard.sources.gnss.nmea_log import read_nmea_log
from tpmsd.onboard.timeline.local_plane import LocalPlane
from tpmsd.onboard.timeline.utc_offset import UtcOffsetTracker

COUNTS = {
    "rav4-suburb-60s": {"GGA": 579, "RMC": 579},
    "van-motorway-a": {"GGA": 5579, "VTG": 5576, "ZDA": 558},
    "van-motorway-b": {"GGA": 5867, "VTG": 5866, "ZDA": 587},
    "van-oval": {"GGA": 1743, "ZDA": 175},
}
DRIVES = sorted(COUNTS)


@functools.cache
def fixes_of(path: Path) -> tuple[list[GnssFix], NmeaAssembler, list[Event]]:
    assembler = NmeaAssembler()
    events = [event for time_s, line, _ in read_nmea_log(path) for event in assembler.feed(time_s, line)]
    events += assembler.flush()
    return [event for event in events if isinstance(event, GnssFix)], assembler, events


@pytest.mark.parametrize("drive", DRIVES)
def test_every_sentence_is_counted_and_every_epoch_is_a_fix(recordings: Path, drive: str):
    """All sentences decode, each GGA is one fix with its own UTC and position, and there is no fault."""
    path = recordings / drive / "gnss.nmea"
    found, assembler, events = fixes_of(path)
    kinds = ("RMC", "GGA", "VTG", "ZDA", "GST", "GNS", "GLL", "checksum", "garbage", "ignored", "no_checksum")
    assert {kind: COUNTS[drive].get(kind, 0) for kind in kinds} == {k: assembler.counts[k] for k in kinds}
    assert len(events) == len(found) == COUNTS[drive]["GGA"]
    # Independent reading of every GGA: its UTC as text, its position by plain arithmetic.
    gga = re.findall(r"GGA,(\d\d)(\d\d)([\d.]+),(\d\d)([\d.]+),N,(\d{3})([\d.]+),W,(\d)", path.read_text())
    seconds = [3600 * int(h) + 60 * int(m) + float(s) for h, m, s, *_ in gga]
    assert pytest.approx(seconds, abs=1e-5) == [fix.utc_s % 86400 for fix in found]
    latitudes = [int(d) + float(m) / 60 for *_, d, m, _, _, _ in gga]
    assert latitudes == [fix.latitude_deg for fix in found]
    assert [int(quality) for *_, quality in gga] == [fix.quality for fix in found]


@pytest.mark.parametrize(
    ("drive", "day"), [("rav4-suburb-60s", 17745), ("van-motorway-a", 19915), ("van-oval", 19940)]
)
def test_date(recordings: Path, drive: str, day: int):
    """Dates come from RMC or ZDA: 2018-08-02, 2024-07-11, 2024-08-05."""
    found, _, _ = fixes_of(recordings / drive / "gnss.nmea")
    assert {day} == {int(fix.utc_s // 86400) for fix in found}


@pytest.mark.parametrize("drive", ["rav4-suburb-60s", "van-motorway-a", "van-motorway-b"])
def test_speed_joins_its_own_epoch(recordings: Path, drive: str):
    """The van's VTG, 5 ms before its GGA, fits that epoch as the RAV4's RMC fits its own, and no other.

    Both report the mean speed of the epoch that ends with the fix, which fits the way since the last.
    """
    found, _, _ = fixes_of(recordings / drive / "gnss.nmea")
    utc, speed, latitude, longitude, altitude, quality = (
        np.array([getattr(fix, name) for fix in found])
        for name in ("utc_s", "speed_mps", "latitude_deg", "longitude_deg", "altitude_m", "quality")
    )
    assert np.count_nonzero(np.isnan(speed)) <= 4
    place = LocalPlane().to_plane_array(latitude, longitude, altitude)
    best = 1 if drive.startswith("rav4") else 4
    middle = np.arange(2, utc.size - 2)
    even = np.abs(utc[middle + 1] - utc[middle - 2] - 0.3) < 1e-3
    middle = middle[even & (quality[middle - 1] == best) & (quality[middle] == best)]
    distance = np.hypot(*(place[middle] - place[middle - 1]).T) / 0.1
    misfit = [float(np.nanmedian(np.abs(distance - speed[middle + shift]))) for shift in (-1, 0, 1)]
    assert misfit[1] < 0.6 * min(misfit[0], misfit[2])


@pytest.mark.parametrize("drive", DRIVES)
def test_serial_line_gives_the_same_fixes(recordings: Path, drive: str):
    """The log's bytes through the framer, in pieces of 7, silences told in between, give the same fixes."""
    expected, _, _ = fixes_of(recordings / drive / "gnss.nmea")
    framer, assembler, actual = NmeaFramer(), NmeaAssembler(), []
    for time_s, line, _ in read_nmea_log(recordings / drive / "gnss.nmea"):
        actual += assembler.advance(time_s - 0.001)
        stream = line + b"\r\n"
        for begin in range(0, len(stream), 7):
            for framed in framer.feed(stream[begin : begin + 7]):
                actual += assembler.feed(time_s, framed)
    actual += assembler.flush()
    assert [repr(fix) for fix in expected] == [repr(fix) for fix in actual]
    assert {"overlong": 0, "skipped_bytes": 0} == {k: framer.counts[k] for k in ("overlong", "skipped_bytes")}


@pytest.mark.parametrize(
    ("drive", "spread_s", "wander_s"),
    [
        ("rav4-suburb-60s", 0.012, 0.01),
        ("van-motorway-a", 0.013, 0.07),
        ("van-motorway-b", 0.012, 0.12),
        ("van-oval", 0.008, 0.06),
    ],
)
def test_clock_offset_of_real_drives(recordings: Path, drive: str, spread_s: float, wander_s: float):
    """The offset is followed as it wanders: lags spread by some 10 ms, no step, and validity goes on."""
    found, _, _ = fixes_of(recordings / drive / "gnss.nmea")
    tracker = UtcOffsetTracker()
    lag, offset, valid = [], [], []
    for fix in found:
        valid.append(tracker.update(fix.arrival_s, fix.utc_s))
        assert "ok" == tracker.status
        lag.append(tracker.lag_s)
        offset.append(tracker.offset_s)
    assert float(np.std(lag)) < spread_s
    assert -0.01 < float(np.percentile(lag, 5)) < 0.0 < float(np.median(lag)) < 0.012
    assert wander_s / 3 < float(np.ptp(offset[50:])) < wander_s or drive == "rav4-suburb-60s"
    assert float(np.min(np.diff(valid))) > 0.02
    assert all(math.isfinite(value) for value in valid)
