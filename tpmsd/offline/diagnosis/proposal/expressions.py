"""Small closed forms over covariates.

In: names of covariates. Out: `Expression`s, each of one number: powers, sizes and one-sided parts of one
covariate, and products of two. All of them are tried; there are few enough (exhaustive search instead of
sparse regression: Brunton, Proctor and Kutz, PNAS 113, 2016, look for the same kind of terms).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from tpmsd.car.physics.covariates import COVARIATES
from tpmsd.foundation.wheels import FloatArray

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


@dataclass(frozen=True)
class Expression:
    """A closed form."""

    form: str
    covariates: tuple[str, ...]

    @property
    def name(self) -> str:
        """For files and classes: `accel_lat_times_speed`."""
        if len(self.covariates) == 1:
            return f"{self.covariates[0]}_{self.form}"
        return f"{self.covariates[0]}_{self.form}_{self.covariates[1]}"

    @property
    def formula(self) -> str:
        """In Python, of variables that are called as the covariates are."""
        if len(self.covariates) == 1:
            return SINGLE[self.form][0].format(x=self.covariates[0])
        return PAIRED[self.form][0].format(x=self.covariates[0], y=self.covariates[1])

    @property
    def unit(self) -> str:
        """Return the standard deviation of its value."""
        units = [COVARIATES[name] for name in self.covariates]
        return ".".join(units * 2 if self.form in ("squared", "signed_square") else units)

    def values(self, covariates: Mapping[str, FloatArray]) -> FloatArray:
        """(n,) of covariates (n,) each."""
        known = [covariates[name] for name in self.covariates]
        if len(known) == 1:
            return SINGLE[self.form][1](known[0])
        return PAIRED[self.form][1](known[0], known[1])


def expressions(names: Sequence[str]) -> list[Expression]:
    """Return all of them over these covariates, the plainest first."""
    usable = [name for name in COVARIATES if name in names and name not in OVER_TIME]
    out = [Expression(form, (name,)) for form in SINGLE for name in usable]
    for x, y in combinations(usable, 2):
        out += [Expression("times", (x, y))]
        out += [Expression("times_size_of", pair) for pair in ((x, y), (y, x))]
    return out
