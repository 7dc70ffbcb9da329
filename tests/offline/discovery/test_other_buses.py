"""Cars drawn apart from the simulator, with what real buses do: multiplexers, reserved values, odd layouts.

The motion is a kinematic car's, written here; frames are packed by cantools.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cantools.database
import numpy as np
import pytest

from tpmsd.car.config.check import check
from tpmsd.car.config.dbc import load_dbc
from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.discovery.discover import discover
from tpmsd.offline.discovery.frames import BusLog
from tpmsd.offline.discovery.result import BusDiscovery
from tpmsd.offline.discovery.result_files import vehicle_text
from tpmsd.onboard.sources.can.block import block_of
from tpmsd.onboard.sources.can.frame import CanFrame
from tpmsd.onboard.sources.can.signal_plan import BitField, bit_field
from tpmsd.onboard.sources.events import GnssFix

RADIUS_M, TRACK_M, WHEELBASE_M = 0.311, 1.57, 2.71
DURATION_S, STEP_S = 480.0, 0.01


@dataclass(frozen=True)
class Motion:
    """A drive of eight minutes through bends, at 2 to 26 m/s, with two stops."""

    time_s: FloatArray
    speed: FloatArray
    """(4, n) of the wheels, m/s."""
    body: FloatArray
    """(3, n) east and north m/s, and yaw rate, of the rear axle's middle."""


def motion(seed: int, speeds: tuple[float, float] = (4.0, 25.0), lateral: float = 1.6) -> Motion:
    """`speeds` that are held for a while, m/s; `lateral`: standard deviation of the acceleration, m/s2."""
    rng = np.random.default_rng([seed, 77])
    t: FloatArray = STEP_S * np.arange(int(DURATION_S / STEP_S), dtype=np.float64)
    knots = np.concatenate([[0.0], np.repeat(rng.uniform(*speeds, 22), 2), [0.0]])
    knots[[15, 16, 33, 34]] = 0.0
    v = np.interp(t, np.linspace(0, DURATION_S, len(knots)), knots)
    v = np.convolve(v, np.ones(200) / 200, mode="same")
    wish = np.interp(t, np.arange(0, DURATION_S + 9, 9.0), rng.normal(0, lateral, int(DURATION_S / 9) + 2))
    yaw = np.clip(wish / np.maximum(v, 4.0), -0.5, 0.5) * np.minimum(v, 1.0)
    heading = np.cumsum(yaw) * STEP_S
    accel = np.gradient(v, STEP_S)
    wheels = []
    for wheel in WHEELS:
        across = (0.5 if wheel[1] == "l" else -0.5) * TRACK_M
        along = WHEELBASE_M if wheel[0] == "f" else 0.0
        slip = 1.0 + (0.006 * accel + 1.5e-6 * v**2 if wheel[0] == "f" else 0.0)
        wheels.append(np.hypot(v - across * yaw, along * yaw) * slip)
    return Motion(t, np.array(wheels), np.array([v * np.cos(heading), v * np.sin(heading), yaw]))


def fixes(drive: Motion, seed: int, latency_s: float = 0.1) -> list[GnssFix]:
    """Velocities at 5 Hz of an antenna over the rear axle, 4 cm/s of noise."""
    rng = np.random.default_rng([seed, 78])
    out = []
    for at in np.arange(1.0, DURATION_S - 1.0, 0.2):
        east, north = (
            float(np.interp(at, drive.time_s, one)) + rng.normal(0, 0.04) for one in drive.body[:2]
        )
        speed = float(np.hypot(east, north))
        course = float(np.arctan2(east, north)) if speed > 1.0 else float("nan")
        out.append(
            GnssFix(arrival_s=1e9 + at + latency_s, utc_s=1e9 + at, speed_mps=speed, course_rad=course)
        )
    return out


