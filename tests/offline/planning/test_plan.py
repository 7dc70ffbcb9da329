"""Plans: what to drive so that effects can be distinguished."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from tests.car.physics.motions import car
from tpmsd.interfaces.cli.main import main
from tpmsd.interfaces.cli.plan import summary
from tpmsd.offline.planning.information import DT_S, Equipment, expected_gains
from tpmsd.offline.planning.search import TARGET, Plan, search_plan
from tpmsd.offline.simulator.manoeuvres import (
    LIBRARY,
    Manoeuvre,
    ManoeuvrePart,
    format_route,
    motion_of,
    steps_of,
)

PAIR = ("load_transfer_lateral", "track_width_error")
"""Both go with the yaw rate; only the one also goes with the speed."""
AT_ONE_SPEED = Manoeuvre(
    "bends at one speed", (ManoeuvrePart(20.0, 15.0), *([ManoeuvrePart(10.0, 15.0, 0.009)] * 2))
)


def gains(manoeuvres: list[Manoeuvre], equipment: Equipment, *effects: str) -> dict[str, float]:
    """Of a drive of these manoeuvres."""
    return expected_gains(motion_of(steps_of(manoeuvres), 2.63, 1.0 / DT_S), equipment, effects)


def test_effects_that_look_similar_bring_little_beside_each_other() -> None:
    """At one speed either explains what the other does; a second speed tells them apart."""
    equipment = Equipment(car())
    slow = Manoeuvre(
        "slow", tuple(replace(s, speed_mps=7.5, curvature_per_m=0.03) for s in AT_ONE_SPEED.steps)
    )
    alone = [gains([AT_ONE_SPEED] * 4, equipment, name)[name] for name in PAIR]
    beside = gains([AT_ONE_SPEED] * 4, equipment, *PAIR)
    both = gains([AT_ONE_SPEED, slow] * 2, equipment, *PAIR)

    assert [True, True] == [beside[name] < 0.2 * one for name, one in zip(PAIR, alone, strict=True)]
    assert [True, True] == [both[name] > 3.0 * beside[name] for name in PAIR]


def test_a_plan_is_short_and_tells_all() -> None:
    """It brings what is wanted of each effect, and no manoeuvre can be left out."""
    equipment = Equipment(car())
    plan = search_plan(PAIR, equipment, LIBRARY, 1800.0)

    assert plan.identifies_all
    assert min(plan.gains.values()) >= TARGET
    for k in range(len(plan.manoeuvres)):
        rest = [*plan.manoeuvres[:k], *plan.manoeuvres[k + 1 :]]
        assert not rest or min(gains(rest, equipment, *PAIR).values()) < TARGET


def test_what_no_sensor_reads_is_not_reported() -> None:
    """Without a gyro nothing tells its bias, however long the drive."""
    equipment = Equipment(car(), gyro=False)

    assert {"yaw_rate_bias": 0.0} == gains([LIBRARY[7]], equipment, "yaw_rate_bias")
    assert not search_plan(["yaw_rate_bias"], equipment, LIBRARY[:2], 200.0).identifies_all


def test_what_no_drive_tells_is_said_with_what_does(capsys: pytest.CaptureFixture[str]) -> None:
    """Wear takes thousands of kilometres: no manoeuvres are proposed for it."""
    assert 0 == main(["plan", "wear"])

    text = capsys.readouterr().out
    assert "No drive of these manoeuvres identifies it." in text
    assert "hold" not in text
    assert "what identifies it: compare the radii of drives that lie thousands of kilometres apart" in text


def test_nothing_is_driven_for_what_cannot_be_detected_and_what_repeats_is_one_line() -> None:
    """Wear beside an effect that manoeuvres tell adds none to them; equal manoeuvres follow each other."""
    equipment = Equipment(car())
    alone = search_plan(PAIR, equipment, LIBRARY, 1800.0)
    both = search_plan([*PAIR, "wear"], equipment, LIBRARY, 1800.0)

    assert alone.manoeuvres == both.manoeuvres
    assert (True, False, 0.0) == (alone.identifies_all, both.identifies_all, both.gains["wear"])
    repeated = Plan((LIBRARY[1], LIBRARY[1], LIBRARY[0], LIBRARY[1]), {"wear": TARGET}, 60.0)
    assert [f"  1. {LIBRARY[1].name}, 2 times", f"  2. {LIBRARY[0].name}", f"  3. {LIBRARY[1].name}"] == (
        summary(repeated).splitlines()[1:4]
    )
    order = search_plan(("lateral_slip", "antenna_lever_arm"), equipment, LIBRARY, 1800.0).manoeuvres
    assert list(order) == sorted(order, key=order.index)


def test_a_step_is_driven_as_it_says() -> None:
    """The speed in the middle of a ramp, the lateral acceleration of a bend, the slope of a hill."""
    steps = [
        ManoeuvrePart(20.0, 20.0),
        ManoeuvrePart(20.0, 20.0, 0.005),
        ManoeuvrePart(20.0, 20.0, 0.0, 0.06),
    ]
    motion = motion_of(steps, 2.63)

    assert pytest.approx(10.0, abs=1e-6) == motion.speed_mps[1000]
    assert pytest.approx(2.0, abs=1e-6) == motion.accel_lat_mps2[3000]
    assert pytest.approx(0.0599281, abs=1e-6) == motion.grade_rad[5000]


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "a route file holds [[manoeuvre]] tables and nothing else"),
        ("[[manoeuvre]\n", "not TOML"),
        ("[[manoeuvre]]\nname = 'x'\n", "manoeuvre 1 has no list of steps"),
        ("[[manoeuvre]]\nsteps = [3]\n", "manoeuvre 1: a step is a table"),
        ("[[manoeuvre]]\nsteps = [{speed_mps = 3}]\n", "manoeuvre 1: a step without duration_s"),
        (
            "[[manoeuvre]]\nsteps = [{duration_s = 3, speed_mps = 300}]\n",
            "manoeuvre 1: speed_mps = 300 is no number from 0 to 70",
        ),
        ("[[manoeuvre]]\nsteps = [{duration_s = 3, wheel = 1}]\n", "manoeuvre 1: a step has no 'wheel'"),
    ],
)
def test_a_file_that_is_no_route_is_refused_in_one_line(
    text: str, reason: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With its name and the reason."""
    path = tmp_path / "route.toml"
    path.write_text(text)

    assert 2 == main(["simulate", str(tmp_path / "out"), "--route-file", str(path)])
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"tpmsd: {path}: {reason}")


