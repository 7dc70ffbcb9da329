"""What is counted shows in the status."""

from __future__ import annotations

import logging
import math
import struct
from collections import Counter
from pathlib import Path
from types import SimpleNamespace

import pytest

from tests.onboard.daemon.fakes import FakeBus, car, wheels_frame
from tests.onboard.gnss.sentences import nmea
from tpmsd.car.config.load import load_config
from tpmsd.foundation.wheels import WHEELS
from tpmsd.onboard.daemon.bus_link import BusLink
from tpmsd.onboard.daemon.health import GNSS_FAULTS, Health, RecentFaults, tyres_line
from tpmsd.onboard.daemon.input_queue import InputQueue
from tpmsd.onboard.daemon.receiver_link import ReceiverLink, configured_receiver
from tpmsd.onboard.monitor.records import AlarmEvent, AlarmKind, MonitorReport, WheelReport, WheelState
from tpmsd.onboard.pipeline import Pipeline
from tpmsd.onboard.sources.can.databases import load_database
from tpmsd.onboard.sources.gnss.nmea_epoch import NmeaAssembler
from tpmsd.onboard.sources.gnss.nmea_sentence import HANDLED

LOG = logging.getLogger("tests.health")
GPS = """BO_ 1536 GPS: 8 CAR
 SG_ LAT : 0|32@1- (1e-07,0) [-90|90] "deg" CAR
 SG_ LON : 32|32@1- (1e-07,0) [-180|180] "deg" CAR
"""


def test_every_fault_of_the_receiver_has_its_place_in_the_status() -> None:
    """Whatever kind of fault the sentences' assembler counts, the status has it."""
    reported = set(NmeaAssembler().counts) - HANDLED - {"fixes", "ignored", "no_checksum"}
    assert reported == set(GNSS_FAULTS)


def test_counts_of_all_stages_are_in_the_document(tmp_path: Path) -> None:
    """Faults of decoding, of the time line and of the links stand side by side."""
    config, database = car(tmp_path, '[gnss]\ndevice = "none"\n')
    bus = FakeBus()
    bus_link = BusLink(lambda: bus.opener()(config.can, None, "fake"), "CAN fake", LOG)
    receiver = ReceiverLink(configured_receiver(config.gnss), "receiver none", LOG)
    receiver.service(0.0)
    pipeline = Pipeline(config, database)
    pipeline.on_frame(1000.0, 0xB0, False, b"\x01")
    pipeline.on_sentence(1000.1, b"$GPGGA,garbage*00")
    for kind in ("late_fixes", "early_fixes", "implausible"):
        pipeline.timeline.counts[kind] = 3
    pipeline.on_sentence(1000.2, nmea("GPRMC,080000,V,,,,,,,010724,,,N"))
    pipeline.on_sentence(1001.2, nmea("GPRMC,080001,V,,,,,,,010724,,,N"))

    document = Health(config, bus_link, receiver, InputQueue(), 0.0).document(pipeline, 1.0, 0)

    assert {"short": 4, "implausible": 3} == document["can"]["faults"]
    assert {"checksum": 1, "no_fix": 1, "unplugged": 1, "late": 3, "early": 3} == document["gnss"]["faults"]


def test_a_receiver_on_the_bus_is_shown_as_any_other(tmp_path: Path) -> None:
    """With fixes on CAN the document names the bus, counts fixes and tells when they cease."""
    car(tmp_path)
    toml, dbc = tmp_path / "vehicle.toml", tmp_path / "bus.dbc"
    roles = '[can.signals]\ngnss_latitude = "GPS.LAT"\ngnss_longitude = "GPS.LON"\n'
    toml.write_text(toml.read_text("utf-8").replace("[can.signals]\n", roles), "utf-8")
    dbc.write_text(dbc.read_text("utf-8") + GPS, "utf-8")
    config, database = load_config(toml), load_database(dbc)
    pipeline = Pipeline(config, database)
    bus = FakeBus()
    link = BusLink(lambda: bus.opener()(config.can, None, "fake"), "CAN fake", LOG)
    health = Health(config, link, None, InputQueue(), 0.0)
    link.service(0.0)
    states = [health.document(pipeline, 0.0, 0)["gnss"]["state"]]
    for k in range(10):
        place = struct.pack("<ii", 480000000 + 10 * k, 110000000)
        pipeline.on_frame(1000.0 + 0.1 * k, 0x600, False, place)
    health.note_steps([], pipeline, 5.0)
    gnss = health.document(pipeline, 5.0, 0)["gnss"]
    states += [gnss["state"], health.document(pipeline, 60.0, 0)["gnss"]["state"]]

    assert ["waiting", "ok", "silent"] == states
    assert ("on CAN", 10) == (gnss["device"], gnss["fixes"])


def test_an_input_is_silent_after_its_time_and_late_frames_are_counted(tmp_path: Path) -> None:
    """The bus is silent after 2 s without a frame, a receiver after 3 s without a fix; what came too late for
    its tick is counted."""
    config, database = car(tmp_path, '[gnss]\ndevice = "none"\n')
    bus = FakeBus()
    link = BusLink(lambda: bus.opener()(config.can, None, "fake"), "CAN fake", LOG)
    link.service(0.0)
    bus.waiting.append(wheels_frame(1000.0))
    link.read(0.0)
    receiver = ReceiverLink(configured_receiver(config.gnss), "receiver none", LOG)
    receiver._is_down = False
    pipeline, queue = Pipeline(config, database), InputQueue()
    queue.counts["late"] = 2
    pipeline.assembler.counts["fixes"] = 1
    health = Health(config, link, receiver, queue, 0.0)
    health.note_frames(10.0)
    health.note_steps([], pipeline, 10.0)
    states = []
    for age_s in (1.9, 2.1, 2.9, 3.1):
        document = health.document(pipeline, 10.0 + age_s, 0)
        states.append((document["can"]["state"], document["gnss"]["state"]))

    assert [("ok", "ok"), ("silent", "ok"), ("silent", "ok"), ("silent", "silent")] == states
    assert 2 == document["can"]["faults"]["too_late"]


