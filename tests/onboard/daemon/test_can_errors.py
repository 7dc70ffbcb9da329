"""Error frames by linux/can/error.h."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tpmsd.onboard.daemon.can_errors import HINTS, error_names, hint_after

PASSIVE = HINTS["error_passive"]


@pytest.mark.parametrize(
    ("identifier", "data", "names"),
    [
        (0x001, "0000000000000000", {"tx_timeout"}),
        (0x002, "0500000000000000", {"lost_arbitration"}),
        (0x004, "0001000000000000", {"controller_overflow"}),
        (0x004, "0002000000000000", {"controller_overflow"}),
        (0x004, "0008000000006000", {"error_warning"}),
        (0x004, "0030000000008282", {"error_passive"}),
        (0x004, "0040000000000000", {"error_active"}),
        (0x088, "0000040000000000", {"bus_error"}),
        (0x010, "0000000040000000", {"transceiver"}),
        (0x020, "0000000000000000", {"not_acknowledged"}),
        (0x040, "0000000000000000", {"bus_off"}),
        (0x044, "0020000000008800", {"bus_off", "error_passive"}),
        (0x100, "0000000000000000", {"restarted"}),
        (0x204, "0004000000006000", {"error_warning"}),
        (0x004, "", set()),
        (0x000, "FFFFFFFFFFFFFFFF", set()),
    ],
)
def test_the_kernels_classes_have_names(identifier: int, data: str, names: set[str]) -> None:
    """Each class of the kernel's header, with the detail that a controller gives in data[1]."""
    assert names == error_names(identifier, bytes.fromhex(data))


def test_the_worst_state_is_reported_until_it_ends() -> None:
    """Passive outweighs warning; other errors change nothing; active, a restart and bus-off take it back."""
    assert PASSIVE == hint_after({"error_passive", "error_warning"}, "")
    assert PASSIVE == hint_after({"bus_error"}, PASSIVE)
    assert HINTS["error_warning"] == hint_after({"error_warning"}, PASSIVE)
    assert ["", "", ""] == [hint_after({name}, PASSIVE) for name in ("error_active", "restarted", "bus_off")]


@given(st.integers(0, 0x1FFFFFFF), st.binary(max_size=64))
def test_no_error_frame_is_too_odd(identifier: int, data: bytes) -> None:
    """Any frame gives names out of a bounded set, so that counters cannot grow without end."""
    assert len(error_names(identifier, data)) <= 13
