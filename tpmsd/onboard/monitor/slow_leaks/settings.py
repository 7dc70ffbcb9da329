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
    min_s: float = 240.0
    """... and for the least that is one."""
    sample_s: float = 20.0
    """Between two samples, as in the baseline."""
    new_drive_s: float = 1800.0
    """A standstill from which the next reading is another drive's."""
    standstill_mps: float = 0.5
    """Below, the car stands."""
    max_std_m: float = 4e-4
    """A difference known less well says nothing of a leak that costs 0.14 mm a week."""
    earliest_s: float = 1.5e9
    """2017: a host's clock before has not been set, and has no dates."""
    max_sets: int = 9
    """Sets of tyres with a history: all that `tyre_sets` keeps, and the present one."""
    max_readings: int = 144
    """Drives that are kept for a new start: two months with two and a half a day."""
    oldest_d: float = 120.0
    """Readings further back say nothing of a leak that is not 20 % low yet at 1 % per week."""
    longest_gap_d: float = 45.0
    """After so long without a drive, or a clock that steps by so much, the readings before are forgotten."""
    stepped_back_d: float = 2.0
    """A clock that is behind the last reading by less is waited for."""
    max_difference_m: float = 0.05
    """A saved difference of radii beyond is none."""


@dataclass(frozen=True, slots=True)
class TrendSettings:
    """Settings of the differences of radii over weeks: per cent of pressure, and per week."""

    noise_floor: tuple[float, float, float] = (1.0, 1.0, 2.0)
    """Standard deviation of a drive's contrasts (front and rear left-right, front-rear) beyond what their
    estimates state, before it is learned: load, sun, camber; people and luggage behind; 1 % is 0.07 mm."""
    noise_shape: float = 1.5
    """Half the number of readings that this is worth: cars differ by factors."""
    max_noise_shape: float = 100.0
    """Half the number of readings remembered: a season; winter roads are another matter."""
    outlier_share: float = 0.06
    outlier_variance: float = 12.0
    """One reading in sixteen scatters by 3.5 times as much: errors have heavy tails."""
    first_base_std: float = 10.0
    """Standard deviation of one tyre's own radius at first: 0.7 mm."""
    base_walk: float = 0.035
    """Random walk of one tyre's own radius per square root of a day: 0.3 % in a quarter."""
    drift_stds: tuple[tuple[float, float, float], ...] = ((0.3, 0.3, 0.6), (1.2, 1.2, 1.2))
    """Standard deviations of fluctuations of each contrast over weeks (tyres answer to warmth
    unequally, by a tenth; radius drift of 0.03 mm): white noise of so many days would be a trend."""
    drift_d: float = 10.0
    """Its time constant: a spell of weather lasts 4 days, radius drift up to a month."""
    diffusion: tuple[float, float] = (0.45, 0.18)
    """Loss of a healthy tyre, mean and standard deviation over tyres: 1 to 3 % per month; and wear that is
    unequal by a tenth.
    """
    rate_walk: float = 0.007
    """Random walk of one tyre's rate per square root of a day: 0.07 % in a quarter."""
    wear_std: float = 0.25
    """A driven axle wears out twice as fast: 0.5 mm in 20,000 km more, at 400 km a week."""
    refill_every_d: float = 85.0
    refill_std: float = 2.0
    """Air is put in every one to five months; a gauge is off by 2 % from wheel to wheel."""
    refill_shares: tuple[float, ...] = (0.7, 0.1, 0.1, 0.025, 0.025, 0.025, 0.025)
    """Fractions of visits to the pump that fill all four tyres, the front or rear axle, one tyre
    (`WHEEL_SETS`).
    """
    change_every_d: float = 600.0
    change_std: float = 8.5
    """Wheels are changed or rotated, each tyre by 0.6 mm of radius; twice a year, most with a reset."""
    change_shares: tuple[float, ...] = (0.8, 0.05, 0.05, 0.025, 0.025, 0.025, 0.025)
    """Fractions of changes: all four wheels (seasonal tyres, rotation), an axle, one wheel."""
    step_at_reset: tuple[float, float] = (0.35, 0.25)
    """Probabilities of a refill and of changed wheels where the driver asked for a reset, ..."""
    step_after_gap: tuple[float, float] = (0.1, 0.05)
    gap_d: float = 6.0
    """... and at least, after so long without a drive."""
    leak_every_d: float = 8000.0
    """A leak per tyre in so many days, ..."""
    leak_rates: tuple[tuple[float, float, float], ...] = (
        *((1.4, 0.35, 0.3), (2.3, 0.6, 0.3), (3.9, 1.0, 0.25), (6.5, 1.8, 0.15)),
    )
    """... with these rates: mean, standard deviation and share of leaks; faster ones are a `deflation`."""
    onsets_from: int = 12
    """Likeliest hypotheses without a leak in which one may begin."""
    kept: int = 40
    """Hypotheses without a leak, and with one in each tyre."""
    min_rate: float = 1.0
    """A tyre at this rate is 20 % low after 20 weeks."""
    raise_probability: float = 0.95
    """Probability of a leak of `min_rate` and more from which it is noticed (bench)."""
    min_days: int = 7
    """Days with readings since it began, ..."""
    min_span_d: float = 14.0
    """... and the time since: shorter trends are load, weather, or chance."""
    min_lost_percent: float = 6.0
    """Per cent of pressure since it began: two standard deviations of what fillings (`refill_std`) leave
    between two tyres. Less may be a filling that was not known of, and passes by itself."""
    clear_days: int = 28
    """Readings from which it is decided whether a leak goes on: a tyre leaked until it was mended."""
    clear_gain: float = 3.0
    """Nats by which no leak must explain these readings better than the leak that was noticed."""
    softness_std: float = 0.15
    """Standard deviation for a tyre whose size is known: radius per pressure, relative
    (docs/explanation/alarms.md).
    """
    strata: int = 5  # quantiles per unknown from which the date is computed
    low_percent: float = 20.0
    """Loss of pressure that is low by UN R141 (assumed: its text was not at hand); `low_on` says when."""
