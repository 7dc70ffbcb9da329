"""Found values in the words of their effect.

In: an effect and the values that a fit found, by parameter. Out: a clause for a sentence, as
'your gyro reads 4.0 % low (0.960 +- 0.001)'. The words stand in the effect's own file
(`Effect.wording`: answers, noun); here is only how numbers are put into them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from tpmsd.car.physics.catalogue import EFFECTS, parameters_of, sentence_of
from tpmsd.car.physics.effect import Parameter

SCALES: dict[str, float] = {
    "mm": 1e3,
    "cm": 1e2,
    "m": 1.0,
    "%": 1e2,
    "ms": 1e3,
    "s": 1.0,
    "min": 1.0 / 60.0,
    "cm/s": 1e2,
    "deg": 180.0 / math.pi,
    "deg/s": 180.0 / math.pi,
    "deg/h/s": 180.0 / math.pi * 3600.0,
    "ppm": 1e6,
    "mm/km": 1e6,
}
"""Units that people read, by how many of them an SI unit is."""


@dataclass(frozen=True, slots=True)
class FoundValue:
    """A found number, as a format string of an effect's answer shows it.

    The format is `[size | just] [UNIT]`: `size` drops the sign of the difference from neutral, `just` the
    standard deviation as well, and UNIT is one of `SCALES`, else the parameter's own. `MORE|LESS` gives the
    first word above neutral, the second one below.
    """

    value: float
    std: float | None
    unit: str
    neutral: float = 0.0

    def __format__(self, spec: str) -> str:
        if "|" in spec:
            more, less = spec.split("|")
            return more if self.value >= self.neutral else less
        how, _, unit = spec.partition(" ")
        if how not in ("size", "just"):
            how, unit = "", spec
        value = self.value if not how else abs(self.value - self.neutral)
        scale = SCALES[unit] if unit else 1.0
        std = None if self.std is None else self.std * scale
        text = rounded(value * scale, std, with_std=how != "just")
        name = unit or ("" if self.unit == "1" else self.unit)
        return f"{text} {name.removesuffix('/h/s') + ' per hour' if name == 'deg/h/s' else name}".rstrip()


def rounded(value: float, std: float | None, with_std: bool = True) -> str:
    """Return a value to the first digit of its standard deviation, to two digits where that begins with 1."""
    if std is None or not math.isfinite(std) or std <= 0.0:
        return f"{value:.3g}"
    power_of_std = math.floor(math.log10(std))
    digits = -power_of_std + (1 if with_std and round(std / 10.0**power_of_std) <= 1 else 0)
    largest = max(abs(value), std)
    if not 1e-3 <= largest < 1e6:
        power = math.floor(math.log10(largest))
        shown = max(power + digits, 0)
        rest = f" +- {std / 10.0**power:.{shown}f}" if with_std else ""
        short = f"{value / 10.0**power:.{shown}f}"
        return f"({short}{rest})e{power}" if rest else f"{short}e{power}"
    shown = max(digits, 0)
    return f"{value:.{shown}f}" + (f" +- {std:.{shown}f}" if with_std else "")


def clause(name: str, values: Mapping[str, FoundValue | str]) -> str:
    """Return a clause on a found effect: those of its answers whose parameters are all in `values`.

    One that has none for these says its sentence and its numbers.
    """
    effect = EFFECTS.get(name)
    parts = []
    for answer in () if effect is None else effect.wording.answers:
        try:
            parts.append(answer.format(**values))
        except KeyError:  # one of its parameters was not found
            continue
    if parts:
        return " and ".join(parts)
    shown = ", ".join(
        f"{key.replace('_', ' ') if isinstance(one, str) else words_without_unit(key)} {one}"
        for key, one in values.items()
    )
    return f"{sentence_of(name)} ({shown})" if shown else sentence_of(name)


def words_without_unit(parameter: str) -> str:
    """Return a parameter's name without the unit behind it."""
    words = parameter.split("_")
    return " ".join(words[:-1] if len(words) > 1 and words[-1] in ("s", "m", "rad", "mps", "mps2") else words)


def found_value(name: str, parameter: str, value: float, std: float | None, unit: str) -> FoundValue:
    """Return a found number with its neutral value, by the names of effect and parameter."""
    known = parameters_of(name).get(parameter) if name in EFFECTS else None
    return FoundValue(value, std, unit, known.neutral if isinstance(known, Parameter) else 0.0)


def noun(name: str) -> str:
    """Return an effect's noun for use in a sentence; its name in words where it has none."""
    effect = EFFECTS.get(name)
    return (effect.wording.noun if effect is not None else "") or name.replace("_", " ")
