"""A receiver that sits on the bus: readings to fixes, and a whole drive with it."""

from __future__ import annotations

import math
import re
from pathlib import Path

import cantools
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tpmsd.car.config.load import load_config
from tpmsd.interfaces.cli.main import main
from tpmsd.interfaces.cli.replay import replay
from tpmsd.offline.simulator.drive import DriveSpec, simulate_drive
from tpmsd.offline.simulator.drive_writer import write_drive
from tpmsd.onboard.sources.events import Event, GnssFix, InertialSample, SourceFault
from tpmsd.onboard.sources.gnss.nmea_epoch import NmeaAssembler
from tpmsd.onboard.sources.gnss.nmea_log import read_nmea_log
from tpmsd.onboard.sources.gnss.on_can import ALIVE_S, CanFixAssembler

UTC_S = 1774778400.0
PLACE = ("gnss_latitude", "gnss_longitude")
MOTION = ("gnss_speed", "gnss_course")


def fixes(events: list[Event]) -> list[GnssFix]:
    return [event for event in events if isinstance(event, GnssFix)]


def reading(role: str, time_s: float, epoch: int) -> InertialSample:
    """North at 20 m/s, from the epoch of that number (10 per second) on."""
    values = {
        "gnss_latitude": math.radians(48.0 + 2.0 * epoch / 111_195.0),
        "gnss_longitude": math.radians(11.0),
        "gnss_speed": 20.0 + 0.001 * epoch,
        "gnss_course": 0.01,
        "gnss_utc": 36000.0 + 0.1 * epoch,
        "gnss_fix": 3.0,
        "gnss_altitude": 500.0,
    }
    return InertialSample(time_s, role, values[role])


def played(roles: tuple[str, ...], messages: list[tuple[float, tuple[str, ...], int]]) -> list[Event]:
    """Messages (time, roles in it, epoch) through an assembler."""
    assembler = CanFixAssembler(roles)
    events: list[Event] = []
    for time_s, inside, epoch in messages:
        events += assembler.advance(time_s)
        for role in inside:
            events += assembler.take(reading(role, time_s, epoch))
    return events + assembler.flush()


def test_an_epoch_in_one_message_is_a_fix_at_once() -> None:
    """All that is said of an epoch is in its fix; a time of the day gets the day of its arrival."""
    roles = (*PLACE, *MOTION, "gnss_utc", "gnss_fix", "gnss_altitude")
    assembler = CanFixAssembler(roles)
    (fix,) = fixes([event for role in roles for event in assembler.take(reading(role, UTC_S + 0.05, 0))])

    assert (UTC_S + 0.05, UTC_S, 1) == (fix.arrival_s, fix.utc_s, fix.quality)
    assert (48.0, 11.0, 20.0, 0.01, 500.0) == pytest.approx(
        (fix.latitude_deg, fix.longitude_deg, fix.speed_mps, fix.course_rad, fix.altitude_m)
    )
    assert math.inf == assembler.deadline_s


@pytest.mark.parametrize("first", [0, 1])
def test_messages_of_one_epoch_are_put_together(first: int) -> None:
    """Position and motion that come 2 ms apart belong together, also when the start is in between."""
    messages = []
    for epoch in range(30):
        at_s = UTC_S + 0.1 * epoch
        messages += [(at_s, MOTION, epoch), (at_s + 0.002, PLACE, epoch)]
    got = fixes(played(PLACE + MOTION, messages[first:]))

    assert len(got) >= 28
    for fix in got[5:]:
        epoch = round((fix.latitude_deg - 48.0) * 111_195.0 / 2.0)
        assert 20.0 + 0.001 * epoch == pytest.approx(fix.speed_mps)


