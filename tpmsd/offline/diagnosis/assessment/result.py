"""Records of a diagnosis.

In: nothing (plain records). Out: `Finding`, `Where`, `Quantity`, `RollingDiagnosis`, and what
pictures are drawn from.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from tpmsd.car.physics.model import ExtendedModel
from tpmsd.foundation.plain import brief
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.assessment.reach import Reach

CONSISTENT, MISMATCH, INSUFFICIENT = "consistent", "mismatch", "insufficient_data"
FINDING, SUSPICION = "finding", "suspicion"


@dataclass(frozen=True)
class Quantity:
    """A parameter's value."""

    value: float | str
    std: float | None
    unit: str


@dataclass(frozen=True)
class Where:
    """The place of a mismatch, in the words of the report's format."""

    wheels: tuple[str, ...]
    channel: str
    covariate: str | None
    range: tuple[float, float] | None
    time_spans: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True)
class DownWeighted:
    """Part that robust weights took out of the data because no hypothesis explains it."""

    share: float
    by_channel: dict[str, float]
    time_spans: tuple[tuple[float, float], ...]
    """Spans in which much of it was lost, seconds from the first drive's start."""


@dataclass(frozen=True)
class SpeedRange:
    """Information of the seconds at some speeds."""

    speed_mps: tuple[float, float]
    driving_s: float
    radius_std_m: float | None
    """Standard deviation of a wheel's radius by these seconds alone; None where they do not tell it."""


@dataclass(frozen=True)
class Explanatory:
    """A variable that the tyre model tells, and what it would explain; gains in sample, nats."""

    variable: str
    """wheel_slip | side_slip"""
    covariate: str
    """Over which it is shown."""
    alone: float
    """Gain over calibration alone."""
    beyond: float
    """Gain over what was found."""
    without: tuple[str, ...] = ()
    """Roles that the bus lacks: what they would tell comes from wheels and receiver."""


@dataclass(frozen=True)
class Proposal:
    """A closed form for what has no name, and its log-likelihood gain instead of the spline terms."""

    name: str
    """For a file of the catalogue."""
    formula: str
    """In Python, of variables that are called as the covariates are."""
    covariates: tuple[str, ...]
    on: str
    """Wheels with their signs, or a reading, as a spline term has them."""
    coefficient: float
    """In metres of radius, or the reading's unit, per `unit`."""
    std: float
    """Standard deviation of the coefficient."""
    unit: str
    """Unit of the formula's value; `1` without one."""
    gain: float
    """Nats in sample."""
    heldout_gain: float
    """Nats on held-out blocks."""


@dataclass(frozen=True)
class Finding:
    """One piece of physics that the rolling model lacks."""

    effect: str
    confidence: float
    parameters: dict[str, Quantity]
    where: Where
    rms_before: float
    """Root mean square of the whitened residual on held-out blocks, without and with this finding."""
    rms_after: float
    loglik_gain_per_s: float
    gain: float
    """Log-likelihood on held-out blocks, in nats."""
    indistinguishable_from: tuple[str, ...]
    advice: str = ""
    """Recommended manoeuvre that would distinguish the alternatives."""
    identified_by: str = ""
    """Evidence that distinguishes it from its like, where that is not in the gains."""
    shape: tuple[tuple[float, float, float], ...] = ()
    """Curve of an `unknown`: (covariate, value, std) at the knots."""
    drives: tuple[str, ...] = ()
    """Drives, of several, in which it stands; empty where it stands in all."""
    held_by: str = ""
    """Compared with a simulation: recording, simulation, or both at different values; else empty."""
    simulated: dict[str, Quantity] = field(default_factory=dict)
    """The simulation's own values; `parameters` are the recording's less these."""
    p_value: float | None = None
    """Share of drives without it that would show as much, counted in replicates; None where no certificate
    was asked for."""
    p_value_is_bound: bool = False
    """No replicate showed as much: the p-value is 1 / (n + 1) of n replicates."""
    own_chance: float | None = None
    """Probability by the test's own distribution, of what has a statistic of its own; a certificate decides
    by no smaller one, and it is not reported."""
    found_by: str = ""
    """The search that found it, of what is looked for apart from the terms; else empty."""
    status: str = FINDING
    """finding | suspicion; a suspicion does not make a mismatch."""