@dataclass(frozen=True)
class Bus:
    """How a car sends its wheels: DBC lines, and what each frame of a message holds."""

    dbc: str
    period_s: float
    kind: str
    step: float
    """Metres per second, or counts per metre, of one raw step of the wheels' signals."""
    base: int = 0
    modulus: int = 0
    reserved: int = 0
    """Raw number that stands for no value; 0: none."""
    teeth: tuple[float, float, float, float] = (48.0, 48.0, 48.0, 48.0)


def _message(identifier: int, name: str, size: int, *signals: str) -> str:
    return "\n".join(
        [f"BO_ {identifier} {name}: {size} ABS", *(f" SG_ {one} ABS" for one in signals), "", ""]
    )


EXTENDED = 1 << 31
NEEDS_DBC = ("multiplexed speeds", "29 bit, reserved 0x3FFF")
"""Without a DBC these stay undecided: branches share their bits, and reserved numbers flip the top bits of a
speed more often than the speed does."""
BUSES = {
    "multiplexed speeds": Bus(
        _message(
            0x1A0, "MUXED", 8, 'SELECT M : 0|2@1+ (1,0) [0|3] ""', 'A m0 : 16|16@1+ (0.01,0) [0|0] "km/h"',
            'B m0 : 32|16@1+ (0.01,0) [0|0] "km/h"', 'C m1 : 16|16@1+ (0.01,0) [0|0] "km/h"',
            'D m1 : 32|16@1+ (0.01,0) [0|0] "km/h"',
        ),
        0.01, "speed", 0.01 / 3.6,
    ),
    "29 bit, reserved 0x3FFF": Bus(
        _message(
            EXTENDED | 0x18FE6E0B, "EEC", 8, 'A : 0|14@1+ (0.01,0) [0|0] "km/h"',
            'B : 16|14@1+ (0.01,0) [0|0] "km/h"', 'C : 32|14@1+ (0.01,0) [0|0] "km/h"',
            'D : 48|14@1+ (0.01,0) [0|0] "km/h"',
        ),
        0.02, "speed", 0.01 / 3.6, reserved=0x3FFF,
    ),
    "CAN FD, offset, checksum": Bus(
        _message(
            0x0C5, "WHEELS", 32, 'CRC : 0|16@1+ (1,0) [0|0] ""', 'ALIVE : 16|8@1+ (1,0) [0|0] ""',
            'A : 71|16@0+ (0.01,-67.67) [0|0] "km/h"', 'B : 87|16@0+ (0.01,-67.67) [0|0] "km/h"',
            'C : 103|16@0+ (0.01,-67.67) [0|0] "km/h"', 'D : 119|16@0+ (0.01,-67.67) [0|0] "km/h"',
        ),
        0.02, "speed", 0.01 / 3.6, base=6767,
    ),
    "one message per wheel, counts": Bus(
        "".join(
            _message(
                0x210 + k, f"W{k}", 8, f'{"ABCD"[k]} : 13|14@0+ (1,0) [0|0] ""',
                'ALIVE : 48|4@1+ (1,0) [0|0] ""',
                'CRC : 56|8@1+ (1,0) [0|0] ""',
            )
            for k in range(4)
        ),
        0.02, "count", 48 / (2 * np.pi * RADIUS_M), modulus=1 << 14,
    ),
    "signed speeds in m/s": Bus(
        _message(
            0x3D0, "V", 8, 'A : 0|16@1- (0.005,0) [0|0] "m/s"', 'B : 16|16@1- (0.005,0) [0|0] "m/s"',
            'C : 32|16@1- (0.005,0) [0|0] "m/s"', 'D : 48|16@1- (0.005,0) [0|0] "m/s"',
        ),
        0.02, "speed", 0.005,
    ),
    "twelve bits above an alive counter": Bus(
        _message(
            0x215, "WHL", 8, 'ALIVE : 0|4@1+ (1,0) [0|0] ""', 'A : 4|12@1+ (0.1,0) [0|0] "km/h"',
            'B : 16|12@1+ (0.1,0) [0|0] "km/h"', 'C : 28|12@1+ (0.1,0) [0|0] "km/h"',
            'D : 40|12@1+ (0.1,0) [0|0] "km/h"', 'CRC : 56|8@1+ (1,0) [0|0] ""',
        ),
        0.02, "speed", 0.1 / 3.6,
    ),
    "revolutions per minute": Bus(
        _message(
            0x2A1, "N", 8, 'A : 7|16@0+ (0.125,0) [0|0] "rpm"', 'B : 23|16@0+ (0.125,0) [0|0] "rpm"',
            'C : 39|16@0+ (0.125,0) [0|0] "rpm"', 'D : 55|16@0+ (0.125,0) [0|0] "rpm"',
        ),
        0.02, "speed", 0.125 * 2 * np.pi / 60 * RADIUS_M,
    ),
}  # fmt: skip


