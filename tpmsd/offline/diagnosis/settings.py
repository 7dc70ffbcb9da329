"""The settings of the diagnosis, with their units and reasons.

In: nothing. Out: `SETTINGS`, with one record per package. All log-likelihoods are in nats. What decides
between findings was fixed on the benchmark's development seeds (`python -m bench run diagnosis`, `origins`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.rings.settings import COUNTERS, CounterSettings


@dataclass(frozen=True, slots=True)
class HypothesisSettings:
    """Terms and their columns."""

    per_value_nats: float = 3.5
    """Penalty of a free value: half the logarithm of a thousand windows (BIC, Schwarz 1978)."""
    shapes: int = 120
    """Wheel patterns times covariates of a spline term: the logarithm is its penalty of multiplicity."""
    ramp_knots: int = 40
    """Intervals between which a radius may change: half a minute each in twenty minutes."""
    spline_intervals: int = 5
    """Knots of a spline term over a covariate at first; more are tried once it is plain."""
    time_intervals: int = 12
    """Knots over time and distance, where a drive holds more than one swing."""
    finer: int = 4
    """Intervals of the finest spline, per interval of the first."""
    apart_stds: float = 4.0
    """Standard deviations of a covariate between two knots: a bump between nearer ones is smeared into
    them, and what it shares with the residual bends it (errors in variables; origin `traffic`, null drive
    1)."""
    fewest_between_knots: int = 6
    """Windows between two of the finest knots."""
    fewest_readings: int = 30
    """Windows with a reading, below which a drive does not have it; of the receiver's, twice as many."""
    probe_m: float = 1e-5
    """Change of a radius small enough to be linear."""
    tangent_share: float = 0.05
    """Fraction of an effect's value by which it is moved to take its tangent: no rounding, hardly a
    curvature.
    """
    smallest_radius_m: float = 3e-5
    """No road leaves a tyre's radius alone better than to this: a smaller change is not worth a name."""
    impossible_nats: float = 12.5
    """Against every ratio of an effect's two values that physics allows (five standard deviations): then it
    is not this effect."""
    best_per_drive: int = 10
    """Terms over time and distance of one drive that a scan of several drives returns."""


@dataclass(frozen=True, slots=True)
class PreparationSettings:
    """Drives, blocks and memory."""

    min_driving_s: int = 90
    """Below, a drive is not judged: three blocks."""
    max_drives: int = 12
    """Each has some three hundred columns of its own."""
    near_m: float = 100.0
    near_share: float = 0.03
    """Two paths are beside each other within this, and this share of the distance from the start: the
    receiver's slow error, and dead reckoning."""
    block_s: float = 30.0
    """Blocks of cross-validation and of the sandwich variance: longer than the receiver's errors are
    correlated."""
    fewest_blocks: int = 10
    """In a short drive blocks are shorter."""
    max_blocks: int = 120
    """Blocks of all drives together: beyond an hour blocks grow, so that memory is bounded."""
    max_moves: int = 8
    """Linearisations of radii and motion of a replicate. After one, a radius that is 8 % off leaves products
    that gain a thousand nats, a wheel that locks 75; five leave none.
    """
    moved_nats: float = 0.1
    """Gain of the last move: far below what any term costs."""
    noises_kept: int = 2
    """Under which a drive's whitened columns are kept: an alternative is tried beside the present one."""


