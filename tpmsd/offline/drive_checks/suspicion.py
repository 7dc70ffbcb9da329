"""A suspicion: a statement of a configuration that a drive contradicts.

In: nothing. Out: the record `Suspicion`.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Suspicion:
    """One statement of the file that the drive speaks against."""

    key: str
    suspicion: str
    probability: float
    suggest: str