def frames(bus: Bus, drive: Motion, order: list[int], seed: int) -> list[CanFrame]:
    """Frames whose signals A to D are the wheels in `order` (indices of `WHEELS`)."""
    rng = np.random.default_rng([seed, 79])
    database = cantools.database.can.Database()
    database.add_dbc_string(bus.dbc)
    times = np.arange(0.0, DURATION_S - 1.0, bus.period_s)
    raw = {}
    for letter, wheel in zip("ABCD", order, strict=True):
        if bus.kind == "count":
            distance = np.cumsum(drive.speed[wheel]) * STEP_S
            number = np.floor(np.interp(times, drive.time_s, distance) * bus.step).astype(np.int64) + 999
            raw[letter] = number % bus.modulus
        else:
            number = np.rint(np.interp(times, drive.time_s, drive.speed[wheel]) / bus.step).astype(np.int64)
            raw[letter] = number + bus.base
    if bus.reserved:
        silent = (times < 15.0) | (rng.random(len(times)) < 0.01)
        raw = {letter: np.where(silent, bus.reserved, number) for letter, number in raw.items()}
    out = []
    for k, at in enumerate(times.tolist()):
        for message in database.messages:
            numbers = {"SELECT": k % 2, "CRC": int(rng.integers(1 << 8)), "ALIVE": k % 16}
            numbers |= {letter: int(one[k]) for letter, one in raw.items()}
            wanted = {signal.name: numbers[signal.name] for signal in message.signals}
            data = message.encode(wanted, scaling=False, strict=False)
            extended = message.is_extended_frame
            out.append(CanFrame(1e9 + at, "can0", message.frame_id, extended, False, False, False, data))
    return out


def drawn(
    name: str, seed: int, speeds: tuple[float, float] = (4.0, 25.0), lateral: float = 1.6
) -> tuple[Motion, list[int], BusLog]:
    """A drive on this bus, with the wheels in an order of its own."""
    drive, order = motion(seed, speeds, lateral), [int(k) for k in np.random.default_rng(seed).permutation(4)]
    log = BusLog()
    log.add(block_of(frames(BUSES[name], drive, order, seed)))
    return drive, order, log


