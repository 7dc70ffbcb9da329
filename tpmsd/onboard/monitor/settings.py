"""The settings of the monitor, with their units and reasons.

In: nothing. Out: `SETTINGS`, with one record per concern. What the operator may set is in
`config.model.MonitorConfig`. What decides on alarms was fixed on the benchmark's development seeds
(`python -m bench run alarms`), slow leaks on `python -m bench run slow-leak`. Relative values are relative to
the wheel's nominal radius.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from tpmsd.onboard.monitor.drive_settings import DriveEvidenceSettings, LevelSettings, SlipSlopeSettings
from tpmsd.onboard.monitor.evidence.nuisance import Nuisance
from tpmsd.onboard.monitor.health.encoder_settings import EncoderSettings
from tpmsd.onboard.monitor.slow_leaks.settings import ReadingSettings, TrendSettings


@dataclass(frozen=True, slots=True)
class ConditionSettings:
    """Settings of the driving conditions that radii depend on."""

    memory_s: tuple[float, float] = (4.0, 40.0)
    """Shortest and longest memory of an estimate that is used."""
    standstill_mps: float = 0.5
    """Below, the car stands."""
    parked_s: float = 90.0
    """From so long a standstill the car may have been loaded otherwise."""
    new_day_s: float = 3600.0
    """After so long tyres and air may have another temperature."""
    warming_s: tuple[float, float] = (400.0, 1000.0)
    """Two time constants of warm-up by driving; real ones lie between (`thermal_growth`: ten minutes, give
    or take)."""
    cooling_s: float = 1800.0
    """Time constant of cooling down at a standstill."""
    max_speed2: float = 1e5
    """(m/s)^2; no car is that fast."""


@dataclass(frozen=True, slots=True)
class ReferenceSettings:
    """The regression of radii on conditions; priors that it shares with effects are in `physics.priors`."""

    knots_mps: tuple[float, ...] = (8.0, 16.0, 24.0, 32.0, 40.0)
    """Centres of the speed ranges that are learned each for itself: 30 km/h apart, from town to motorway."""
    per_speed2: float = 1000.0
    """Unit of speed squared, (m/s)^2: 32 m/s."""
    own_std: float = 0.01
    """A guessed nominal radius: 1 % by make, tread and pressure."""
    growth_own_std: float = 5e-4
    """Growth at 32 m/s between wheels of different load, tread and make."""
    speed_std: float = 1.5e-4
    """Standard deviation of what else all wheels do in each range of speed: 0.05 mm."""
    warm_axle_std: float = 2e-4
    """Front against rear when warm: the engine's heat, brakes; 0.06 mm."""
    hill_free_std: float = 3e-4
    """Per m/s2 of slope, of an axle that is not driven: load."""
    load_std: tuple[float, float] = (1.5e-4, 4e-4)
    """Front and rear: 0.13 mm are 250 N on each rear tyre; a full car is four times that."""
    day_std: float = 3e-4
    """0.1 mm: 3.5 K."""
    drift_std: float = 2e-4
    drift_own_std: float = 2e-4
    """Standard deviation of fluctuations within a drive, of all wheels and of one: 0.06 mm, as the recordings
    show.
    """
    drift_time_constant_s: float = 900.0
    """Time constant of fluctuations within a drive."""
    far_stds: float = 10.0
    """Prior standard deviations by which a saved parameter may be off: 10 % of a radius."""
    wider: float = 1.5
    """A saved standard deviation over the prior's: priors of earlier versions were as wide on large tyres."""
    max_samples: int = 1_000_000
    """A saved number of samples beyond is none: 230 days of driving."""


