"""The settings of slow leaks (a part of `settings`), fixed on `python -m bench run slow-leak`.

In: nothing. Out: `ReadingSettings`, `TrendSettings`.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class ReadingSettings:
    """A drive's reading of left against right, and the history of such readings."""

    warm_s: float = 120.0
    """Informative driving before the first sample, ..."""
    full_s: float = 600.0
    """... for a full reading, ..."""
    least_s: float = 240.0
    """... and for the least that is one."""
    sample_s: float = 20.0
    """Between two samples, as in the baseline."""
    new_drive_s: float = 1800.0
    """A standstill from which the next reading is another drive's."""
    standing_mps: float = 0.5
    """Below, the car stands."""
    most_std_m: float = 4e-4
    """A difference known less well says nothing of a leak that costs 0.14 mm a week."""
    earliest_s: float = 1.5e9
    """2017: a host's clock before has not been set, and has no dates."""
    most_sets: int = 9
    """Sets of tyres with a history: all that `tyre_sets` keeps, and the present one."""
    most_days: int = 72
    """Days with readings that are kept for a new start."""
    oldest_d: float = 120.0
    """Readings further back say nothing of a leak that is not 20 % low yet at 1 % per week."""
    longest_gap_d: float = 45.0
    """After so long without a drive, or a clock that steps by so much, the readings before are forgotten."""
    stepped_back_d: float = 2.0
    """A clock that is behind the last reading by less is waited for."""
    most_difference_m: float = 0.05
    """A saved difference of radii beyond is none."""
    most_drives: int = 1000
    """On a day; a saved number beyond is none."""


@dataclass(frozen=True, slots=True)
class TrendSettings:
    """How the left-right difference of an axle moves over weeks: per cent of pressure, and per week."""

    scatters: tuple[float, ...] = (0.7, 1.5, 3.0)
    """Standard deviations of a day's reading beyond what its estimates state; 1 % is 0.07 mm of radius."""
    stated_shares: tuple[float, ...] = (0.5, 1.6)
    """Variances of the estimates relative to the stated one: stated too wide or too narrow, by the car."""
    outlier_share: float = 0.06
    outlier_variance: float = 12.0
    """One reading in sixteen scatters by 3.5 times as much: errors have heavy tails."""
    first_level_std: float = 15.0
    """Left against right at first: 1 mm."""
    level_walk: float = 0.05
    """Per square root of a day: 0.5 % in a quarter."""
    drift_stds: tuple[float, ...] = (0.3, 1.2)
    """Standard deviations of what comes and goes within weeks (tyres answer to warmth unequally, by a tenth;
    radius drift of 0.03 mm): white noise of so many days would be a trend."""
    drift_d: float = 10.0
    """Its time constant: a spell of weather lasts 4 days, radius drift up to a month."""
    healthy_rate_std: float = 0.25
    """Diffusion of 1 to 3 % per month, unequal by a third, and wear that is unequal by a tenth."""
    rate_walk: float = 0.01
    """Per square root of a day: 0.1 % in a quarter."""
    refill_every_d: float = 85.0
    refill_std: float = 2.8
    """Air is put in every one to five months; a gauge is off by 2 % from wheel to wheel."""
    change_every_d: float = 600.0
    change_std: float = 12.0
    """Wheels are changed or rotated, by 0.8 mm of radius; twice a year, most with a reset."""
    both_share: float = 0.8
    """Of changes without a word, that are of both axles: seasonal tyres, and rotation front to rear."""
    same_change_d: float = 5.0
    """Between the days on which readings of both axles place the same change."""
    step_at_reset: tuple[float, float] = (0.35, 0.25)
    """Probabilities of a refill and of changed wheels where the driver asked for a reset, ..."""
    step_after_gap: tuple[float, float] = (0.1, 0.05)
    gap_d: float = 6.0
    """... and at least, after so long without a drive."""
    leak_every_d: float = 4000.0
    """A leak per axle in so many days, ..."""
    leak_rates: tuple[tuple[float, float, float], ...] = (
        *((1.4, 0.35, 0.3), (2.3, 0.6, 0.3), (3.9, 1.0, 0.25), (6.5, 1.8, 0.15)),
    )
    """... with these rates: mean, standard deviation and share of leaks; faster ones are a `deflation`."""
    onsets_from: int = 12
    """Likeliest hypotheses without a leak in which one may begin."""
    kept: int = 60
    """Hypotheses without a leak, with one on the left, and with one on the right."""
    least_rate: float = 1.0
    """A tyre at this rate is 20 % low after 20 weeks."""
    raise_probability: float = 0.6
    """Of a leak of `least_rate` and more, from which it is noticed (bench)."""
    least_days: int = 7
    """Days with readings since it began, ..."""
    least_span_d: float = 14.0
    """... and the time since: shorter trends are load, weather, or chance."""
    clear_gain: float = 3.0
    """Nats by which no leak must explain the days since the notice better than the leak that was noticed."""
    diffusion: tuple[float, float] = (0.45, 0.15)
    """What the fellow loses: 1 to 3 % per month."""
    softness_std: float = 0.15
    """Of a tyre whose size is known: radius per pressure, relative (docs/explanation/alarms.md)."""
    strata: int = 5  # quantiles per unknown from which the date is computed
    low_percent: float = 20.0
    """Loss of pressure that is low by UN R141 (assumed: its text was not at hand); `low_on` says when."""