def test_what_the_bus_repeats_is_one_fix() -> None:
    """A receiver of 1 Hz on a message of 10 Hz gives one fix per second, stamped with its first coming."""
    messages = [(UTC_S + 0.1 * k, PLACE + MOTION, 10 * (k // 10)) for k in range(50)]
    got = fixes(played(PLACE + MOTION, messages))

    assert [UTC_S + k for k in range(5)] == pytest.approx([fix.arrival_s for fix in got])


def test_a_receiver_at_rest_is_not_dead() -> None:
    """What never changes is said again once a second."""
    got = fixes(played(PLACE, [(UTC_S + 0.1 * k, PLACE, 0) for k in range(100)]))

    assert 9 <= len(got) <= 10
    assert all(fix.arrival_s % ALIVE_S < 0.2 for fix in got)


def test_a_coarse_clock_speaks_for_the_first_fix_of_its_second() -> None:
    """Beside fixes ten times a second, a clock in whole seconds gives a time to one of ten."""
    assembler = CanFixAssembler((*PLACE, "gnss_utc"))
    events: list[Event] = []
    for k in range(30):
        at_s = UTC_S + 0.1 * k + 0.01
        sample = InertialSample(at_s, "gnss_utc", float(int(UTC_S + 0.1 * k + 1e-6)))
        for one in (*(reading(role, at_s, k) for role in PLACE), sample):
            events += assembler.take(one)
    known = [fix.utc_s for fix in fixes(events) if math.isfinite(fix.utc_s)]

    assert 30 == len(fixes(events))
    assert [UTC_S, UTC_S + 1.0, UTC_S + 2.0] == known


def test_coarse_signals_say_so() -> None:
    """A speed in steps of 1 km/h and a coarse position are given the error of their rounding."""
    steps = {"gnss_speed": 1 / 3.6, "gnss_latitude": math.radians(1e-4), "gnss_longitude": 0.0}
    assembler = CanFixAssembler(PLACE + MOTION, steps)
    (fix,) = fixes([event for role in PLACE + MOTION for event in assembler.take(reading(role, 1.0, 0))])

    assert 1 / 3.6 / math.sqrt(12) == pytest.approx(fix.speed_std_mps)
    assert math.hypot(1.5, 11.12 / math.sqrt(12)) == pytest.approx(fix.position_std_m, rel=1e-3)


@pytest.mark.parametrize(
    ("changed", "kind"),
    [
        ({"gnss_fix": 0.0}, "no_fix"),
        ({"gnss_latitude": 0.0, "gnss_longitude": 0.0}, "no_fix"),
        ({"gnss_latitude": math.radians(90.1)}, "range"),
        ({"gnss_speed": 500.0}, "range"),
        ({"gnss_longitude": math.radians(12.0)}, "leap"),
    ],
)
def test_what_cannot_be_is_kept_back(changed: dict[str, float], kind: str) -> None:
    """No fix, impossible numbers and leaps lose their position and are counted, once reported."""
    roles = (*PLACE, *MOTION, "gnss_fix")
    assembler = CanFixAssembler(roles)
    events: list[Event] = []
    for k in range(2):
        for role in roles:
            sample = reading(role, UTC_S + 0.1 * k, k)
            if k and role in changed:
                sample = sample._replace(value=changed[role])
            events += assembler.take(sample)

    assert [True, False] == [math.isfinite(fix.latitude_deg) for fix in fixes(events)]
    assert [kind] == [event.kind for event in events if isinstance(event, SourceFault)]
    assert 1 == assembler.counts[kind]


@settings(derandomize=True, deadline=None, max_examples=200)
@given(
    st.lists(
        st.tuples(
            st.floats(-2.0, 2.0),
            st.sampled_from([*PLACE, *MOTION, "gnss_utc", "gnss_fix", "gnss_altitude"]),
            st.floats(allow_nan=False, allow_infinity=False),
        ),
        max_size=60,
    )
)
def test_any_readings_are_borne(samples: list[tuple[float, str, float]]) -> None:
    """Whatever the bus says and whenever, a position is on the globe and has a finite uncertainty."""
    assembler = CanFixAssembler({role for _, role, _ in samples})
    time_s, events = UTC_S, []
    for step_s, role, value in samples:
        time_s += step_s
        events += assembler.advance(time_s) + assembler.take(InertialSample(time_s, role, value))
    for fix in fixes(events + assembler.flush()):
        assert not abs(fix.latitude_deg) > 90.0 and not abs(fix.longitude_deg) > 180.0
        assert math.isnan(fix.latitude_deg) or 0.0 < fix.position_std_m < math.inf


DBC = """
BO_ 1536 GPS_POS: 8 CAR
 SG_ LAT : 7|32@0- (1e-07,0) [-90|90] "deg" X
 SG_ LON : 39|32@0- (1e-07,0) [-180|180] "deg" X

BO_ 1537 GPS_VEL: 8 CAR
 SG_ SPEED : 0|16@1+ (0.01,0) [0|400] "km/h" X
 SG_ COURSE : 16|16@1+ (0.01,0) [0|360] "deg" X
 SG_ TIME : 32|27@1+ (1,0) [0|86400000] "ms" X
 SG_ FIX : 60|2@1+ (1,0) [0|3] "" X
"""
SIGNALS = """
gnss_latitude = "GPS_POS.LAT"
gnss_longitude = "GPS_POS.LON"
gnss_speed = "GPS_VEL.SPEED"
gnss_course = "GPS_VEL.COURSE"
gnss_utc = "GPS_VEL.TIME"
gnss_fix = "GPS_VEL.FIX"
"""


def moved_to_the_bus(folder: Path) -> None:
    """Turn the receiver's sentences of a drive into frames of a DBC, and delete the sentences."""
    dbc = folder / "bus.dbc"
    dbc.write_text(dbc.read_text("utf-8") + DBC, "utf-8")
    database = cantools.database.load_file(dbc)
    assembler = NmeaAssembler()
    events = [
        e for time_s, line, _ in read_nmea_log(folder / "gnss.nmea") for e in assembler.feed(time_s, line)
    ]
    lines = (folder / "can.log").read_text("utf-8").splitlines()
    channel = lines[0].split()[1]
    for fix in fixes(events + assembler.flush()):
        known = math.isfinite(fix.latitude_deg)
        place = {"LAT": fix.latitude_deg, "LON": fix.longitude_deg} if known else {"LAT": 0, "LON": 0}
        course = math.degrees(fix.course_rad) if math.isfinite(fix.course_rad) else 0.0
        motion = {
            "SPEED": 3.6 * fix.speed_mps if math.isfinite(fix.speed_mps) else 0.0,
            "COURSE": course,
            "TIME": round(1000 * (fix.utc_s % 86400.0)),
            "FIX": 3 if known else 0,
        }
        for number, (name, values) in enumerate((("GPS_POS", place), ("GPS_VEL", motion))):
            message = database.get_message_by_name(name)
            at_s = fix.arrival_s + 0.001 * number
            lines.append(
                f"({at_s:.6f}) {channel} {message.frame_id:03X}#{message.encode(values).hex().upper()}"
            )
    lines.sort(key=lambda line: float(line[1 : line.index(")")]))
    (folder / "can.log").write_text("\n".join(lines) + "\n", "utf-8")
    (folder / "gnss.nmea").unlink()
    toml = folder / "vehicle.toml"
    text = toml.read_text("utf-8").replace("[can.signals]\n", f"[can.signals]{SIGNALS}")
    toml.write_text(
        re.sub(r"(?m)^(device|baud) = .*$", "", text).replace("[gnss]\n", '[gnss]\nsource = "can"\n'), "utf-8"
    )


def test_a_drive_without_sentences_is_replayed_from_the_bus(tmp_path: Path) -> None:
    """Radii and their certainty are those of the same drive with sentences; no gnss.nmea is needed."""
    drive = simulate_drive(DriveSpec(duration_s=100.0, seed=5))
    spoken, on_bus = write_drive(tmp_path / "nmea", drive), write_drive(tmp_path / "can", drive)
    moved_to_the_bus(on_bus)
    a, b = (replay(folder, load_config(folder)) for folder in (spoken, on_bus))

    for one, other in zip(a.wheels, b.wheels, strict=True):
        assert one.std_m == pytest.approx(other.std_m, rel=0.3)
        assert one.deviation_m == pytest.approx(other.deviation_m, abs=0.25 * one.std_m + 1e-5)


def test_the_position_on_the_bus_is_the_source_where_none_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Roles alone will do; beside another source they are of no use, and `check` says so."""
    folder = write_drive(tmp_path, simulate_drive(DriveSpec(duration_s=10.0, seed=5)))
    moved_to_the_bus(folder)
    toml = folder / "vehicle.toml"
    text = toml.read_text("utf-8")
    toml.write_text(text.replace('source = "can"\n', ""), "utf-8")
    assert "can" == load_config(toml).gnss.source
    toml.write_text(text.replace('"can"\n', '"gpsd://localhost"\n', 1), "utf-8")

    assert 0 == main(["check", str(toml)])
    assert "[can.signals] gnss_fix: of no use: [gnss] source is not 'can'" in capsys.readouterr().err