@dataclass(frozen=True, slots=True)
class BaselineSettings:
    """Settings of what is learned of the car, and when."""

    sample_every_s: float = 20.0
    """Between two samples: the estimate's memory is 4 to 40 s."""
    range_samples: int = 40
    """After which a range of speed is frozen: a quarter of an hour in it."""
    drive_samples: int = 8
    """In which load and day are learned after a standstill: three minutes."""
    max_contrast_std: float = 0.0008
    """Learning goes on until the contrast between the wheels is known this well, relative."""
    fit_probability: float = 0.999
    """A sample that fits worse than this quantile of chi-square is not learned."""
    recent_samples: int = 9
    """Samples that are held against the baseline together: three minutes."""
    settled_samples: int = 45
    """From so many (15 min of driving) on a drive is held against what was known before it, ..."""
    next_drive_samples: int = 20
    """... and on the next drive from so many."""
    doubt_s: float = 180.0
    """Time constant of the share of driving during which something was suspected."""
    unsettled_share: float = 0.5
    """Relative uncertainty of the growth that the estimate's memory has yet to follow."""
    unsettled_speed2: float = 150.0
    """(m/s)^2; while speed changes faster, nothing is learned."""
    longest_s: float = 1e9
    """Thirty years of driving: a saved time beyond is none."""
    steep: Nuisance = Nuisance(common=2e-3, axle=3e-3, side=0.0, own=2e-4)
    """Per m/s2 of slope: heights are known late, and slip is not quite in proportion to force."""


@dataclass(frozen=True, slots=True)
class JudgeSettings:
    """Losses that are compared, their prior probabilities, and what is nuisance."""

    losses: tuple[float, float, int] = (0.0008, 0.05, 24)
    """Least and greatest relative loss considered and their number, in equal ratios: 0.46 % is a 20 % loss
    of pressure, 5 % a flat tyre."""
    named_causes: int = 3
    """Causes that a question names, the likeliest first: what a reader weighs at a glance."""
    all_hold_s: float = 180.0
    """An alarm of all wheels rests on the receiver's speed alone, which is held against its positions over so
    long (`gates.path_length`): a receiver whose speed drifts is a malfunction by then."""
    losses_per_km: tuple[float, float, float, float] = (4.5e-6, 1.4e-6, 4.5e-7, 4.5e-6)
    """Rate at which each subset of one to four tyres loses air, per km: one tyre in 220,000 km, two or three
    at once more rarely, all four by diffusion and neglect as often as one (docs/explanation/alarms.md has the
    sources).
    """
    unseen_km: float = 220.0
    """Over which a loss may have gone unseen, in a week of 12,000 km a year: a prior of 1 in 1,000."""
    unseen_all_km: float = 1000.0
    """Distance over which a loss of all four alike stays unseen, for only long drives at learned speeds show
    it: a month, and a prior of 1 in 220. Without a monitor 3 % of passenger cars and 6 % of light trucks are
    driven so [NHTSA 2001].
    """
    prior_larger: float = 1e-4
    """Prior probability of each wheel that it is larger than was learned: a new tyre without a reset,
    as rare as three tyres that lose air at once.
    Of a pair alone the data do not identify the wheel that has changed: there it is the one that lost."""
    prior_resized: float = 1e-3
    """Prior probability of each axle and all wheels that they are larger than was learned, and of wheels that
    were changed front to rear: chains, other tyres, a receiver that scales; a few drives in a thousand
    (assumed)."""
    resized: tuple[float, float] = (0.02, 0.006)
    """Relative difference of a wheel of another size, mean and standard deviation: a temporary spare 1 to 3
    %, chains 2 to 3 %.
    """
    max_relative_growth: float = 0.05
    """A wheel that seems larger than was learned by more, relative, has an estimate that is lost: snow chains
    add 2 to 3 %, no tyre more."""
    nuisance: Nuisance = Nuisance(common=3e-4, axle=4e-4, side=3e-4, own=3e-4)
    """Fluctuations beyond what the baseline explains: wind, camber, ruts, load in bends."""
    nuisance_s: float = 30.0
    """Correlation time of what of it acts by side and by wheel. Left against right strays by 0.28 mm on a
    recorded motorway (van-motorway-a), as `nuisance` and the baseline have it, for some 30 s at a time."""
    other_tyres: Nuisance = Nuisance(common=0.02, axle=0.01, side=0.0, own=5e-4)
    """Differences of tyres of another set: by size and wear of all and of an axle, and little among
    themselves.
    """
    full_samples: int = 7
    """Samples of the mean from which it judges several tyres: two minutes of driving."""
    undecided: float = 0.5
    """A probability that neither raises nor clears."""
    suspicious: float = 0.5
    """Log-likelihood ratio of a loss to none from which nothing is learned: what might be a fault must not
    become normal, however improbable faults are beforehand."""
    suspicious_at_first: float = 3.0
    """Such a ratio while the car is learned for the first time. A baseline of a few samples is off by half
    a millimetre; held to the former limit it would take its own error for a fault and never learn better.
    """
    every_s: float = 1.0
    """Between two judgements."""
    detectable_stds: float = 1.28
    """Standard deviations by which the evidence of a loss that `status` calls seen may fall short of what is
    to be expected: one in ten does by more."""
    detectable_losses: int = 200
    """Losses that are tried for the smallest one that would be seen, in equal steps up to the largest."""
    seen_share: float = 1.5
    """Standard deviation of a wheel against the others, relative to the threshold of a deflation, up to
    which a tyre that has lost 20 % (1.8 thresholds) is seen."""
    seen_fresh_s: float = 2.5
    """After the last judgement with such a standard deviation: two may fail."""

    @property
    def prior_by_size(self) -> tuple[float, ...]:
        """Prior probability of each subset of one to four wheels."""
        some = tuple(rate * self.unseen_km for rate in self.losses_per_km[:-1])
        return (*some, self.losses_per_km[-1] * self.unseen_all_km)


