"""Ticks without frames give the program the same drive as the folder does."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench.campaigns.onboard.alarms.cases import group
from bench.campaigns.onboard.alarms.one import story, write_story
from bench.campaigns.onboard.alarms.play import LegResult, Said, fast_seconds, replay_leg
from bench.campaigns.onboard.alarms.score import judge
from bench.campaigns.onboard.alarms.ticks import ticks_of
from bench.worlds.folder import write_folder
from bench.worlds.trip_cars import Car, draw_car
from bench.worlds.trips import Driven, Leg, Loss, drive_leg
from tpmsd.car.config.load import load_config
from tpmsd.interfaces.cli.drive_reading import read_ticks
from tpmsd.interfaces.cli.replay import replay
from tpmsd.offline.report.replay_result import ReplayResult

BUSES = {
    "counts": {"wheel_signal": "counts", "teeth": 48.0, "split_wheels": True},
    "speeds": {"wheel_signal": "speeds", "speed_step_kmh": 0.03, "split_wheels": False},
}


def car_with(bus: str) -> Car:
    drawn = draw_car(np.random.default_rng(6), "development", 6)
    spec = replace(drawn.spec, **BUSES[bus], receiver_hz=5.0, with_gyro=True, with_accel=True)  # type: ignore[arg-type]
    return replace(drawn, spec=spec)


@dataclass(frozen=True)
class Written:
    """A leg, its folder, and what a replay of that says."""

    driven: Driven
    folder: Path
    replayed: ReplayResult


@pytest.fixture(scope="module", params=sorted(BUSES))
def leaking(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Written:
    """Learned within two minutes, then a third of a tyre's pressure goes."""
    leg = Leg(seed=2, road="track", duration_s=220.0, losses=(Loss(3, 0.3, 150.0, 10.0),))
    driven = drive_leg(car_with(request.param), leg)
    folder = tmp_path_factory.mktemp("drive")
    write_folder(driven.drive, folder)
    return Written(driven, folder, replay(folder, load_config(folder)))


def test_ticks_are_those_of_the_written_folder(leaking: Written) -> None:
    """Rotations agree to a hundredth of a count, fixes and gyro to what the text rounds."""
    read = {round(t.time_s, 3): t for t in read_ticks(leaking.folder, load_config(leaking.folder))}
    made = {round(tick.time_s, 3): tick for tick in ticks_of(leaking.driven.drive)}
    both = sorted(read.keys() & made.keys())[20:-20]

    assert len(both) > 2100
    turned = np.array([[read[t].rotation_rad, made[t].rotation_rad] for t in both])
    assert np.abs(turned[:, 0] - turned[:, 1]).max() < 2e-3
    gyro = np.array([[read[t].yaw_rate_radps, made[t].yaw_rate_radps] for t in both])
    assert np.abs(gyro[:, 0] - gyro[:, 1]).max() < 3e-3
    fixes = [[f for t in both for f in ticks[t].fixes] for ticks in (read, made)]
    assert len(fixes[0]) == pytest.approx(len(fixes[1]), abs=1)
    speed = np.array([[a.speed_mps, b.speed_mps] for a, b in zip(*fixes, strict=False)])
    assert np.abs(speed[:, 0] - speed[:, 1]).max() < 1e-6


def test_ticks_give_the_alarms_of_a_replay_of_the_folder(leaking: Written) -> None:
    """Kind, wheel and state of each alarm of a tyre are the same, and its time to within 3 s."""
    replayed = [a for a in leaking.replayed.alarms if a.kind != "malfunction"]
    outcome = [said for said in replay_leg(leaking.driven).said if said.kind != "malfunction"]

    assert [("deflation", "rr")] == [(said.kind, said.wheel) for said in outcome]
    assert [(str(a.kind), a.wheel, a.state) for a in replayed] == [
        (s.kind, s.wheel, s.state) for s in outcome
    ]
    start_s = leaking.driven.leg.start_s
    late = [a.time_s - start_s - s.time_s for a, s in zip(replayed, outcome, strict=True)]
    assert max(map(abs, late)) < 3.0


