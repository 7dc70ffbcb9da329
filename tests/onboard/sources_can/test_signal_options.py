"""The table form at work: modulus, validity, direction, scale and bus change what the decoder says."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

import cantools
import pytest

from tpmsd.car.config.model import BusConfig, CanConfig, Condition, Config, SignalOptions, VehicleConfig
from tpmsd.onboard.sources.can.channels import bus_numbers
from tpmsd.onboard.sources.can.databases import CarDatabase
from tpmsd.onboard.sources.can.decoder import CanDecoder, can_filters
from tpmsd.onboard.sources.events import InertialSample, RotationSample

DBC = """
BO_ 176 WHEELS: 8 CAR
 SG_ RL : 0|10@1+ (1,0) [0|1023] "" CAR
 SG_ RR : 16|10@1+ (1,0) [0|1023] "" CAR
 SG_ QF : 32|2@1+ (1,0) [0|3] "" CAR
 SG_ BACK : 34|1@1+ (1,0) [0|1] "" CAR

BO_ 177 GYRO: 8 CAR
 SG_ YAW : 0|16@1- (0.01,0) [-300|300] "deg/s" CAR
"""
TEETH = 48.0


def decoder(vehicle_teeth: tuple[float, ...] | None = None, **options: SignalOptions) -> CanDecoder:
    database = cantools.database.load_string(DBC, "dbc", strict=False)
    teeth = None if vehicle_teeth is None else (*vehicle_teeth, *vehicle_teeth)
    vehicle = VehicleConfig((0.3,) * 4, 1.5, 1.5, 2.6, teeth_per_rev=TEETH, teeth_by_wheel=teeth)  # type: ignore[arg-type]
    signals = {"wheel_count_rl": "WHEELS.RL", "wheel_count_rr": "WHEELS.RR", "yaw_rate": "GYRO.YAW"}
    return CanDecoder(Config(vehicle, CanConfig(signals, Path("bus.dbc"), options=options)), database)


def frame(left: int, right: int, quality: int = 1, back: int = 0) -> bytes:
    return (left | right << 16 | quality << 32 | back << 34).to_bytes(8, "little")


def angles(decoded: CanDecoder, frames: list[bytes], wheel: int = 2) -> list[float]:
    """Counts of one wheel since the start, as long as it stays in one segment."""
    samples = [
        event
        for k, data in enumerate(frames)
        for event in decoded.decode(0.02 * k, 176, False, data)
        if isinstance(event, RotationSample) and event.wheel == wheel
    ]
    assert {sample.segment for sample in samples} <= {0}
    return [round(sample.angle_rad * TEETH / (2 * math.pi), 6) for sample in samples]


def test_a_modulus_below_the_width() -> None:
    """A counter of 10 bits that rolls over at 1001 gives the true way over its roll-over."""
    counts = [995, 997, 999, 0, 2, 4]
    frames = [frame(left, left) for left in counts]

    assert [0, 2, 4, 6, 8, 10] == angles(decoder(wheel_count_rl=SignalOptions(modulus=1001)), frames)
    with_full_width = decoder()
    assert 10 != angles(with_full_width, frames[:3] + frames[4:])[-1]


def test_values_beyond_the_modulus_are_none() -> None:
    """1001 and above are no counts where the counter ends at 1000."""
    decoded = decoder(wheel_count_rl=SignalOptions(modulus=1001))
    frames = [frame(5, 5), frame(1010, 6), frame(7, 7)]

    assert [0, 2] == angles(decoded, frames)
    assert 1 == decoded.counts["rl.invalid"]


def test_validity_is_a_comparison_with_another_signal() -> None:
    """A count is used only while the quality bits say so; the other wheel, without the condition, always."""
    decoded = decoder(wheel_count_rl=SignalOptions(valid_when=Condition("WHEELS.QF", "==", 1.0)))
    frames = [frame(5, 5), frame(6, 6, quality=2), frame(7, 7)]

    assert [0, 2] == angles(decoded, frames)
    assert {"rl.invalid": 1} == {key: n for key, n in decoded.counts.items() if "invalid" in key}


def test_invalid_values_of_the_table() -> None:
    """A raw value that the table calls invalid is no reading."""
    decoded = decoder(wheel_count_rl=SignalOptions(invalid=(6,)))
    assert [0, 2] == angles(decoded, [frame(5, 5), frame(6, 6), frame(7, 7)])


def test_a_direction_bit_makes_the_count_signed() -> None:
    """A counter that counts up in reverse, too, goes back while the direction bit is set."""
    option = SignalOptions(backward_when=Condition("WHEELS.BACK", "!=", 0.0))
    frames = [frame(1020, 0), frame(1023, 0), frame(1, 0), frame(3, 0, back=1), frame(5, 0, back=1)]

    assert [0, 3, 5, 3, 1] == angles(decoder(wheel_count_rl=option), frames)


def test_the_reverse_gear_turns_signals_without_a_sign() -> None:
    """While the flag is set, unsigned counts go back; a signed speed keeps the sign that it bears."""
    dbc = DBC.replace('16|10@1+ (1,0) [0|1023] ""', '16|16@1- (0.01,0) [-99|99] "rad/s"')
    database = cantools.database.load_string(dbc, "dbc", strict=False)
    vehicle = VehicleConfig((0.3, 0.3, 0.3, 0.3), 1.5, 1.5, 2.6, teeth_per_rev=TEETH)
    signals = {
        "wheel_count_rl": "WHEELS.RL",
        "wheel_speed_rr": "WHEELS.RR",
        "reverse_gear": "WHEELS.BACK",
    }
    decoded = CanDecoder(Config(vehicle, CanConfig(signals, Path("bus.dbc"))), database)
    slowly_back = 0xFFFF - 99
    frames = [(2 * k | slowly_back << 16 | (k > 2) << 34).to_bytes(8, "little") for k in range(5)]
    reported = [
        event for k, data in enumerate(frames) for event in decoded.decode(0.02 * k, 176, False, data)
    ]
    turns = [event for event in reported if isinstance(event, RotationSample)]
    angle = {wheel: [one.angle_rad for one in turns if one.wheel == wheel] for wheel in (2, 3)}

    assert [0, 2, 4, 2, 0] == pytest.approx([turn * TEETH / (2 * math.pi) for turn in angle[2]])
    assert [-0.02] * 4 == pytest.approx([b - a for a, b in pairwise(angle[3])])


def test_teeth_by_wheel_scale_each_wheel() -> None:
    """One wheel with 96 teeth turns half as far per count as one with 48."""
    frames = [frame(0, 0), frame(2, 2), frame(4, 4)]

    assert [0, 1, 2] == angles(decoder((48.0, 96.0)), frames, wheel=3)
    assert [0, 2, 4] == angles(decoder((48.0, 96.0)), frames, wheel=2)


@pytest.mark.parametrize(
    ("option", "value"),
    [
        (SignalOptions(), math.radians(1.0)),
        (SignalOptions(sign=-1.0), -math.radians(1.0)),
        (SignalOptions(unit="rad/s"), 1.0),
        (SignalOptions(scale=0.02, offset=1.0), math.radians(3.0)),
    ],
)
def test_sign_unit_scale_and_offset(option: SignalOptions, value: float) -> None:
    """Each takes the place of what the DBC says."""
    (event,) = decoder(yaw_rate=option).decode(0.0, 177, False, (100).to_bytes(8, "little"))
    assert isinstance(event, InertialSample)
    assert pytest.approx(value) == event.value


def test_the_same_identifier_on_two_buses() -> None:
    """A signal on a further bus is read there alone, and its filter is of that bus alone."""
    main = cantools.database.load_string(DBC, "dbc", strict=False)
    database = CarDatabase(main.messages, strict=False)
    database.others = (
        cantools.database.load_string(DBC.replace("177 GYRO", "176 GYRO"), "dbc", strict=False),
    )
    signals = {"wheel_count_rl": "WHEELS.RL", "wheel_count_rr": "WHEELS.RR", "yaw_rate": "GYRO.YAW"}
    can = CanConfig(
        signals,
        Path("bus.dbc"),
        options={"yaw_rate": SignalOptions(bus="body")},
        buses={"body": BusConfig("can1", Path("body.dbc"))},
    )
    config = Config(VehicleConfig((0.3,) * 4, 1.5, 1.5, 2.6), can)
    decoded = CanDecoder(config, database)

    data = (100).to_bytes(8, "little")
    assert [InertialSample] == [type(event) for event in decoded.decode(0.0, 176, False, data, bus=1)]
    assert {RotationSample} == {type(event) for event in decoded.decode(0.0, 176, False, data)}
    assert [[0xB0], [0xB0]] == [[f["can_id"] for f in can_filters(config, database, bus)] for bus in (0, 1)]


def test_the_channels_of_a_log() -> None:
    """A log's channel belongs to the bus that is configured so, by name or by number."""
    assert {"can0": 0, "can1": 1} == bus_numbers(["can0", "can1"], "can0", ["can1"])
    assert {"0": 0, "1": 1, "2": 0} == bus_numbers(["0", "1", "2"], "can0", ["can1"])