@dataclass(frozen=True, slots=True)
class SelectionSettings:
    """Stepwise selection."""

    admit_nats: float = 6.0
    """Penalised gain from which a term is admitted: odds of four hundred."""
    heldout_nats: float = 4.0
    """Cross-validated gain that it must bring."""
    max_terms: int = 8
    """In one model."""
    spline_gain_margin: float = 0.08
    """Share of its gain by which a spline must beat an effect: no effect's formula is the last word."""
    drift_gain_margin: float = 0.25
    """Such a share for a spline over time or distance on all wheels, with which the receiver's slow error
    is confounded."""
    share_of_rest: float = 1e-5
    """Share of what all terms together gain that a term must gain: no linearised model is better than
    that."""
    model_error: float = 4e-3
    """Relative standard deviation of any value: the reference motion that it multiplies is no better
    known."""
    spline_over_effects: float = 0.03
    """Share of what effects gain that a spline fitted jointly must gain: so well their formulas hold."""
    over_same_covariate: float = 0.05
    """Share of a spline's gain that an effect over the same covariate must gain jointly with it: a spline is
    one of many that would do, and what its form leaves looks like whatever depends on the same."""
    over_other_covariate: float = 1e-3
    """Share of a spline's gain that an effect on differences between wheels must gain jointly with it even
    over another covariate: slip that no effect holds is not the same on the inner wheels of a bend."""
    same_effect: float = 0.97
    """Share of an effect's response from which a spline on those wheels is the same effect without a
    name."""
    confounded_nats: float = 2.0
    """Alternatives whose fit is worse by less than this are confounded with a term."""
    confounded_share: float = 5e-4
    """... or by less than this share of the term's gain: so small a difference may come from what is not
    linear in the responses, and not from the drive."""
    alternative_weight: float = 1e-3
    """Gain of an alternative over the term's own, above which its values are checked for plausibility."""
    nearer_shares: tuple[float, ...] = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5)
    """Shares by which a value may lie nearer to zero where its penalty is taken; at a half a quarter of the
    gain is lost."""
    needed_share: float = 0.7
    """Share of what admits a term that keeps it in a backward step: above a half, so that steps do not
    cycle."""
    exchange_nats: float = 0.5
    """Penalised gain by which an exchange must be better, so that exchanges end."""
    best_pairs: int = 3
    """Pairs of single values that a step considers beside single terms: the likeliest few of thousands."""
    pairs_tried: int = 6
    """Pairs of effects that are tried instead of a spline term, the best first."""
    independent_share: float = 0.5
    """Share of its gain that a term keeps beside an alternative from which the two explain different
    things."""
    min_eigenvalue: float = 1e-6
    """Least eigenvalue of the terms' correlation matrix, calibration included: below, they are one."""
    min_own_share: float = 1e-5
    """Share of a column that the chosen terms leave of it, below which it is theirs."""
    max_overdispersion: float = 25.0
    """Block-wise over assumed variance: beyond, a few blocks decide."""
    step_s: float = 3.0
    """A ramp shorter than this is a step: the middle of a window is known no better."""
    pulse_edge_s: float = 0.5
    """Half the time in which a pulse rises: half a window."""


@dataclass(frozen=True, slots=True)
class RefinementSettings:
    """Settings of what enters nonlinearly, and of finer splines."""

    plain_splines: int = 3
    """Splines taken out before the noise is first estimated: one of each kind of covariate."""
    plain_nats: float = 40.0
    """Penalised gain from which a spline is no noise."""
    compared: int = 2
    """Splines over covariates that are held, on their best knots, against what is best over time."""
    rounds: int = 4
    """Grids of trial values, each two and a half times finer."""
    drift_rounds: int = 4
    """Rounds in which ramps and radius drift are fitted in turn: after three the likelihood rises no more."""
    best: int = 3
    """Candidates among which a spline is looked for."""
    levels: tuple[int, ...] = (1, 2, 4)
    """Numbers of intervals tried, in those of the first look."""
    finer_nats: float = 3.0
    """Penalised gain by which finer knots must be better."""
    exact_rounds: int = 2
    """Steps of Gauss-Newton with the exact response: the first leaves a tenth of the linearisation error."""
    step_halvings: int = 4
    """Times that a step of Gauss-Newton is halved: what takes a shorter one is no step of a linear model."""
    max_relative_radius_change: float = 0.05
    """Relative change of a radius at one linearisation."""


