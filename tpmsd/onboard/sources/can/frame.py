"""One frame of a CAN bus, as a log or an interface has it.

In: nothing (a plain record). Out: `CanFrame`.
"""

from __future__ import annotations

from typing import NamedTuple


class CanFrame(NamedTuple):
    """One frame. A named tuple, because a drive has hundreds of thousands."""

    time_s: float
    """Host time stamp, epoch seconds."""
    channel: str
    """Name of the interface; empty if the log has none."""
    arbitration_id: int
    is_extended: bool
    is_fd: bool
    is_error: bool
    is_remote: bool
    data: bytes
    line: int = 0
    """Line in the log; 0 where there are no lines."""