def test_a_receiver_that_gave_no_fix_is_waited_for(tmp_path: Path) -> None:
    """It is open, and sentences may come, but there is no fix yet, and so none that has an age."""
    config, database = car(tmp_path, '[gnss]\ndevice = "none"\n')
    bus = FakeBus()
    link = BusLink(lambda: bus.opener()(config.can, None, "fake"), "CAN fake", LOG)
    receiver = ReceiverLink(configured_receiver(config.gnss), "receiver none", LOG)
    receiver._is_down = False
    pipeline = Pipeline(config, database)
    health = Health(config, link, receiver, InputQueue(), 0.0)
    health.note_steps([], pipeline, 5.0)

    gnss = health.document(pipeline, 60.0, 0)["gnss"]

    assert ("waiting", 0, None) == (gnss["state"], gnss["fixes"], gnss["age_s"])


def report(
    *states: str, alarms: tuple[tuple[str, str | None], ...] = (), learned: float = 1.0
) -> MonitorReport:
    """A report of wheels in these states, with these alarms."""
    nan = math.nan
    wheels = [
        WheelReport(name, WheelState(state), nan, nan, nan, nan, 0.0, 0.0)
        for name, state in zip(WHEELS, states, strict=True)
    ]
    active = [
        AlarmEvent(0.0, AlarmKind(kind), wheel, "raised", nan, nan, 1.0, "soft") for kind, wheel in alarms
    ]
    return MonitorReport(0.0, tuple(wheels), tuple(active), (), learned)


GONE, LEARNS, WATCHED = "unavailable", "learning", "monitoring"


@pytest.mark.parametrize(
    ("said", "line"),
    [
        (report(*[WATCHED] * 4), "monitoring 4 wheels, no alarm"),
        (report(GONE, GONE, WATCHED, WATCHED), "monitoring 2 wheels, no alarm"),
        (report(GONE, LEARNS, WATCHED, WATCHED, learned=0.455), "learning 3 wheels, 46 %"),
        (report(*[GONE] * 4), "no wheel to watch"),
        (
            report(*[WATCHED] * 4, alarms=(("malfunction", None), ("deflation", "rl"), ("deflation", "rl"))),
            "ALARM: deflation rl, malfunction",
        ),
    ],
)
def test_the_tyres_in_a_few_words(said: MonitorReport, line: str) -> None:
    """Alarms before all else, each once; then what is watched, and how far the learning is."""
    assert line == tyres_line(said)


def test_the_line_is_of_the_last_step(tmp_path: Path) -> None:
    """Of several steps the last one counts; its speed is in km/h, and an unknown one is left out."""
    config, database = car(tmp_path)
    bus = FakeBus()
    link = BusLink(lambda: bus.opener()(config.can, None, "fake"), "CAN fake", LOG)
    health, pipeline = Health(config, link, None, InputQueue(), 0.0), Pipeline(config, database)
    steps = []
    for k in range(40):
        steps += pipeline.on_frame(1000.0 + 0.1 * k, 0xB0, False, wheels_frame(0.0, 0.1 * k).data)
    first = steps[0]._replace(report=report(*[GONE] * 4))
    for speed_mps, words in ((20.0, " 72 km/h;"), (math.nan, " bus ")):
        last = steps[-1]._replace(
            report=report(*[WATCHED] * 4),
            estimate=steps[-1].estimate._replace(speed_mps=speed_mps),
        )
        health.note_steps([first, last], pipeline, 1.0)
        assert health.line(pipeline, 1.0, 3).startswith(f"monitoring 4 wheels, no alarm;{words}")
    assert health.line(pipeline, 1.0, 3).endswith("; bus waiting; receiver off; 4 ticks, 3 late")


def test_faults_of_the_last_minute_stand_apart() -> None:
    """Of totals since the start only what came within the last minute counts as recent."""
    recent = RecentFaults()
    assert {} == recent.update(0.0, Counter(lost=7)), "what was there before the first look is not recent"
    assert {"lost": 2} == recent.update(10.0, Counter(lost=9))
    assert {"lost": 2, "jump": 1} == recent.update(59.0, Counter(lost=9, jump=1))
    assert {"jump": 1} == recent.update(80.0, Counter(lost=9, jump=1))
    assert {} == recent.update(200.0, Counter(lost=9, jump=1))


def test_the_last_change_stays_with_its_age(tmp_path: Path) -> None:
    """A wheel whose change is not known any more keeps its last one in the document, with its age."""
    config, database = car(tmp_path, '[gnss]\ndevice = "none"\n')
    bus = FakeBus()
    link = BusLink(lambda: bus.opener()(config.can, None, "fake"), "CAN fake", LOG)
    health = Health(config, link, None, InputQueue(), 0.0)
    pipeline = Pipeline(config, database)
    nan = math.nan
    for time_s, change_m in ((100.0, -0.003), (140.0, nan)):
        wheel = WheelReport("rl", WheelState.ALARM, nan, nan, change_m, 0.0002, nan, nan)
        report = MonitorReport(time_s, (wheel,), (), (), 1.0)
        health.note_steps([SimpleNamespace(report=report, estimate=None)], pipeline, time_s)  # type: ignore[list-item]
    shown = health.document(pipeline, 140.0, 0)["wheels"]["rl"]
    assert (None, -3.0, 40.0) == tuple(
        shown[key] for key in ("change_mm", "last_change_mm", "last_change_age_s")
    )
