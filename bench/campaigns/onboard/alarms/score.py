"""Plays cases and lives, and says of each what came of it as a plain row.

In: `Group` or `Life`. Out: rows of plain numbers, one per case or leg.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from bench.campaigns.onboard.alarms.cases import LAWS, Case, Group
from bench.campaigns.onboard.alarms.lives import LEARNING, Life
from bench.campaigns.onboard.alarms.play import LegResult, Said, State, fast_seconds, law_seconds, replay_leg
from bench.campaigns.onboard.alarms.reliability import counts
from bench.worlds.magic_tyre import Array
from bench.worlds.trip_cars import Car
from bench.worlds.trips import Driven, drive_leg

Row = dict[str, Any]
WHEELS = ("fl", "fr", "rl", "rr")
AFTER_S = 45.0
"""A case is heard for this long after its alarm, to see which other wheels are named."""
ONE_INCIDENT_S = 120.0
"""Alarms this close to each other are one incident."""


def learned(
    car: Car, group: Group, memory: Path | None, method: str | None = None
) -> tuple[Row, State, Array]:
    """Drive the healthy legs; a row on how that went, what was learned and how warm the tyres were."""
    state: State = {}
    tyre_k = None
    false: list[Said] = []
    kilometres = 0.0
    outcome = LegResult()
    for leg in group.healthy:
        driven = drive_leg(car, leg, tyre_k)
        outcome = replay_leg(driven, state, memory=memory, method=method)
        state, tyre_k = outcome.state, driven.temperature_k
        kilometres += driven.kilometres
        false += [said for kind in ("deflation", "radius_deviation") for said in outcome.raised(kind)]
    assert tyre_k is not None
    row = {"learned": outcome.learned, "false": [_short(said) for said in false], "km": kilometres}
    return row, state, tyre_k


def play_group(group: Group, memory: Path | None = None, method: str | None = None) -> Iterator[Row]:
    """A row for the learning and one for each case; `method`: an estimator instead of the default."""
    car = group.car
    begun = time.process_time()
    first, state, tyre_k = learned(car, group, memory, method)
    about = _about(car)
    pool, seed, _ = group.cases[0].name.split("/")
    yield {"what": "learning", "name": f"{pool}/{seed}/learning", **about, **first, **_spent(begun)}
    for case in group.cases:
        begun = time.process_time()
        row = play_case(car, case, state, tyre_k, memory, method)
        yield {"what": "case", "name": case.name, **about, **row, **_spent(begun)}
    begun = time.process_time()
    row = play_malfunction(car, group, state, tyre_k, method)
    yield {"what": "malfunction", "name": f"{pool}/{seed}/malfunction", **about, **row, **_spent(begun)}


def play_case(
    car: Car,
    case: Case,
    state: State,
    tyre_k: Array | None,
    memory: Path | None = None,
    method: str | None = None,
) -> Row:
    """Play one case from what was learned."""
    driven = drive_leg(car, case.leg, tyre_k)
    onset = case.leg.losses[0].onset_s

    def stop(outcome: LegResult) -> float | None:
        real = [said for said in outcome.raised("deflation") if said.time_s >= onset]
        return real[0].time_s + AFTER_S if real else None

    outcome = replay_leg(driven, state, stop, memory=memory, method=method)
    row = judge(case, driven, outcome)
    if case.then is not None and not row["named"]:
        row |= _after_stop(car, case, driven, outcome, method)
    if row["detected"]:
        row["stands"] = _stands(car, driven, outcome, "deflation", method)
    return row


OFF_S = 300.0
"""With the ignition off, after which the telltale has to light again (UN R141)."""


def _after_stop(car: Car, case: Case, driven: Driven, outcome: LegResult, method: str | None) -> Row:
    """The drive goes on after a stop, from what was saved: what the law's time brings."""
    assert case.then is not None
    more = drive_leg(car, case.then, driven.temperature_k)
    law = LAWS[case.standard]
    again = replay_leg(more, outcome.state, lambda so_far: _first_time(so_far, "deflation"), method=method)
    counted = law_seconds(driven, law, case.done_s, math.inf)
    at = _first_time(again, "deflation")
    counted += law_seconds(more, law, 0.0, again.played_s if at is None else at)
    return {"by_law": at is not None and counted <= law.limit_s, "law_s": _number(counted)}


def _first_time(outcome: LegResult, kind: str) -> float | None:
    raised = outcome.raised(kind)
    return raised[0].time_s if raised else None


