"""Extraction of signals against cantools' own decoding, and the errors of a DBC that does not fit."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import cantools.database
import pytest
from cantools.database.can import Message, Signal
from cantools.database.conversion import BaseConversion
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.onboard.sources_can.build import RADIUS_M, SPEEDS_DBC, config, database, four
from tpmsd.car.config.model import CalibrationConfig
from tpmsd.foundation.errors import ConfigError
from tpmsd.onboard.sources.can.databases import load_database
from tpmsd.onboard.sources.can.decoder import CanDecoder
from tpmsd.onboard.sources.can.signal_plan import EXTENDED, bit_field, can_filters, compile_plans
from tpmsd.onboard.sources.events import InertialSample

ROLES = {"yaw_rate": "rad/s", "accel_long": "m/s2", "accel_lat": "m/s2", "brake_pressure": "Pa"}


@st.composite
def signals(draw: st.DrawFn, size: int) -> Signal:
    """A signal of any kind that fits into `size` bytes."""
    is_float = draw(st.booleans()) and size >= 2
    longest = min(64, 8 * size)
    widths = [width for width in (16, 32, 64) if width <= longest]
    length = draw(st.sampled_from(widths) if is_float else st.integers(1, longest))
    first = draw(st.integers(0, 8 * size - length))
    big = draw(st.booleans())
    scale = draw(st.sampled_from([1, 2, -1, 0.5, 0.01, -0.125, 1e-3]))
    offset = draw(st.sampled_from([0, -40, 0.5, -67.67, 1000]))
    return Signal(
        "S",
        8 * (first // 8) + 7 - first % 8 if big else first,
        length,
        "big_endian" if big else "little_endian",
        not is_float and draw(st.booleans()),
        conversion=BaseConversion.factory(scale, offset, is_float=is_float),
    )


@settings(derandomize=True, deadline=None, max_examples=150)
@given(st.data())
def test_a_signal_has_the_value_that_cantools_decodes(data: st.DataObject) -> None:
    """Bits, sign, byte order, float, scale and offset of a random signal agree with cantools."""
    size = data.draw(st.sampled_from([1, 2, 3, 7, 8, 12, 64]))
    signal = data.draw(signals(size))
    frame = data.draw(st.binary(min_size=size, max_size=size))
    expected = float(Message(1, "M", size, [signal]).decode(frame, decode_choices=False)["S"])  # type: ignore[arg-type,call-overload,index]

    field = bit_field(signal)
    actual = signal.scale * field.number(field.bits(frame)) + signal.offset

    assert expected == actual or (math.isnan(expected) and math.isnan(actual))


@settings(derandomize=True, deadline=None, max_examples=60)
@given(st.data())
def test_signals_that_share_a_frame_decode_as_each_would_alone(data: st.DataObject) -> None:
    """The decoder reads a frame once per byte order; no signal is shifted by its neighbours' needs."""
    size = data.draw(st.sampled_from([4, 8, 20]))
    chosen = {role: data.draw(signals(size)) for role in ROLES}
    frame = data.draw(st.binary(min_size=size, max_size=size))
    expected = {}
    for role, signal in chosen.items():
        value = Message(1, "M", size, [signal]).decode(frame, decode_choices=False)["S"]  # type: ignore[call-overload,index]
        signal.name, signal.unit = role, ROLES[role]
        if math.isfinite(value):
            expected[role] = value
    together = cantools.database.can.Database(
        [Message(1, "M", size, list(chosen.values()), strict=False)], strict=False
    )

    decoder = CanDecoder(config({role: f"M.{role}" for role in ROLES}), together)
    events = decoder.decode(1.0, 1, False, frame)

    actual = {event.role: event.value for event in events if isinstance(event, InertialSample)}
    assert expected == pytest.approx(actual, rel=1e-12, abs=1e-12)


MULTIPLEXED = """VERSION ""
NS_ :
BS_:
BU_: CAR
BO_ 2147484672 M: 8 CAR
 SG_ INNER m0M : 8|4@1+ (1,0) [0|0] "" CAR
 SG_ OUTER M : 0|4@1+ (1,0) [0|0] "" CAR
 SG_ YAW m1 : 16|12@1- (0.01,0) [0|0] "rad/s" CAR
 SG_ LONG m0 : 23|10@0+ (0.1,-5) [0|0] "m/s2" CAR
 SG_ LAT m5 : 48|9@1- (0.1,0) [0|0] "m/s2" CAR
 SG_ TEMP : 56|8@1+ (1,-40) [0|0] "K" CAR
SG_MUL_VAL_ 2147484672 INNER OUTER 0-0;
SG_MUL_VAL_ 2147484672 YAW OUTER 1-1, 4-6;
SG_MUL_VAL_ 2147484672 LONG INNER 0-2, 9-9;
SG_MUL_VAL_ 2147484672 LAT INNER 3-3, 5-7;
"""


