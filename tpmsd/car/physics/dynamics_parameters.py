"""Parameters that several effects of vehicle dynamics share.

Out: `Parameter` records.
"""

from __future__ import annotations

from collections.abc import Mapping

from tpmsd.car.physics.parameters import Parameter, Prior

FORCE_ERROR = Parameter(
    "relative",
    "1",
    0.1,
    -0.8,
    2.0,
    "true over configured, minus 1",
    probe=0.001,
    prior=Prior(0.0, 0.1, "5 to 15 %: Rajamani, ch. 5"),
)
"""Error of a force's reading."""
READING_DELAY = Parameter(
    "delay_s",
    "s",
    0.04,
    -0.3,
    0.3,
    "age of the reading",
    probe=0.0001,
    prior=Prior(0.0, 0.03, "3 to 50 ms: data sheets, buses"),
)
"""Age of an instrument's reading."""

INSTANT = Parameter(
    "instant",
    "1",
    1.0,
    0.0,
    1.0,
    "share of dv/dt in the lateral acceleration that the body rolls by: 0 for u r, 1 for all of it",
)
"""Acceleration that an effect of the body's roll follows."""
DIRECTED = Parameter(
    "directed",
    "1",
    1.0,
    0.0,
    1.0,
    "share of the rear wheels' turn that their forces follow: all of it, or none in simulations that add the"
    " turn to the slip angle alone",
)
"""Direction of the forces of rear wheels that turn."""


def values_of_instant(nonlinear: bool) -> tuple[Mapping[str, float], ...]:
    """Return the values of `instant` to try: 0 and 1, only 0 for tyres that feel their loads.

    There the effect `instant_loads` sets the acceleration that the body follows.
    """
    return ({"instant": 0.0},) if nonlinear else ({"instant": 0.0}, {"instant": 1.0})


def directions(nonlinear: bool) -> tuple[Mapping[str, float], ...]:
    """Return the values of `directed` to try: 1 and 0, only 1 where angles are small."""
    return ({"directed": 1.0}, {"directed": 0.0}) if nonlinear else ({"directed": 1.0},)


def formula_coefficient(description: str, source: str) -> Parameter:
    """Return the parameter that scales a formula every car obeys: 0 leaves it out, 1 is the formula.

    Its prior is 1 +- 0.3, for the quantities that the formula takes as known; `source` names them.
    """
    prior = Prior(1.0, 0.3, source)
    return Parameter("coefficient", "1", 1.0, -1.0, 3.0, description, probe=0.001, prior=prior)
