"""The names of what a signal of `[[can.output]]` may be filled with.

In: nothing. Out: the names. `tpmsd.onboard.sinks.output_values` says what they are.
"""

from __future__ import annotations

from tpmsd.foundation.wheels import WHEELS

OF_WHEEL = ("state", "alarm", "deflation", "radius_deviation", "deviation_mm", "change_mm", "std_mm")
PRESSURE_LOSS = "pressure_loss_percent"
OF_CAR = ("alarm", "malfunction", "warning", "learning", "alarms")
COUNTER, CHECKSUM = "counter", "checksum"
NAMES = (
    *OF_CAR,
    *(f"{name}_{wheel}" for name in (*OF_WHEEL, PRESSURE_LOSS) for wheel in WHEELS),
    COUNTER,
    CHECKSUM,
)
"""All names; counter and checksum are of the frame, the others of the report."""
DISCRETE = frozenset((*OF_CAR, *(f"{name}_{wheel}" for name in OF_WHEEL[:4] for wheel in WHEELS)))
"""States and bits: their change is what `when = "change"` means."""
