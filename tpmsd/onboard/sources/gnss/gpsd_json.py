"""gpsd's reports: JSON lines to solutions.

In: bytes of gpsd's socket in pieces of any size. Out: a `Solution` per TPV report, with the error estimates
that are the receiver's own. Source: gpsd's manual, gpsd_json(5).

gpsd makes up error estimates where a receiver gives none: it multiplies the dilution by 15 or 19 m, and
divides differences of positions for the speed. These say nothing of this receiver, so they are left aside:
then HDOP and the kind of fix tell the position's accuracy, as with NMEA.
"""

from __future__ import annotations

import json
import math
import re
from typing import Any

from tpmsd.foundation.plain import number
from tpmsd.onboard.sources.gnss.nmea_sentence import unix_day
from tpmsd.onboard.sources.gnss.noise import GST_MAX_AGE_S
from tpmsd.onboard.sources.gnss.solution import NAN, Solution

WATCH = b'?WATCH={"enable":true,"json":true}\n'
"""Request that gpsd waits for before it reports."""
MAX_LINE_BYTES = 16384
"""gpsd itself stops at 10240 (GPS_JSON_RESPONSE_MAX)."""
UERE_M = (15.0, 3.75, 19.0, 4.75)
"""gpsd's own factors from HDOP and PDOP to a 95 % error, without and with corrections (libgpsd_core.c)."""
_UERE_TOLERANCE = 0.03
MAX_SPEED_STD_MPS = 1.0
"""Doppler of a receiver that has a fix is better; gpsd's difference of positions is worse."""

_TIME = re.compile(r"(\d{4})-(\d\d)-(\d\d)T(\d\d):(\d\d):(\d\d(?:\.\d{1,9})?)Z", re.ASCII)
_QUALITY = {0: 1, 1: 1, 2: 2, 3: 4, 4: 5, 5: 6, 6: 1, 7: 1, 8: 8, 9: 3}
"""gpsd's TPV status -> GGA quality."""


