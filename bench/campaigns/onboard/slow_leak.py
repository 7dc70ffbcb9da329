"""Notices of slow leaks over years of simulated cars: false ones on healthy tyres, delays to true ones.

    python -m bench run slow-leak [--json FILE] [--healthy 500] [--leaks 100] [--first 1] [--rates 1.5,2,4]

Each car of `bench/worlds/tyre_years.py` gives one reading per drive; the program's `LeakHistory` takes them
and looks for a trend after each. A healthy car-year counts as false if
there is any notice. A leak begins between the 60th and the 250th day on one wheel and is in time if its wheel
is noticed before 15 % of the pressure is lost since the beginning (refills counted as they come).
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from typing import Any

import numpy as np

from bench.statistics import percent, rate, share
from bench.worlds.tyre_years import Leak, Year, draw_year
from tpmsd.car.physics.tyre import radius_change_for_pressure_loss
from tpmsd.foundation.wheels import WHEELS
from tpmsd.onboard.monitor.slow_leaks.history import LeakHistory

METRES_PER_PERCENT = -radius_change_for_pressure_loss(0.1, 0.316) / 10.0
LATE_PERCENT = 15.0


@dataclass(frozen=True)
class Notice:
    """The first notice of a year."""

    drive: int
    wheel: int
    percent_per_week: float
    low_in_d: tuple[float, float, float]


def first_notice(year: Year) -> Notice | None:
    """Play a year drive by drive."""
    history = LeakHistory()
    for k, day in enumerate(year.day):
        if year.reset[k]:
            history.mark_step()
        fl, fr, rl, rr = year.radius_m[k]
        fl_var, fr_var, rl_var, rr_var = year.std_m[k] ** 2
        difference = np.array([fl - fr, rl - rr, (fl + fr - rl - rr) / 2.0])
        variance = np.array([fl_var + fr_var, rl_var + rr_var, (fl_var + fr_var + rl_var + rr_var) / 4.0])
        history.add(20_000.0 + day, difference, variance)
        trend = history.trend((METRES_PER_PERCENT,) * 3)
        if trend is not None and trend.noticeable():
            return Notice(k, trend.wheel, trend.rate, trend.low_in_d)
    return None


def healthy(first: int, cars: int) -> dict[str, Any]:
    """False notices on cars without a leak."""
    found, years = [], 0.0
    for seed in range(first, first + cars):
        year = draw_year(np.random.default_rng([1, seed]))
        years += 1.0
        notice = first_notice(year)
        if notice is not None:
            found.append({"seed": seed, "wheel": WHEELS[notice.wheel], "rate": notice.percent_per_week})
    return {"car_years": years, "false": rate(len(found), years, 100.0), "notices": found}


def leaking(first: int, cars: int, percent_per_week: float) -> dict[str, Any]:
    """Delays to the notice of a leak of this rate."""
    in_time = wrong = covered = 0
    delays, rates, missed = [], [], []
    for seed in range(first, first + cars):
        rng = np.random.default_rng([2, seed])
        leak = Leak(int(rng.integers(4)), float(rng.uniform(60.0, 250.0)), percent_per_week)
        year = draw_year(rng, leak.onset_d + 7.0 * 20.0 / percent_per_week + 1.0, leak)
        notice = first_notice(year)
        onset = int(np.searchsorted(year.day, leak.onset_d))
        if notice is not None and (notice.wheel != leak.wheel or notice.drive < onset):
            wrong += 1
            continue
        start = year.lost[onset - 1, leak.wheel]
        lost = 100.0 * (np.maximum.accumulate(year.lost[onset:, leak.wheel]) - start)
        late = onset + int(np.searchsorted(lost, LATE_PERCENT))
        if notice is None or notice.drive >= late:
            missed.append(seed)
        if notice is not None:
            in_time += notice.drive < late
            at_d = float(year.day[notice.drive])
            delays.append(at_d - leak.onset_d)
            rates.append(notice.percent_per_week)
            covered += notice.low_in_d[0] <= _low_in_d(year, leak, onset, notice) <= notice.low_in_d[2]
    return {
        "percent_per_week": percent_per_week,
        "in_time": share(in_time, cars),
        "wrong_or_early": share(wrong, cars),
        "delay_d": [float(q) for q in np.quantile(delays, (0.1, 0.5, 0.9))] if delays else None,
        "rate_median": float(np.median(rates)) if rates else None,
        "date_in_interval": share(covered, len(delays)),
        "missed_seeds": missed,
    }


def _low_in_d(year: Year, leak: Leak, onset: int, notice: Notice) -> float:
    """Days from a notice until its tyre has truly lost 20 % since the leak began, if no air is put in."""
    lost, day = 100.0 * year.lost[onset:, leak.wheel], year.day[onset:]
    per_day = float(np.median(np.diff(lost) / np.diff(day)))  # leak and diffusion; refills are rare
    so_far = 100.0 * (year.lost[notice.drive, leak.wheel] - year.lost[onset - 1, leak.wheel])
    return float(max(20.0 - so_far, 0.0) / per_day)


def options(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    parser.add_argument("--healthy", type=int, default=500, help="car-years without a leak")
    parser.add_argument("--leaks", type=int, default=100, help="cars with a leak, for each rate")
    parser.add_argument("--first", type=int, default=1, help="seed of the first car")
    parser.add_argument("--rates", default="1.5,2,4", help="per cent of pressure per week")


def main(args: argparse.Namespace) -> dict[str, Any]:
    """Run and print."""
    sound = healthy(args.first, args.healthy)
    false = sound["false"]
    print(f"healthy: {false['events']} false notices in {sound['car_years']:.0f} car-years")
    print(f"  per 100 car-years {false['rate']:.2f} [{false['low']:.2f}, {false['high']:.2f}]", flush=True)
    for notice in sound["notices"]:
        print(f"  car {notice['seed']}: {notice['wheel']} {notice['rate']:.1f} %/week")
    rows = []
    for text in args.rates.split(","):
        row = leaking(args.first, args.leaks, float(text))
        rows.append(row)
        delay = "-" if row["delay_d"] is None else " / ".join(f"{d:.0f}" for d in row["delay_d"])
        print(
            f"{float(text):g} %/week: in time {percent(row['in_time'])}; wrong or before the leak "
            f"{percent(row['wrong_or_early'])}; delay (10/50/90 %) {delay} d; rate {row['rate_median']}; "
            f"date within the interval {percent(row['date_in_interval'])}",
            flush=True,
        )
    return {"healthy": sound, "leaks": rows}
