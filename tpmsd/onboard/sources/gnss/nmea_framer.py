"""Cuts NMEA 0183 sentences out of any byte stream.

In: bytes as they come from a serial line, in pieces of any size, with binary protocols, noise and cut lines
in between. Out: complete candidate lines, from `$` up to the line end (which is taken off). Whether a
candidate is a sound sentence is for `nmea_sentence` to say. Memory is bounded by the longest line that is
accepted.
"""

from __future__ import annotations

import re

MAX_LINE_BYTES = 256
"""NMEA 0183 allows 82; receivers with long proprietary or high-precision sentences exceed that threefold."""

_LINE_END = re.compile(rb"[\r\n]+")
_ADDRESS = re.compile(rb"\$[A-Z][A-Z0-9]{2,}[,*]")
WRONG_BAUD_BYTES = 2000


class NmeaFramer:
    """Byte stream in, candidate lines out; the result does not depend on how the stream was cut into pieces.

    `counts`: `lines` handed out, `overlong` candidates given up, `skipped_bytes` that were in no candidate.
    """

    def __init__(self, max_line_bytes: int = MAX_LINE_BYTES) -> None:
        self.counts: dict[str, int] = {"lines": 0, "overlong": 0, "skipped_bytes": 0}
        self._max = max_line_bytes
        self._partial = b""
        self._bytes_since_line = 0

    @property
    def wrong_baud(self) -> bool:
        """True if bytes keep coming but no sentence: most likely another baud rate or a binary protocol."""
        return self._bytes_since_line >= WRONG_BAUD_BYTES

    def feed(self, data: bytes) -> list[bytes]:
        """Return the candidate lines that `data` completes, in order."""
        self._bytes_since_line += len(data)
        *complete, rest = _LINE_END.split(self._partial + data)
        lines = [line for piece in complete if (line := self._candidate_line(piece)) is not None]
        self._partial = self._from_last_dollar(rest)
        if len(self._partial) > self._max:
            self._count_skipped(self._partial)
            self._partial = b""
        if lines:
            self.counts["lines"] += len(lines)
            self._bytes_since_line = len(self._partial)
        return lines

    def reset(self) -> None:
        """Forget the unfinished line, for example when the line was unplugged in the middle of it."""
        self.counts["skipped_bytes"] += len(self._partial)
        self._partial = b""

    def _candidate_line(self, piece: bytes) -> bytes | None:
        """Return the sentence at the end of a piece; None if it has no `$`, no NMEA address, or is too
        long."""
        line = self._from_last_dollar(piece)
        if not line:
            return None
        # A `$` inside a binary message starts no sentence; an address field (talker and type) follows a true
        # one.
        if len(line) > self._max or _ADDRESS.match(line) is None:
            self._count_skipped(line)
            return None
        return line

    def _from_last_dollar(self, piece: bytes) -> bytes:
        """Return the bytes from the last `$` on, empty if there is none: a sentence begins there, so whatever
        came before was cut off."""
        start = piece.rfind(b"$")
        if start < 0:
            self.counts["skipped_bytes"] += len(piece)
            return b""
        before, *cut = piece[:start].split(b"$")
        self.counts["skipped_bytes"] += len(before)
        for segment in cut:
            self._count_skipped(b"$" + segment)
        return piece[start:]

    def _count_skipped(self, line: bytes) -> None:
        """Count the bytes of a line that is dropped, and the line if it is too long."""
        self.counts["skipped_bytes"] += len(line)
        self.counts["overlong"] += len(line) > self._max
