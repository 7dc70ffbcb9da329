"""Constants of the discovery, each with its unit and where it comes from.

In: nothing. Out: `Settings`.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Settings:
    """Limits, priors and floors."""

    cell_s: float = 0.5
    """Length of the cells over which rates are averaged: two fixes of a 5 Hz receiver, and ten frames of a
    slow wheel message."""
    min_rate_hz: float = 4.0
    """Slower messages carry no wheel; temperatures and torques may be slower."""
    min_speed_mps: float = 2.0
    """Below this coarse counters and Doppler speeds say little."""
    speed_r2: float = 0.97
    """Share of the speed's variance that a wheel must explain; ice and gravel leave more than this."""
    max_lag_s: float = 2.0
    """Largest age of a receiver's fix against the bus that is looked for."""
    lag_gap_s: float = 0.03
    """Signals further apart in time are of different units: a wheel message comes every 10 to 40 ms."""
    same_scale: float = 0.03
    """Wheels of one car agree in counts per metre within this share: mixed tyres, 30 % of the pressure."""
    track_m: float = 1.54
    track_std_m: float = 0.09
    """Prior of the track over passenger cars and vans."""
    wheelbase_m: float = 2.68
    wheelbase_std_m: float = 0.25
    radius_m: float = 0.322
    radius_std_m: float = 0.025
    """Prior of the rolling radius where no tyre size is given."""
    tyre_radius_std: float = 0.010
    """Relative: rolling radius of a tyre of known size. Diameter over makes 0.6 % (ETRTO allows about 1 %),
    wear 0.5 % (0 to 6 mm), rolling share over constructions, load and pressure 0.6 %. Assumed."""
    rolling_share: float = 0.969
    """Rolling radius over the unloaded radius of the size (ETRTO: circumference at 60 km/h, 3.05 of the
    diameter for radial tyres, is 0.971 pi; at working load a little less)."""
    side_slip: float = 3e-3
    side_slip_std: float = 4e-3
    """Prior of the rear axle's side slip per lateral acceleration, rad s2/m: from 0, of a car that rolls, to
    9e-3 (650 kg on 1e5 N/rad make 6e-3; Gillespie 1992, ch. 6)."""
    ripple_window_s: float = 0.5
    """Length of the smooth motion against which a wheel's ripple is seen: a car's speed changes in tenths of
    seconds at most, a wheel at town speed turns several times."""
    ripple_least_hz: float = 4.0
    """Revolutions per second below which the ripple is as slow as the car's own changes of speed."""
    ripple_block_s: float = 120.0
    """Length of the stretches in which the ripple is coherent: with 48 counts, numbers 1/16 apart are told
    apart, and a counter that loses counts spoils one stretch alone."""
    ripple_least_rows: int = 200
    """Samples of a stretch; fewer show no line."""
    other_lines: float = 0.5
    """Share of the ripple's stretches that may hold another line at a candidate. Of 16 perfect rings at
    constant speeds none is called a wrong number above 0.95; with 0.1 it is two, and 15 without other
    lines."""
    encoder_jitter: float = 0.01
    """Largest step back of a counter at rest, as a share of the median step forward: a quadrature encoder
    counts the trembling of a standing car up and down (9 of 5,200 counts on a van with a running engine)."""
    backward_steps: float = 0.02
    """Share of larger steps back from which a field is no counter: frames out of order, resets."""
    glance_steps: int = 6_000
    """Steps of a field of raw frames, spread over the drive, in which it must count up to be looked at."""
    corrupt_steps: float = 4.0
    """Step, in 99th percentiles of the drive's steps, from which a count is not its neighbours': a car's
    greatest speed is twice to three times its usual one."""
    contrast_floor_m: float = 0.06
    """Least standard deviation of a wheel's lateral place, for what the model of a rolling car leaves out."""
    curvature_floor_m2: float = 0.35
    """The same for the front axle's longer way in a bend, in m2 (half the square of the wheelbase is 3.6)."""
    blocks_per_column: int = 3
    """With fewer blocks the coefficients' covariance is not known well enough to weigh a prior against it."""
    block_s: float = 10.0
    """Length of the blocks whose sums give standard errors: driving within one is one event."""
    named_platform: float = 6.0
    """Log of the odds, per wheel, that a signal with name and place of a known platform is that wheel."""
    platform_layout: float = 1.0
    """The same where the place agrees and not the name: a DBC may have been written by hand, and four wheels
    in other roles are then 1 in 50."""
    decided: float = 0.95
    """A role below this probability is listed as undecided."""
    right_radius_std: float = 0.006
    """Relative: how far a configured radius may be off in a file that is right."""
    right_speed_std: float = 0.012
    """The same for a maker's scale of wheel speeds."""
    wrong_scale_std: float = 0.06
    """Spread of the same where the number of teeth, or a unit, is wrong."""
    antenna_left_floor_m: float = 0.1
    """Standard deviation of a measured place beyond the regression's: the tape's, the phase centre's."""
    antenna_forward_floor_m: float = 0.15
    """The same along the car, where the middle of the rear axle is harder to find."""
    antenna_z: float = 3.7
    """Standard deviations from which a stated place is wrong: 1 in 4,600 right ones."""
    clocks_apart_s: float = 0.7
    """Clocks this far apart are no latency of a receiver, beyond the one that the file states."""
    clocks_apart_nats: float = 10.0
    """Log-likelihood gain by which another offset must fit better."""
    independent_s: float = 10.0
    """Driving that counts as one independent reading of the speed."""
    sensors_apart: float = 1.25
    """Factor by which a right gyro or accelerometer may be off: they err by some per cent, and accelerometers
    feel roll and slopes."""
    steering_apart: float = 2.5
    """The same for the steering wheel: the ratio varies over the angle, and an understeering car needs up to
    twice the angle."""
    unit_near: float = 0.25
    """Logarithm of a factor; a role's units differ by at least a third, so one this near is meant."""
    copy_share: float = 0.95
    """Of a message's payloads that another bus has, too, from which it is a copy: gateways lose frames."""
    compared_payloads: int = 2_000
    """Payloads of a message that are looked up for that, spread over the drive."""
    max_probability: float = 0.999
    """No more is claimed, whatever the numbers: the model itself may be wrong."""


SETTINGS = Settings()