@dataclass(frozen=True, slots=True)
class FirstStartSettings:
    """Tyres that are soft before they were ever learned."""

    car_std: float = 0.01
    """A guessed nominal radius, relative."""
    axle_std: float = 0.005
    """Front and rear, each way: another size, load or wear."""
    first_s: float = 600.0
    """Informative driving, from the first start on, in which tyres are held against the prior."""
    changed_share: float = 0.0023
    """Change since the baseline, relative, from which a difference may be younger than it: half of a loss
    of 20 % of the pressure."""
    within_std: tuple[tuple[float, float], ...] = ((0.95, 0.001), (0.05, 0.003))
    """Left against right of an axle: share of cars and standard deviation of the difference, for one set and
    for a mixed or unevenly worn one."""
    losses: tuple[float, float, int] = (0.0046, 0.05, 20)
    """Least and greatest relative loss and their number: from a loss of 20 % of the pressure to a flat
    tyre."""
    soft_prior: float = 0.01
    """Prior probability per wheel: every hundredth tyre on the road is soft by 20 % and more alone (3 % of
    cars have one tyre that is 25 % low: assumed).
    """
    larger_prior: float = 0.0005
    """A single larger tyre is a mixed one, and rare."""


@dataclass(frozen=True, slots=True)
class SignalSettings:
    """Inputs that fail."""

    gnss_fresh_s: float = 10.0
    """A fix that is older is missing."""
    moving_mps: float = 2.0
    """Estimated speed from which wheels that do not turn are silent."""
    driving_mps: float = 40.0 / 3.6
    """From here on UN R141 counts driving time (40 km/h; assumed: its text was not at hand)."""
    no_detection_s: float = 600.0
    """Driving to a malfunction: UN R141 (assumed: not at hand); FMVSS 138, 49 CFR 571.138, has twenty."""
    turning_rad: float = 0.1
    """Rotation in a tick from which a wheel turns."""
    bad_time_reset_s: float = 1.0
    """Time in good order after which the bad time counted so far is set to zero."""
    clear_share: float = 0.1
    """Good time after which a malfunction is cleared, as a share of the bad time that raises it, ..."""
    min_clear_s: float = 2.0
    """... and at least this."""
    at_once_s: float = 1e-9
    """Limit of what is a malfunction with the first tick of it."""
    fault_fresh_s: float = 2.5
    """A fault of an input that lasts is reported at least once a second."""
    disagree_mps: float = 3.0
    disagree_share: float = 0.2
    """Beyond both, speeds of wheels and receiver are of two cars; braking and lags are less."""
    agreed_s: float = 60.0
    """Driving in which wheels and receiver agreed, after which the bus has been decoded rightly: a wrong
    scale shows within the 10 s of `gates.agreement`."""
    speed_fresh_s: float = 2.0
    """After a fix, how long its speed is that of the car."""
    chord_s: float = 1.0
    """At least so long, at most twice, between positions that make a speed where the receiver has none."""
    car_late_s: float = 2.0
    car_scale_share: float = 0.08
    """A speed that the car states by OBD-II may be so late, and so far off: other tyre sizes, UN R39."""


