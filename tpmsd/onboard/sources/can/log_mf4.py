"""CAN frames of an MF4 log, read by asammdf in a process of its own.

In: a path. Out: frames; ValueError where the file is damaged. Each frame is a packed record; see `_RECORD`.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from pathlib import Path

from tpmsd.foundation.child_reader import ChildReader, Send, limit
from tpmsd.foundation.startup import bring_in_mf4
from tpmsd.onboard.sources.can.frame import CanFrame
from tpmsd.onboard.sources.can.packed_bounds import check_mf4

_RECORD = struct.Struct("<dI4?BB")
"""Time, identifier, extended, FD, error, remote, lengths of channel and data."""
_RECORDS_PER_MESSAGE = 1000


def read_mf4(path: Path) -> Iterator[CanFrame]:
    """Yield all frames; the child ends with the iteration."""
    with ChildReader(f"{__name__}:send_frames", path) as child:
        while (message := child.receive()) is not None:
            at = 0
            while at < len(message):
                time_s, number, extended, fd, error, remote, named, size = _RECORD.unpack_from(message, at)
                at += _RECORD.size + named + size
                channel = message[at - named - size : at - size].decode()
                yield CanFrame(
                    time_s, channel, number, extended, fd, error, remote, message[at - size : at], 0
                )


def send_frames(path: Path, _: Iterator[str], send: Send) -> None:
    """Send the frames of the file, as the child."""
    bring_in_mf4()
    from can.io.mf4 import MF4Reader

    from tpmsd.onboard.sources.can.log_others import frame_of

    limit(path)
    with path.open("rb") as file:
        check_mf4(file)
    records: list[bytes] = []
    flush = _make_flush(records, send)
    try:
        with MF4Reader(path) as reader:
            for message in reader:
                frame = frame_of(message)
                channel = frame.channel.encode()[:255]
                fields = (frame.is_extended, frame.is_fd, frame.is_error, frame.is_remote)
                sizes = (len(channel), len(frame.data))
                records.append(
                    _RECORD.pack(frame.time_s, frame.arbitration_id, *fields, *sizes) + channel + frame.data
                )
                if len(records) == _RECORDS_PER_MESSAGE:
                    flush()
    finally:
        flush()


def _make_flush(records: list[bytes], send: Send) -> Callable[[], None]:
    """Return a function that sends the gathered records and empties the list."""

    def flush() -> None:
        if records:
            send(b"".join(records))
            records.clear()

    return flush
