"""The settings of what is looked for in counts and rings, with their units and reasons.

In: nothing. Out: `COUNTERS`, a part of the diagnosis' settings, and `ToothCountSettings`, a part of those of
the discovery. All log-likelihoods are in nats.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.foundation.wheels import FloatArray


@dataclass(frozen=True, slots=True)
class CounterSettings:
    """Settings of what is looked for in counts, apart from the windows."""

    ripple_high_pass_s: float = 0.5
    """Width of the Gaussian that takes slow differences between wheels away: several turns."""
    ripple_from_mps: float = 4.0
    """Below, a turn lasts as long as the high-pass."""
    ripple_block_ticks: int = 300
    """Half a minute: blocks over which the ripple's variance is estimated."""
    ripple_folds: int = 5
    """Folds of cross-validation."""
    ripple_admit_nats: float = 12.0
    """For amplitude, phase and flattening of one of four wheels, and odds of a thousand."""
    ripple_longest_period_s: float = 0.1
    """Between readings: what is interpolated between them is flatter than the ripple, the more the faster
    the wheel turns. Periods are tried in steps of a tenth of this."""
    ripple_flattened_std: float = 0.1
    """Relative standard deviation of an amplitude: how much flatter is known no better."""
    ripple_ranges: int = 12
    """Range of turns per second, where speeds fold the ripple."""
    ripple_folded_from: float = 2.0
    """Gain of folded ripples, over that of plain ones, from which they are folded."""
    ripple_folded_std: float = 0.6
    """Relative standard deviation of an amplitude that was folded."""
    fewest_teeth: int = 20
    max_teeth: int = 200
    """Counts per revolution of the rings that cars have (48 to 100 are usual), and of finer ones."""
    teeth_from_offset: float = 0.012
    """Relative offset of a radius from which another number of teeth is thought of: radii differ by some
    tenths of a per cent."""
    teeth_within: float = 0.35
    """Distance to a whole number of teeth within which the offset must be."""
    teeth_all_from: float = 0.055
    """Relative offset of all wheels together: so far off no radius of a tyre of about the right size is."""
    teeth_at_once: float = 0.04
    """Relative offset of one wheel that is put right before anything else is looked for: no small
    change."""
    radius_spread: float = 0.003
    """Relative standard deviation between the radii of one car's wheels: where one tooth is less, no count
    is distinguished from its neighbour."""
    nominal_radius_m: float = 0.3
    """Radius to which the prior of radii belongs."""
    lost_compared_to_mps: float = 15.0
    """Up to which fixes are compared for lost counts: beyond, radii that grow with speed show."""
    lost_min_limit_mps: float = 1.0
    lost_max_limit_mps: float = 4.0
    lost_limit_step_mps: float = 0.1
    """Speeds below which counts may be lost: passive sensors fall silent at 1 to 3 m/s."""
    lost_min_mps: float = 0.6
    """Least speed looked at: the receiver's course and speed are noise below."""
    lost_min_stds: float = 4.0
    """Least speed looked at, in standard deviations of the receiver's speed."""
    lost_half_s: float = 0.25
    """Half the time over which a wheel's speed is taken."""
    lost_admit_nats: float = 14.0
    """For the share that is lost, its limit among thirty, and odds of a thousand."""
    lost_share: float = 0.3
    """Least share of counts that is called lost: what is less may be a low-pass of the sensor."""
    lost_block_s: float = 20.0
    """Fixes nearer than this err alike."""
    lost_braking_mps2: float = 2.0
    """Usual change of speed before a stop, which blurs the limit."""
    lost_fewest: int = 3
    """Fixes below the limit."""
    single_block_windows: int = 120
    """Two minutes, over which a mean is taken away: radii drift slowly."""
    single_max_steps: int = 60
    """Counts lost in a window: of more the scatter looks normal, and no steps show."""
    single_sum_windows: int = 12
    """Windows of a sum that distinguishes losses from bounded errors: a tenth of a block, whose mean is
    gone."""
    single_few_windows: tuple[int, ...] = (2, 4)
    """Windows of sums that distinguish losses at random from what lasts for seconds: slip and loads do."""
    single_stds: float = 6.0
    """Standard deviations above the mean up to which numbers of lost counts are added up."""
    single_probe: float = 0.05
    """Step in the logarithm of rate and noise by which the likelihood's curvature is taken."""
    single_similar: float = 0.98
    """Share of what an error of the best wheel explains, from which another wheel's explains it as well."""
    single_admit_nats: float = 6.0
    """Gain of losses over symmetric noise from which they are a finding: odds of four hundred."""
    single_min_own: float = 0.05
    """Share of a wheel's distance that the motion must leave open: without a gyro half of it is, on two
    wheels nothing."""
    missed_stds: float = 3.0
    """Standard deviations from which a share is lost: what is less and fluctuates with bends is load."""
    missed_from_hz: float = 4.0
    """Turns per second from which a ripple is faster than the car's own changes of speed."""
    missed_smoothing_s: float = 2.0
    """Over which what a wheel counts less than the other one is smoothed: many turns, less than a bend."""
    missed_block_s: float = 60.0
    """In which a ripple is coherent: 700 turns tell shares of 1e-3 apart, and a bend's load is over."""

    @property
    def ripple_periods_s(self) -> FloatArray:
        """Trial periods between readings, s, from 0."""
        return np.linspace(0.0, self.ripple_longest_period_s, 11)

    @property
    def lost_limits_mps(self) -> FloatArray:
        """Trial speed limits below which counts are lost, m/s."""
        count = round((self.lost_max_limit_mps - self.lost_min_limit_mps) / self.lost_limit_step_mps)
        return np.linspace(self.lost_min_limit_mps, self.lost_max_limit_mps, count + 1)


