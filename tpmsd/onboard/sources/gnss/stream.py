"""Stamped sentences from a receiver's bytes, whatever its protocol.

In: bytes in pieces, each with the host time at which it came. Out: NMEA lines, each with the time of the
first byte of the message that it was or was made of. One interface, so that the daemon's link knows none of
the protocols.
"""

from __future__ import annotations

from typing import Protocol

from tpmsd.onboard.sources.gnss.gpsd_json import GpsdReports
from tpmsd.onboard.sources.gnss.nmea_framer import NmeaFramer
from tpmsd.onboard.sources.gnss.solution import sentences
from tpmsd.onboard.sources.gnss.ubx import UbxFramer, nav_pvt

NMEA_AFTER_PVT = 200
"""Lines of NMEA without a NAV-PVT among them, after which NMEA is listened to again: ten epochs and more."""

UBX_WITHOUT_PVT = 50
"""Frames of other messages, and no line of NMEA, after which the receiver's settings are suspected."""

StampedLine = tuple[float, bytes]


class GnssStream(Protocol):
    """Stream that turns a receiver's bytes into stamped sentences."""

    @property
    def lines(self) -> int:
        """Lines handed out so far."""

    @property
    def overlong(self) -> int:
        """Messages given up because they did not end."""

    @property
    def hint(self) -> str:
        """Possible fault of an open line, in words; empty if nothing is found."""

    def feed(self, data: bytes, stamp_s: float) -> list[StampedLine]:
        """Return the lines that this piece completes."""

    def reset(self) -> None:
        """Forget the unfinished message: the line was closed and opened again."""


class NmeaStream:
    """NMEA, and u-blox's NAV-PVT in between.

    A receiver that sends both says each epoch twice; NAV-PVT knows more, so the NMEA beside it is left out.
    """

    def __init__(self) -> None:
        self._ubx, self._nmea = UbxFramer(), NmeaFramer()
        self._begun_ubx_s = self._begun_s = 0.0
        """Times at which the unfinished frame and the unfinished line began."""
        self._since_pvt = NMEA_AFTER_PVT
        self._pvt_lines = 0

    @property
    def lines(self) -> int:
        """Lines handed out so far."""
        return self._nmea.counts["lines"] + self._pvt_lines

    @property
    def overlong(self) -> int:
        """Lines given up because they did not end."""
        return self._nmea.counts["overlong"]

    @property
    def hint(self) -> str:
        """Likely fault of baud rate or settings, in words; empty if none is found."""
        if self._since_pvt < NMEA_AFTER_PVT:
            return ""
        if self._ubx.counts["frames"] >= UBX_WITHOUT_PVT and not self.lines:
            return "UBX without NAV-PVT: the receiver must be told to send it"
        return "bytes but no sentence: wrong baud rate?" if self._nmea.wrong_baud else ""

    def feed(self, data: bytes, stamp_s: float) -> list[StampedLine]:
        """Return the lines that this piece completes."""
        out: list[StampedLine] = []
        held_s, early = self._begun_ubx_s, self._ubx.held
        for is_frame, piece in self._ubx.feed(data):
            piece_s = held_s if early > 0 else stamp_s
            early -= len(piece)
            if not is_frame:
                out += self._feed_nmea(piece, piece_s)
            elif (solution := nav_pvt(piece)) is not None:
                made = sentences(solution)
                self._since_pvt = 0
                self._pvt_lines += len(made)
                out += [(piece_s, line) for line in made]
        if early <= 0:  # what is held now began in this piece
            self._begun_ubx_s = stamp_s
        return out

    def _feed_nmea(self, data: bytes, stamp_s: float) -> list[StampedLine]:
        """Return the NMEA lines that this piece completes; none while NAV-PVT comes."""
        # A line that is not whole in this piece began in an earlier one.
        lines = [(stamp_s if line in data else self._begun_s, line) for line in self._nmea.feed(data)]
        if b"$" in data[max(data.rfind(b"\n"), data.rfind(b"\r")) + 1 :]:
            self._begun_s = stamp_s
        if self._since_pvt < NMEA_AFTER_PVT:
            self._since_pvt += len(lines)
            return []
        return lines

    def reset(self) -> None:
        """Forget the unfinished line and frame."""
        self._ubx.reset()
        self._nmea.reset()


class GpsdStream:
    """gpsd's JSON."""

    def __init__(self) -> None:
        self._reports = GpsdReports()
        self._begun_s = 0.0
        self.lines = 0

    @property
    def overlong(self) -> int:
        """Reports given up because they did not end."""
        return self._reports.counts["overlong"]

    @property
    def hint(self) -> str:
        """Message of gpsd, or that another service answers in its place; empty if there is none."""
        return self._reports.hint

    def feed(self, data: bytes, stamp_s: float) -> list[StampedLine]:
        """Return the lines made of the reports that this piece completes."""
        out: list[StampedLine] = []
        idle = not self._reports.held
        for early, solution in self._reports.feed(data):
            made = sentences(solution)
            self.lines += len(made)
            out += [(self._begun_s if early else stamp_s, line) for line in made]
        if idle or b"\n" in data:
            self._begun_s = stamp_s
        return out

    def reset(self) -> None:
        """Forget the unfinished report."""
        self._reports.reset()
