"""A configuration against its DBC."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.car.config.conftest import GOOD_DBC, GOOD_TOML, Make
from tpmsd.car.config.check import check
from tpmsd.car.config.dbc import load_dbc
from tpmsd.car.config.plan import ConfigurationPlan
from tpmsd.car.config.problems import ConfigProblems


def plan_of(path: Path) -> ConfigurationPlan:
    """The plan of a configuration that is right."""
    result = check(path)
    assert result.problems == ()
    assert result.plan is not None
    return result.plan


def line_number(path: Path, start: str) -> int:
    """Where the line that starts so is."""
    lines = path.read_text(encoding="utf-8").splitlines()
    return next(number for number, line in enumerate(lines, 1) if line.startswith(start))


def test_plan_of_counters(make: Make) -> None:
    """Resolution, roll-over and certainty of a counter follow from its bits, the teeth and the radius."""
    wheel = plan_of(make()).wheels[2]
    turn_m = 2 * math.pi * 0.316
    assert (wheel.wheel, wheel.source.role, wheel.source.signal) == ("rl", "wheel_count_rl", "WHEELS.CNT_RL")
    assert (wheel.source.frame_id, wheel.source.extended, wheel.source.period_s) == (176, False, 0.020)
    assert (wheel.kind, wheel.bits) == ("count", 16)
    assert pytest.approx(1000 * turn_m / 48) == wheel.resolution_mm
    assert pytest.approx(65536 * turn_m / 48) == wheel.rollover_m
    assert pytest.approx(65536 * turn_m / 48 / 2 / 60) == wheel.unambiguous_s


def test_plan_of_scaled_counter(make: Make) -> None:
    """A factor of one half makes steps of half a count and rolls over after half the road."""
    scaled = (("CNT_RL : 32|16@1+ (1,0)", "CNT_RL : 32|8@1+ (0.5,0)"),)
    wheel = plan_of(make(dbc=scaled)).wheels[2]
    turn_m = 2 * math.pi * 0.316
    assert pytest.approx(500 * turn_m / 48) == wheel.resolution_mm
    assert pytest.approx(128 * turn_m / 48) == wheel.rollover_m


def test_plan_of_speeds(make: Make) -> None:
    """A speed's step is in m/s of road, whether its unit is one of the road or of rotation."""
    edits = [
        (f'count_{w} = "WHEELS.CNT_{w.upper()}"', f'speed_{w} = "SPEEDS.V_{w.upper()}"') for w in ("fl", "rl")
    ]
    front, _, rear, _ = plan_of(make(*edits)).wheels
    assert (front.source.frame_id, front.source.extended) == (2566844926 - (1 << 31), True)
    assert (front.source.unit, rear.source.unit) == ("km/h", "rpm")
    assert pytest.approx(0.01 / 3.6) == front.speed_step_mps
    assert pytest.approx(0.01 * 2 * math.pi / 60 * 0.316) == rear.speed_step_mps
    assert rear.rollover_m is None


def test_losses(make: Make) -> None:
    """What is missing is named with its cost, the rear axle alone among it; what is there is not."""
    four = plan_of(make())
    assert set(four.losses) == {
        "accel_long", "accel_lat", "steering_wheel_angle", "brake_pressure", "drive_torque", "ambient_temp",
    }  # fmt: skip
    rear = plan_of(
        make(
            ('wheel_count_fl = "WHEELS.CNT_FL"\n', ""),
            ('wheel_count_fr = "WHEELS.CNT_FR"\n', ""),
            ('device = "/dev/ttyACM0"\n', ""),
        )
    )
    assert "rear axle only" in rear.losses["front wheels"]
    assert "no receiver" in rear.losses["[gnss] device"]


