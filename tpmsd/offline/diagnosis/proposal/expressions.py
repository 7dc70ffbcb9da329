"""Small closed forms over covariates.

In: names of covariates. Out: `Expression`s, each of one coefficient: powers, sizes and one-sided parts of one
covariate, products of two, and of one covariate with its values also steps, saturation and thresholds, whose
own one or two numbers are written into the formula. All of them are tried; there are few enough (exhaustive
search instead of sparse regression: Brunton, Proctor and Kutz, PNAS 113, 2016, look for the same kind of
terms).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from tpmsd.car.physics.covariates import COVARIATES
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.settings import SETTINGS

OVER_TIME = ("time", "distance")
"""Covariates of one drive, over which a closed form is no physics of the car."""

SINGLE: Mapping[str, tuple[str, Callable[[FloatArray], FloatArray]]] = {
    "linear": ("{x}", lambda x: x),
    "squared": ("{x}**2", lambda x: x**2),
    "size": ("np.abs({x})", np.abs),
    "above_zero": ("np.maximum({x}, 0.0)", lambda x: np.maximum(x, 0.0)),
    "below_zero": ("np.minimum({x}, 0.0)", lambda x: np.minimum(x, 0.0)),
    "signed_square": ("{x} * np.abs({x})", lambda x: x * np.abs(x)),
}
PAIRED: Mapping[str, tuple[str, Callable[[FloatArray, FloatArray], FloatArray]]] = {
    "times": ("{x} * {y}", lambda x, y: x * y),
    "times_size_of": ("{x} * np.abs({y})", lambda x, y: x * np.abs(y)),
}
SHAPED: Mapping[str, tuple[str, Callable[..., FloatArray]]] = {
    "saturated": ("np.tanh({x} / {0!r})", lambda x, width: np.tanh(x / width)),
    "step": ("np.tanh(({x} - {0!r}) / {1!r})", lambda x, centre, width: np.tanh((x - centre) / width)),
    "above": ("np.maximum({x} - {0!r}, 0.0)", lambda x, least: np.maximum(x - least, 0.0)),
    "dead_zone": ("{x} - np.clip({x}, -{0!r}, {0!r})", lambda x, least: x - np.clip(x, -least, least)),
}
"""Forms with numbers of their own: widths and thresholds in the covariate's unit."""
UNITLESS = ("saturated", "step")


@dataclass(frozen=True)
class Expression:
    """A closed form."""

    form: str
    covariates: tuple[str, ...]
    numbers: tuple[float, ...] = ()
    """Numbers of the form itself, beside its coefficient."""

    @property
    def name(self) -> str:
        """Return a name for files and classes, such as `accel_lat_times_speed`."""
        if len(self.covariates) == 1:
            return f"{self.covariates[0]}_{self.form}"
        return f"{self.covariates[0]}_{self.form}_{self.covariates[1]}"

    @property
    def formula(self) -> str:
        """Return the formula as Python text; its variables are the covariates' names."""
        if self.numbers:
            return SHAPED[self.form][0].format(*self.numbers, x=self.covariates[0])
        if len(self.covariates) == 1:
            return SINGLE[self.form][0].format(x=self.covariates[0])
        return PAIRED[self.form][0].format(x=self.covariates[0], y=self.covariates[1])

    @property
    def unit(self) -> str:
        """Return the unit of the expression's value; `1` without one."""
        if self.form in UNITLESS:
            return "1"
        units = [COVARIATES[name] for name in self.covariates]
        return ".".join(units * 2 if self.form in ("squared", "signed_square") else units)

    def values(self, covariates: Mapping[str, FloatArray]) -> FloatArray:
        """Return the expression's values (n,) for covariates (n,) each."""
        known = [covariates[name] for name in self.covariates]
        if self.numbers:
            return SHAPED[self.form][1](known[0], *self.numbers)
        if len(known) == 1:
            return SINGLE[self.form][1](known[0])
        return PAIRED[self.form][1](known[0], known[1])


def expressions(names: Sequence[str]) -> list[Expression]:
    """Return all expressions over these covariates without numbers of their own, the plainest first."""
    usable = [name for name in COVARIATES if name in names and name not in OVER_TIME]
    out = [Expression(form, (name,)) for form in SINGLE for name in usable]
    for x, y in combinations(usable, 2):
        out += [Expression("times", (x, y))]
        out += [Expression("times_size_of", pair) for pair in ((x, y), (y, x))]
    return out


def shaped_expressions(name: str, values: FloatArray) -> list[Expression]:
    """Return the forms with numbers of their own over a covariate with these values; none over time.

    Centres and thresholds lie at quantiles of the values, widths are shares of their standard deviation.
    """
    known = values[np.isfinite(values)]
    if name in OVER_TIME or not len(known) or float(known.std()) == 0.0:
        return []
    thresholds = [_three_digits(float(one)) for one in np.quantile(known, SETTINGS.report.shape_quantiles)]
    widths = [_three_digits(share * float(known.std())) for share in SETTINGS.report.shape_widths]
    sizes = [_three_digits(float(one)) for one in np.quantile(np.abs(known), SETTINGS.report.shape_quantiles)]
    both = min(float((known > 0.0).mean()), float((known < 0.0).mean())) > SETTINGS.report.shape_quantiles[0]
    out = [Expression("step", (name,), (centre, width)) for centre in thresholds for width in widths]
    out += [Expression("above", (name,), (least,)) for least in thresholds]
    if both:
        out += [Expression("saturated", (name,), (width,)) for width in widths]
        out += [Expression("dead_zone", (name,), (least,)) for least in sizes if least > 0.0]
    return out


def _three_digits(value: float) -> float:
    """Return a number rounded to three significant digits, as it stands in a formula."""
    return float(f"{value:.3g}")