@dataclass(frozen=True, slots=True)
class ConfigurationSettings:
    """The drive against the configuration (`configuration_watch`)."""

    look_s: float = 600.0
    """Driving during which the configuration is held against the drive."""
    slowest_mps: float = 5.0
    """Below, the receiver's course and speed are noise."""
    step_s: tuple[float, float] = (0.9, 2.5)
    """Between two fixes that make one interval."""
    min_turn_radps: float = 0.02
    """Below, a course is noise; at 20 m/s a bend of 1 km."""
    min_turns_rad2: float = 0.05
    """Sum of squared changes of course, each of at most a second: three bends of 90 degrees, ..."""
    min_intervals: int = 15
    """... and the number of intervals that turned."""
    min_correlation: float = 0.5
    """Correlation from which a sign is right and no longer looked at; below its negative it is wrong."""
    radius_share: float = 0.05
    """Relative: five standard deviations of a nominal radius (1 %, docs/explanation/alarms.md)."""
    radius_intervals: int = 120
    """Number of intervals of which the median is taken: two minutes, in which no bend or slope lasts."""


@dataclass(frozen=True, slots=True)
class TyreSetSettings:
    """Sets of tyres, and the resets that a driver may ask for."""

    max_sets: int = 8
    """Summer, winter, two drivers' spares: more is a mistake of who asks."""
    soft_probability: float = 0.9
    """Probability of a soft tyre from which a reset is refused."""
    max_reason_chars: int = 500
    """Characters of a saved reason."""
    allowance: float = 10.0
    """Resets are paid from this, ..."""
    cost_same: float = 3.0
    """... one to the same set costs so much, ..."""
    cost_other: float = 1.0
    """... one to another set so much, ..."""
    refill_per_s: float = 1.0 / 200.0
    """... and it fills up by one in 200 s: three at once, then one in ten minutes. A leak that is reset away
    every minute would else never be a change."""
    signal_steady_s: float = 5.0
    """The car's own number of the set counts after so long: signals pass through others while units start."""


@dataclass(frozen=True, slots=True)
class StatedStdSettings:
    """Standard deviations of radii in reports and alarms."""

    receiver_scale: float = 0.001
    """Standard deviation of a scale that a receiver has in speeds and positions alike: R * s of a radius R.
    Nothing in the car tells it from the common radius; it cancels in changes. Three of them are 0.3 %, which
    rounding to 0.1 knots does at 17 m/s, and by which `gates.path_length` lets positions and speeds
    differ."""
    unknown_level: float = 0.3
    """Standard deviation of what all radii have in common before the first fix, relative: any, for all that
    the wheels say of it; without a bound covariances would lose the differences in rounding."""


@dataclass(frozen=True, slots=True)
class MonitorSettings:
    """All of them, by concern."""

    conditions: ConditionSettings = ConditionSettings()
    reference: ReferenceSettings = ReferenceSettings()
    baseline: BaselineSettings = BaselineSettings()
    drive_evidence: DriveEvidenceSettings = field(default_factory=DriveEvidenceSettings)
    slip_slope: SlipSlopeSettings = field(default_factory=SlipSlopeSettings)
    level: LevelSettings = field(default_factory=LevelSettings)
    judge: JudgeSettings = JudgeSettings()
    stated: StatedStdSettings = StatedStdSettings()
    first_start: FirstStartSettings = FirstStartSettings()
    signals: SignalSettings = SignalSettings()
    configuration: ConfigurationSettings = ConfigurationSettings()
    encoders: EncoderSettings = field(default_factory=EncoderSettings)
    tyre_sets: TyreSetSettings = TyreSetSettings()
    readings: ReadingSettings = field(default_factory=ReadingSettings)
    trend: TrendSettings = field(default_factory=TrendSettings)


SETTINGS = MonitorSettings()
"""The ones in use; below, by concern."""
CONDITIONS = SETTINGS.conditions
REFERENCE = SETTINGS.reference
BASELINE = SETTINGS.baseline
DRIVE_EVIDENCE = SETTINGS.drive_evidence
SLIP_SLOPE = SETTINGS.slip_slope
LEVEL = SETTINGS.level
JUDGE = SETTINGS.judge
STATED = SETTINGS.stated
FIRST_START = SETTINGS.first_start
SIGNALS = SETTINGS.signals
CONFIGURATION = SETTINGS.configuration
ENCODERS = SETTINGS.encoders
TYRE_SETS = SETTINGS.tyre_sets
READINGS = SETTINGS.readings
TREND = SETTINGS.trend
