"""Whole drives: reproducible, in the public format, and truthful."""

from __future__ import annotations

import json
import re
import time
import tomllib
from pathlib import Path

import cantools
import numpy as np
import pytest

from tests.offline.simulator.drives import straight
from tpmsd.car.physics.catalogue import make_effect
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.foundation.errors import ConfigError, TpmsdError
from tpmsd.foundation.wheels import WHEELS
from tpmsd.offline.simulator.bus import BusSpec
from tpmsd.offline.simulator.bus_layouts import BUS_KINDS
from tpmsd.offline.simulator.clock import Clocks
from tpmsd.offline.simulator.drive import DriveSpec, simulate_drive
from tpmsd.offline.simulator.drive_writer import write_drive
from tpmsd.offline.simulator.faults import Fault
from tpmsd.offline.simulator.receiver import ReceiverSpec

PUNCTURE = Fault("puncture", 2.0, "percent", "rl", onset_s=30.0, duration_s=10.0)


def short(**options: object) -> DriveSpec:
    """A minute on an oval."""
    return DriveSpec(**{"route": "oval", "duration_s": 60.0, **options})


def files_of(folder: Path) -> dict[str, bytes]:
    """All that is in a folder."""
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


@pytest.mark.parametrize("kind", BUS_KINDS)
def test_the_same_seed_writes_the_same_files(tmp_path: Path, kind: str) -> None:
    """Every file is the same to the byte; another seed changes all that is measured."""
    for name, seed in (("a", 5), ("b", 5), ("c", 6)):
        write_drive(tmp_path / name, simulate_drive(short(seed=seed, bus=BusSpec(kind=kind))))
    first, again, other = (files_of(tmp_path / name) for name in "abc")

    assert ["bus.dbc", "can.log", "gnss.nmea", "truth.json", "vehicle.toml"] == list(first)
    assert first == again
    assert [name for name in first if first[name] != other[name]] == ["can.log", "gnss.nmea", "truth.json"]


def test_a_fault_changes_nothing_before_its_onset() -> None:
    """Noise is drawn apart from faults: up to the onset, both drives have the same frames and sentences."""
    healthy, faulty = simulate_drive(short()), simulate_drive(short(faults=(PUNCTURE,)))
    before = healthy.frames.time_s < healthy.spec.clocks.start_utc_s + 30.0

    assert healthy.frames.data[before].tolist() == faulty.frames.data[before].tolist()
    assert healthy.frames.data[~before].tolist() != faulty.frames.data[~before].tolist()
    assert healthy.nmea == faulty.nmea


@pytest.mark.parametrize("kind", BUS_KINDS)
def test_logs_have_the_public_form(tmp_path: Path, kind: str) -> None:
    """can.log holds candump lines in order of time; gnss.nmea holds stamped sentences."""
    folder = write_drive(tmp_path / "d", simulate_drive(short(bus=BusSpec(kind=kind))))
    can_lines = (folder / "can.log").read_text().splitlines()
    nmea_lines = (folder / "gnss.nmea").read_text().splitlines()
    stamps = [float(line[1:18]) for line in can_lines]

    assert all(re.fullmatch(r"\(\d{10}\.\d{6}\) can0 [0-9A-F]{3}#[0-9A-F]{16}", line) for line in can_lines)
    assert all(re.fullmatch(r"\(\d{10}\.\d{6}\) \$GN[A-Z]{3},.*\*[0-9A-F]{2}", line) for line in nmea_lines)
    assert sorted(stamps) == stamps


@pytest.mark.parametrize("wheels", [2, 4])
@pytest.mark.parametrize("kind", BUS_KINDS)
def test_the_configuration_names_signals_that_the_dbc_has(tmp_path: Path, kind: str, wheels: int) -> None:
    """Every role of vehicle.toml is a signal of bus.dbc, and the wheels are the four or the rear pair."""
    folder = write_drive(tmp_path / "d", simulate_drive(short(bus=BusSpec(kind=kind, wheels=wheels))))
    config = tomllib.loads((folder / "vehicle.toml").read_text())
    database = cantools.database.load_file(folder / "bus.dbc")
    for name in config["can"]["signals"].values():
        message, signal = name.split(".")
        assert signal in [s.name for s in database.get_message_by_name(message).signals]
    found = [role[-2:] for role in config["can"]["signals"] if role.startswith("wheel_")]

    assert list(WHEELS[4 - wheels :]) == found
    assert (0.316, 1.53, 1.52, 2.63, "front", 48) == tuple(
        config["vehicle"][key]
        for key in (
            "wheel_radius_m",
            "track_front_m",
            "track_rear_m",
            "wheelbase_m",
            "driven_axle",
            "teeth_per_rev",
        )
    )