COUNTERS = CounterSettings()


@dataclass(frozen=True, slots=True)
class ToothCountSettings:
    """Settings of the counts per revolution: tyres, rings, and the line of a ripple."""

    radius_m: float = 0.322
    radius_std_m: float = 0.025
    """Prior of the rolling radius where no tyre size is given."""
    tyre_radius_std: float = 0.010
    """Relative: rolling radius of a tyre of known size. Diameter over makes 0.6 % (ETRTO allows about 1 %),
    wear 0.5 % (0 to 6 mm), rolling share over constructions, load and pressure 0.6 %. Assumed."""
    wrong_size: float = 0.05
    """Probability that the tyre's size as given is not that of the tyres that rolled: the door label or the
    papers name another one, winter wheels differ. Assumed."""
    rolling_share: float = 0.969
    """Rolling radius over the unloaded radius of the size (ETRTO: circumference at 60 km/h, 3.05 of the
    diameter for radial tyres, is 0.971 pi; at working load a little less)."""
    ripple_window_s: float = 0.5
    """Length of the smooth motion against which a wheel's ripple is seen: a car's speed changes in tenths of
    seconds at most, a wheel at town speed turns several times."""
    ripple_min_hz: float = 4.0
    """Revolutions per second below which the ripple is as slow as the car's own changes of speed."""
    ripple_block_s: float = 120.0
    """Length of the stretches in which the ripple is coherent: with 48 counts, numbers 1/16 apart are
    distinguished, and a counter that loses counts spoils one stretch alone."""
    ripple_min_rows: int = 200
    """Samples of a stretch; fewer show no line."""
    other_lines: float = 0.5
    """Share of the ripple's stretches that may hold another line at a candidate. Of 16 perfect rings at
    constant speeds none is called a wrong number above 0.95; with 0.1 it is two, and 15 without other
    lines."""
    decided: float = 0.95
    """A role below this probability is listed as undecided."""
    faultless: float = 0.5
    """Prior of no line at all. Assumed: rings on simulated buses are perfect, real ones are not."""
    ripple_min_window: int = 7
    """Samples of the window that takes out the smooth motion, for a polynomial of the third degree."""
    ripple_jump: float = 20.0
    """Steps beyond this many usual ones are resets and long gaps: counts on either side share no phase."""
    bins_per_cycle: float = 16.0
    """Bins smear a line by at most 0.7 % of its power."""
    oversampled: int = 8
    """Frequencies per width of a line: between two of them 1.3 % of its power is lost at most."""
    even_count: float = 0.15
    """Weight of an even number of counts that no workshop lists, ..."""
    odd_count: float = 0.07
    """... and of an odd one. Assumed."""
    max_ring_teeth: float = 300.0
    """More counts than this come from an encoder, not from teeth, and are reported as a number, not to the
    count."""
    grid_per_line: float = 8.0
    """Trial numbers per width of a line, for encoders."""
    line_nats: float = 10.0
    """Evidence from which a line of an encoder is one: e^-10 times the thousand trials is 1 in 20."""
    max_trials: int = 4000
    """Trial numbers at most, of a tyre's size and of all tyres each."""
    max_probability: float = 0.999
    """Largest probability that is reported, whatever the numbers: the model itself may be wrong."""


TOOTH_COUNTS = ToothCountSettings()
