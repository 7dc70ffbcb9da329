"""Records of an effect next to its equation: its words, how it shows, its confounders, what is nonlinear.

In: nothing. Out: `Wording`, `Identification`, `Confounding` and `Nonlinear`, of which each effect's class
holds one, and `fold_attributes_into_records`, by which a class may give the fields one by one, or by their
former names.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from enum import Enum
from functools import wraps
from typing import Any, TypeVar

Record = TypeVar("Record")


def _accepts_former_names(**names: str) -> Callable[[type[Record]], type[Record]]:
    """Return a decorator by which a record's constructor accepts former names of its fields."""

    def accepting_former_names(cls: type[Record]) -> type[Record]:
        """Return the class, whose constructor takes the former names too."""
        made: Any = cls.__init__

        def initialise(self: Record, *args: Any, **given: Any) -> None:
            made(self, *args, **{names.get(name, name): value for name, value in given.items()})

        setattr(cls, "__init__", wraps(made)(initialise))  # noqa: B010
        return cls

    return accepting_former_names


class NoiseResemblance(Enum):
    """Slow noise that an effect resembles: it is tested against that noise at its maximum likelihood."""

    OTHER = "none"
    COMMON = "the receiver's slow error"
    """It acts on all wheels together and slowly, so that only the receiver shows it."""
    WHEEL = "radius drift"
    """It changes single wheels slowly."""
    VELOCITY = "the receiver's slow error of speed"
    """It changes the receiver's speed slowly, as a heading does along a road."""


@_accepts_former_names(price="penalty")
@dataclass(frozen=True, slots=True)
class SecondParameter:
    """A second parameter that enters nonlinearly: typical on the grid, and fitted once the first one is."""

    parameter: str
    range: tuple[float, float]
    """Least and greatest plausible value."""
    penalty: Callable[[float], float]
    """Nats against a value."""
    step: float
    """Factor by which it is first moved."""


@_accepts_former_names(price="penalty")
@dataclass(frozen=True, slots=True)
class Grid:
    """Values of a parameter that enters nonlinearly, at which the effect is first looked for."""

    parameter: str
    values: tuple[float, ...]
    middle: float
    """The one that stands for all while noise is estimated."""
    range: tuple[float, float]
    """Least and greatest plausible value."""
    penalty: Callable[[float], float]
    """Nats against a value, on top of those for the choice among the grid's."""
    step: float
    """Factor between neighbours."""
    second: SecondParameter | None = None
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
    """True if it is looked for once per revolution of a wheel, apart from the windows of a second."""
    by_ripple: bool = False
    """True if a ring's ripple distinguishes it from a radius, apart from the windows too."""
    at_walking_pace: bool = False
    """True if it is looked for below the speeds of the windows, apart from them."""
    always_fitted: bool = False
    """True for a nuisance: part of the baseline model, not a hypothesis."""


@_accepts_former_names(beside="tested_jointly_with", beside_value="estimated_jointly_with")
@dataclass(frozen=True, slots=True)
class Confounding:
    """Explanations that an effect may be confounded with, and how readily it is expected."""

    common: bool = False
    """True where every car has some of it: it is expected, jointly with others of the kind."""
    rare: bool = False
    """True where few drives show it: it is penalised by odds of fifty, and no noise is estimated jointly with
    it."""
    resembles: NoiseResemblance = NoiseResemblance.OTHER
    """Slow noise that it resembles, and against which it is tested."""
    tested_jointly_with: tuple[str, ...] = ()
    """Effects that are fitted jointly when it is tested next to spline terms: they must not replace it."""
    estimated_jointly_with: tuple[str, ...] = ()
    """Effects of which every car has some: fitted jointly, within their priors, for its reported value."""
    widened_by: tuple[str, ...] = ()
    """Effects of which every car has some, too small beside this one to be found: its value is that of the
    model without them, and its standard deviation the root mean square about it with them fitted jointly."""
    confounded: tuple[str, ...] = ()
    """Effects that read the same on every drive, whatever is driven."""
    limit: str = ""
    """The simpler effect that it equals where it is small. It always explains as much, and is no
    alternative."""
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
    such; infinite where the first may be zero beside the second.
    """


RECORDS = {
    "wording": Wording,
    "identification": Identification,
    "confounding": Confounding,
    "nonlinear": Nonlinear,
}
"""Attributes of an effect's class and the record that each holds."""
FORMER_NAMES = {
    "telling_drive": ("wording", "distinguished_by"),
    "places": ("identification", "wheel_patterns"),
    "looks": ("confounding", "resembles"),
    "beside": ("confounding", "tested_jointly_with"),
    "beside_value": ("confounding", "estimated_jointly_with"),
} | {one.name: (name, one.name) for name, record in RECORDS.items() for one in fields(record)}
"""Attributes by which an effect of one's own may give a field outside its record, with record and field."""

FORMER_ATTRIBUTES = {
    "rivals": "confounding",
    "against": "penalty",
    "usual": "tolerance_note",
    "completed_by": "summed_with",
    "alike_on_every_drive": "common_to_all_drives",
}
"""Former names of an effect's records, hooks and marks, with those that replace them."""
Rivals = Confounding
"""Former name of `Confounding`."""
Beside = SecondParameter
"""Former name of `SecondParameter`."""


def fold_attributes_into_records(cls: type) -> None:
    """Move fields that a class gives as its own attributes, by present or former names, into its records."""
    for former, name in FORMER_ATTRIBUTES.items():
        if former in vars(cls) and name not in vars(cls) and hasattr(cls, name):
            setattr(cls, name, vars(cls)[former])
    given: dict[str, dict[str, object]] = {}
    for name, value in vars(cls).items():
        record, field = FORMER_NAMES.get(name, ("", ""))
        if isinstance(getattr(cls, record, None), RECORDS.get(record, ())):
            given.setdefault(record, {})[field] = value
    for record, values in given.items():
        setattr(cls, record, replace(getattr(cls, record), **values))