@dataclass(frozen=True, slots=True)
class AssessmentSettings:
    """Settings of what a drive identifies, what was reached, and the comparison with a simulation."""

    confounded_cosine: float = 0.9
    """Cosine of the angle between two sensitivities: of what the one gains, four fifths are then gained by
    the other.
    """
    identifiable_nats: float = 10.0
    """At the usual size, from which a drive identifies an effect: its penalty, and odds of a thousand."""
    power_stds: float = 1.645
    """Standard deviations of a value that make it seen in 19 of 20 drives: the normal's 95 % quantile."""
    size_rounds: int = 5
    """Iterations of size and what it is compared with: after three it changes by less than a percent."""
    implausible_stds: float = 100.0
    """Beyond, a size is not looked for: what instruments usually have ends far below."""
    lags: int = 10
    """Windows over which what is left is looked at for correlation."""
    shrinkage_decades: tuple[float, float] = (-4.0, 2.0)
    """Prior standard deviations of a column's value that are tried, as powers of ten of its own noise."""
    interval_nats: float = 1.92
    """Fall of the log-likelihood at the ends of a 95 % interval (Wilks 1938)."""
    ramp_reach_s: tuple[float, float] = (0.5, 120.0)
    """Least and greatest change of a ramp's begin or end at which its likelihood is taken: half a window, and
    beyond what any drive with a finding left open."""
    ramp_nodes: int = 18
    """Number of such changes to either side, each 1.4 times the one before."""
    longest_share: float = 16.0
    """Factor to either side over which the likelihood of an exponential's time constant is taken: a
    sixteenth of one within a drive is nearly a step."""
    halvings: int = 4
    """Fraction of the span in which an onset's interval ends: to a sixteenth of it."""
    first_values: int = 19
    """Values over its range at which the likelihood of a nonlinear parameter is taken."""
    second_values: int = 9
    """Values of a second nonlinear parameter at which it is taken."""
    simulation_floor: float = 0.5
    """A simulation's noise is no less than this share of the recording's: a difference cannot be known
    better than the recording determines it."""
    simulation_silent: float = 0.01
    """A simulation with this share of the recording's information on a value, or less, holds none of
    it."""
    simulation_rounds: int = 6
    """Rounds of adding and removing the simulation's own effects."""
    seen_stds: float = 3.0
    """From so many standard deviations on, a value is there."""

    @property
    def shrinkage(self) -> FloatArray:
        """(38,) prior standard deviations that are tried, from none."""
        return np.concatenate([[0.0], np.logspace(*self.shrinkage_decades, 37)])


@dataclass(frozen=True, slots=True)
class RobustnessSettings:
    """Other noise, and the certificate."""

    clear_of_receiver_nats: float = 300.0
    """Beyond, no slow noise of a receiver is the reason: reflections that weigh less can make 80."""
    clear_of_drift_nats: float = 3000.0
    """Gain beyond which no radius drift is the reason for a wheel that changes against the others."""
    confident_from: float = 0.95
    """Confidence below which an effect is not distinguished from what instruments usually make."""
    drifts_from: float = 1e-4
    """Relative standard deviation of the radii's drift that is more than usual: five times that."""
    drift_unsure: float = 1.5
    """Factor by which so much drift may be greater than it seems: a drive holds but a few of its swings."""
    judged: int = 6
    """Changes and events, the best first, whose block-wise variance is looked at beside radius drift."""
    drift_levels: tuple[float, ...] = (1.0, 0.5, 0.25)
    """Shares of the estimated drift at which a change of radius is looked for: beside it there is less."""
    student_freedom: float = 4.0
    """Degrees of freedom of Student's distribution, usual for outliers in regression (Lange, Little and
    Taylor 1989).
    """
    down_weighting_rounds: int = 5
    """Rounds in which outliers are made lighter (iteratively reweighted least squares, Holland and Welsch
    1977): an error of some seconds has none left after three or four."""
    normal_median: float = 1.4826
    """Standard deviation of a normal distribution in its median distance from the mean."""
    together_share: float = 0.85
    """Share of what four separate wheels gain that one group must gain."""
    gyro_walks_from: float = 4.0
    """Estimated walk of the gyro's bias over the usual one that is more than usual."""
    gyro_far_radps: float = 1.2e-3
    """Range over a drive beyond which a gyro's drift is not the bias instability that data sheets allow (3 to
    60 deg/h, flicker noise by IEEE Std 952): 99 % of such gyros stay below in ten minutes."""
    false_discovery_rate: float = 0.01
    """Expected share of false findings among the findings (Benjamini and Hochberg 1995)."""
    exceeded: int = 3
    """Replicates beyond a finding after which chance makes as much without doubt (Besag and Clifford
    1991)."""
    fewest_replicates: int = 7
    """Before drawing may stop because a finding is beyond doubt."""
    beyond_doubt: float = 1e-4
    """Probability below which no further replicate changes the answer: a hundredth of the discovery
    rate."""
    min_scale_nats: float = 1.0
    """Scale of the maxima's distribution: half a chi-square falls off by e per nat, whatever its degrees of
    freedom (Wilks 1938). Scatter of a few maxima may look narrower than that; it is not.
    """
    ridge: float = 1e-6
    """Least norm of columns of unit length: what the model explains already has next to nothing left."""


