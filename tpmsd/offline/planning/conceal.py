"""Draws effects to be concealed in a recording: those that it can show, at usual sizes.

In: a `Recording`, how many, a Generator. Out: effects of the catalogue. An effect can be concealed where a
drive of these readings, roads and noise shows it by a log-likelihood gain of four times the limit of
identifiability, which is twice the size at the limit, and where no other effect of the catalogue looks the
same. Noise and radius drift are those that the diagnosis finds in the untouched recording, and what it finds
there is fitted beside the effect; nobody asks whether the diagnosis finds the effect itself. Pure: the same
arguments give the same effects.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from tpmsd.car.physics.catalogue import EFFECTS, FAULT, Probe, make_effect, probes
from tpmsd.car.physics.effect import Effect, Kind, Parameter
from tpmsd.car.physics.reading_change import by_slopes
from tpmsd.foundation.errors import ConfigError, InputError
from tpmsd.foundation.wheels import WHEELS
from tpmsd.offline.diagnosis.assessment.identifiability import Telling, tellings, usual_size
from tpmsd.offline.diagnosis.hypotheses.terms import wheels_of
from tpmsd.offline.diagnosis.prepared.admission import admitted
from tpmsd.offline.diagnosis.prepared.study import Study
from tpmsd.offline.diagnosis.settings import SETTINGS
from tpmsd.offline.diagnosis.stages import examine
from tpmsd.offline.inference.recording import Recording

SIZES = (0.7, 1.5)
"""Least and greatest share of the usual size that is drawn: sizes of ordinary cars."""
SHOWN = 4.0
"""Gain over that at the limit (`tells_nats`): twice the size."""
MOST_ALIKE = 0.95
"""Cosine of the angle to another effect's sensitivity from which a name is a matter of luck."""
LOSS_M = 1.4e-3
"""Loss of radius (m) at 20 % less pressure, of which UN R64 requires a warning."""
TRIES = 20
"""Attempts for each effect, until one draw is large enough."""


class Showing:
    """Information that a recording can give."""

    def __init__(self, recording: Recording, progress: Callable[[float], None]) -> None:
        """InputError where the recording cannot be examined."""
        readers, notes = admitted([recording])
        if not readers:
            raise InputError(recording.name, "; ".join(notes))
        found = examine(Study(readers), progress)
        self._drive = found.study.drives[0]
        self._recording = readers[0].recording
        self._nuisance = found.study.hypotheses.nuisance
        self._terms = [one.term for one in found.selection.chosen]
        self.tellings: tuple[Telling, ...] = tellings(found.study)

    @property
    def duration_s(self) -> float:
        """Duration of the drive, s."""
        return float(self._recording.edges_s[-1])

    @property
    def wheels(self) -> list[int]:
        """Wheels that are read."""
        return self._recording.wheels

    def gain(self, effect: Effect) -> float:
        """Return the log-likelihood gain (nats) to be expected of the effect fitted jointly with those of the
        recording."""
        others = [term.design for term in self._terms if term.effect != effect.name]
        beside = self._drive.acting(np.concatenate([self._nuisance, *others], axis=1))
        beside = beside.reshape(-1, beside.shape[2])
        change = self._drive.reader.change(self._drive.base, effect)
        white = self._drive.whitened(change[:, :, None]).reshape(-1)
        fitted = np.linalg.lstsq(beside, white, rcond=None)[0]
        return 0.5 * float(np.sum((white - beside @ fitted) ** 2))


