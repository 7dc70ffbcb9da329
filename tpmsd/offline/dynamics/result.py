"""The outcome of a diagnosis of vehicle dynamics, as plain records.

In: nothing. Out: `DynamicsDiagnosis` and what it consists of.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from tpmsd.car.physics.dynamics_effect import DynamicsEffect
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.assessment.result import Proposal

CONSISTENT, MISMATCH, INSUFFICIENT = "consistent", "mismatch", "insufficient_data"
FINDING, SUSPICION = "finding", "suspicion"


@dataclass(frozen=True, slots=True)
class FittedNumber:
    """A fitted number with its standard deviation."""

    value: float
    std: float
    unit: str


@dataclass(frozen=True, slots=True)
class Location:
    """Location at which baseline and recording differ."""

    channel: str
    covariate: str | None
    range: tuple[float, float] | None
    time_spans: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True, slots=True)
class Residuals:
    """Mean residual of one output per bin of a covariate, in standard deviations of its mean."""

    covariate: str
    middle: FloatArray
    """(b,) of the bins, as `before` and `after`."""
    before: FloatArray
    """Predicted without the finding."""
    after: FloatArray


@dataclass(frozen=True, slots=True)
class DynamicsFinding:
    """One effect that the drive holds."""

    effect: str
    status: str
    confidence: float
    p_value: float
    parameters: Mapping[str, FittedNumber]
    where: Location
    rms_before: float
    """Residual of the output where it shows, predicted without it."""
    rms_after: float
    loglik_gain: float
    """Nats on held-out blocks."""
    loglik_gain_per_s: float
    evidence: float
    indistinguishable_from: tuple[str, ...]
    distinguished_by: str
    shape: tuple[tuple[float, float, float], ...] = ()
    """Curve of a spline: covariate, value, standard deviation."""
    acts_on: str = ""
    may_be_proxy: bool = False
    """True if it may be a proxy of an effect that is not in the catalogue."""
    unusual: bool = False
    """True if its size is one that hardly any car has."""
    term: int = 0
    """Position of its term in the selection."""
    p_value_is_bound: bool = False
    """True if no replicate of the certificate showed as much: the p-value is 1 / (n + 1)."""
    residuals: Residuals | None = None


@dataclass(frozen=True, slots=True)
class FittedNuisance:
    """An effect that every car has and the baseline simplifies, as it was fitted; no finding."""

    effect: str
    parameters: Mapping[str, FittedNumber]


@dataclass(frozen=True, slots=True)
class Curves:
    """One output over the drive, (n,) each; predictions with parameters fitted on the other folds."""

    recorded: FloatArray
    before: FloatArray
    """Predicted by the baseline."""
    after: FloatArray
    """Predicted by the extended model."""


@dataclass(frozen=True)
class ClosedForm(Proposal):
    """A closed form for a term without a name, on an equation or an output."""

    on_unit: str
    """Unit of what it is added to."""


@dataclass(frozen=True, slots=True)
class Certificate:
    """Fraction of replicates of the drive, drawn from the fitted model, that show as much."""

    replicates: int
    """Drawn at most for one question."""
    remaining_gain: float
    """Largest log evidence of anything that was not found."""
    remaining_p_value: float
    remaining_exceeded: int
    remaining_replicates: int


@dataclass(frozen=True, slots=True)
class OutputFit:
    """Prediction error of an output from the inputs, parameters fitted on the other folds."""

    unit: str
    rms_before: float
    rms_after: float
    rating_before: float
    rating_after: float


@dataclass(frozen=True, slots=True)
class SelectionStep:
    """The model after one more effect: root mean square error of each output, held out."""

    effects: tuple[str, ...]
    rms: Mapping[str, float]
    model: tuple[DynamicsEffect, ...] = ()
    """The effects as they were fitted to the whole drive in this step, those of the baseline included."""


@dataclass(frozen=True, slots=True)
class UndetectableEffect:
    """An effect that the drive could not have shown at a typical value."""

    effect: str
    smallest: Mapping[str, tuple[float | None, str]]
    """Size by parameter that would have shown and its unit; None where none would."""


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
    steps: tuple[SelectionStep, ...] = ()
    not_detectable: tuple[UndetectableEffect, ...] = ()
    effects: tuple[DynamicsEffect, ...] = ()
    """The extended model, effects of the baseline included."""
    stds: tuple[Mapping[str, float], ...] = ()
    noise: Mapping[str, float] = field(default_factory=dict)
    """Standard deviation of a reading of each output."""
    loglik_gain_per_s: float = 0.0
    notes: tuple[str, ...] = ()
    time_s: FloatArray | None = None
    """(n,) of the curves, since the drive's start."""
    curves: Mapping[str, Curves] = field(default_factory=dict)
    """Residuals by output; recorded rows alone."""
    proposals: tuple[ClosedForm, ...] = ()
    certificate: Certificate | None = None
    nuisances: tuple[FittedNuisance, ...] = ()
    simulated: tuple[DynamicsEffect, ...] | None = None
    """Effects with which the baseline moves like the user's simulation; None where there was none."""
