"""The settings of fleets, with their units and reasons.

In: nothing. Out: `FleetSettings`.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class FleetSettings:
    """Defaults of all commands."""

    tries: int = 2
    """Starts of a drive in one run after which it is set aside: a worker may be killed for another reason."""
    tries_in_all: int = 4
    """The same over all runs, for a drive that takes the machine down with the run itself."""
    memory_per_worker: str = "2GiB"
    """A drive of two hours takes 0.6 GiB, with the libraries 0.3 GiB."""
    tasks_ahead: int = 2
    """Drives handed to each worker at a time: it never waits, and the scheduler never holds the fleet."""
    progress_s: float = 30.0
    """Between two lines of progress where nobody watches a terminal."""
    false_discovery_rate: float = 0.01
    """Expected share of false findings among those of the fleet (Benjamini and Hochberg 1995)."""
    min_drives_trend: int = 5
    """Of a car, for a trend: two parameters and a spread, with some to spare."""
    min_span_days: float = 1.0
    """Between the first and the last drive, for a trend: tyres warm up and cool down within a day."""
    soft_percent: float = 0.25
    """Loss of radius in per cent against the axle's other wheel from which a car needs attention: the
    daemon's default threshold of a deflation."""


SETTINGS = FleetSettings()
