"""Every tunable number of the estimators, with its unit and where it comes from.

In: nothing. Out: `SETTINGS`, `AGREEMENT`, `PATH_LENGTH`. What the operator may set is in
`config.model.FilterConfig`. `bench` in a reason means the estimator benchmark
(`bench/results/estimators.md`): development seeds, both receivers.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class EstimatorSettings:
    """Constants of gates, beliefs and their pieces."""

    # -- finding, carrying on and losing the pose (`radius_filter`, `pose_start`) --

    extrapolation_limit_s: float = 3.0
    """Without rear rotation the pose is carried on for this long; a bend begins and ends within it."""
    steady_s: float = 0.5
    """Smoothing of the yaw rate that the pose is carried on with, s. At 10 Hz one count of 48 is 0.3 rad/s:
    that of a single tick, held for half a second, would turn the car by 0.15 rad."""
    extrapolation_yaw_std: float = 0.1
    """Heading noise of the extrapolation, rad per sqrt(s): a bend that begins or ends, what smoothing
    leaves."""
    extrapolation_speed_std_mps: float = 1.0
    """Speed noise of the extrapolation, m/s: gentle braking over a second."""
    extrapolation_speed_share: float = 0.1
    """Fraction of the speed."""
    moving_mps: float = 0.5
    """Below this a fix is no measurement: at a standstill correlated fixes would only sharpen a wrong
    position."""
    course_speed_mps: float = 3.0
    """Above this the receiver's course is a measurement (0.06 m/s of Doppler noise: 1.2 degrees)."""
    start_speed_mps: float = 4.0
    """Above this the receiver's course or a chord starts a heading: slower cars may be reversing, and their
    heading is then the other way round."""
    reverse_course_mps: float = 0.8
    """From this speed on the receiver's course tells forward from backward (0.1 m/s of noise: 7 degrees)."""
    reverse_within_rad: float = 0.8
    """Angle about the opposite direction: no car slips sideways by so much at this speed."""
    reverse_after_s: float = 0.35
    """Between two courses that say so: one may be the echo of a fix before."""
    reverse_rest_s: float = 0.5
    """Standing still for this long opens the direction: gears take as long, counts at a crawl less."""
    chord_in_std: float = 8.0
    """A chord between two fixes tells a heading if it is this many standard deviations long (7 degrees)."""
    chord_min_m: float = 6.0
    chord_max_s: float = 20.0
    """Over a longer time the road bends."""
    start_heading_std_rad: tuple[float, float] = (0.05, 0.2)
    """Standard deviation of a heading by course: a + b / speed (m/s)."""
    chord_bend_rad: float = 0.15
    """Added to that of a heading by chord: it is the mean heading of the way, and a bend leaves an error."""
    chord_noise_m: tuple[float, float] = (0.1, 0.33)
    """Noise of a short chord: a + b times the stated errors; the correlated part of the errors cancels."""

    # -- which fixes are used (`fix_gate`) --

    refuse_distance: float = 6.0
    """Fixes further off than this many standard deviations (plus the slack) are rejected."""
    refuse_slack_m: float = 5.0
    """Multipath of this size occurs without being stated."""
    lost_after_s: float = 8.0
    """Fixes rejected for this long: it is the pose that is wrong. Reflections last for seconds."""
    fix_interval_s: float = 0.45
    """The Gaussian-sum filter uses positions and courses at most this often: between, their errors are the
    same."""
    igg3_zones: tuple[float, float] = (2.5, 5.0)
    """Zones of the IGG-III weights, standard deviations [Liu 2022, eq. 19]."""
    igg3_floor: float = 1e-6
    """Least weight, so that a division stays finite."""

    # -- positions that slide (`position_accuracy`) --

    slide_step_s: float = 0.9
    """Least time between two positions whose distance is a step of the way: an arc."""
    slide_window_s: float = 4.5
    """Time over which way and speeds are compared: long against white noise, short against `bias_tau_s`."""
    slide_max_turn_rad: float = 1.0
    """Largest turn of a step: beyond, its direction is noise and it is no arc."""
    slide_jump_m: float = 1.0
    """A step of the way that differs from the speeds by more is a jump and no slide ..."""
    slide_jump_share: float = 0.1
    """... and by more than this share of it, as of `PathLengthSettings`."""
    slide_lag_s: float = 0.1
    """Standard deviation of the time between the epochs of a position and of its speed, s (recordings: 0.06
    s; twice the prior of the effect)."""
    slide_share: float = 0.003
    """Standard deviation of the scale of a way against speeds: rounding to 0.1 knots, bends between fixes."""
    slide_tolerated: float = 3.0
    """The slow error may be so many times the stated one: makers state theirs differently, as of
    `speed_accuracy.TOLERATED`."""
    slide_stds: float = 3.0
    """The receiver is trusted up to a difference of so many standard deviations."""
    slide_slowest_mps: float = 3.0
    """Below, noise of positions lengthens the way between them, as of `PathLengthSettings`."""

    # -- which ticks are informative (`motion_gate`, `gyro_check`) --

    gate_smoothing_s: float = 0.5
    """Smoothing of speed and yaw rate for accelerations to rise out of the quantisation."""
    course_rate_fresh_s: float = 3.0
    """A yaw rate from the receiver's courses is used for this long."""
    course_rate_chord_m: float = 8.0
    course_rate_span_s: float = 0.9
    """Least time between two courses whose difference is a yaw rate."""
    gyro_span_s: float = 30.0
    """Time between two courses from which the gyro's bias is taken: errors of courses last for a second."""
    max_curvature_per_m: float = 0.03
    """Tighter bends are not informative: errors of track and side slip grow with curvature (5 cm of track at
    33 m: 0.5 mm)."""
    gyro_memory_s: float = 300.0
    """Memory of the regression that checks the gyro."""
    gyro_slope_range: tuple[float, float] = (0.7, 1.4)
    """Slopes of wheels against gyro that no wrong unit or sign has."""
    gyro_excitation: float = 0.02**2 * 30.0
    """Variance of yaw rate times driving time before the gyro is judged, (rad/s)2 s: 30 s of gentle bends."""

    # -- sampled and Gaussian beliefs of [Lundquist 2013] --

    particles: int = 500
    """Number where neither configuration nor row says: half of what AUG-PF needs in the paper's Fig. 9."""
    position_floor_m: float = 0.3
    """Least position error: below it a bootstrap proposal would starve; it covers what the clocks leave."""
    distance_floor_m: float = 0.1
    """Least error of a block's Doppler way, for the same reason, ..."""
    turn_floor_rad: float = 0.01
    """... of its turn by the gyro, ..."""
    course_floor_sampled_rad: float = 0.02
    """... and of a course: as much as a tick's noise turns a particle."""
    position_dof: float = 4.0
    """Degrees of freedom of positions' Student-t errors: multipath has heavy tails."""
    resample_below: float = 0.5
    """Resampling where N_eff <= this share of N (eta of Table I, line 17)."""
    radius_prior: float = 0.01
    """Prior standard deviation of a radius, relative: tread wear, pressure and a guessed nominal."""
    noise_m: float = 0.003
    """Prior standard deviation of one tick's radius error: about one cog of 48 at 20 m/s and 10 Hz."""
    noise_floor_m: float = 0.0005
    """Floor of the same, so that a bus with fine speeds does not freeze the filter."""
    noise_ceiling_m: float = 0.02
    """Ceiling of the same in AUG-PF, whose variance walks freely while fixes say little of it."""
    niw_gamma: float = 0.2
    """Prior gamma. The prior spread of a radius is in the particles' means: a wide gamma would make the first
    ticks' noise as large as the prior and lose the heading."""
    niw_nu: float = 5.0
    """Prior nu: the least for which the variance of Sigma's mean exists at d = 2."""
    change_rate_per_s: float = 0.003
    """Rate at which a particle assumes that a radius has just changed (bench: slow puncture)."""
    change_std: float = 0.01
    """Size of such a change, relative to the radius: twice a loss of 20 % of the pressure."""
    change_heading_rad: float = 0.03
    """Heading error that the change has caused before it was assumed."""
    changes_judged_s: float = 2.0
    """Changes are assumed while the last fix is no older: later ones would only spread the radii."""
    walk_particles_m: float = 0.06e-3
    """Random walk of AUG-PF's radii, m per sqrt(s): particles need a long one to explore (bench: tuning)."""
    walk_gaussian_m: float = 0.02e-3
    """Random walk of the radii of AUG-EKF and AUG-UKF, m per sqrt(s) (bench: tuning)."""
    sigma_step: float = 0.05
    """Standard deviation of a step of Sigma, relative [Lundquist 2013, eqs 28c, 28d]."""
    sigma_first_m: float = 0.001
    """Square root of AUG-KF's first and only Sigma: a counter's reading error does not add up (bench)."""
    sigma_std_limit: float = 0.3
    """The variance of Sigma in AUG-KF is held at this share of its square: fixes say nothing of it."""
    walk_yaw_radps2: float = 0.25
    """Random walk of MPF-MN's yaw rate over a tick, per second [Lundquist 2013, eq. 31c]."""
    walk_speed_mps2: float = 2.0
    """Random walk of its speed: brisk braking."""
    path_quantum_m: float = 0.02
    """Least error of a wheel's path in a tick of MPF-MN: half a cog."""
    start_motion: tuple[float, float] = (0.05, 0.5)
    """Spread of MPF-MN's yaw rate (rad/s) and speed (m/s) about the wheels' where it begins."""
    front_prior: float = 0.01
    """Prior spread of a front radius against the rear pair's, relative."""
    front_smoothing_s: float = 0.5
    """Smoothing of the turn where a front hub's lateral path is formed: it enters squared."""

    # -- the Gaussian-sum filter: hypotheses (`jump_hypotheses`) --

    hypotheses: int = 40
    """Jump hypotheses kept where the configuration says nothing (bench: 20 lose time, 80 gain none)."""
    jump_rate_per_s: float = 1.0 / 3600.0
    """Prior rate of sudden changes of one wheel's radius."""
    jump_std: float = 0.008
    """Size of a jump, relative to the radius: a loss of 20 to 40 % of the pressure."""
    jump_heading_rad: float = 0.05
    """Heading error that a jump may have caused before it was assumed."""
    drift_levels: tuple[tuple[float, float], ...] = (
        *((1.0, 0.1), (0.15, 0.3), (0.04, 0.3), (0.01, 0.28), (4.0, 0.005)),
    )
    """Process-noise levels of all wheels relative to the drifts below, and their prior probabilities (bench:
    drift-levels). The first is that of a filter with few hypotheses."""
    drift_alone: tuple[float, float, float] = (4.0, 0.04, 0.0035)
    """Level of one wheel of four whose radius drifts alone, that of the others, and the prior probability of
    each such kind of hypothesis (bench: drift-levels, lively drives). A rear pair tells no wheel from the
    other: there one that drifts alone is all that drift."""
    level_floor: float = 0.003
    """Least weight of each level, relative to the best hypothesis."""
    recent_change_s: float = 10.0
    """Time of driving; what is stated of a radius leaves out changes within so much driving, or all else:
    blocks judge a change within two to five seconds (bench: 2 to 60 s state the same).
    """

    # -- the particles of MPF-PN (`particle_bank`) --

    marginal_particles: int = 200
    """Number where the configuration gives none."""
    noise_log_std: float = 0.7
    """Standard deviation of the log of the variance of way and heading noise: crown, bank and roughness of
    roads differ by a factor of two."""
    level_log_mean: float = -2.8
    """Log of the usual noise level of the radii's drift, in the middle of `drift_levels`, ..."""
    level_log_std: float = 1.6
    """... and its standard deviation: from 0.01 to 1 within two of them."""
    level_contrast_std: float = 0.7
    """Standard deviation of one wheel's log level against that: a factor of two."""
    level_tau_s: float = 600.0
    """Time in which a noise level is forgotten: roads and loads last for minutes."""
    level_step_s: float = 10.0
    """Its steps: small against that, and rare enough to cost nothing."""
    proposed_share: float = 0.04
    """Share of the particles that assume a change of a radius, per second and over all wheels: two of each
    wheel with 200 particles, ..."""
    reserved_share: float = 0.25
    """... which have places for the children of six seconds, in which a change shows."""
    shrinkage_kernel: float = 0.3
    """Step h by which copies are moved apart, in standard deviations of theta (Liu and West 2001: a discount
    of 0.95 is 0.31)."""
    lineage_s: float = 60.0
    """Over this time at least, and twice as long at most, ancestors of the particles are counted."""

    # -- its state and process (`error_state`) --

    drift_own_m: float = 0.010e-3
    """Random walk of one wheel's radius, m per sqrt(s): load, temperature, what the model leaves out."""
    drift_axle_m: float = 0.020e-3
    """Random walk of front against rear: slip of the driven axle, load."""
    drift_common_m: float = 0.040e-3
    """Random walk of all wheels together: centrifugal growth, warm-up."""
    calm_common: float = 0.5
    """Least share of `drift_common_m` that a calm level has."""
    turn_noise: float = 0.0004
    """Heading noise, rad per sqrt(m) of way: side slip, road crown, roughness."""
    turn_relative: float = 0.02
    """Heading noise relative to the turn of a tick."""
    path_noise: float = 0.003
    """Way noise, m per sqrt(m)."""
    rough_path: float = 0.015
    """Relative way noise in ticks that are not informative: slip."""
    rough_turn: float = 0.004
    """Relative turn noise in such ticks, by way over track."""
    bias_tau_s: float = 40.0
    """Correlation time of the receiver's slow position error (20 to 100 s in the recordings)."""
    position_std_m: float = 1.5
    """Position error before the receiver has stated one."""
    latency_drift: float = 0.001
    """s per sqrt(s): what the tracking of the clocks leaves."""
    min_load_factor: float = 0.5
    """Least ratio of the wheels' turn over the car's, which load transfer makes larger: less than one is
    unphysical, at zero a turn would have no end.
    """
    gyro_drift: float = 5e-6
    """rad/s per sqrt(s): 0.3 mrad/s in an hour, as production gyros drift with temperature."""
    common_prior: float = 0.75
    """Share of the radii's prior variance that all wheels have alike: a guessed nominal is wrong for all."""

    # -- its measurements (`measurements`, `odometry_block`, `batched_kalman`) --

    white_position_m: float = 0.25
    """The part of a position error that is new with every fix."""
    resolution_m: float = 0.02
    """Resolution of a position in a sentence."""
    doppler_mps: float = 0.06
    """Error of a Doppler speed, m/s ..."""
    doppler_tau_s: float = 1.0
    """... and its correlation time."""
    timing_s: float = 0.03
    """Jitter of time stamps, which turns speed, acceleration and yaw rate into errors."""
    course_floor_rad: float = 0.004
    """Side slip of the rear axle that no state holds."""
    gyro_noise_radps: float = 0.002
    """White part of a yaw rate over one second, and what the road's bank and steering add."""
    gyro_relative: float = 0.02
    """Fraction of the turn: side slip makes the wheels' turn and the body's differ in the way into a bend."""
    roughness: float = 2.0e-4
    """Front against rear over one block, relative to the way at 20 m; grows with the way's square root."""
    slow_yaw_s: float = 3.0
    """Smoothing of the wheels' yaw rate where it stands in for a gyro."""
    block_min_s: float = 0.95
    """A block of odometry is at least this long: quantisation is small in it ..."""
    block_max_s: float = 2.5
    """... and at most this long."""
    innovation_dof: float = 5.0
    """Degrees of freedom of an innovation's Student-t log-likelihood."""
    robust_from: float = 2.5
    """Innovations beyond this many standard deviations lose influence, with the square."""