def _stands(car: Car, driven: Driven, outcome: LegResult, kind: str, method: str | None) -> bool:
    """Whether an alarm of this kind stands when the ignition is switched on again."""
    leg = driven.leg
    start_s = leg.start_s + outcome.played_s + OFF_S
    losses = tuple(replace(loss, onset_s=0.0, duration_s=0.0) for loss in leg.losses)
    begin = replace(
        leg, seed=leg.seed + 70, duration_s=ON_S, losses=losses, pause_s=OFF_S, start_s=start_s, tags=()
    )
    after = replay_leg(drive_leg(car, begin, driven.temperature_k), outcome.state, method=method)
    return any(name.split()[0] == kind for name in after.standing)


ON_S = 20.0
SILENT_S = 120.0
"""After which a wheel's signal is missing, in a case of a malfunction."""


def play_malfunction(car: Car, group: Group, state: State, tyre_k: Array | None, method: str | None) -> Row:
    """A wheel's signal is missing: when a malfunction is announced, and whether it stands after a restart."""
    usual = group.healthy[1]
    start_s = group.cases[0].leg.start_s
    driven = drive_leg(car, replace(usual, seed=190, duration_s=700.0, start_s=start_s), tyre_k)
    wheel = car.seed % 4
    outcome = replay_leg(
        driven, state, lambda one: _first_time(one, "malfunction"), method=method, silent=(wheel, SILENT_S)
    )
    at, law = _first_time(outcome, "malfunction"), LAWS["r141-malfunction"]
    counted = law_seconds(driven, law, SILENT_S, outcome.played_s)
    return {
        "standard": "r141-malfunction",
        "wheels": [WHEELS[wheel]],
        "by_law": at is not None and at >= SILENT_S and counted <= law.limit_s,
        "law_s": _number(counted),
        "stands": any(name.split()[0] == "malfunction" for name in _restarted(car, driven, outcome, method)),
    }


def _restarted(car: Car, driven: Driven, outcome: LegResult, method: str | None) -> list[str]:
    """What stands at once when the ignition is switched on again, and the signal is still missing."""
    leg = replace(
        driven.leg,
        seed=driven.leg.seed + 70,
        duration_s=ON_S,
        pause_s=OFF_S,
        start_s=driven.leg.start_s + outcome.played_s + OFF_S,
    )
    wheel = car.seed % 4
    again = drive_leg(car, leg, driven.temperature_k)
    return replay_leg(again, outcome.state, method=method, silent=(wheel, 0.0)).standing


def _estimated_mm(outcome: LegResult) -> dict[str, list[float | None]]:
    """Change of each radius at the end as the daemon estimates it, and its standard deviation."""
    return {name: [_number(1e3 * x), _number(1e3 * s)] for name, (x, s) in outcome.change.items()}


def judge(case: Case, driven: Driven, outcome: LegResult) -> Row:
    """What the alarms are worth."""
    onset, done = case.leg.losses[0].onset_s, case.done_s
    lost_m = driven.lost_m[min(round(outcome.played_s / 0.02), len(driven.lost_m) - 1)]
    soft = {WHEELS[wheel] for wheel in case.wheels}
    raised = outcome.raised("deflation")
    before = [said for said in raised if said.time_s < onset]
    real = [said for said in raised if said.time_s >= onset]
    first = real[0] if real else None
    fast = wait = math.nan
    if first is not None:
        fast, wait = fast_seconds(driven, done, first.time_s), max(first.time_s - done, 0.0)
    detected = first is not None and fast <= case.limit_s
    named = {said.wheel for said in real}
    return {
        "standard": case.standard,
        "onset": case.onset,
        "road": case.leg.road,
        "wheels": sorted(soft),
        "season": case.season,
        "reloaded": case.reloaded,
        "trailer": case.leg.trailer_kg > 0.0,
        "detected": detected,
        "fast_s": _number(fast),
        **_by_law(case, driven, outcome, first),
        "wait_s": _number(wait),
        "early": first is not None and first.time_s < done,
        "driven_fast_s": fast_seconds(driven, done, outcome.played_s),
        "right_wheel": first is not None and all(name is None or name in soft for name in named),
        "named": sorted(str(name) for name in named),
        "false_before": [_short(said) for said in before],
        "other": [_short(said) for said in outcome.said if said.kind != "deflation"],
        "lost_mm": _per_wheel(1e3 * lost_m),
        "stated_mm": _estimated_mm(outcome),
        "reliability": counts(driven, outcome),
        "reason": "" if detected else why_missed(case, driven, outcome, before, first),
    }


def _by_law(case: Case, driven: Driven, outcome: LegResult, first: Said | None) -> Row:
    """Driving that the law counts until the first alarm, or the end; and whether that is in time."""
    law = LAWS[case.standard]
    counted = law_seconds(driven, law, case.done_s, outcome.played_s if first is None else first.time_s)
    return {"by_law": first is not None and counted <= law.limit_s, "law_s": _number(counted)}


