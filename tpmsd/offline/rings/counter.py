"""A wheel's counter over a drive, as frames carry it.

In: nothing. Out: the record `Counter`.
"""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.foundation.wheels import FloatArray


@dataclass(frozen=True, slots=True)
class Counter:
    """A counter whose roll-overs are taken out."""

    time_s: FloatArray
    """(n,) stamps of the frames with a valid number."""
    counts: FloatArray
    """(n,) raw counts since the first of them."""
    modulus: int
    """Number of values."""
    modulus_seen: bool
    """True if roll-overs showed the modulus; else it is the field's width."""
    no_value: frozenset[int] = frozenset()
    """Numbers that are no counts, other than those that the DBC names."""
