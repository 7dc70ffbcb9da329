"""Settings of the readers that a user may tune, with unit and reason; codes and limits of formats stand
beside their readers."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SourceSettings:
    """Limits from which wheel speeds that stay the same are no readings."""

    frozen_s: float = 2.0
    """A speed other than zero may be constant on a smooth road; not so long while the others change (s)."""
    frozen_mps: float = 1.5
    """Below this a car may roll evenly; by so much another wheel's speed must have changed (m/s)."""
    frozen_runs: float = 5.0
    """All speeds are frozen when they are the same for so many times the longest run of the last minutes.
    Runs of noisy readings fall off exponentially: five times the longest of hundreds does not occur."""
    frozen_min_s: float = 0.25
    """Several frames of any sender: fewer may be the same by chance (s)."""
    frozen_learn_s: float = 10.0
    """Before so much has been seen, `frozen_s` holds (s)."""
    frozen_forget: float = 0.9999
    """Per frame: 200 s at 50 frames a second, several stops and starts of a town."""
    noise_turns: float = 10.0
    """A signal with noise would have turned so often within a stretch that is called frozen: if it turns at
    random, none in ten times its mean interval has a chance of exp(-10)."""


SETTINGS = SourceSettings()