def test_the_slip_gate_says_what_it_lacks(make: Make) -> None:
    """With [filter] gate = "slip" the missing inertial and steering signals cost more, and that is said."""
    slip = plan_of(make(("[gnss]\n", '[filter]\ngate = "slip"\n\n[gnss]\n')))
    lacking = {role for role, cost in slip.losses.items() if "slip gate" in cost}
    assert {"accel_long", "steering_wheel_angle"} == lacking
    assert not any("slip gate" in cost for cost in plan_of(make()).losses.values())


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("WHEELS.CNT_FL", "WHEELS.CNT_FI",
         'no signal CNT_FI in message WHEELS, found "WHEELS.CNT_FI"; did you mean WHEELS.CNT_FL?'),
        ("WHEELS.CNT_FL", "WHEEL.CNT_FL",
         'no message WHEEL in the DBC, found "WHEEL.CNT_FL"; did you mean WHEELS.CNT_FL?'),
        ("WHEELS.CNT_FL", "wheels.cnt_fl",
         'no message wheels in the DBC, found "wheels.cnt_fl"; did you mean WHEELS.CNT_FL?'),
        ("WHEELS.CNT_FL", "ESP.CNT_FL",
         'no signal CNT_FL in message ESP (but in WHEELS), found "ESP.CNT_FL"; did you mean WHEELS.CNT_FL?'),
        ("WHEELS.CNT_FL", "ZZZ.CNT_FL",
         'no message ZZZ in the DBC, found "ZZZ.CNT_FL"; did you mean WHEELS.CNT_FL?'),
        ("WHEELS.CNT_FL", "ZZZ.QQQ",
         'no message ZZZ in the DBC, found "ZZZ.QQQ"; allowed: WHEELS ESP SPEEDS'),
        ("WHEELS.CNT_FL", "ESP.QQQ", 'no signal QQQ in message ESP, found "ESP.QQQ"; allowed: YAW AY'),
        ("WHEELS.CNT_FL", "SPEEDS.V_FL",
         "SPEEDS.V_FL: a counter cannot have the unit 'km/h' (linear speed)"),
    ],
)  # fmt: skip
def test_names_against_the_dbc(make: Make, old: str, new: str, text: str) -> None:
    """A name that is not in the DBC comes with the nearest that is, at the role's line."""
    path = make((old, new))
    (problem,) = check(path).problems
    line = line_number(path, "wheel_count_fl")
    assert f"{path}:{line}: [can.signals] wheel_count_fl: {text}" == problem.text


def test_unit_of_the_wrong_kind(make: Make) -> None:
    """A yaw rate in km/h is a problem that names the units of a yaw rate."""
    path = make(dbc=(('"deg/s"', '"km/h"'),))
    (problem,) = check(path).problems
    expected = (
        "[can.signals] yaw_rate: ESP.YAW: unit 'km/h' is linear speed; allowed for angular speed: rad/s deg/s"
    )
    assert f"{path}:{line_number(path, 'yaw_rate')}: {expected}" == problem.text


def test_unit_in_latin_1(make: Make) -> None:
    """The degree sign of a DBC in its own encoding is understood."""
    plan = plan_of(make(dbc=(('"deg/s"', '"°/s"'),)))
    assert [signal.unit for signal in plan.optional] == ["deg/s"]


def test_missing_unit_is_a_warning(make: Make) -> None:
    """A speed without a unit is taken as km/h, and that is said."""
    path = make(('count_rr = "WHEELS.CNT_RR"', 'speed_rr = "SPEEDS.V_RR"'))
    result = check(path)
    assert [warning.text for warning in result.warnings] == [
        f"{path}:{line_number(path, 'wheel_speed_rr')}: [can.signals] wheel_speed_rr: "
        "SPEEDS.V_RR has no unit in the DBC: km/h is assumed"
    ]
    assert result.plan is not None
    assert result.plan.wheels[3].source.unit == "km/h"