def test_the_truth_has_the_puncture_on_the_hosts_clock(tmp_path: Path) -> None:
    """truth.json has radius minus nominal once per second: -6.32 mm within ten seconds from the onset."""
    spec = short(
        faults=(PUNCTURE,),
        radius_offset_m=(0.001, 0.0, -0.0005, 0.0),
        clocks=Clocks(start_utc_s=5000.0, host_offset_s=1.5),
    )
    folder = write_drive(tmp_path / "d", simulate_drive(spec))
    truth = json.loads((folder / "truth.json").read_text())
    rl = np.array(truth["deviation_m"]["rl"])

    assert (1, 61, 5001.5) == (truth["seed"], len(truth["time_s"]), truth["time_s"][0])
    assert pytest.approx([-0.0005] * 31) == rl[:31]
    assert pytest.approx(-0.0005 - 0.00316) == rl[35]
    assert pytest.approx([-0.0005 - 0.00632] * 21) == rl[40:]
    assert pytest.approx([0.001] * 61) == truth["deviation_m"]["fl"]
    assert ["radius_change"] == [
        effect["name"] for effect in truth["effects"] if "wheel" in effect["parameters"]
    ]


def test_counts_and_fixes_give_back_the_radius() -> None:
    """Distance of the fixes over the counted angle of the rear axle is the mean rear radius to 0.1 mm."""
    spec = DriveSpec(radius_offset_m=(0.0, 0.0, 0.002, 0.001), model=ExtendedModel())
    drive = simulate_drive(spec, straight(25.0, 300.0))
    fixes = drive.epochs
    speed = np.hypot(fixes.east_mps, fixes.north_mps)
    wheels = drive.frames.frame_id == 0x0B0
    counts = drive.frames.data[wheels].view("<u2")[:, 2:].astype(np.int64)
    turned = np.sum(np.diff(counts, axis=0) % 65536, axis=0) * 2 * np.pi / 48
    span = drive.frames.time_s[wheels][-1] - drive.frames.time_s[wheels][0]

    assert pytest.approx(0.3175, abs=1e-4) == speed.mean() * span / turned.mean()
    assert pytest.approx(0.317 / 0.318, abs=2e-5) == turned[0] / turned[1]


def test_the_known_latency_is_configured_and_the_effect_is_not() -> None:
    """vehicle.toml states the receiver's usual latency; what the effect adds is for others to find."""
    model = ExtendedModel((make_effect("gnss_latency", latency_s=0.1),))
    drive = simulate_drive(short(model=model, receiver=ReceiverSpec(latency_s=0.05)))

    assert 0.05 == tomllib.loads(drive.vehicle_toml)["gnss"]["latency_s"]
    assert pytest.approx(0.15) == drive.truth()["fix_age_s"]


def test_live_ports_go_into_the_configuration() -> None:
    """A live drive's configuration names its ports and is the recording's otherwise."""
    drive = simulate_drive(short())
    recorded = tomllib.loads(drive.vehicle_toml)
    live = tomllib.loads(drive.configuration("virtual", "demo", "/dev/pts/7"))

    assert ("virtual", "demo", "/dev/pts/7") == (
        live["can"].pop("interface"),
        live["can"].pop("channel"),
        live["gnss"].pop("device"),
    )
    for table, key in (("can", "interface"), ("can", "channel"), ("gnss", "device")):
        recorded[table].pop(key)
    assert recorded == live


def test_a_folder_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    """A file in the folder's place is named with the reason."""
    (tmp_path / "d").write_text("in the way")
    with pytest.raises(TpmsdError, match=r"d: cannot be written: File exists"):
        write_drive(tmp_path / "d", simulate_drive(short()))


def test_a_negative_seed_is_refused() -> None:
    """Seeds are whole numbers from zero."""
    with pytest.raises(ConfigError, match=r"^seed -1 is negative$"):
        simulate_drive(short(seed=-1))


def test_ten_minutes_are_written_within_eight_seconds(tmp_path: Path) -> None:
    """Ten minutes of the busiest bus take a fraction of a second on a free machine."""
    begin = time.process_time()
    write_drive(tmp_path / "d", simulate_drive(DriveSpec(bus=BusSpec(kind="counts8"))))

    assert time.process_time() - begin < 8.0
