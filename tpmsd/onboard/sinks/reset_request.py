"""Request to learn the tyres again, in the two forms in which it reaches the pipeline.

In: a CAN frame or a sentence. Out: the name of the set of tyres that is asked for. Both forms are inputs with
a stamp: so a recording holds the request, and a replay resets at the very same tick.

As a CAN frame, where `[alarms] reset_id` names an identifier: three bytes, the checksum of `can_layout` with
the data id 0xF2, 0x52 ('R'), and the number of the set: 0 the one that is driven, 1 to 7 "set1" to "set7".

As a sentence, which the daemon makes of `tpmsd reset`: $PTPMSD,RESET,NAME*hh. A receiver that sends one is
rejected: the daemon lets through its own alone.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import reduce

from tpmsd.onboard.sinks.can_layout import crc8_j1850

PREFIX = b"$PTPMSD"
"""Prefix of all sentences that the daemon itself makes."""
RESET_DATA_ID = 0xF2
RESET_CODE = 0x52
_LENGTH = 3
_HIGHEST_SET = 7
_SENTENCE = re.compile(rb"\$(PTPMSD,RESET,([a-z0-9_-]{0,24}))\*([0-9A-F]{2})\s*")


@dataclass(frozen=True, slots=True)
class ResetRequest:
    """Request to learn the tyres again."""

    tyres: str | None
    """Name of a set of tyres; None for the one that is driven."""


def from_frame(data: bytes) -> ResetRequest | None:
    """Return the request in a frame's data; None if it is none."""
    if len(data) < _LENGTH or data[1] != RESET_CODE or data[2] > _HIGHEST_SET:
        return None
    if data[0] != crc8_j1850(bytes((RESET_DATA_ID, *data[1:_LENGTH]))):
        return None
    return ResetRequest(f"set{data[2]}" if data[2] else None)


def to_frame(number: int = 0) -> bytes:
    """Return the frame's data of a reset request for the set of that number."""
    body = bytes((RESET_CODE, number))
    return bytes((crc8_j1850(bytes((RESET_DATA_ID, *body))),)) + body


def from_sentence(line: bytes) -> ResetRequest | None:
    """Return the request in a sentence; None if it is none, or its checksum is wrong."""
    match = _SENTENCE.fullmatch(line)
    if match is None or int(match[3], 16) != _checksum(match[1]):
        return None
    return ResetRequest(match[2].decode("ascii") or None)


def to_sentence(request: ResetRequest) -> bytes:
    """Return the request as a sentence, without line end."""
    body = b"PTPMSD,RESET," + (request.tyres or "").encode("ascii")
    return b"$%s*%02X" % (body, _checksum(body))


def _checksum(body: bytes) -> int:
    return reduce(lambda total, byte: total ^ byte, body, 0)
