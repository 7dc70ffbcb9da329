"""Decoding of SocketCAN error frames, after linux/can/error.h.

In: the identifier and data of an error frame. Out: names of what happened, for the counts of the status, and
the state that the controller is in now, where the frame tells one.
"""

from __future__ import annotations

BUS_OFF = "bus_off"
RESTARTED = "restarted"

_CLASSES = {
    0x001: "tx_timeout",
    0x002: "lost_arbitration",
    0x008: "bus_error",
    0x010: "transceiver",
    0x020: "not_acknowledged",
    0x040: BUS_OFF,
    0x080: "bus_error",
    0x100: RESTARTED,
}
"""Bits of the identifier. CAN_ERR_PROT and CAN_ERR_BUSERROR come together and are one thing."""
_CONTROLLER = 0x004
_CONTROLLER_STATES = {
    0x01: "controller_overflow",
    0x02: "controller_overflow",
    0x04: "error_warning",
    0x08: "error_warning",
    0x10: "error_passive",
    0x20: "error_passive",
    0x40: "error_active",
}
"""Bits of data[1] where the identifier has CAN_ERR_CRTL; receiver and transmitter are not distinguished."""

HINTS = {
    "error_passive": "error-passive: most frames are damaged (wiring, termination or bit rate)",
    "error_warning": "error-warning: many frames are damaged (wiring, termination or bit rate)",
}
"""Meaning of a controller's state for the person who looks after the car."""


def error_names(identifier: int, data: bytes) -> set[str]:
    """Return the names of the errors in an error frame; empty if none is known."""
    names = {name for bit, name in _CLASSES.items() if identifier & bit}
    if identifier & _CONTROLLER and len(data) > 1:
        names |= {name for bit, name in _CONTROLLER_STATES.items() if data[1] & bit}
    return names


def hint_after(names: set[str], before: str) -> str:
    """Return the hint on the controller's state after an error frame; `before`: the hint until then."""
    for state, hint in HINTS.items():
        if state in names:
            return hint
    return "" if names & {"error_active", RESTARTED, BUS_OFF} else before
