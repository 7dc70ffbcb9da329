"""Every number of the diagnosis of vehicle dynamics that may be tuned, with unit and reason.

In: nothing. Out: `SETTINGS`.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class DynamicsSettings:
    """Blocks, noise, selection."""

    block_s: float = 10.0
    """Contiguous blocks: many times the memory of a car's lateral motion (0.1 to 0.5 s), and enough of them
    in five minutes (30) for the spread between them to be an estimate."""
    shortest_block_s: float = 1.5
    """Blocks of short drives: still several times the memory of lateral motion."""
    blocks: float = 16.0
    """Wanted in a short drive."""
    relative_std: float = 0.005
    """Standard deviation of a value beside that by noise, over the value: noise of inputs, steps of the
    integration and neighbouring physics, on worlds of the same equations 0.2 to 0.8 %."""
    folds: int = 4
    """Groups of neighbouring blocks that are held out in turn."""
    gap_s: float = 0.5
    """A longer pause between rows begins a new block."""
    slowest_mps: float = 3.0
    """Rows below are left out: slip angles are singular at walking pace."""
    disturbance_time_s: float = 0.2
    """Correlation time of accelerations that belong to no term: of the order of a steering movement."""
    start_std: tuple[float, float, float] = (3.0, 1.0, 3.0)
    """Standard deviations of v, r, u at the start of a block: wider than any of them is unknown. States that
    effects add have their sizes: what is narrower than a state holds each step to it back."""
    min_white: tuple[float, float, float] = (2e-3, 2e-4, 2e-3)
    """Least random walk of v, r, u per square root of a second: rounding of the recording and of the step."""
    min_other: float = 3e-5
    """Least random walk of states that effects add, over their sizes (1 rad of slip angle, 10 m/s2 of rolled
    lateral acceleration): a step's share stays far below what tyres make of a reading's noise, and the weight
    of a step far enough below the inverse of rounding errors that these do not decide what the path is.
    """
    min_disturbance: tuple[float, float, float] = (3e-3, 3e-3, 3e-3)
    """Least standard deviation of accelerations that belong to no term: m/s2, m/s2, rad/s2 (x, y, moment)."""
    white_share: float = 0.9
    """Least noise of a reading over its white noise: a term must not explain what differs from row to row."""
    noise_rounds: int = 10
    """Steps of the fixed-point iteration for the noise: two figures are reached in five to ten."""
    noise_faster: float = 1.5
    """Growth of a step of that iteration, as a power of the factor, while it keeps its direction."""
    noise_max_power: float = 6.0
    """Its limit: variances that fall to 0 do so in fewer than ten steps."""
    noise_rows: int = 4000
    """Rows from which noise is estimated: standard deviations to 2 %."""
    last_fits: int = 4
    """Fits of the finished model, at most, each with its noise: one leaves a delay of 30 ms 1 ms off, that is
    five of its standard deviations, while the noise still falls."""
    settled: float = 1e-3
    """Change of every value between two fits, in standard deviations of its prior, below which it stands."""
    swing_rounds: int = 8
    """Rounds of a fit with a swinging body, at most: its values move by one standard deviation of their
    priors in each, and noise falls with them."""
    path_rounds: int = 8
    """Steps of Gauss-Newton for the path, at most."""
    path_tolerance: float = 1e-2
    """Decrease of the sum of squares that is left aside, per unit of it or per ten thousand residuals: 0.005
    nats of log-likelihood, far below what any decision asks."""
    derivative_error: float = 0.01
    """Relative difference between the decrease of that sum of squares and the one that the derivatives
    predict, up to which the derivatives are kept: the noise, and so every standard deviation, is known to
    two hundredths."""
    null_finding_probability: float = 0.02
    """Probability that a null drive has a finding, by Markov's inequality for Bayes factors over all
    alternatives: the bar is one in fifty."""
    false_discovery_rate: float = 0.02
    """Expected share of certified findings that are none (Benjamini and Hochberg), among the findings of one
    certificate: no more than null drives may have."""
    max_p_value: float = 0.05
    """Largest p-value, all alternatives counted, of a finding, beyond which it is a suspicion: a second
    opinion by the blocks' scatter about what the evidence has chosen, at the usual level."""
    max_prior_stds: float = 4.0
    """A fit stays within this many standard deviations of a prior: where a model lacks much, its terms would
    otherwise run to sizes that no car has."""
    unusual_prior_stds: float = 3.0
    """A value farther from its prior than that is one that a car in 400 has: its effect may stand in for
    something else."""
    nameless_nats: float = 3.0
    """Log odds against a cause without a name: of twenty effects on a car the catalogue has nineteen."""
    max_error_increase: float = 0.003
    """Largest increase of the mean log error of the prediction, over outputs and blocks, that a step may
    cost: what explains how readings follow each other but predicts them worse is a property of the noise."""
    plain: float = 4.0
    """Log evidence on a part of the blocks, in thresholds, beyond which the whole drive need not be asked."""
    plain_error_increase: float = 0.03
    """Increase of the prediction's error on a part of the blocks beyond which the whole drive need not be
    asked: fits to a part and to the whole differ by half of that in it."""
    min_fall: float = 0.995
    """Prediction error after over before, below which it is said to fall: three digits are printed."""
    tried: int = 4
    """Terms that a forward step tries, best evidence first, until one predicts no worse; those that are
    confounded with each other count once."""
    proxy_share: float = 0.7
    """Share of what a model explains that one term without a name explains alone, from which the model's
    named effects may be proxies of it."""
    max_effects: int = 10
    """More findings than anybody can follow are not looked for."""
    confounded_nats: float = 3.0
    """Alternatives whose log evidence is within this are listed as confounded: odds of twenty."""
    competitor_share: float = 0.7
    """Share of a term's log evidence from which a competing name is fitted in its place: to first order a
    change by a fifth is off by a fifth of itself, and evidence by twice that."""
    spline_knots: int = 6
    """Knots of a term without a name: a shape with two bends."""
    wiggle_shares: tuple[float, ...] = (1.0, 0.3, 0.1, 0.03, 0.01)
    """Deviations of a term without a name from a straight line, over its size: alternatives of one prior."""
    plain_odds_nats: float = 6.0
    """Log odds of the only effect found against the best term without a name, in a part of the blocks, beyond
    which no selection begins with the latter: odds of four hundred."""
    time_knot_s: float = 12.0
    """Between knots of a spline over time: shorter than a bend of a road takes is determined by its
    forces."""
    bank_std_rad: float = 0.03
    """Slopes across the road: crowns of 2.5 %, superelevation of 4 to 8 % (AASHTO 2018, ch. 3)."""
    grade_std_rad: float = 0.04
    """Slopes along the road: 3 to 7 % on rural roads (AASHTO 2018, ch. 3)."""
    wind_box_s: float = 5.0
    """Resolution of the spans in which wind is looked for."""
    max_spans: int = 4
    """Spans of wind, at most: gusts between woods and bridges of one drive."""
    wind_edge_s: float = 0.5
    """Resolution of begin and end of the likeliest span: a gust builds up in about a second."""
    slow_share: float = 1.6
    """Variance of slow sums of scores over that of white ones, from which slopes are looked at: with 25
    sums its standard deviation is 0.3 where nothing acts."""
    span_sizes: float = 4.0
    """Largest sum of scores over spans, in standard deviations, from which wind is looked at."""
    screen_p: float = 0.003
    """p-value over blocks below which a term without a name is looked at: some forty are asked."""
    nameless_looked: int = 8
    """Terms without a name that get a proper look, the most significant first: neighbours among equations and
    covariates are alike in the cheap one."""
    rating_samples: int = 1000
    """Most samples of a curve whose rating is computed: the work grows with their square."""
    max_rows: int = 60_000
    """Rows of a drive that are looked at, blocks spread evenly over a longer one: 20 min at 50 Hz, from which
    no value is known better than its model's own error, and 700 MB of columns."""
    values_at_once: int = 50_000
    """Rows times columns that are computed at once: with their states and outputs some megabytes, which a
    processor's cache holds."""
    min_s: float = 8.0
    """Driving below which nothing is concluded: a handful of blocks."""


SETTINGS = DynamicsSettings()
"""The ones in use."""