SETTINGS = EstimatorSettings()
"""The ones in use."""


@dataclass(frozen=True, slots=True)
class AgreementSettings:
    """When wheels and receiver report the same drive (`agreement`)."""

    window_s: float = 10.0
    """Length of the window over which fixes that are off are counted, ..."""
    min_fixes: int = 4
    """... which has to hold so many, ..."""
    min_span_s: float = 3.0
    """... so far apart."""
    off_share: float = 0.5
    """Share of the window's fixes that are off, from which it is a disagreement, ..."""
    fair_share: float = 0.1
    """... and up to which it is agreement again."""
    speed_noise_mps: float = 0.35
    """Doppler 0.1 m/s, counts over half a second 0.1 m/s: three standard deviations."""
    speed_share: float = 0.01
    """Fraction of the speed: by how much all four radii may differ from their estimates."""
    lag_s: float = 0.6
    """Time by which a receiver's speed may be late, of the present acceleration."""
    smoothing_s: float = 0.5
    """Time constant of the wheels' speeds and of their acceleration: a tick of 0.1 s holds few counts."""
    moving_mps: float = 5.0
    """Below, counts and Doppler are too coarse to tell drives apart."""
    position_noise_mps: float = 2.5
    """Noise of a speed from positions a second or more apart, ..."""
    position_share: float = 0.1
    """... and its share of the speed."""
    recover_s: tuple[float, float] = (10.0, 40.0)
    """Shortest and longest time of agreement that ends a disagreement, ..."""
    recover_share: float = 0.5
    """... and its share of the time that the disagreement lasted."""
    faults_window_s: float = 30.0
    """Wheel readings that are faulty in 4 of the last 6 spans of five seconds are not a fault that passes:
    the time that is looked at, ..."""
    fault_bin_s: float = 5.0
    """... one span, ..."""
    fault_bins: int = 4
    """... and how many of them."""
    steady_s: float = 15.0
    """So long without a fault, and they are trusted again."""


