"""CAN bus on which frames are put, opened again after it was away.

In: frames. Out: whether each was taken. A SocketCAN interface must be virtual: a bridge has no business on a
car's own bus, and `can0` is easily typed for `vcan0`.
"""

from __future__ import annotations

import contextlib
import logging
import math
import socket
import struct
import time

import can

from tpmsd.foundation.errors import ConfigError
from tpmsd.interfaces.bridges.vss_frames import VssFrame

RETRY_S = 1.0
"""Time from a failure to the next attempt, s."""
VIRTUAL = frozenset({"vcan", "vxcan"})
_RTM_GETLINK, _NLM_F_REQUEST, _IFLA_LINKINFO, _IFLA_INFO_KIND = 18, 1, 18, 1
"""Linux's numbers (linux/rtnetlink.h, netlink.h, if_link.h)."""
_HEADERS = struct.Struct("=LHHLLBxHiII")
"""struct nlmsghdr and ifinfomsg."""
_ATTRIBUTE = struct.Struct("=HH")


def link_kind(name: str) -> str | None:
    """Return the kind of a network interface: `vcan`, `vxcan`, '' for hardware; None where it does not
    exist."""
    try:
        index = socket.if_nametoindex(name)
        with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, socket.NETLINK_ROUTE) as netlink:
            netlink.settimeout(1.0)
            netlink.send(_HEADERS.pack(_HEADERS.size, _RTM_GETLINK, _NLM_F_REQUEST, 1, 0, 0, 0, index, 0, 0))
            answer = netlink.recv(1 << 16)
    except OSError:
        return None
    information = _netlink_attributes(answer[_HEADERS.size :]).get(_IFLA_LINKINFO, b"")
    return _netlink_attributes(information).get(_IFLA_INFO_KIND, b"").rstrip(b"\0").decode("ascii", "replace")


def _netlink_attributes(data: bytes) -> dict[int, bytes]:
    """Return netlink attributes, type -> payload: each has a length, a type and a payload padded to 4
    bytes."""
    found = {}
    while len(data) >= _ATTRIBUTE.size:
        length, number = _ATTRIBUTE.unpack_from(data)
        if length < _ATTRIBUTE.size:
            break
        found[number] = data[_ATTRIBUTE.size : length]
        data = data[(length + 3) & ~3 :]
    return found


class CanWire:
    """Open CAN bus on which a bridge sends frames."""

    def __init__(self, interface: str, channel: str, log: logging.Logger) -> None:
        """ConfigError for a SocketCAN interface that is not virtual. A bus that is not there may come."""
        self._interface, self._channel, self._log = interface, channel, log
        if interface == "socketcan" and link_kind(channel) not in (None, *VIRTUAL):
            raise ConfigError(f"{channel} is no virtual CAN interface: values of VSS go on a vcan alone")
        self._bus: can.BusABC | None = None
        self._again_s = -math.inf
        self._said = ""

    def send(self, frame: VssFrame) -> bool:
        """Send a frame; return False if the bus is not available."""
        message = can.Message(arbitration_id=frame.identifier, data=frame.data, is_extended_id=False)
        try:
            self._open()
            if self._bus is None:
                return False
            self._bus.send(message)
        except Exception as error:
            self._close_and_warn(error)
            return False
        if self._said:
            self._log.info("CAN %s takes frames", self._channel)
            self._said = ""
        return True

    def open(self) -> None:
        """Open the bus, which takes seconds with some adapters; if that fails it is tried again later."""
        try:
            self._open()
        except Exception as error:
            self._close_and_warn(error)

    def _open(self) -> None:
        """Open the bus unless it is open or was tried less than `RETRY_S` ago.

        Each of python-can's backends has its own exceptions, from its driver's to ImportError.
        """
        now_s = time.monotonic()
        if self._bus is not None or now_s < self._again_s:
            return
        self._again_s = now_s + RETRY_S
        if self._interface == "socketcan" and link_kind(self._channel) not in VIRTUAL:
            raise OSError("no such virtual CAN interface")
        self._bus = can.Bus(interface=self._interface, channel=self._channel)

    def _close_and_warn(self, error: Exception) -> None:
        """Close the bus, and log the reason unless it was the last one logged."""
        self.close()
        reason = " ".join(str(error).split())
        if reason != self._said:
            self._log.warning("CAN %s: %s; trying again", self._channel, reason)
        self._said = reason

    def close(self) -> None:
        """Close the bus, if it is open."""
        if self._bus is not None:
            with contextlib.suppress(Exception):
                self._bus.shutdown()
            self._bus = None
