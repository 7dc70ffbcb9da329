"""Logs of several buses: where the wheels are is found and written; a copied message is no second one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.offline.discovery.test_other_buses import (
    BUSES,
    RADIUS_M,
    TRACK_M,
    WHEELBASE_M,
    fixes,
    frames,
    motion,
)
from tpmsd.car.config.check import check
from tpmsd.car.config.dbc import load_dbc
from tpmsd.car.config.model import (
    BusConfig,
    CanConfig,
    Condition,
    Config,
    GnssConfig,
    SignalOptions,
    VehicleConfig,
)
from tpmsd.foundation.wheels import WHEELS
from tpmsd.interfaces.cli.discover import write_files
from tpmsd.offline.discovery.discover import discover
from tpmsd.offline.discovery.frames import BusLog
from tpmsd.offline.drive_checks.check_drive import suspicions
from tpmsd.offline.drive_checks.configured import configured_fields, configured_frames
from tpmsd.onboard.sources.can.block import block_of
from tpmsd.onboard.sources.can.databases import load_databases
from tpmsd.onboard.sources.can.frame import CanFrame

NAME, SEED = "one message per wheel, counts", 311
FRONT, REAR = {0x210, 0x211}, {0x212, 0x213}


def bus_log(sent: list[CanFrame]) -> BusLog:
    log = BusLog()
    log.add(block_of(sorted(sent, key=lambda frame: frame.time_s)))
    return log


def two_buses() -> list[CanFrame]:
    """Front wheels on can1 and rear wheels on can0, which a gateway copies to can2 but for a few frames."""
    sent = frames(BUSES[NAME], motion(SEED), [0, 1, 2, 3], SEED)
    front = [one._replace(channel="can1") for one in sent if one.arbitration_id in FRONT]
    rear = [one for one in sent if one.arbitration_id in REAR]
    late = [one._replace(channel="can2", time_s=one.time_s + 0.002) for k, one in enumerate(rear) if k % 50]
    return front + rear + late


def dbc_file(folder: Path, extra: str = "") -> Path:
    file = folder / "bus.dbc"
    file.write_text('VERSION ""\n\nBU_: ABS\n\n' + BUSES[NAME].dbc + extra)
    return file


@pytest.mark.parametrize("with_dbc", [True, False])
def test_wheels_on_two_buses(with_dbc: bool, tmp_path: Path) -> None:
    """Each wheel is found on its own bus, and the file written names both."""
    dbc = dbc_file(tmp_path) if with_dbc else None
    drive = motion(SEED)
    found = discover(bus_log(two_buses()), fixes(drive, SEED), load_dbc(dbc) if dbc else None)

    assert found.wheels_decided
    received = {
        role[-2:]: found.channel(one.bus) for role, one in found.roles.items() if role.startswith("wheel_")
    }
    assert {"fl": "can1", "fr": "can1", "rl": "can0", "rr": "can0"} == received
    write_files(found, dbc, tmp_path / "vehicle.toml")
    result = check(tmp_path / "vehicle.toml")
    assert () == result.problems
    assert result.plan is not None
    can = result.plan.config.can
    channels = [can.channel, *(bus.channel for bus in can.buses.values())]
    assert received == {role[-2:]: channels[can.bus_number(role)] for role in can.signals if "wheel" in role}


def test_identifiers_that_two_buses_share() -> None:
    """Other contents under the same identifier on another bus are no wheel, and disturb none."""
    sent, drive = frames(BUSES[NAME], motion(SEED), [0, 1, 2, 3], SEED), motion(SEED)
    rng = np.random.default_rng(5)
    noise = [one._replace(channel="can7", data=rng.bytes(8), time_s=one.time_s + 0.003) for one in sent]
    found = discover(bus_log(sent + noise), fixes(drive, SEED), None)

    assert found.wheels_decided
    assert {"can0"} == {found.channel(one.bus) for one in found.roles.values()}


def configuration(dbc: Path, options: dict[str, SignalOptions]) -> Config:
    vehicle = VehicleConfig(
        (RADIUS_M, RADIUS_M, RADIUS_M, RADIUS_M),
        TRACK_M,
        TRACK_M,
        WHEELBASE_M,
        driven_axle="front",
        teeth_per_rev=48.0,
    )
    signals = {f"wheel_count_{wheel}": f"W{k}.{'ABCD'[k]}" for k, wheel in enumerate(WHEELS)}
    return Config(vehicle, CanConfig(signals, dbc, options=options), GnssConfig())


def test_numbers_count_only_where_they_are_valid(tmp_path: Path) -> None:
    """Frames count while another message's flag says so; garbage beside them raises no suspicion."""
    dbc = dbc_file(tmp_path, 'BO_ 801 Q: 1 ABS\n SG_ QF : 0|2@1+ (1,0) [0|3] "" ABS\n\n')
    drive, rng = motion(SEED), np.random.default_rng(6)
    sent: list[CanFrame] = []
    valid = 0
    for one in frames(BUSES[NAME], drive, [0, 1, 2, 3], SEED):
        spoilt = int(one.time_s / 2.0) % 20 == 0
        valid += one.arbitration_id == 0x210 and not spoilt
        sent.append(one._replace(data=rng.bytes(8) if spoilt else one.data))
        if one.arbitration_id == 0x210:
            flag = bytes([2 if spoilt else 1])
            sent.append(one._replace(arbitration_id=801, data=flag, time_s=one.time_s - 1e-4))
    option = SignalOptions(valid_when=Condition("Q.QF", "==", 1.0))
    config = configuration(dbc, {f"wheel_count_{wheel}": option for wheel in WHEELS})
    database, log = load_dbc(dbc), bus_log(sent)
    kept = configured_frames(config, database, log, configured_fields(config, database, log))

    assert dict.fromkeys(config.can.signals, valid) == {role: len(one.time_s) for role, one in kept.items()}
    assert [] == suspicions(config, database, log, fixes(drive, SEED))


def test_signals_of_a_further_bus_are_checked(tmp_path: Path) -> None:
    """A left and a right wheel that are exchanged on the second bus are found out."""
    dbc = dbc_file(tmp_path)
    option = SignalOptions(bus="chassis")
    config = configuration(dbc, {"wheel_count_fl": option, "wheel_count_fr": option})
    buses = {"chassis": BusConfig("can1", dbc)}
    right = replace(config, can=replace(config.can, buses=buses))
    names = right.can.signals
    turned = {**names, "wheel_count_fl": names["wheel_count_fr"], "wheel_count_fr": names["wheel_count_fl"]}
    wrong = replace(right, can=replace(right.can, signals=turned))
    log, there, database = bus_log(two_buses()), fixes(motion(SEED), SEED), load_databases(right)

    assert [] == suspicions(right, database, log, there)
    assert [("can.signals.wheel_count_fl", "swapped_left_right")] == [
        (one.key, one.suspicion) for one in suspicions(wrong, database, log, there)
    ]
