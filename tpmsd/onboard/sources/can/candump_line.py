"""One line as `candump -L` writes it.

In: a line. Out: a `CanFrame`, or None. Pure.

    (1719820800.012345) can0 0B0#1122334455667788        standard identifier: three digits
    (1719820800.012345) can0 18FEF100#11223344 R         extended: eight; a direction may follow
    (1719820800.012345) can0 123##1001122                CAN FD: two #, one digit of flags
    (1719820800.012345) can0 123#R8                      remote frame, with its length
    (1719820800.012345) can0 20000080#0000000000000000   error frame
    (1719820800.012345) can0 123#1122334455667788_9      classic frame with its raw length code
"""

from __future__ import annotations

import re

from tpmsd.onboard.sources.can.frame import CanFrame

ERROR_FLAG = 0x20000000
EXTENDED_MASK = 0x1FFFFFFF
MAX_STANDARD = 0x7FF

LINE = re.compile(
    r"\((\d{1,12}\.\d{1,9})\)[ \t]+(\S+)[ \t]+"
    r"(?:([0-9A-Fa-f]{3})|([0-9A-Fa-f]{8}))#"
    r"(?:((?:[0-9A-Fa-f]{2}){0,8})(?:_[0-9A-Fa-f])?"
    r"|(R)[0-9A-Fa-f]?(?:_[0-9A-Fa-f])?"
    r"|#[0-9A-Fa-f]((?:[0-9A-Fa-f]{2}){0,64}))"
    r"(?:[ \t]+[RT])?[ \t]*$",
    re.ASCII,
)
"""Groups: stamp, channel, standard identifier, extended identifier, data, R of a remote frame, data of
CAN FD."""


def parse_candump_line(line: str, number: int = 0) -> CanFrame | None:
    """Return the frame of one line; None if the line is not one."""
    match = LINE.match(line)
    if match is None:
        return None
    time_s, channel, standard, extended, data, remote, fd_data = match.groups()
    if standard is not None:
        identifier = int(standard, 16)
        if identifier > MAX_STANDARD:
            return None
        is_extended = is_error = False
    else:
        identifier = int(extended, 16)
        is_error = bool(identifier & ERROR_FLAG)
        # Bits 31 and 30 are SocketCAN's flags for extended and remote; candump leaves them out.
        is_extended = not is_error
        identifier &= EXTENDED_MASK
    return CanFrame(
        float(time_s),
        channel,
        identifier,
        is_extended,
        fd_data is not None,
        is_error,
        remote is not None,
        bytes.fromhex(data or fd_data or ""),
        number,
    )