class GpsdReports:
    """Lines of one connection.

    `counts`: `lines`, `garbage` (no JSON object), `overlong`. `hint`: what is wrong, in a few words.
    """

    def __init__(self) -> None:
        self.counts = {"lines": 0, "garbage": 0, "overlong": 0}
        self.hint = ""
        self._partial = b""
        self._skipping = False
        self._hdop = self._pdop = NAN
        self._satellites = -1
        self._gst: dict[str, Any] = {}

    @property
    def held(self) -> int:
        """Bytes of an unfinished line."""
        return len(self._partial)

    def reset(self) -> None:
        """Forget the unfinished line and the last reports of a connection that has ended."""
        self._partial, self._skipping, self.hint = b"", False, ""
        self._hdop = self._pdop = NAN
        self._satellites, self._gst = -1, {}

    def feed(self, data: bytes) -> list[tuple[bool, Solution]]:
        """Return (whether it began in an earlier piece, the solution) per TPV report that is completed."""
        out = []
        *complete, rest = (self._partial + data).split(b"\n")
        early = bool(self._partial)
        for line in complete:
            if self._skipping:
                self._skipping = False
            elif (solution := self._parse_line(line)) is not None:
                out.append((early, solution))
            early = False
        if len(rest) > MAX_LINE_BYTES:
            self.counts["overlong"] += not self._skipping
            self._skipping, rest = True, b""
        self._partial = rest
        return out

    def _parse_line(self, line: bytes) -> Solution | None:
        """Return the solution of a TPV report; None for every other line, of which accuracy and hint are
        kept."""
        if not line.strip():
            return None
        self.counts["lines"] += 1
        try:
            report = json.loads(line)
        except (ValueError, RecursionError):  # JSONDecodeError and UnicodeDecodeError are ValueErrors
            report = None
        if not isinstance(report, dict):
            self.counts["garbage"] += 1
            if self.counts["garbage"] == self.counts["lines"]:
                self.hint = "what answers is not gpsd"
            return None
        match report.get("class"):
            case "TPV":
                self.hint = ""
                return self._solution(report)
            case "SKY":
                self._keep_sky(report)
            case "GST":
                self._gst = report
            case "DEVICES":
                devices = report.get("devices")
                self.hint = "gpsd has no receiver" if devices == [] else ""
            case "ERROR":
                self.hint = "gpsd refuses: " + "".join(
                    c for c in str(report.get("message"))[:80] if c.isprintable()
                )
        return None

    def _keep_sky(self, report: dict[str, Any]) -> None:
        """Keep dilutions of precision and the number of satellites of a SKY report."""
        self._hdop, self._pdop = reading(report, "hdop"), reading(report, "pdop")
        satellites = report.get("satellites")
        if isinstance(satellites, list):
            self._satellites = sum(isinstance(one, dict) and one.get("used") is True for one in satellites)

    def _solution(self, report: dict[str, Any]) -> Solution:
        """Return the solution that a TPV report states."""
        utc_s = unix_time(report.get("time"))
        mode = reading(report, "mode")
        if not mode >= 2:
            return Solution(utc_s)
        status = reading(report, "status")
        altitude_m = reading(report, "altHAE")
        latitude_std, longitude_std = self._position_stds_m(report, utc_s)
        speed_std = reading(report, "eps")
        return Solution(
            utc_s=utc_s,
            quality=_QUALITY.get(int(status), 1) if 0 <= status < 100 else 1,
            latitude_deg=_nan_beyond(reading(report, "lat"), 90.0),
            longitude_deg=_nan_beyond(reading(report, "lon"), 180.0),
            altitude_m=altitude_m if math.isfinite(altitude_m) else reading(report, "alt"),
            satellites=self._satellites if 0 <= self._satellites <= 99 else None,
            hdop=self._hdop if 0.0 < self._hdop < 100.0 else NAN,
            latitude_std_m=latitude_std,
            longitude_std_m=longitude_std,
            altitude_std_m=reading(report, "epv"),
            speed_mps=reading(report, "speed"),
            speed_std_mps=speed_std if 0.0 < speed_std <= MAX_SPEED_STD_MPS else NAN,
            course_deg=reading(report, "track") % 360.0,
        )

    def _position_stds_m(self, report: dict[str, Any], utc_s: float) -> tuple[float, float]:
        """Return the standard deviations of latitude and longitude, m: from a fresh GST, else from the
        receiver's radius, else NaN."""
        stated = reading(self._gst, "lat"), reading(self._gst, "lon")
        if min(stated) > 0.0 and abs(utc_s - unix_time(self._gst.get("time"))) <= GST_MAX_AGE_S:
            return stated
        radius_m = reading(report, "eph")
        if not (radius_m > 0.0 and self._hdop > 0.0):
            return NAN, NAN
        made_up = (uere_m * dop for uere_m in UERE_M for dop in (self._hdop, self._pdop))
        if any(abs(radius_m - one_m) < _UERE_TOLERANCE * radius_m for one_m in made_up):
            return NAN, NAN
        return radius_m / math.sqrt(2.0), radius_m / math.sqrt(2.0)


def reading(report: dict[str, Any], key: str) -> float:
    """Return the finite number under a key of a report; NaN for anything else."""
    value = number(report.get(key))
    return NAN if value is None else value


def unix_time(text: object) -> float:
    """Return Unix seconds of gpsd's ISO 8601 time; NaN if it is none."""
    match = _TIME.fullmatch(text) if isinstance(text, str) else None
    if match is None:
        return NAN
    day = unix_day(int(match[1]), int(match[2]), int(match[3]))
    hour, minute, second = int(match[4]), int(match[5]), float(match[6])
    if day is None or hour > 23 or minute > 59 or second >= 61.0:
        return NAN
    return 86400.0 * day + 3600.0 * hour + 60.0 * minute + second


def _nan_beyond(value: float, limit: float) -> float:
    """Return the value; NaN if its magnitude exceeds the limit."""
    return value if abs(value) <= limit else NAN