def draw(
    recording: Recording,
    count: int,
    rng: np.random.Generator,
    progress: Callable[[float], None] = lambda share: None,
) -> tuple[Effect, ...]:
    """Return `count` different effects that are not confounded.

    ConfigError where the drive cannot show as many, InputError where it cannot be examined.
    """
    showing = Showing(recording, progress)
    alike = {
        one.effect: {other for other, cosine in one.confounded_with if other != one.effect}
        for one in showing.tellings
    }
    names = [one.effect for one in showing.tellings if not _is_ambiguous(one)]
    candidates = sorted({*filter(_usual, names), FAULT.name})
    drawn: list[Effect] = []
    for index in rng.permutation(len(candidates)):
        name = candidates[int(index)]
        if any(name in alike.get(one.name, ()) or one.name in alike.get(name, ()) for one in drawn):
            continue
        effect = _large_enough(showing, name, rng)
        if effect is not None:
            drawn.append(effect)
            if len(drawn) == count:
                return tuple(drawn)
    raise ConfigError(
        f"{recording.name}: shows {len(drawn)} effects of usual sizes side by side, {count} are wanted"
        " (tpmsd effects --drive says which)"
    )


def _is_ambiguous(one: Telling) -> bool:
    """Return whether another effect is confounded with it, other than one whose limit it is for small
    values."""
    return any(
        cosine > MOST_ALIKE and EFFECTS[other].limit != one.effect for other, cosine in one.confounded_with
    )


def _usual(name: str) -> bool:
    """Return whether an effect is one that acts of itself and that a recording does not hold already."""
    effect = EFFECTS[name]
    if (
        effect.kind in (Kind.FREE, Kind.NUISANCE)
        or effect.always_fitted
        or effect.shortens
        or effect.mirror_of
    ):
        return False
    return any(not by_slopes(probe.made()) for probe in _probes(name))


def _probes(name: str) -> list[Probe]:
    """Return its numbers that are fitted, of each wheel pattern and at the middle of its grid."""
    grid = EFFECTS[name].grid
    return [
        probe
        for probe in probes()
        if probe.effect == name and (grid is None or probe.at is None or probe.at == grid.middle)
    ]


def _large_enough(showing: Showing, name: str, rng: np.random.Generator) -> Effect | None:
    """Return one draw of an effect that the drive shows; None where no draw is large enough."""
    for _ in range(TRIES):
        effect = _fault(showing, rng) if name == FAULT.name else _drawn(showing, name, rng)
        if effect is None:
            return None
        if showing.gain(effect) >= SHOWN * SETTINGS.assessment.tells_nats:
            return effect
    return None


def _fault(showing: Showing, rng: np.random.Generator) -> Effect:
    """Return a tyre that loses air at once or within minutes, in the middle half of the drive."""
    share, long_s = float(rng.uniform(*SIZES)), float(rng.choice([0.0, 30.0, 120.0]))
    return make_effect(
        FAULT.name,
        wheel=WHEELS[int(rng.choice(showing.wheels))],
        deviation_m=_short(-share * LOSS_M),
        onset_s=_short(float(rng.uniform(0.3, 0.6)) * showing.duration_s),
        duration_s=long_s,
    )


def _drawn(showing: Showing, name: str, rng: np.random.Generator) -> Effect | None:
    """Return an effect with its first number at a usual size, on wheels that are read."""
    known = _probes(name)
    first = known[0].parameter if known else ""
    usable = [probe for probe in known if probe.parameter == first and _is_read(probe.place, showing.wheels)]
    if not usable:
        return None
    probe = usable[int(rng.integers(len(usable)))]
    if not first:
        return probe.made()
    cls = EFFECTS[name]
    sign = 1.0 if cls.one_sign else float(rng.choice([-1.0, 1.0]))
    size = sign * float(rng.uniform(*SIZES)) * usual_size(cls, first)
    parameter = next(p for p in cls.parameters if p.name == first)
    assert isinstance(parameter, Parameter)
    value = float(np.clip(_short(parameter.neutral + size), *parameter.limits))
    return replace(probe, value=value).made()


def _is_read(pattern: str, wheels: Sequence[int]) -> bool:
    """Return whether all wheels of a pattern are read; what has no pattern knows its wheels itself."""
    return not pattern or set(wheels_of(pattern)) <= set(wheels)


def _short(value: float) -> float:
    """Return three digits: the precision of a stated truth."""
    if value == 0.0:
        return 0.0
    digits = 2 - math.floor(math.log10(abs(value)))
    return round(value, digits)
