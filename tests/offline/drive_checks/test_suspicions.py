"""A wrong configuration is found out by the drive, with the right name, and a right one is left alone."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench.campaigns.offline.drawn_buses import LAYOUTS, DrawnBus, draw
from tpmsd.car.config.dbc import load_dbc
from tpmsd.car.config.model import CanConfig, Config, GnssConfig, SignalOptions
from tpmsd.foundation.wheels import WHEELS
from tpmsd.interfaces.cli.main import main
from tpmsd.offline.discovery.other_roles import find_gyro
from tpmsd.offline.discovery.prepared_log import prepare
from tpmsd.offline.drive_checks.check_drive import suspicions
from tpmsd.offline.drive_checks.suspicion import Suspicion
from tpmsd.onboard.sources.events import GnssFix

_DRAWN: dict[str, DrawnBus] = {}


def drawn(name: str) -> DrawnBus:
    if name not in _DRAWN:
        layout = next(one for one in LAYOUTS if one.name == name)
        _DRAWN[name] = draw(7_100 + LAYOUTS.index(layout), 600.0, layout)
    return _DRAWN[name]


def right(bus: DrawnBus, folder: Path) -> Config:
    """The configuration that the car deserves."""
    file = folder / "bus.dbc"
    file.write_text(bus.dbc)
    what = bus.layout.kind.removesuffix("s")
    signals = {f"wheel_{what}_{wheel}": bus.truth[wheel] for wheel in WHEELS}
    options = {}
    if bus.layout.modulus:
        options = {role: SignalOptions(modulus=bus.layout.modulus) for role in signals}
    gnss = GnssConfig(antenna_forward_m=bus.spec.antenna_forward_m, antenna_left_m=bus.spec.antenna_left_m)
    return Config(bus.spec.vehicle, CanConfig(signals, file, options=options), gnss)


def ask(config: Config, bus: DrawnBus, fixes: list[GnssFix] | None = None) -> list[Suspicion]:
    return suspicions(config, load_dbc(config.can.dbc), bus.log, fixes or bus.fixes)


def swapped(config: Config, *pairs: tuple[str, str]) -> Config:
    signals = dict(config.can.signals)
    for one, other in pairs:
        keys = [next(role for role in signals if role.endswith(wheel)) for wheel in (one, other)]
        signals[keys[0]], signals[keys[1]] = signals[keys[1]], signals[keys[0]]
    return replace(config, can=replace(config.can, signals=signals))


def options(config: Config, option: SignalOptions) -> Config:
    return replace(config, can=replace(config.can, options=dict.fromkeys(config.can.signals, option)))


CARS = ("counts10-1001", "speeds-0.0075")


@pytest.mark.parametrize("name", CARS)
def test_a_right_file_is_left_alone(name: str, tmp_path: Path) -> None:
    """The true configuration raises no suspicion."""
    bus = drawn(name)
    assert [] == ask(right(bus, tmp_path), bus)


@pytest.mark.parametrize("name", CARS)
def test_wrong_statements_are_found(name: str, tmp_path: Path) -> None:
    """Each wrong statement is named as what it is, at its key, with nothing else suspected beside it."""
    bus = drawn(name)
    config = right(bus, tmp_path)
    what = "count" if bus.layout.kind == "counts" else "speed"
    axle = "rear" if bus.spec.vehicle.driven_axle == "front" else "front"
    vehicle, gnss = config.vehicle, config.gnss
    wrong = {
        ("swapped_left_right", f"can.signals.wheel_{what}_fl"): swapped(config, ("fl", "fr"), ("rl", "rr")),
        ("swapped_front_rear", f"can.signals.wheel_{what}_fl"): swapped(config, ("fl", "rl"), ("fr", "rr")),
        ("wrong_driven_axle", "vehicle.driven_axle"): replace(
            config, vehicle=replace(vehicle, driven_axle=axle)
        ),
        ("wrong_antenna", "gnss.antenna_left_m"): replace(
            config, gnss=replace(gnss, antenna_left_m=gnss.antenna_left_m + 0.8)
        ),
        ("wrong_antenna", "gnss.antenna_forward_m"): replace(
            config, gnss=replace(gnss, antenna_forward_m=gnss.antenna_forward_m + 2.0)
        ),
    }
    if what == "count":
        teeth = vehicle.teeth_per_rev - 4
        key = ("wrong_teeth", "vehicle.teeth_per_rev")
        wrong[key] = replace(config, vehicle=replace(vehicle, teeth_per_rev=teeth))
        wrong[("wrong_modulus", "can.signals.wheel_count_fl")] = options(config, SignalOptions(modulus=1024))
    else:
        wrong[("wrong_unit", "can.signals.wheel_speed_fl")] = options(config, SignalOptions(unit="mph"))
        wrong[("wrong_scale", "can.signals.wheel_speed_fl")] = options(config, SignalOptions(scale=0.01))
    for (suspicion, at), bad in wrong.items():
        found = ask(bad, bus)
        assert {suspicion} == {one.suspicion for one in found}, suspicion
        assert at in {one.key for one in found}
        assert min(one.probability for one in found) >= 0.95


def test_a_unit_of_rotation_and_a_stated_scale_are_told_apart(tmp_path: Path) -> None:
    """Rad/s for rpm and rpm for rad/s are wrong units; a stated scale is wrong whatever unit it fits."""
    bus = drawn(CARS[1])
    config = right(bus, tmp_path)
    radius_m = config.vehicle.wheel_radius_m[0]
    as_radps = 0.0075 / 3.6 / radius_m
    as_rpm = as_radps * 60.0 / (2.0 * np.pi)
    assert [] == ask(options(config, SignalOptions(scale=as_radps, unit="rad/s")), bus)
    wrong = {
        SignalOptions(scale=as_radps, unit="rpm"): ("wrong_unit", 'unit = "rad/s"'),
        SignalOptions(scale=as_rpm, unit="rad/s"): ("wrong_unit", 'unit = "rpm"'),
        SignalOptions(scale=0.0075 / 1.609): ("wrong_scale", "scale = 0.007"),
    }
    for option, (suspicion, suggest) in wrong.items():
        found = ask(options(config, option), bus)
        assert {suspicion} == {one.suspicion for one in found}
        assert all(one.suggest.startswith(suggest) for one in found)


def test_other_signals_of_the_wrong_size(tmp_path: Path) -> None:
    """Gyro and accelerometer are held against the car's motion, to the unit or the scale that fits."""
    bus = drawn(CARS[1])
    config = right(bus, tmp_path)
    names = {
        signal.unit: f"{message.name}.{signal.name}"
        for message in load_dbc(config.can.dbc).messages
        for signal in message.signals
        if signal.unit in ("deg/s", "m/s2")
    }
    roles = {"yaw_rate": names["deg/s"], "accel_lat": names["m/s2"]}
    fitted = replace(config, can=replace(config.can, signals={**config.can.signals, **roles}))
    wrong = {
        ("can.signals.yaw_rate", "wrong_unit"): {"yaw_rate": SignalOptions(unit="rad/s")},
        ("can.signals.accel_lat", "wrong_unit"): {"accel_lat": SignalOptions(unit="g")},
        ("can.signals.accel_lat", "wrong_scale"): {"accel_lat": SignalOptions(scale=0.02)},
    }

    assert [] == ask(fitted, bus)
    for expected, option in wrong.items():
        found = ask(replace(fitted, can=replace(fitted.can, options=option)), bus)
        assert [expected] == [(one.key, one.suspicion) for one in found]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_gyro_of_either_sign_is_turned_also_where_cells_are_unknown(tmp_path: Path, sign: float) -> None:
    """Cells without readings leave the gyro's sign to be seen, and with it which wheels are left."""
    bus = drawn(CARS[1])
    config = right(bus, tmp_path)
    found = prepare(bus.log, bus.fixes, load_dbc(config.can.dbc))
    gyro = next(one for one in found.series if one.field.unit == "deg/s" and one.kind == "value")
    rate = sign * gyro.rate
    rate[np.flatnonzero(found.reference.moving)[100::100]] = np.nan
    reported = find_gyro([replace(gyro, rate=rate)], found.reference)

    assert reported is not None
    both = np.isfinite(reported) & np.isfinite(found.reference.yaw_radps)
    assert 0.9 < np.corrcoef(reported[both], found.reference.yaw_radps[both])[0, 1]