def lowest_bit(key: int, layout: BitField) -> tuple[int, int]:
    """Identifier, and the place of the lowest bit in the payload."""
    at = layout.shift
    return key, 8 * (layout.word_bytes - 1 - at // 8) + at % 8 if layout.big_endian else at


def places(name: str, order: list[int]) -> dict[str, tuple[int, int]]:
    """Where each wheel's number truly begins, on a bus of 11-bit identifiers."""
    database = cantools.database.can.Database()
    database.add_dbc_string(BUSES[name].dbc)
    signals = {
        signal.name: lowest_bit(message.frame_id, bit_field(signal))
        for message in database.messages
        for signal in message.signals
    }
    return {WHEELS[wheel]: signals[letter] for letter, wheel in zip("ABCD", order, strict=True)}


def found_places(found: BusDiscovery) -> dict[str, tuple[int, int]]:
    return {role[-2:]: lowest_bit(one.field.key, one.field.layout) for role, one in found.roles.items()}


@pytest.mark.parametrize("name", list(BUSES))
def test_wheels_of_other_buses(name: str, tmp_path: Path) -> None:
    """The wheels are found under permuted names that say nothing, and the file written passes the check."""
    bus, seed = BUSES[name], list(BUSES).index(name)
    drive, order, log = drawn(name, seed)
    (tmp_path / "bus.dbc").write_text('VERSION ""\n\nBU_: ABS\n\n' + bus.dbc)
    found = discover(log, fixes(drive, seed), load_dbc(tmp_path / "bus.dbc"))

    got = {role[-2:]: one.field.name for role, one in found.roles.items() if role.startswith("wheel_")}
    assert {WHEELS[wheel]: letter for letter, wheel in zip("ABCD", order, strict=True)} == got
    assert bus.kind + "s" == found.kind
    assert "front" == (found.driven_axle or ("", 0.0))[0]
    base, latency = found.geometry["wheelbase_m"], found.gnss["latency_s"]
    assert abs(base.value - WHEELBASE_M) < 3 * base.std
    assert abs(latency.value - 0.1) < 3 * latency.std < 0.1
    if bus.reserved:
        assert {(bus.reserved,)} == {one.invalid for one in found.roles.values()}
    (tmp_path / "vehicle.toml").write_text(vehicle_text(found, "bus.dbc"))
    assert () == check(tmp_path / "vehicle.toml").problems
    raw = discover(log, fixes(drive, seed), None)
    assert raw.wheels_decided == (name not in NEEDS_DBC)
    assert ({} if name in NEEDS_DBC else places(name, order)) == found_places(raw)


def test_bytes_of_two_wheels_make_no_speed() -> None:
    """One wheel's high byte with its neighbour's low byte follows the speed, too, and is not taken."""
    name, seed = "signed speeds in m/s", 103
    drive, order, log = drawn(name, seed)

    assert places(name, order) == found_places(discover(log, fixes(drive, seed), None))


def test_slip_by_air_drag_is_no_longer_way(tmp_path: Path) -> None:
    """Gentle bends and a fast road: front wheels that slip by drag are told from rear ones all the same."""
    name, seed = "one message per wheel, counts", 305
    (tmp_path / "bus.dbc").write_text('VERSION ""\n\nBU_: ABS\n\n' + BUSES[name].dbc)
    drive, order, log = drawn(name, seed, (8.0, 38.0), 0.8)
    found = discover(log, fixes(drive, seed), load_dbc(tmp_path / "bus.dbc"))

    assert found.wheels_decided
    assert places(name, order) == found_places(found)


@pytest.mark.parametrize("seed", [200, 201, 202])
def test_the_wheelbase_of_speeds_is_exact_but_for_rounding(seed: int, tmp_path: Path) -> None:
    """Neither drag slip nor a number at standstill that is known to centimetres per second moves it."""
    name = "signed speeds in m/s"
    (tmp_path / "bus.dbc").write_text('VERSION ""\n\nBU_: ABS\n\n' + BUSES[name].dbc)
    drive, _, log = drawn(name, seed, (4.0, 38.0))
    found = discover(log, fixes(drive, seed), load_dbc(tmp_path / "bus.dbc"))

    assert found.geometry["wheelbase_m"].value == pytest.approx(WHEELBASE_M, abs=0.05)


@pytest.mark.parametrize("seed", [402, 403])
def test_the_antenna_on_a_motorway(seed: int, tmp_path: Path) -> None:
    """Where a count of a wheel is as large as a cell's yaw rate, latency and side slip make no lever arm."""
    name = "one message per wheel, counts"
    (tmp_path / "bus.dbc").write_text('VERSION ""\n\nBU_: ABS\n\n' + BUSES[name].dbc)
    drive, _, log = drawn(name, seed, (22.0, 33.0), 0.6)
    found = discover(log, fixes(drive, seed), load_dbc(tmp_path / "bus.dbc"))

    forward = found.gnss["antenna_forward_m"]
    assert abs(forward.value) < 1.5 * forward.std