def why_missed(case: Case, driven: Driven, outcome: LegResult, before: list[Said], late: Said | None) -> str:
    """The proximate cause, from what is known of both sides."""
    if not outcome.learned:
        return "nothing was learned: no baseline"
    if before:
        names = ", ".join(str(said.wheel) for said in before)
        return f"an alarm before the air was let out, of {names}"
    if late is not None:
        return f"late: {fast_seconds(driven, case.done_s, late.time_s):.0f} s above 40 km/h"
    fast = fast_seconds(driven, case.done_s, outcome.played_s)
    if fast < 0.9 * case.limit_s:
        return f"the drive had but {fast:.0f} s above 40 km/h"
    end = min(round(outcome.played_s / 0.02), len(driven.lost_m)) - 1
    lost = -1e3 * driven.lost_m[max(end - 3000, 0) : end].mean(axis=0)
    texts = []
    seen = []
    for wheel in case.wheels:
        change, std = outcome.change.get(WHEELS[wheel], (math.nan, math.nan))
        reported = f"estimated {1e3 * change:+.2f} +- {1e3 * std:.2f} mm"
        texts.append(f"{WHEELS[wheel]} lost {-lost[wheel]:.2f} mm, {reported}")
        seen.append(1e3 * change / lost[wheel] if abs(lost[wheel]) > 1e-3 else math.nan)
    share = float(np.nanmedian(seen)) if np.isfinite(seen).any() else math.nan
    cause = (
        "the change is hidden in the estimate"
        if not share > 0.6
        else "the change is seen, and not significant"
    )
    return f"{cause}: " + "; ".join(texts)


def play_life(
    life: Life,
    pool: str,
    seed: int,
    memory: Path | None = None,
    what: str = "life",
    method: str | None = None,
) -> Iterator[Row]:
    """A row for each leg, all of it heard, alarms or not; `what`: the units, for the names."""
    about = _about(life.car)
    state: State = {}
    tyre_k: Array | None = None
    for k, leg in enumerate(life.legs):
        begun = time.process_time()
        driven = drive_leg(life.car, leg, tyre_k)
        outcome = replay_leg(driven, state, memory=memory, method=method)
        if k < LEARNING:
            state, tyre_k = outcome.state, driven.temperature_k
        yield {
            "what": "leg",
            "name": f"{pool}/{what}/{seed}/{k}",
            **about,
            **judge_leg(driven, outcome),
            **_spent(begun),
        }


def judge_leg(driven: Driven, outcome: LegResult) -> Row:
    """Incidents of each kind on a leg on which nothing was wrong, and how far it went."""
    end = min(round(outcome.played_s / 0.02), len(driven.distance_m) - 1)
    incidents = {
        kind: incidents_of(outcome.raised(kind)) for kind in ("deflation", "radius_deviation", "malfunction")
    }
    return {
        "road": driven.leg.road,
        "tags": list(driven.leg.tags),
        "km": float(driven.distance_m[end]) / 1000.0,
        "hours": outcome.played_s / 3600.0,
        "learned": outcome.learned,
        "reliability": counts(driven, outcome),
        "resized_mm": _per_wheel(1e3 * np.array(driven.leg.resized_m)),
        "stated_mm": {name: [_number(1e3 * x), _number(1e3 * s)] for name, (x, s) in outcome.change.items()},
        **incidents,
    }


def incidents_of(raised: list[Said]) -> list[list[Any]]:
    """First alarm of each cluster: seconds since the start, wheels named, reason."""
    out: list[list[Any]] = []
    last = -math.inf
    for said in raised:
        if said.time_s - last > ONE_INCIDENT_S:
            out.append([round(said.time_s, 1), [said.wheel], said.reason])
        else:
            out[-1][1].append(said.wheel)
        last = said.time_s
    return out


def _about(car: Car) -> Row:
    spec = car.spec
    return {
        "car": car.kind,
        "driven_axle": spec.driven,
        "signal": spec.wheel_signal
        if spec.wheel_signal == "counts"
        else f"speeds {spec.speed_step_kmh:g} km/h",
        "receiver_hz": spec.receiver_hz,
        "gyro": spec.with_gyro,
    }


def _spent(begun: float) -> Row:
    return {"cpu_s": round(time.process_time() - begun, 2)}


def _short(said: Said) -> list[Any]:
    return [round(said.time_s, 1), said.kind, said.wheel, said.state]


def _per_wheel(values: Array) -> dict[str, float]:
    return {name: round(float(value), 3) for name, value in zip(WHEELS, values, strict=True)}


def _number(value: float) -> float | None:
    return round(value, 3) if math.isfinite(value) else None
