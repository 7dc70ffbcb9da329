"""The car library: every entry is a bus on which the wheels are found, and a configuration that is right."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from bench.campaigns.offline.drawn_buses import gnss_fixes
from tpmsd.car.config.check import check
from tpmsd.car.config.dbc import load_dbc
from tpmsd.car.config.units import UNITS
from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.wheels import WHEELS
from tpmsd.interfaces.api.car_library import load_cars
from tpmsd.interfaces.cli.main import main
from tpmsd.offline.discovery.car_start import discovery_of_car
from tpmsd.offline.discovery.discover import discover
from tpmsd.offline.discovery.frames import BusLog
from tpmsd.offline.discovery.library import CarPlatform, car_from, field_of, match_car
from tpmsd.offline.discovery.raw_fields import dbc_start
from tpmsd.offline.discovery.result_files import dbc_text
from tpmsd.offline.simulator.drive import DriveSpec, SimulatedDrive, simulate_drive
from tpmsd.offline.simulator.frame_layout import MessageLayout, SignalLayout
from tpmsd.onboard.sources.can.block import block_of
from tpmsd.onboard.sources.can.frame import CanFrame
from tpmsd.onboard.sources.can.signal_plan import EXTENDED

CARS = {car.name: car for car in load_cars()}


@cache
def drive() -> SimulatedDrive:
    return simulate_drive(DriveSpec(duration_s=360.0, seed=4))


def log_of(car: CarPlatform) -> BusLog:
    """The frames of a bus as the entry describes it, of one simulated drive."""
    world = drive().world
    rng = np.random.default_rng(1)
    log = BusLog()
    messages: dict[int, list[str]] = {}
    for role, entry in car.signals.items():
        messages.setdefault(field_of(entry).key, []).append(role)
    for key, roles in messages.items():
        stamps = np.arange(0.02, float(world.motion.time_s[-1]), 0.02)
        layouts, raw = [], {}
        for role in roles:
            entry, field = car.signals[role], field_of(car.signals[role])
            wheel = WHEELS.index(role[-2:])
            bits = field.layout
            layout = SignalLayout(role, dbc_start(field), bits.length, bits.big_endian, bits.signed)
            layouts.append(layout)
            counts = world.counts_at(stamps, wheel)
            if role.startswith("wheel_count_"):
                modulus = int(entry.get("modulus", 1 << bits.length))
                raw[role] = (np.floor(counts / field.scale).astype(np.int64) + 100) % modulus
                continue
            omega = (counts - world.counts_at(stamps - 0.02, wheel)) / 48 * 2 * np.pi / 0.02
            kind, factor, _ = UNITS[field.unit]
            speed = omega / factor if kind == "angular speed" else omega * 0.316 / factor
            raw[role] = np.clip(np.rint((speed - field.offset) / field.scale), 0, bits.mask).astype(np.int64)
        size = max(int(car.signals[role].get("length", 8)) for role in roles)
        rows = MessageLayout(key, "M", 0.02, tuple(layouts), size).pack(raw, len(stamps))
        host = drive().spec.clocks.host_s(stamps + rng.exponential(0.0004, len(stamps)))
        identifier, extended = key & ~EXTENDED, bool(key & EXTENDED)
        frames = [
            CanFrame(time_s, "can0", identifier, extended, size > 8, False, False, row.tobytes())
            for time_s, row in zip(host.tolist(), rows, strict=True)
        ]
        log.add(block_of(frames))
    return log


def test_at_least_twenty() -> None:
    """The library holds the platforms that it promises."""
    assert len(CARS) >= 20


@pytest.mark.parametrize("name", CARS)
def test_a_drive_on_every_bus(name: str, tmp_path: Path) -> None:
    """A drive on the entry's bus gives its wheels, its modulus, and its name."""
    car = CARS[name]
    file = tmp_path / "bus.dbc"
    file.write_text(dbc_text(discovery_of_car(car)))
    found = discover(log_of(car), gnss_fixes(drive()), load_dbc(file), cars=list(CARS.values()))

    expected = car.signal_names()
    assert expected == {role: one.field.signal for role, one in found.roles.items() if role in expected}
    assert set(expected.values()) == set(CARS[str(found.car)].signal_names().values())
    for role, entry in car.signals.items():
        assert entry.get("modulus", 0) == found.roles[role].modulus


@pytest.mark.parametrize("name", CARS)
def test_what_init_writes_is_right(name: str, tmp_path: Path) -> None:
    """The written configuration passes the check with every wheel of the entry."""
    target = tmp_path / "vehicle.toml"
    assert 0 == main(["init", "--car", name, "--write", str(target)])
    result = check(target)
    assert () == result.problems
    assert result.plan is not None
    assert list(WHEELS) == [wheel.wheel for wheel in result.plan.wheels]


def test_what_no_library_knows_is_called_a_usual_value(capsys: pytest.CaptureFixture[str]) -> None:
    """A number of teeth that is only usual has no probability; nor a 0."""
    assert 0 == main(["init", "--car", "vw_mqb"])
    text = capsys.readouterr().out

    assert "teeth_per_rev = 48   # a usual value: not measured" in text
    assert "probability 0.00" not in text


def test_a_wrong_name(capsys: pytest.CaptureFixture[str]) -> None:
    """A name that is not there comes with the nearest that is."""
    assert 2 == main(["init", "--car", "vw_mqp"])
    assert "did you mean vw_mqb?" in capsys.readouterr().err


@pytest.mark.parametrize(
    "data", [{}, {"signals": {"x": {}}}, {"colour": 1}, {"signals": {"wheel_count_fl": {}}}]
)
def test_an_entry_that_is_none(data: dict[str, object]) -> None:
    """A file without wheel signals, or with keys nobody knows, is refused by name."""
    with pytest.raises(ConfigError, match="car mine"):
        car_from("mine", data)


def exchanged(car: CarPlatform) -> CarPlatform:
    """The bus with left and right wheels in each other's places, under names that tell nothing."""
    other = {"l": "r", "r": "l"}
    signals = {
        role: {**car.signals[role[:-1] + other[role[-1]]], "signal": f"M1.S{number}"}
        for number, role in enumerate(car.signals)
    }
    return CarPlatform("exchanged", "Exchanged", "", signals)


def test_a_layout_is_a_weak_prior(tmp_path: Path) -> None:
    """Wheels in a known platform's places in other roles are told by the drive; the platform is not named."""
    car = exchanged(CARS["toyota"])
    file = tmp_path / "bus.dbc"
    file.write_text(dbc_text(discovery_of_car(car)))
    found = discover(log_of(car), gnss_fixes(drive()), load_dbc(file), cars=[CARS["toyota"]])

    expected = car.signal_names()
    assert expected == {role: one.field.signal for role, one in found.roles.items() if role in expected}
    assert found.car is None


def test_a_name_alone_is_no_match(tmp_path: Path) -> None:
    """Signals called as a platform's, in another message's place, are not that platform's."""
    toyota = CARS["toyota"]
    signals = {role: {**entry, "id": int(entry["id"]) + 1} for role, entry in toyota.signals.items()}
    elsewhere = CarPlatform("elsewhere", "Elsewhere", "", signals)

    assert match_car([toyota], [field_of(entry) for entry in signals.values()]) is None
    assert match_car([elsewhere], [field_of(entry) for entry in signals.values()]) is not None