@dataclass(frozen=True)
class RadiusDrift:
    """Radii that drift more than tyres and roads make them: the model takes it as noise, and does not explain
    it."""

    relative_std: float
    """Standard deviation of the drift, relative to the radius."""
    time_constant_s: float
    drive: str
    """Drive, of several, in which it is largest; empty for one drive."""
    where: Where


@dataclass(frozen=True)
class Remaining:
    """The best of all hypotheses that were not chosen, against what chance makes of them."""

    gain: float
    """Penalised gain jointly with what was chosen, nats."""
    p_value: float
    """Fraction of drives in which nothing else acts that would show as much."""
    exceeded: int
    """Replicates that did."""
    replicates: int


@dataclass(frozen=True)
class NotDetectable:
    """An effect that would have had to be larger than typical to be found for sure."""

    effect: str
    smallest: dict[str, tuple[float | None, str]]
    """Sizes by parameter, difference from neutral and unit; None where nothing of it shows in the drive."""


@brief
@dataclass(frozen=True)
class RollingDiagnosis:
    """The whole answer for one drive or several."""

    verdict: str
    reason: str
    """Reason why the data are insufficient; else empty."""
    findings: tuple[Finding, ...]
    driving_s: float
    """Windows that were compared."""
    baseline_rms: float
    baseline_loglik_per_s: float
    model_rms: float
    unexplained: Where | None
    """Structure in the residual that one more term would explain."""
    model: ExtendedModel
    evidence: tuple[tuple[str, float], ...] = ()
    """Held-in gain of every hypothesis alone against the rolling model, the best first."""
    baseline: tuple[str, ...] = ("rolling",)
    """With what the recording was compared: the rolling model, or the user's simulation."""
    simulation: tuple[str, ...] = ()
    """Effects that the user's simulation was seen to hold."""
    notes: tuple[str, ...] = ()
    """Drives and stretches that were left out, and why."""
    reach: Reach | None = None
    """Fraction of the reachable improvement that was reached; None where the data are insufficient."""
    explanatory: tuple[Explanatory, ...] = ()
    """Gain that slips by the tyre model would bring."""
    replicates: int = 0
    """Drawn for the certificate of the findings; 0 without one."""
    drift: RadiusDrift | None = None
    """None where the radii drift no more than usual."""
    remaining: Remaining | None = None
    """None without a certificate."""
    control: float | None = None
    """Largest penalised gain (nats) of a shape over covariates that cannot act; None if not asked for."""
    down_weighted: DownWeighted | None = None
    """None where the data are insufficient."""
    information: tuple[SpeedRange, ...] = ()
    """Information by speed, the slowest first."""
    proposals: tuple[Proposal, ...] = ()
    """The best first; empty if not asked for, or if all has a name."""
    not_detectable: tuple[NotDetectable, ...] = ()
    """The nearest to its typical value first."""
    inner: PictureData | None = field(default=None, repr=False)


@dataclass(frozen=True)
class Trace:
    """Mismatch in standard deviations per bin of a covariate: residual along the finding's response."""

    effect: str
    covariate: str
    middle: FloatArray
    before: FloatArray
    after: FloatArray


@brief
@dataclass(frozen=True)
class DriveMap:
    """The drive's map."""

    east_m: FloatArray
    north_m: FloatArray
    mismatch: FloatArray
    """Log-likelihood per second that the rolling model loses there against the extended one, smoothed over 9
    s.
    """


@brief
@dataclass(frozen=True)
class PictureData:
    """Data that the pictures are drawn from."""

    rms_by_channel: dict[str, tuple[float, float]]
    """Root mean square of the whitened residual, before and after."""
    traces: tuple[Trace, ...]
    ground: DriveMap | None