@pytest.mark.parametrize("offset_s", [1.0, -3.0, 10.0, -45.0, 3600.0])
def test_clocks_that_are_apart(offset_s: float, tmp_path: Path) -> None:
    """A log on another clock is found out to the latency, from a second on and where files do not overlap."""
    bus = drawn(CARS[0])
    moved = [replace(fix, arrival_s=fix.arrival_s + offset_s) for fix in bus.fixes]
    (found,) = ask(right(bus, tmp_path), bus, moved)

    assert ("gnss", "clock_offset") == (found.key, found.suspicion)
    shift_s = float(found.suggest.split("shift them by ")[1].removesuffix(" s"))
    assert pytest.approx(-offset_s - bus.spec.receiver.latency_s, abs=0.51) == shift_s
    assert (abs(offset_s) > 600) == ("do not overlap" in found.suggest)


def test_a_message_that_never_came(tmp_path: Path) -> None:
    """A role whose message is not in the log is named."""
    bus = drawn(CARS[0])
    config = right(bus, tmp_path)
    extra = 'BO_ 2000 GHOST: 8 CAR\n SG_ YAW : 0|16@1- (0.01,0) [0|0] "deg/s" CAR\n'
    config.can.dbc.write_text(bus.dbc + "\n" + extra)
    signals = {**config.can.signals, "yaw_rate": "GHOST.YAW"}
    (found,) = ask(replace(config, can=replace(config.can, signals=signals)), bus)
    assert ("can.signals.yaw_rate", "message_never_seen") == (found.key, found.suspicion)


@pytest.mark.parametrize(
    "name", ["rav4-suburb-60s", "van-motorway-a", "van-motorway-lost-counts", "van-oval"]
)
def test_real_drives_and_their_files(recordings: Path, tmp_path: Path, name: str) -> None:
    """The real drives do not speak against their own configurations."""
    target = tmp_path / "check.json"
    assert 0 == main(["check", "--drive", str(recordings / name), "--json", str(target)])
    assert [] == json.loads(target.read_text())["suspicions"]


def test_lines_of_the_file(recordings: Path, tmp_path: Path) -> None:
    """A suspicion names the line of its key in the file."""
    drive = recordings / "van-motorway-a"
    text = (drive / "vehicle.toml").read_text().replace("COUNT_RL", "X").replace("COUNT_RR", "COUNT_RL")
    text = text.replace("ENCODERS.X", "ENCODERS.COUNT_RR").replace(
        '"bus.dbc"', json.dumps(str(drive / "bus.dbc"))
    )
    file = tmp_path / "vehicle.toml"
    file.write_text(text)
    target = tmp_path / "check.json"
    assert 0 == main(["check", str(file), "--drive", str(drive), "--json", str(target)])
    (found,) = json.loads(target.read_text())["suspicions"]

    assert "swapped_left_right" == found["suspicion"]
    assert text.splitlines()[found["line"] - 1].startswith("wheel_count_rl")