def test_a_leg_by_frames_is_a_replay_of_its_folder(leaking: Written) -> None:
    """Alarms and radii are those of `tpmsd replay`, to the last bit."""
    outcome = replay_leg(leaking.driven, frames=True)
    start_s = leaking.driven.leg.start_s

    expected = [(a.time_s - start_s, str(a.kind), a.wheel, a.state) for a in leaking.replayed.alarms]
    assert expected == [(s.time_s, s.kind, s.wheel, s.state) for s in outcome.said]
    assert [wheel.change_m for wheel in leaking.replayed.wheels] == [x for x, _ in outcome.change.values()]


def test_what_was_learned_is_carried_over_a_restart() -> None:
    """Already flat at the start: the alarm comes without learning again, on the right wheel."""
    car = car_with("counts")
    healthy = replay_leg(drive_leg(car, Leg(seed=1, road="track", duration_s=180.0)))
    flat = drive_leg(car, Leg(seed=2, road="track", duration_s=120.0, losses=(Loss(0, 0.3),)))
    outcome = replay_leg(flat, healthy.state, lambda so_far: so_far.said[0].time_s)

    assert healthy.learned
    assert not healthy.raised("deflation")
    assert ["fl"] == [said.wheel for said in outcome.raised("deflation")]
    assert outcome.played_s == outcome.said[0].time_s


def test_a_story_is_written_as_one_folder_with_the_car_parked_in_between(tmp_path: Path) -> None:
    """Three legs, the learning ones first; time goes on, and the receiver starts where the car was left."""
    reported = story("development/3/" + _name("development", 3))
    short = replace(reported, legs=tuple(replace(leg, duration_s=30.0, losses=()) for leg in reported.legs))
    write_story(short, tmp_path)
    stamps = [float(line[1:18]) for line in (tmp_path / "can.log").read_text().splitlines()]
    pauses = np.diff(stamps)

    assert ["bus.dbc", "can.log", "gnss.nmea", "vehicle.toml"] == sorted(p.name for p in tmp_path.iterdir())
    assert 2 == int((pauses > 60.0).sum())
    assert pauses.min() >= 0.0
    assert replay(tmp_path, load_config(tmp_path)).tick_gaps == 2


def _name(pool: str, seed: int) -> str:
    return group(pool, seed).cases[0].name.split("/")[-1]


def test_driving_above_40_kmh_is_counted_between_two_instants() -> None:
    """On a road of 52 to 97 km/h, after the start, all of it."""
    driven = drive_leg(car_with("counts"), Leg(seed=1, road="track", duration_s=100.0))

    assert 50.0 == pytest.approx(fast_seconds(driven, 40.0, 90.0), abs=0.05)
    assert 0.0 == fast_seconds(driven, 0.0, 2.0)


def test_a_case_is_judged_by_what_was_raised_after_the_loss() -> None:
    """In time and on the soft wheel; late; on another wheel; never; and already before the loss."""
    case = next(
        each for each in group("development", 3).cases if each.onset == "fast" and len(each.wheels) == 1
    )
    driven = drive_leg(group("development", 3).car, case.leg)
    soft = ("fl", "fr", "rl", "rr")[case.wheels[0]]
    other = "rr" if soft == "fl" else "fl"

    def judged(*alarms: tuple[float, str]) -> dict[str, Any]:
        said = [Said(at, "deflation", wheel, "raised", "why") for at, wheel in alarms]
        change = dict.fromkeys(("fl", "fr", "rl", "rr"), (-1.4e-3, 2e-4))
        end = float(driven.drive.time_s[-1])
        return judge(case, driven, LegResult(said=said, learned=True, played_s=end, change=change))

    prompt, wrong = judged((case.done_s + 30.0, soft)), judged((case.done_s + 30.0, other))
    late, never = judged((float(driven.drive.time_s[-1]) - 1.0, soft)), judged()
    before = judged((case.leg.losses[0].onset_s - 20.0, other))

    assert (True, True, "") == (prompt["detected"], prompt["right_wheel"], prompt["reason"])
    assert prompt["fast_s"] <= 30.0
    assert (True, False, [other]) == (wrong["detected"], wrong["right_wheel"], wrong["named"])
    assert not late["detected"]
    assert late["reason"].startswith("late: ")
    assert not never["detected"]
    assert never["reason"].startswith("the change is seen, and not significant: ")
    assert before["reason"] == f"an alarm before the air was let out, of {other}"
    assert 1 == len(before["false_before"])
