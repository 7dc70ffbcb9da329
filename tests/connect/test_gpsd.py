"""Debian's gpsd, fed by a pseudo terminal."""

from __future__ import annotations

import logging
import os
import signal
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import pytest

from tests.connect.servers import Server, free_port, program, raw_pty
from tests.onboard.gnss import sentences as nmea
from tests.onboard.gnss.test_ubx import frame
from tpmsd.car.config.model import GnssConfig
from tpmsd.onboard.daemon.receiver_link import ReceiverLink, configured_receiver, configured_stream
from tpmsd.onboard.sources.events import GnssFix
from tpmsd.onboard.sources.gnss.nmea_epoch import NmeaAssembler

LOG = logging.getLogger("tests.connect")
RATE_HZ = 5
Epoch = Callable[[int, float], bytes]


def nmea_epoch(number: int, utc_s: float) -> bytes:
    """North at 20 m/s."""
    at = (48.0 + number * 20.0 / RATE_HZ / 111_195.0, 11.0)
    lines = [
        nmea.rmc(utc_s, at=at, speed_mps=20.0, course_deg=0.0),
        nmea.gga(utc_s, at=at, hdop=0.9),
        nmea.gst(utc_s, 0.7, 0.5),
    ]
    return b"".join(line + b"\r\n" for line in lines)


def ubx_epoch(number: int, utc_s: float) -> bytes:
    """The same from a receiver of u-blox, which knows how sure it is of the speed."""
    at = time.gmtime(utc_s)
    date = {"year": at.tm_year, "month": at.tm_mon, "day": at.tm_mday}
    clock = {"hour": at.tm_hour, "min": at.tm_min, "second": at.tm_sec, "nano": int(utc_s % 1 * 1e9)}
    week_ms = int((utc_s - 315964800 + 18) % 604800 * 1000)
    place = {"lat": 48.0 + number * 20.0 / RATE_HZ / 111_195.0, "lon": 11.0}
    return frame(**date, **clock, **place, iTOW=week_ms, gSpeed=20000, headMot=0.0)


class Feed:
    """Epochs into a pty at their pace, and what the link makes of them."""

    def __init__(self, master: int, link: ReceiverLink, epoch: Epoch) -> None:
        self._master, self.link, self._epoch = master, link, epoch
        self._assembler = NmeaAssembler()
        self._first = self._last = int(time.time() * RATE_HZ)
        self.fixes: list[GnssFix] = []

    def drive(self, seconds: float) -> None:
        """Go on for so long."""
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            now_s = time.time()
            if (epoch := int(now_s * RATE_HZ)) > self._last:
                # Where the car is follows from the time of validity, however late this loop is.
                os.write(self._master, self._epoch(epoch - self._first, epoch / RATE_HZ))
                self._last = epoch
            self.link.service(time.monotonic())
            for stamp_s, line in self.link.read(time.monotonic(), now_s):
                self._take(self._assembler.feed(stamp_s, line))
            self._take(self._assembler.advance(now_s))
            time.sleep(0.005)

    def _take(self, events: list[object]) -> None:
        self.fixes += [event for event in events if isinstance(event, GnssFix)]


def gpsd(folder: Path, device: str) -> Server:
    port = free_port()
    return Server([program("gpsd"), "-N", "-n", "-S", str(port), device], folder / "gpsd.log", port)


@pytest.mark.parametrize(("epoch", "accuracy"), [(nmea_epoch, None), (ubx_epoch, 0.09)])
def test_fixes_come_through_gpsd_also_when_it_restarts(
    epoch: Epoch, accuracy: float | None, tmp_path: Path
) -> None:
    """Positions, speeds and the receiver's own accuracy come through; a killed gpsd is found again."""
    with raw_pty() as (master, device):
        server = gpsd(tmp_path, device)
        config = GnssConfig(source=f"gpsd://localhost:{server.port}")
        link = ReceiverLink(configured_receiver(config), "gpsd", LOG, configured_stream(config))
        feed = Feed(master, link, epoch)
        with server:
            feed.drive(5.0)
            before = len(feed.fixes)
            server.stop(signal.SIGKILL)
            feed.drive(1.0)
            was_down = link.is_down
            server.start()
            feed.drive(6.0)
        link.close()
    moving = [fix for fix in feed.fixes if fix.speed_mps == pytest.approx(20.0, abs=0.01)]
    after = [fix for fix in moving if fix.arrival_s > feed.fixes[before - 1].arrival_s + 1.0]

    assert was_down and not link.is_down
    assert before >= 10 and len(after) >= 10
    assert len(moving) >= 0.8 * len(feed.fixes)
    # 20 m/s north: what lies between two fixes is what they say of their speed.
    steps = [
        ((b.latitude_deg - a.latitude_deg) * 111_195.0, b.utc_s - a.utc_s)
        for a, b in pairwise(moving)
        if b.utc_s - a.utc_s < 0.3
    ]
    assert len(steps) >= 20
    assert [4.0] * len(steps) == pytest.approx([distance_m for distance_m, _ in steps], abs=0.1)
    assert [0.2] * len(steps) == pytest.approx([time_s for _, time_s in steps], abs=1e-3)
    stated = {round(fix.speed_std_mps, 3) for fix in moving if fix.speed_std_mps == fix.speed_std_mps}
    assert (set() if accuracy is None else {accuracy}) == stated
    assert all(0.0 <= fix.arrival_s - fix.utc_s < 1.0 for fix in moving)