def test_float_counter(make: Make) -> None:
    """A counter that is a floating-point number on the bus is refused."""
    as_float = (
        ("SG_ CNT_FL : 0|16@1+", "SG_ CNT_FL : 0|32@1-"),
        ("BO_ 180 ESP", "BO_ 180 ESP"),
        ("BA_DEF_ BO_", "SIG_VALTYPE_ 176 CNT_FL : 1;\nBA_DEF_ BO_"),
    )
    (problem,) = check(make(dbc=as_float)).problems
    assert (problem.what, problem.found) == (
        "a counter must be an integer",
        "WHEELS.CNT_FL as IEEE 754 float",
    )


def test_constant_signal(make: Make) -> None:
    """A factor of zero makes a constant of a signal, whatever comes over the bus."""
    (problem,) = check(make(dbc=(("CNT_FL : 0|16@1+ (1,0)", "CNT_FL : 0|16@1+ (0,0)"),))).problems
    assert (problem.key, problem.found) == ("[can.signals] wheel_count_fl", "WHEELS.CNT_FL with factor 0")


@pytest.mark.parametrize(("period_ms", "warned"), [(20, False), (44, False), (45, True)])
def test_narrow_counter(make: Make, period_ms: int, warned: bool) -> None:
    """Seven bits of 48 teeth are certain for 64 counts, which is 44.1 ms at 60 m/s."""
    narrow = (
        ("CNT_FL : 0|16@1+ (1,0)", "CNT_FL : 0|7@1+ (1,0)"),
        ("BO_ 176 20;", f"BO_ 176 {period_ms};"),
    )
    # 64 / 48 * 2 pi * 0.316 m = 2.647 m in 44.1 ms
    result = check(make(dbc=narrow))
    assert result.plan is not None
    assert warned == any("7 bits are ambiguous after 44.1 ms" in warning.what for warning in result.warnings)


def test_alarm_identifier_of_the_bus(make: Make) -> None:
    """An identifier that the bus uses itself is refused, in its own frame format only."""
    path = make(text=GOOD_TOML + "[alarms]\nstatus_id = 176\n")
    (problem,) = check(path).problems
    expected = "the identifier is that of WHEELS in the DBC, found 0xB0; allowed: one that is free"
    assert f"{path}:{line_number(path, 'status_id')}: [alarms] status_id: {expected}" == problem.text
    for free in ("extended_ids = true", 'channel = "can1"', "can = false"):
        assert check(make(text=f"{GOOD_TOML}[alarms]\nstatus_id = 176\n{free}\n")).problems == ()


def test_own_frames_in_the_bus_description(make: Make) -> None:
    """A DBC that holds tpmsd's own frames already does not collide with them."""
    own = (("BO_ 180 ESP", "BO_ 1776 TPMSD_STATUS: 8 CAR\n\nBO_ 180 ESP"),)
    assert check(make(dbc=own)).problems == ()
    foreign = (("BO_ 180 ESP", "BO_ 1776 OTHER: 8 CAR\n\nBO_ 180 ESP"),)
    (problem,) = check(make(dbc=foreign)).problems
    assert problem.key == "[alarms] status_id"


def test_can_interface(make: Make) -> None:
    """An interface that python-can does not have comes with the nearest that it has."""
    (problem,) = check(make(('"socketcan"', '"socketcam"'))).problems
    assert (problem.what, problem.suggestion) == ("no such python-can interface", "socketcan")


def test_fd_frame_on_a_classic_bus(make: Make) -> None:
    """Wheel signals in a long frame need fd = true, said once and not per wheel."""
    long = (("WHEELS: 8", "WHEELS: 64"),)
    warnings = check(make(dbc=long)).warnings
    assert len(warnings) == 1
    assert "fd = true" in warnings[0].what
    assert check(make(("[can]\n", "[can]\nfd = true\n"), dbc=long)).warnings == ()


def test_twin_messages(make: Make) -> None:
    """Two messages of one name are warned of, since only one can be meant."""
    messages = (
        ("BO_ 180 ESP", 'BO_ 181 ESP: 8 CAR\n SG_ YAW : 0|8@1+ (1,0) [0|1] "deg/s" CAR\n\nBO_ 180 ESP'),
    )
    (warning,) = check(make(dbc=messages)).warnings
    assert warning.what == "the DBC has 2 messages named ESP: the last one is taken"


