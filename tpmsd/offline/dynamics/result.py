"""The outcome of a diagnosis of vehicle dynamics, as plain records.

In: nothing. Out: `DynamicsDiagnosis` and what it consists of.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from tpmsd.car.physics.dynamics_effect import DynamicsEffect

CONSISTENT, MISMATCH, INSUFFICIENT = "consistent", "mismatch", "insufficient_data"
FINDING, SUSPICION = "finding", "suspicion"


@dataclass(frozen=True, slots=True)
class Quantity:
    """A fitted number with its standard deviation."""

    value: float
    std: float
    unit: str


@dataclass(frozen=True, slots=True)
class Place:
    """Where baseline and recording part."""

    channel: str
    covariate: str | None
    range: tuple[float, float] | None
    time_spans: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True, slots=True)
class DynamicsFinding:
    """One effect that the drive holds."""

    effect: str
    status: str
    confidence: float
    p_value: float
    parameters: Mapping[str, Quantity]
    where: Place
    rms_before: float
    """Of the output where it shows, predicted without it."""
    rms_after: float
    loglik_gain: float
    """Nats on held-out blocks."""
    loglik_gain_per_s: float
    evidence: float
    indistinguishable_from: tuple[str, ...]
    telling_drive: str
    shape: tuple[tuple[float, float, float], ...] = ()
    """Of a spline: covariate, value, standard deviation."""
    acts_on: str = ""
    stand_in: bool = False
    """Whether it may stand in for a term without a name."""


@dataclass(frozen=True, slots=True)
class OutputFit:
    """How well an output is predicted from the inputs, parameters fitted on the other folds."""

    unit: str
    rms_before: float
    rms_after: float
    rating_before: float
    rating_after: float


@dataclass(frozen=True, slots=True)
class Step:
    """The model after one more effect: root mean square error of each output, held out."""

    effects: tuple[str, ...]
    rms: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class NotDetectable:
    """An effect that the drive could not have shown at a usual size."""

    effect: str
    smallest: Mapping[str, tuple[float | None, str]]
    """By parameter, the size that would have shown and its unit; None where none would."""


@dataclass(frozen=True, slots=True)
class DynamicsDiagnosis:
    """Everything that is said of a drive."""

    verdict: str
    reason: str
    baseline: str
    forces: bool
    given: tuple[str, ...]
    """Effects that belonged to the baseline."""
    driving_s: float
    findings: tuple[DynamicsFinding, ...] = ()
    outputs: Mapping[str, OutputFit] = field(default_factory=dict)
    steps: tuple[Step, ...] = ()
    not_detectable: tuple[NotDetectable, ...] = ()
    effects: tuple[DynamicsEffect, ...] = ()
    """The extended model, effects of the baseline included."""
    stds: tuple[Mapping[str, float], ...] = ()
    noise: Mapping[str, float] = field(default_factory=dict)
    """Standard deviation of a reading of each output."""
    loglik_gain_per_s: float = 0.0
    notes: tuple[str, ...] = ()