def test_what_manoeuvres_do_not_tell_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    """An event, a calibration constant and a name that there is not are one line each."""
    for name, reason in (
        ("wheel_spin", "is not identified by manoeuvres"),
        ("radius_constant", "is not identified by manoeuvres"),
        ("load_transfer_latral", "did you mean 'load_transfer_lateral'?"),
    ):
        assert 2 == main(["plan", name])
        (line,) = capsys.readouterr().err.splitlines()
        assert reason in line


def test_a_diagnosis_that_could_not_tell_names_the_effect_after_the_planned_drive(tmp_path: Path) -> None:
    """Bends at one speed leave load transfer and track alike; the plan for that car parts them."""
    before, after, route = tmp_path / "before", tmp_path / "after", tmp_path / "route.toml"
    route.write_text(format_route([AT_ONE_SPEED] * 5))
    effect = ["--effect", "load_transfer_lateral:coefficient=1.3e-4"]

    def diagnosed(drive: Path) -> list[tuple[str, list[str]]]:
        assert 0 == main(["diagnose", str(drive), "--certify", "0", "--json", str(drive / "said.json")])
        said = json.loads((drive / "said.json").read_text())
        return [(one["effect"], one["indistinguishable_from"]) for one in said["findings"]]

    assert 0 == main(["simulate", str(before), "--route-file", str(route), *effect, "--seed", "3"])
    (found,) = diagnosed(before)
    assert set(PAIR) == {found[0], *found[1]}

    planned_to = ["--drive", str(before), "--write", str(route), "--json", str(tmp_path / "plan.json")]
    assert 0 == main(["plan", *PAIR, *planned_to])
    plan = json.loads((tmp_path / "plan.json").read_text())
    assert plan["told"]
    assert plan["duration_s"] < 600.0

    assert 0 == main(["simulate", str(after), "--route-file", str(route), *effect, "--seed", "4"])
    assert [("load_transfer_lateral", [])] == diagnosed(after)