@dataclass(frozen=True, slots=True)
class SensorSettings:
    """Errors of accelerometers, steering wheel and clock, apart from the windows."""

    known_share: float = 0.8
    """Fraction of a sensor's readings that must be there."""
    fewest_fixes: int = 100
    """With UTC, for the clock."""
    clock_step_s: float = 0.2
    """Between neighbouring fixes, from which the clock was set: that is a fault of its own."""
    block_s: float = 30.0
    """Slopes, gusts and drivers make residuals that last for seconds: blocks show the scatter."""
    fewest_blocks: int = 8
    """With fewer, the scatter between blocks is known too badly."""
    model_error: float = 0.02
    """Relative standard deviation of any value: the motion that it multiplies is no better known."""
    min_share: float = 1e-3
    """Fraction of a column that the others must leave, squared, for its value to be reported."""
    beyond_stds: float = 4.0
    """Beyond the usual size of an error: one in 30,000 by chance, for some ten errors of a drive."""


@dataclass(frozen=True, slots=True)
class ReportSettings:
    """Settings of what is written down."""

    drift_reported_from: float = 2e-4
    """Relative standard deviation of the radii's drift from which it is reported as unexplained."""
    suspected_from: float = 0.5
    """Confidence of a suspicion: below, it is likelier that there is nothing, or something else."""
    much_removed: float = 0.25
    """Share of a block's data from which its span of time is named."""
    bins: int = 16
    """Bins of a covariate, in the pictures."""
    known_ripple_stds: float = 3.0
    """Standard deviations within which a ring's ripple is the known one: one of 370 is farther by chance."""
    proposed_reach: float = 10.0
    """Limits of a proposed coefficient, in units of what was fitted."""
    proposals: int = 3
    """Closed forms that are proposed for what has no name."""
    shape_quantiles: tuple[float, ...] = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
    """Quantiles of a covariate at which the centre of a step and a threshold are tried."""
    shape_widths: tuple[float, ...] = (0.1, 0.2, 0.4, 0.8)
    """Widths of a step or saturation that are tried, as fractions of the covariate's standard deviation."""
    folds: int = 5
    """Shares of the blocks that are held out in turn when a closed form is judged."""
    speeds_mps: tuple[float, ...] = (0.0, 2.5, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 40.0, 60.0)
    """Between two of them a drive's information is added up."""


@dataclass(frozen=True, slots=True)
class DiagnosisSettings:
    """All of them, by package."""

    hypotheses: HypothesisSettings = HypothesisSettings()
    counters: CounterSettings = COUNTERS
    preparation: PreparationSettings = PreparationSettings()
    selection: SelectionSettings = SelectionSettings()
    refinement: RefinementSettings = RefinementSettings()
    assessment: AssessmentSettings = AssessmentSettings()
    robustness: RobustnessSettings = RobustnessSettings()
    sensors: SensorSettings = SensorSettings()
    report: ReportSettings = ReportSettings()


SETTINGS = DiagnosisSettings()
