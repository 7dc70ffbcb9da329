"""Hysteresis: a probability becomes an alarm, and an alarm ends, only when it lasts.

In: a probability and the driving time it stands for. Out: whether the alarm was just raised or cleared.
The limits are `raise_probability` and `clear_probability` of `config.model.MonitorConfig`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(slots=True)
class Hysteresis:
    """State of one alarm: active or not, and for how long a change of that has been due."""

    raise_at: float
    clear_at: float
    raise_hold_s: float
    clear_hold_s: float
    active: bool = False
    hold_elapsed_s: float = 0.0

    def update(
        self,
        probability: float,
        elapsed_s: float,
        min_hold_s: float = 0.0,
        possible: float | None = None,
    ) -> Literal["raised", "cleared"] | None:
        """Update by a probability that held for `elapsed_s`; return the transition that it completes, else
        None.

        `min_hold_s`: an alarm that is not raised yet has to last for so long at least. `possible`: of that,
        or of what looks the same for a while, which keeps an alarm but raises none; None: the same.

        Never on a single reading: the first reading beyond a threshold only starts the hold.
        """
        retained = probability if possible is None else possible
        beyond = retained <= self.clear_at if self.active else probability >= self.raise_at
        if not beyond:
            self.hold_elapsed_s = 0.0
            return None
        hold = self.clear_hold_s if self.active else max(self.raise_hold_s, min_hold_s)
        if self.hold_elapsed_s == 0.0:
            self.hold_elapsed_s = 1e-9
            return None
        self.hold_elapsed_s += elapsed_s
        if self.hold_elapsed_s < hold:
            return None
        self.active = not self.active
        self.hold_elapsed_s = 0.0
        return "raised" if self.active else "cleared"
