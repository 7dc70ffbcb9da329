"""Records of an effect beside its equation: its words, how it shows, its rivals, what is nonlinear.

In: nothing. Out: `Wording`, `Identification`, `Rivals` and `Nonlinear`, of which each effect's class holds
one, and `fold_flat`, by which a class may give the fields one by one instead.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from enum import Enum


class NoiseResemblance(Enum):
    """Slow noise that an effect resembles: it must stand against that noise at its likeliest."""

    OTHER = "none"
    COMMON = "the receiver's slow error"
    """It acts on all wheels together and slowly, so that only the receiver shows it."""
    WHEEL = "radius drift"
    """It changes single wheels slowly."""
    VELOCITY = "the receiver's slow error of speed"
    """It changes the receiver's speed slowly, as a heading does along a road."""


@dataclass(frozen=True, slots=True)
class Beside:
    """A second parameter that enters nonlinearly: typical on the grid, and fitted once the first one is."""

    parameter: str
    range: tuple[float, float]
    """Least and greatest that is thinkable."""
    price: Callable[[float], float]
    """Nats against a value."""
    step: float
    """Factor by which it is first moved."""


@dataclass(frozen=True, slots=True)
class Grid:
    """Values of a parameter that enters nonlinearly, at which the effect is first looked for."""

    parameter: str
    values: tuple[float, ...]
    middle: float
    """The one that stands for all while noise is estimated."""
    range: tuple[float, float]
    """Least and greatest that is thinkable."""
    price: Callable[[float], float]
    """Nats against a value, beside those for the choice among the grid's."""
    step: float
    """Factor between neighbours."""
    second: Beside | None = None
    """A further parameter that enters nonlinearly, if there is one."""


@dataclass(frozen=True, slots=True)
class Wording:
    """The words for an effect, in reports and in the reference."""

    formula: str = ""
    """Formula in one line of plain text, for the reference."""
    sentence: str = ""
    """Name of the effect as a clause for reports; the docstring's first line where it is empty."""
    noun: str = ""
    """Name of the effect within a sentence."""
    answers: tuple[str, ...] = ()
    """Clauses for an effect that was found: format strings over its parameters (`in_words`), each used where
    all of its parameters were found."""
    distinguished_by: str = ""
    """Recommended manoeuvre by which it shows beside what resembles it."""


@dataclass(frozen=True, slots=True)
class Identification:
    """Place in which an effect shows, what a drive needs to show it, and how it is looked for."""

    shows_in: tuple[str, str] = ("wheel", "speed")
    """Channel and covariate over which it shows: wheel, wheel_ratio, gnss_speed, gnss_course, yaw_rate."""
    needs: tuple[str, ...] = ()
    """Readings without which no drive shows it: `yaw_rate`, `gnss` (any), `gnss_speed`, `gnss_position`,
    `slopes`, `heights` or `accelerometer` (slopes by these), `speeds` (no counts), `temperature`,
    `torque`, `both_axles` (wheels of both)."""
    reads: tuple[str, ...] = ()
    """Readings in which alone it shows, apart from wheels, gyro and fixes: `accel_long`, `accel_lat`,
    `steering`, `clock`. It is looked for in these."""
    wheel_patterns: tuple[str, ...] = ()
    """Wheels or groups of wheels on which it may act, one hypothesis each; empty: it knows its wheels."""
    contrast: bool = False
    """True if it acts on wheels with both signs, so that it shows between them although all take part."""
    everywhere: bool = False
    """True if it acts at all times alike, so that its place is the whole drive."""
    by_teeth: bool = False
    """True if it is looked for once per turn of a wheel, apart from the windows of a second."""
    by_ripple: bool = False
    """True if a ring's ripple distinguishes it from a radius, apart from the windows too."""
    at_walking_pace: bool = False
    """True if it is looked for below the speeds of the windows, apart from them."""
    always_fitted: bool = False
    """True for a nuisance: part of the baseline model, not a hypothesis."""


@dataclass(frozen=True, slots=True)
class Rivals:
    """Explanations that an effect may be taken for, and how readily it is expected."""

    common: bool = False
    """True where every car has some of it: it is expected, jointly with others of the kind."""
    rare: bool = False
    """True where few drives show it: it costs odds of fifty, and no noise is estimated jointly with it."""
    resembles: NoiseResemblance = NoiseResemblance.OTHER
    """Slow noise against which it must stand."""
    beside: tuple[str, ...] = ()
    """Effects beside which it must be needed, where shapes act that no formula holds."""
    beside_value: tuple[str, ...] = ()
    """Effects of which every car has some: fitted along within their priors when its value is stated."""
    confounded: tuple[str, ...] = ()
    """Effects that read the same on every drive, whatever is driven."""
    limit: str = ""
    """The effect that it is where it is small: one that always explains as much, and no rival of it."""
    mirror_of: str = ""
    """The effect of which this is the other sign, by the same sensitivity."""
    drifts_into: str = ""
    """A reading, of which this is the constant part of a slow error."""


@dataclass(frozen=True, slots=True)
class Nonlinear:
    """Parts of an effect that enter nonlinearly: a grid, the time of a change or a span, a ratio."""

    grid: Grid | None = None
    """Grid of its one parameter that enters nonlinearly."""
    ramp: bool = False
    """True if it steps or ramps once, at a time that is looked for."""
    courses: tuple[str, ...] = ()
    """Courses of a ramp: the values of its parameter `course`, the plainest first."""
    span: bool = False
    """True if it acts from one time to another, which are looked for."""
    ratio_limits: tuple[float, float] | None = None
    """Ratio of its second parameter to its first, the least and the greatest that are possible, if it has
    such.
    """


RECORDS = {"wording": Wording, "identification": Identification, "rivals": Rivals, "nonlinear": Nonlinear}
"""Attributes of an effect's class and the record that each holds."""
FORMER_NAMES = {
    "telling_drive": ("wording", "distinguished_by"),
    "places": ("identification", "wheel_patterns"),
    "looks": ("rivals", "resembles"),
} | {one.name: (name, one.name) for name, record in RECORDS.items() for one in fields(record)}
"""Attributes by which an effect of one's own may give a field outside its record, with record and field."""


def fold_flat(cls: type) -> None:
    """Put the fields that a class gives as attributes of its own, by their names or former ones, into the
    records that it has or inherits.
    """
    given: dict[str, dict[str, object]] = {}
    for name, value in vars(cls).items():
        record, field = FORMER_NAMES.get(name, ("", ""))
        if isinstance(getattr(cls, record, None), RECORDS.get(record, ())):
            given.setdefault(record, {})[field] = value
    for record, values in given.items():
        setattr(cls, record, replace(getattr(cls, record), **values))