def test_assumed_teeth_and_useless_steering(make: Make) -> None:
    """Keys whose default is a guess are warned of."""
    path = make(
        ("teeth_per_rev = 48\n", ""),
        ("steering_ratio = 15.3\n", ""),
        ('yaw_rate = "ESP.YAW"', 'steering_wheel_angle = "ESP.YAW"'),
        dbc=(('"deg/s"', '"deg"'),),
    )
    keys = [warning.key for warning in check(path).warnings]
    assert keys == ["[vehicle] teeth_per_rev", "[vehicle] steering_ratio"]


def test_file_and_dbc_at_once(make: Make) -> None:
    """Mistakes in the file and against the DBC come in one answer, by line."""
    path = make(("0.316", "316"), ("WHEELS.CNT_RR", "WHEELS.CNT_RX"), ("ESP.YAW", "ESP.YAV"))
    keys = [problem.key for problem in check(path).problems]
    assert keys == ["[vehicle] wheel_radius_m", "[can.signals] wheel_count_rr", "[can.signals] yaw_rate"]


@pytest.mark.parametrize(
    ("content", "line", "text"),
    [
        ("", None, "not a bus description"),
        ("\0\1\2", None, "not a bus description"),
        ('VERSION ""\n', None, "holds no messages"),
        ("BO_ 1 A 1 X\n", 1, "holds no messages"),
    ],
)
def test_damaged_dbc(make: Make, content: str, line: int | None, text: str) -> None:
    """A DBC that cannot be read is one line with the DBC's own name and line."""
    path = make()
    dbc = path.parent / "bus.dbc"
    dbc.write_text(content)
    (problem,) = check(path).problems
    assert (problem.file, problem.line) == (str(dbc), line)
    assert problem.text.endswith(text)


@given(st.integers(0, len(GOOD_DBC)), st.integers(0, 6), st.text(alphabet='0189 -"(|@,:ax.\n', max_size=4))
@settings(
    derandomize=True,
    deadline=None,
    max_examples=150,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
def test_any_damage_to_the_dbc(make: Make, start: int, length: int, scrap: str) -> None:
    """A DBC with a piece replaced gives a plan or problems of one printable line each, never a traceback."""
    path = make()
    (path.parent / "bus.dbc").write_text(GOOD_DBC[:start] + scrap + GOOD_DBC[start + length :])
    result = check(path)
    assert (result.plan is None) == bool(result.problems)
    assert all(problem.text.isprintable() for problem in result.problems + result.warnings)


def test_dbc_that_is_a_folder(tmp_path: Path) -> None:
    """A folder in the place of a DBC cannot be read."""
    with pytest.raises(ConfigProblems, match="cannot be read: Is a directory"):
        load_dbc(tmp_path)


@pytest.mark.parametrize("name", ["rav4-suburb-60s", "van-motorway-a", "van-motorway-b", "van-oval"])
def test_recordings(recordings: Path, name: str) -> None:
    """The real drives are right, without a warning, and know what they lack."""
    result = check(recordings / name)
    assert (result.problems, result.warnings) == ((), ())
    assert result.plan is not None
    if name.startswith("rav4"):
        assert [wheel.kind for wheel in result.plan.wheels] == ["speed"] * 4
        assert [signal.role for signal in result.plan.optional] == ["yaw_rate", "steering_wheel_angle"]
    else:
        assert [wheel.wheel for wheel in result.plan.wheels] == ["rl", "rr"]
        # 39931 counts on a circumference of 2 pi 0.315 m
        assert [pytest.approx(0.04957, rel=1e-3)] * 2 == [wheel.resolution_mm for wheel in result.plan.wheels]
        assert "front wheels" in result.plan.losses