@settings(derandomize=True, deadline=None, max_examples=100)
@given(st.binary(min_size=8, max_size=8))
def test_multiplexed_signals_come_from_the_frames_that_carry_them(frame: bytes) -> None:
    """Simple, ranged and nested multiplexing select the signals that cantools selects."""
    bus = database(MULTIPLEXED)
    roles = {"yaw_rate": "YAW", "accel_long": "LONG", "accel_lat": "LAT", "ambient_temp": "TEMP"}
    try:
        decoded = bus.get_message_by_name("M").decode(frame, decode_choices=False)
    except cantools.database.DecodeError:
        # cantools refuses a frame with an unknown branch; its unmultiplexed part is sound all the same.
        decoded = {"TEMP": frame[7] - 40}
    expected = {role: float(decoded[name]) for role, name in roles.items() if name in decoded}  # type: ignore[index,arg-type,operator]

    decoder = CanDecoder(config({role: f"M.{name}" for role, name in roles.items()}), bus)
    events = decoder.decode(1.0, 1024, True, frame)

    actual = {event.role: event.value for event in events if isinstance(event, InertialSample)}
    assert expected == pytest.approx(actual)


def test_identifiers_of_both_lengths_are_kept_apart() -> None:
    """A 29-bit message is not decoded from an 11-bit frame of the same number."""
    decoder = CanDecoder(config({"ambient_temp": "M.TEMP"}), database(MULTIPLEXED))

    assert [] == decoder.decode(1.0, 1024, False, bytes(8))
    assert [InertialSample(1.1, "ambient_temp", -40.0)] == decoder.decode(1.1, 1024, True, bytes(8))
    assert 1 == decoder.counts["ignored"]


def test_filters_let_through_just_the_needed_identifiers() -> None:
    """One filter per needed message, with the mask of its length of identifier."""
    text = (
        MULTIPLEXED
        + 'BO_ 170 W: 8 CAR\n SG_ RL : 0|16@1+ (1,0) [0|0] "" CAR\n SG_ V : 16|8@1+ (1,0) [0|0] "km/h" CAR\n'
    )
    text += 'BO_ 171 UNUSED: 8 CAR\n SG_ V : 0|8@1+ (1,0) [0|0] "km/h" CAR\n'
    signals = {"wheel_count_rl": "W.RL", "wheel_speed_rl": "UNUSED.V", "ambient_temp": "M.TEMP"}

    assert [
        {"can_id": 170, "can_mask": 0x7FF, "extended": False},
        {"can_id": 1024, "can_mask": 0x1FFFFFFF, "extended": True},
    ] == can_filters(config(signals), database(text))
    assert {170, 1024 | EXTENDED} == set(compile_plans(config(signals), database(text)))


def test_units_become_si() -> None:
    """km/h over the nominal radius, rpm, degrees and degrees Celsius become rad/s, rad and K."""
    text = """VERSION ""
BO_ 1 M: 8 CAR
 SG_ KMH : 0|8@1+ (1,0) [0|0] "km/h" CAR
 SG_ RPM : 8|8@1+ (1,0) [0|0] "rpm" CAR
 SG_ DEG : 16|8@1+ (1,0) [0|0] "deg" CAR
 SG_ TEMP : 24|8@1+ (0.5,-40) [0|0] "degC" CAR
"""
    signals = {
        "wheel_speed_rl": "M.KMH",
        "wheel_speed_rr": "M.RPM",
        "steering_wheel_angle": "M.DEG",
        "ambient_temp": "M.TEMP",
    }
    plans = compile_plans(config(signals, radius_m=0.32), database(text))[1].groups[0].signals
    actual = {plan.role: plan.gain * 36 + plan.bias for plan in plans}

    assert {
        "wheel_speed_rl": 10.0 / 0.32,
        "wheel_speed_rr": 36 * 2 * math.pi / 60,
        "steering_wheel_angle": math.pi / 5,
        "ambient_temp": 273.15 - 22.0,
    } == pytest.approx(actual)


