"""Constants of the discovery, each with its unit and where it comes from.

In: nothing. Out: `Settings`; those of the counts per revolution are `ToothCountSettings`.
"""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.offline.rings.settings import ToothCountSettings


@dataclass(frozen=True, slots=True)
class Settings(ToothCountSettings):
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
    """Prior of the wheelbase, likewise."""
    side_slip: float = 3e-3
    side_slip_std: float = 4e-3
    """Prior of the rear axle's side slip per lateral acceleration, rad s2/m: from 0, of a car that rolls, to
    9e-3 (650 kg on 1e5 N/rad make 6e-3; Gillespie 1992, ch. 6)."""
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
    """Least standard deviation of a wheel's lateral position, for what the model of a rolling car leaves
    out."""
    curvature_floor_m2: float = 0.35
    """Floor for the front axle's longer distance in a bend, in m2 (half the square of the wheelbase is
    3.6)."""
    blocks_per_column: int = 3
    """Blocks per column, at least: with fewer the coefficients' covariance is not known well enough to weigh
    a prior against it."""
    block_s: float = 10.0
    """Length of the blocks whose sums give standard errors: driving within one is one event."""
    named_platform: float = 6.0
    """Log of the odds, per wheel, that a signal with name and layout of a known platform is that wheel."""
    platform_layout: float = 1.0
    """Evidence of a layout whose position agrees and not the name, nats: a DBC may have been written by hand,
    and four wheels in other roles are then 1 in 50."""
    right_radius_std: float = 0.006
    """Relative: how far a configured radius may be off in a file that is right."""
    right_speed_std: float = 0.012
    """Standard deviation of a maker's scale of wheel speeds."""
    unit_fits: float = 0.05
    """Relative: four times that, within which a speed is in this unit, by a maker's own scale."""
    wrong_scale_std: float = 0.06
    """Relative spread of a scale where the number of teeth, or a unit, is wrong."""
    antenna_left_floor_m: float = 0.1
    """Standard deviation of a measured position beyond the regression's, m: the tape's, the phase
    centre's."""
    antenna_forward_floor_m: float = 0.15
    """Floor along the car, where the middle of the rear axle is harder to find, m."""
    antenna_z: float = 3.7
    """Standard deviations from which a stated position is wrong: 1 in 4,600 right ones."""
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
    """Factor for the steering wheel: the ratio varies over the angle, and an understeering car needs up to
    twice the angle."""
    unit_near: float = 0.25
    """Logarithm of a factor; a role's units differ by at least a third, so one this near is meant."""
    copy_share: float = 0.95
    """Share of a message's payloads that another bus has, too, from which it is a copy: gateways lose
    frames."""
    compared_payloads: int = 2_000
    """Payloads of a message that are looked up for that, spread over the drive."""

    # -- `assign` --

    max_in_cluster: int = 14
    """Signals of one speed that are tried as its wheels, those farthest out first: the number of ways to
    assign them grows with its fourth power."""
    lag_scale_s: float = 0.008
    """A copy of a wheel that comes this much later is that much less likely the wheel itself."""
    slip_similar_s2pm: float = 0.0006
    """Slip per acceleration of two wheels of one axle: an open differential gives both the same torque."""
    decoy_std_m: float = 0.5
    """Spread of lateral positions of speeds that are no wheel's, m."""

    # -- `clock_offset`, `course`, `discover` --

    offset_step_s: float = 1.0
    """Grid on which two recordings' speeds are compared to find the offset of their clocks."""
    min_overlap_steps: int = 120
    """Steps of that grid that both recordings must share at an offset, so that chance does not fit."""
    min_cells: int = 6
    """Cells of a stretch; its constant takes one of them."""
    min_drive_s: float = 30.0
    """Shorter drives hold too few cells to tell a wheel from what follows the speed by chance."""
    equal_r2: float = 5e-4
    """Readings of the same bits that follow the speed equally well differ by less."""
    unit_tolerance: float = 0.08
    """Makers scale wheel speeds by a radius of their own, some per cent off the true one."""

    # -- `geometry` --

    slip_floor_s2pm: float = 0.0007
    """Difference of the axles' slip that load transfer alone makes: 1e-4 s2 over 0.32 m, both axles."""
    antenna_widest_m: float = 2.0
    """Antennas are on the car; what is farther to the side, or as uncertain, is not reported, ..."""
    antenna_farthest_m: float = 8.0
    """... nor what is farther along it."""
    track_floor: float = 0.004
    """Relative: what steering geometry and unequal slip do to a track measured by the wheels."""

    # -- `other_roles` --

    smooth_cells: int = 5
    """Cells of the running mean of a signal, and of what is expected of it, before they are compared."""
    unit_nats: float = 3.0
    """Log-likelihood ratio of a signal whose unit is one of the role's."""
    steering_ratios: tuple[float, float] = (8.0, 30.0)
    """Least and greatest steering ratio of cars."""
    ambient_c: tuple[float, float] = (-45.0, 60.0)
    """Least and greatest temperature of the air on a road."""

    # -- `raw_fields` --

    flip_rise: float = 1.35
    """Flip rates of neighbouring bits within one number may rise by so much by chance, ..."""
    flip_noise: float = 0.004
    """... and by so much whatever their size."""
    flip_slow: float = 0.2
    """Bits that flip oftener are low ones, whose rates follow from the steps: they may rise (steps of
    2^k)."""
    flip_halving: float = 0.1
    """Lost frames shift the flip rates of an alive counter's bits by less than this share."""
    flip_sample: int = 400_000
    """Frames of a message whose bits are looked at: rates are known to a thousandth by then."""

    # -- `reference` --

    longest_gap_s: float = 2.5
    """Between two fixes; a receiver of 1 Hz may lose one."""
    offset_window_s: float = 60.0
    """Length of the pieces whose median gives the host's clock against UTC: it may drift by tenths of a
    second in a drive."""
    position_base_s: float = 0.8
    """Positions are differenced over at least this time."""

    # -- `series` --

    long_gap_periods: float = 5.0
    """Gap, in periods, beyond which the number of roll-overs is derived from the speed before and after."""
    min_reserved_value: int = 1023
    """Numbers of ten bits and more may be reserved, ..."""
    reserved_apart: float = 0.9
    """... and a speed does not jump by a tenth between two frames."""
    reached_steps: float = 2.0
    """Step, in 95th percentiles of a counter's steps forward, from which it did not come by counting: a frame
    lost, or the car faster than on most of the drive."""
    most_reserved: int = 8
    """Greatest numbers of a field that are looked at as reserved ones: J1939 has two, and a frame in which
    bits were flipped makes one of its own."""
    few_reserved: int = 3
    """Times that such a number comes from which it is reserved; flipped bits make another one each time."""
    few_wraps: int = 3
    """Roll-overs from which they tell the modulus; with fewer it is that of the field's width."""
    step_std: float = 0.7
    """Least standard deviation of a step against the mean of its neighbours, in counts: rounding of three."""


SETTINGS = Settings()
