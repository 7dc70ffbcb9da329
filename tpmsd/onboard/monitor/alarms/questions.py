"""Questions of the monitor: a tyre has probably changed, and the radii do not identify the cause.

In: every judgement. Out: the open `Question`s. An alarm reports what is known, a question what is ambiguous.

A tyre is in order while its probability of a change is at most `clear_probability`; an alarm is raised from
`raise_probability` on. What stays between the two for as long as an alarm of all wheels has to
(`all_hold_s`) is asked. A question goes once the evidence no longer speaks for a change at all, the
posterior being back at the prior, or once an alarm says it. Sound drives that ask are few, whatever the
drive: of probabilities that are calibrated, those whose prior is q exceed p at most q / p times (Markov's
inequality).

Another load or a trailer looks like both tyres of an axle that were soft when the drive began, and is far
more frequent; so does a road on which driven wheels slip evenly. Where it is as certain as an alarm has to
be that something is other than learned, the driver is asked whether it is one of these.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tpmsd.car.config.model import MonitorConfig
from tpmsd.car.physics.motion import driven_mask
from tpmsd.foundation.wheels import WHEELS
from tpmsd.onboard.monitor.alarms.alarm_state import Hysteresis
from tpmsd.onboard.monitor.alarms.judge import Judgement
from tpmsd.onboard.monitor.evidence.posterior import Posterior
from tpmsd.onboard.monitor.evidence.sizes import size_rows, subsets
from tpmsd.onboard.monitor.settings import DRIVE_EVIDENCE, FIRST_START, JUDGE


@dataclass(frozen=True, slots=True)
class Question:
    """An ambiguous change of the radii, with its likeliest causes, as a question to the driver."""

    wheels: tuple[str, ...]
    """That are asked about: the most probable change."""
    question: str
    """One sentence for the driver."""
    probability: float
    """That a tyre has lost air or is of another size; of a question about the load, that it is another."""
    since_s: float
    """Host time at which it was first asked."""

    def entry(self) -> dict[str, object]:
        """Return the question as every JSON document shows it."""
        return {
            "wheels": list(self.wheels),
            "question": self.question,
            "probability": round(self.probability, 4),
            "since": self.since_s,
        }


class Questions:
    """The question of one car: about tyres, or else about the load."""

    def __init__(self, settings: MonitorConfig, wheels: list[int], driven_axle: str) -> None:
        """`wheels`: indices of the monitored wheels; `driven_axle`: front, rear or all."""
        self._wheels = wheels
        self._subsets = subsets(len(wheels))
        self._sizes = size_rows(tuple(wheels))
        prior = sum(JUDGE.prior_by_size[len(one) - 1] for one in self._subsets)
        prior += float(np.exp(self._sizes.log_prior[1:]).sum())
        clear, hold_s = settings.clear_probability, JUDGE.all_hold_s
        self._of_tyres = Hysteresis(clear, prior, hold_s, settings.clear_hold_s)
        self._of_load = Hysteresis(settings.raise_probability, clear, hold_s, settings.clear_hold_s)
        soft = len(wheels) * (FIRST_START.soft_prior + FIRST_START.larger_prior)
        self._of_first = Hysteresis(clear, soft, hold_s, settings.clear_hold_s)
        self._first: tuple[int, float, str] | None = None
        self._axles = [
            index
            for index, one in enumerate(self._subsets)
            if len(one) == 2 and wheels[one[0]] ^ 1 == wheels[one[1]]
        ]
        driven = driven_mask(driven_axle)[wheels]
        self._driven_axles = [index for index in self._axles if driven[list(self._subsets[index])].all()]
        self.open: tuple[Question, ...] = ()

    def update(
        self,
        found: Judgement | None,
        elapsed_s: float,
        time_s: float,
        *,
        alarm_active: bool,
    ) -> None:
        """Update the open questions by a judgement that stands for `elapsed_s` of driving; None where the
        tyres may be others. `alarm_active`: a tyre alarm is active, which closes them."""
        if alarm_active:
            self.close_all()
            return
        asked: list[tuple[tuple[str, ...], str, float]] = []
        if found is not None and found.posterior is not None:
            asked = self._update_from_posterior(found.posterior, found, elapsed_s)
        if self._of_first.active and self._first is not None:
            wheel, probability, words = self._first
            asked = [((WHEELS[wheel],), f"{WHEELS[wheel]} is {words}?", probability)]
        since = {one.wheels: one.since_s for one in self.open}
        self.open = tuple(
            Question(wheels, question, probability, since.get(wheels, time_s))
            for wheels, question, probability in asked
        )

    def _update_from_posterior(
        self, bank: Posterior, found: Judgement, elapsed_s: float
    ) -> list[tuple[tuple[str, ...], str, float]]:
        """Advance both hystereses by a posterior; return the open questions: wheels, text, probability."""
        self._of_tyres.update(bank.changed, elapsed_s)
        self._of_load.update(found.unusual, elapsed_s)
        if self._of_tyres.active:
            return [(*self._tyre_question(bank, found.drive_models), bank.changed)]
        if self._of_load.active and self._axles:
            return [(*self._load_question(bank, found.drive_models), found.unusual)]
        return []

    def update_first_start(self, suspected: tuple[int, float, str] | None, elapsed_s: float) -> None:
        """Update the question about a tyre that was soft before the first start.

        `suspected`: wheel, probability and state in words; None leaves the question as it is.
        """
        if suspected is not None:
            self._first = suspected
            self._of_first.update(suspected[1], elapsed_s)

    def close_all(self) -> None:
        """Close all questions: an alarm answers them, or other tyres are on the car."""
        for asked in (self._of_tyres, self._of_load, self._of_first):
            asked.active, asked.hold_elapsed_s = False, 0.0
        self.open = ()

    def _load_question(self, found: Posterior, models: dict[str, float]) -> tuple[tuple[str, ...], str]:
        """Return the wheels of the axle whose loss would look the same, and the question about load or
        grip."""
        slips = sum(models.get(name, 0.0) for name in DRIVE_EVIDENCE.by_slope) > JUDGE.undecided
        axles = self._driven_axles if slips and self._driven_axles else self._axles
        # By what looks the same now: of an axle that slips `subsets` leaves out what its slip hides.
        index = max(axles, key=lambda one: float(found.possible[list(self._subsets[one])].sum()))
        names = self._wheel_names(self._subsets[index])
        cause = "a slippery road" if slips else "another load than usual, or a trailer"
        return names, (
            f"{cause}? If not, look at {' '.join(names)}: both tyres soft since the drive began look the same"
        )

    def _tyre_question(self, found: Posterior, models: dict[str, float]) -> tuple[tuple[str, ...], str]:
        """Return the wheels of the likeliest change, and the question with the causes by their
        probability."""
        causes: list[tuple[float, tuple[str, ...], str]] = []
        for members, probability in zip(self._subsets, found.subsets.tolist(), strict=True):
            names = self._wheel_names(members)
            causes.append((probability, names, f"{' '.join(names)} soft"))
        for row in range(1, found.sizes.size):
            names = self._wheel_names(tuple(np.flatnonzero(self._sizes.pattern[row]).tolist()))
            other = "other tyres" if self._sizes.mean[row] > 0.0 else "wheels changed front to rear"
            causes.append((float(found.sizes[row]), names, f"{other} ({' '.join(names)} larger)"))
        best = max(causes, key=lambda cause: cause[0])
        usual = DRIVE_EVIDENCE.models[0].name
        other_models = [(probability, (), name) for name, probability in models.items() if name != usual]
        named = sorted([*causes, *other_models], key=lambda cause: -cause[0])[: JUDGE.named_causes]
        stated = " or ".join(f"{what} ({probability:.2f})" for probability, _, what in named)
        return best[1], f"{stated}? Look at the tyres; if they are other ones: tpmsd reset --tyres NAME"

    def _wheel_names(self, members: Sequence[int]) -> tuple[str, ...]:
        return tuple(WHEELS[self._wheels[index]] for index in members)