AGREEMENT = AgreementSettings()
"""The ones in use."""


@dataclass(frozen=True, slots=True)
class PathLengthSettings:
    """When a receiver's positions and its speeds are of one drive (`path_length`)."""

    windows_s: tuple[float, ...] = (60.0, 180.0)
    """Two are watched side by side: the short one finds a large scale early, the long one a scale of 0.5 %
    from 45 km/h on. Honest drives of the recordings reach a tenth of the limit in either."""
    step_s: float = 0.9
    """Least time between the ends of a step of the path ..."""
    longest_step_s: float = 2.5
    """... and most: beyond, too little is known of the way between them."""
    min_m: float = 400.0
    """Path below which the drift of positions hides what is looked for."""
    position_slack_m: float = 4.0
    """Distance by which the ends of a path may drift against each other at least, ..."""
    position_slack_stds: float = 5.0
    """... and by so many standard deviations of a random walk whose rate is that of the steps in the window:
    the positions of some receivers drift by 3 m in a minute, those of others by centimetres."""
    share: float = 0.003
    """Fraction of the path: bends between fixes, rounding of speeds (0.1 knots is 0.05 m/s)."""
    lag_s: float = 1.0
    """Time by which speeds may be late against positions."""
    agree_share: float = 0.6
    """Fraction of the limit below which they agree again."""
    jump_m: float = 1.0
    """A step that is off by more is a position that jumped (another solution of the receiver), and no scale;
    ..."""
    jump_share: float = 0.1
    """... the same as a share of the step."""
    slowest_mps: float = 3.0
    """Below, positions drift as fast as the car moves."""
    max_turn_rad: float = 1.0
    """Largest turn of a step: beyond, it is no arc."""


PATH_LENGTH = PathLengthSettings()
"""The ones in use."""