@pytest.mark.parametrize(
    ("definition", "expected"),
    [
        ("0|8@1+ (1,0) [0|254]", {255}),
        ("0|8@1+ (1,0) [0|255]", set()),
        ("0|8@1+ (1,0) [0|0]", set()),
        ("0|8@1+ (0.5,-40) [-40|87]", {255}),
        ("0|8@1- (1,0) [-127|127]", {128}),
        ("0|8@1- (1,0) [-128|127]", set()),
    ],
)
def test_the_reserved_value_is_invalid_where_the_limits_exclude_it(
    definition: str, expected: set[int]
) -> None:
    """All ones (the lowest number if signed) mean 'no value' only if the DBC's limits say so."""
    text = f'VERSION ""\nBO_ 1 M: 8 CAR\n SG_ S : {definition} "m/s2" CAR\n'
    plan = compile_plans(config({"accel_long": "M.S"}), database(text))[1].groups[0].signals[0]

    assert expected == plan.invalid


def test_named_choices_that_say_no_value_are_invalid() -> None:
    """SNA, invalid, not available and their like; but not 'no error'."""
    text = """VERSION ""
BO_ 1 M: 8 CAR
 SG_ S : 0|8@1+ (1,0) [0|0] "m/s2" CAR
VAL_ 1 S 255 "SNA" 254 "Signal not available" 253 "Invalid_value" 252 "Error" 251 "No error" 9 "N/A";
"""
    plan = compile_plans(config({"accel_long": "M.S"}), database(text))[1].groups[0].signals[0]

    assert {255, 254, 253, 252, 9} == plan.invalid


@pytest.mark.parametrize(
    ("signal", "reason"),
    [
        ("M", "not of the form"),
        ("N.S", "no message 'N'"),
        ("M.T", "M has no signal 'T'"),
        ("M.S", "unit 'bar'"),
        ("M.Z", "scale 0"),
    ],
)
def test_a_role_that_does_not_fit_the_dbc_is_named(signal: str, reason: str) -> None:
    """The error is one line with the role and what is wrong with it."""
    text = """VERSION ""
BO_ 1 M: 8 CAR
 SG_ S : 0|8@1+ (1,0) [0|0] "bar" CAR
 SG_ Z : 8|8@1+ (0,0) [0|0] "deg/s" CAR
"""
    with pytest.raises(ConfigError) as caught:
        compile_plans(config({"yaw_rate": signal}), database(text))

    assert "can.signals.yaw_rate" in str(caught.value)
    assert reason in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_floating_point_counter_is_refused() -> None:
    """A counter has to be an integer to roll over."""
    text = 'VERSION ""\nBO_ 1 M: 8 CAR\n SG_ S : 0|32@1- (1,0) [0|0] "" CAR\nSIG_VALTYPE_ 1 S : 1;\n'
    with pytest.raises(ConfigError, match=r"wheel_count_rl: M\.S is a floating-point number"):
        compile_plans(config({"wheel_count_rl": "M.S"}), database(text))


@pytest.mark.parametrize("content", [None, b"", b"BO_ oops", b"\x00\xff" * 50])
def test_a_file_that_is_no_database_is_one_line(tmp_path: Path, content: bytes | None) -> None:
    """Missing, empty, garbled and binary files end in one line that names the file."""
    path = tmp_path / "bus.dbc"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ConfigError) as caught:
        load_database(path)

    assert str(caught.value).startswith(f"{path}:")
    assert "\n" not in str(caught.value)


def test_a_calibrated_radius_does_not_move_what_it_was_calibrated_on() -> None:
    """Speeds over the road become rotation by the radius of the calibration's time: with the calibrated one
    in its place a wheel that is 1 % larger would be 1 % larger again. A file that does not say which one it
    was is no calibration of such a bus."""
    given = config(four("speed"))
    calibration = CalibrationConfig(
        bus_radius_fl_m=RADIUS_M, bus_radius_fr_m=RADIUS_M, bus_radius_rl_m=RADIUS_M, bus_radius_rr_m=RADIUS_M
    )
    larger = replace(given.vehicle, wheel_radius_m=(1.01 * RADIUS_M,) * 4)
    unsaid = replace(given, vehicle=larger)
    said = replace(unsaid, calibration=calibration)
    before, without, after = (
        [plan.gain for plan in compile_plans(one, database(SPEEDS_DBC))[176].groups[0].signals]
        for one in (given, unsaid, said)
    )
    assert before == after
    assert [gain / 1.01 for gain in before] == pytest.approx(without)
    assert (False, True) == (unsaid.calibration_holds, said.calibration_holds)
    assert config(four("count")).calibration_holds
