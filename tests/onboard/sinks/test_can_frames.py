"""The CAN frames, read back through dbc/tpmsd.dbc by cantools as a stranger would read them."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import cantools
import pytest
from cantools.database import Message
from hypothesis import given, settings
from hypothesis import strategies as st

from tpmsd.car.config.model import AlarmsConfig
from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.wheels import WHEELS
from tpmsd.onboard.monitor.records import AlarmEvent, AlarmKind, MonitorReport, WheelReport, WheelState
from tpmsd.onboard.sinks import can_layout
from tpmsd.onboard.sinks.can_frames import CLEARED_REPEATS, CanReporter, OutFrame

NAN = math.nan
REPO = Path(__file__).resolve().parents[3]
DATABASE = cantools.database.Database()
DATABASE.add_dbc_file(REPO / "dbc" / "tpmsd.dbc")
STATUS: Message = DATABASE.get_message_by_name("TPMSD_STATUS")
ALARM: Message = DATABASE.get_message_by_name("TPMSD_ALARM")


def wheel_report(wheel: str, **changed: Any) -> WheelReport:
    wheel_ = WheelReport(wheel, WheelState.MONITORING, -0.0012, 0.00013, -0.0003, 0.0002, 0.01, 0.0)
    return wheel_._replace(**changed)


def alarm(
    kind: AlarmKind = AlarmKind.DEFLATION, wheel: str | None = "rl", state: str = "raised"
) -> AlarmEvent:
    return AlarmEvent(0.0, kind, wheel, state, -0.003, 0.0001, 0.995, "rear left is soft")  # type: ignore[arg-type]


def report(
    time_s: float = 0.0,
    wheels: tuple[WheelReport, ...] | None = None,
    active: tuple[AlarmEvent, ...] = (),
    events: tuple[AlarmEvent, ...] = (),
) -> MonitorReport:
    wheels = tuple(wheel_report(name) for name in WHEELS) if wheels is None else wheels
    return MonitorReport(time_s, wheels, active, events, 1.0)


def decode(frame: OutFrame) -> dict[str, Any]:
    message = STATUS if frame.arbitration_id == STATUS.frame_id else ALARM
    signals: Any = message.decode(frame.data)
    return {name: getattr(value, "name", value) for name, value in signals.items()}


def pages(frames: list[OutFrame]) -> dict[str, Any]:
    """The signals of all status pages of one cycle."""
    return {k: v for f in frames if f.arbitration_id == STATUS.frame_id for k, v in decode(f).items()}


def alarm_frames(frames: list[OutFrame]) -> list[dict[str, Any]]:
    return [decode(frame) for frame in frames if frame.arbitration_id == ALARM.frame_id]


def long_division_crc8(data: bytes) -> int:
    """CRC-8/SAE-J1850 from its definition: the remainder of one long binary number, all bits at once."""
    number = int.from_bytes(data, "big") << 8 ^ 0xFF << 8 * len(data)
    for bit in range(8 * len(data) - 1, -1, -1):
        if number >> (bit + 8) & 1:
            number ^= 0x11D << bit
    return number ^ 0xFF


def test_the_checksum_has_the_published_check_value() -> None:
    """CRC-8/SAE-J1850 of '123456789' is 0x4B."""
    assert 0x4B == can_layout.crc8_j1850(b"123456789")
    assert 0x4B == long_division_crc8(b"123456789")


@given(st.binary(max_size=16))
@settings(derandomize=True, deadline=None)
def test_the_checksum_is_the_remainder_of_a_long_division(data: bytes) -> None:
    """The bytewise checksum agrees with a polynomial division of the whole message."""
    assert long_division_crc8(data) == can_layout.crc8_j1850(data)


@pytest.mark.parametrize(
    ("message", "page", "fields"),
    [
        *(("TPMSD_STATUS", p, can_layout.STATUS_HEAD + can_layout.STATUS_FIELDS[p]) for p in (0, 1, 2)),
        ("TPMSD_ALARM", None, can_layout.ALARM_FIELDS),
    ],
)
def test_the_dbc_describes_exactly_the_layout(
    message: str, page: int | None, fields: tuple[can_layout.Field, ...]
) -> None:
    """Every field has its signal in the DBC with the same bits, sign, scale, unit, range and empty value."""
    signals = [
        signal
        for signal in DATABASE.get_message_by_name(message).signals
        if page is None or signal.multiplexer_ids is None or page in signal.multiplexer_ids
    ]
    assert sorted(field.name for field in fields) == sorted(signal.name for signal in signals)
    by_name = {signal.name: signal for signal in signals}
    for field in fields:
        signal = by_name[field.name]
        codes = {str(name): raw for raw, name in (signal.choices or {}).items()}
        assert (field.start, field.length, field.signed, "little_endian") == (
            signal.start,
            signal.length,
            signal.is_signed,
            signal.byte_order,
        )
        assert (field.factor, 0, field.unit) == (signal.scale, signal.offset, signal.unit or "")
        assert field.not_available == codes.get("not_available")
        if field.unit in ("mm",):
            assert [raw * field.factor for raw in field.raw_range] == pytest.approx(
                [signal.minimum, signal.maximum]
            )
        assert signal.comment


def test_the_value_tables_name_the_codes() -> None:
    """States, kinds and wheels decode to the words that the rest of the project uses."""

    def table(message: Message, name: str) -> dict[str, int]:
        return {str(v): k for k, v in (message.get_signal_by_name(name).choices or {}).items()}

    assert can_layout.WHEEL_STATE_CODES == table(STATUS, "State_FL")
    assert set(can_layout.WHEEL_STATE_CODES) == set(WheelState)
    assert {"none": 0, **can_layout.ALARM_KIND_CODES} == table(ALARM, "AlarmKind")
    assert set(can_layout.ALARM_KIND_CODES) == set(AlarmKind)
    assert {**can_layout.WHEEL_CODES, "none": 7} == table(ALARM, "AlarmWheel")


def test_identifiers_and_cycle_times_of_the_dbc_are_the_defaults() -> None:
    """Somebody who changes nothing can rely on the DBC's identifiers, periods and repetitions."""
    defaults = AlarmsConfig()
    assert (STATUS.frame_id, ALARM.frame_id) == (defaults.status_id, defaults.alarm_id)
    assert (STATUS.cycle_time, ALARM.cycle_time) == (
        1000 * defaults.status_period_s,
        1000 * defaults.alarm_period_s,
    )
    repetitions = ALARM.dbc.attributes["GenMsgNrOfRepetition"].value  # type: ignore[union-attr]
    assert repetitions == CLEARED_REPEATS


def test_a_status_cycle_says_all_there_is_to_know_of_each_wheel() -> None:
    """Deviation, standard deviation, validity, state and change come back as they went in."""
    wheels = (
        wheel_report("fl", state=WheelState.LEARNING, change_m=NAN),
        wheel_report("fr", deviation_m=0.00104, std_m=0.00001),
        wheel_report("rl", state=WheelState.ALARM, deviation_m=-0.0041, change_m=-0.00289),
        wheel_report("rr", state=WheelState.UNAVAILABLE, deviation_m=NAN, std_m=NAN, change_m=NAN),
    )
    got = pages(CanReporter(AlarmsConfig()).frames(0.0, report(wheels=wheels)))
    assert ["learning", "monitoring", "alarm", "unavailable"] == [got[f"State_{w.upper()}"] for w in WHEELS]
    assert ["valid", "valid", "valid", "invalid"] == [got[f"Valid_{w.upper()}"] for w in WHEELS]
    assert pytest.approx([-1.2, 1.04, -4.1]) == [got[f"Deviation_{w}"] for w in ("FL", "FR", "RL")]
    assert pytest.approx([0.14, 0.02, 0.14]) == [got[f"Std_{w}"] for w in ("FL", "FR", "RL")]
    assert ["not_available"] * 4 == [got[k] for k in ("Deviation_RR", "Std_RR", "Change_FL", "Change_RR")]
    assert pytest.approx([-0.3, -2.89]) == [got["Change_FR"], got["Change_RL"]]


def test_a_bus_with_the_rear_pair_alone_reports_the_front_as_unavailable() -> None:
    """Wheels that the monitor does not report are sent, as not available."""
    got = pages(
        CanReporter(AlarmsConfig()).frames(0.0, report(wheels=(wheel_report("rl"), wheel_report("rr"))))
    )
    assert ("unavailable", "invalid", "not_available") == (
        got["State_FL"],
        got["Valid_FL"],
        got["Deviation_FL"],
    )
    assert ("monitoring", "valid", pytest.approx(-1.2)) == (
        got["State_RR"],
        got["Valid_RR"],
        got["Deviation_RR"],
    )


millimetres = st.one_of(st.just(NAN), st.floats(-60, 60, allow_nan=False), st.just(math.inf))


@given(
    st.tuples(millimetres, millimetres, millimetres, millimetres),
    st.floats(0, 20),
    st.sampled_from(WheelState),
)
@settings(derandomize=True, deadline=None)
def test_every_report_survives_the_round_trip(
    deviations_mm: tuple[float, ...], std_mm: float, state: WheelState
) -> None:
    """Numbers come back to half a step, saturate at the range, and no number stays no number."""
    wheels = tuple(
        wheel_report(name, state=state, deviation_m=mm / 1e3, change_m=-mm / 1e3, std_m=std_mm / 1e3)
        for name, mm in zip(WHEELS, deviations_mm, strict=True)
    )
    frames = CanReporter(AlarmsConfig()).frames(5.0, report(wheels=wheels))
    got = pages(frames)
    for name, mm in zip(WHEELS, deviations_mm, strict=True):
        suffix = name.upper()
        deviation, change, std = (got[f"{kind}_{suffix}"] for kind in ("Deviation", "Change", "Std"))
        if math.isfinite(mm):
            expected = min(max(mm, -20.47), 20.47)
            assert "valid" == got[f"Valid_{suffix}"]
            assert pytest.approx(expected, abs=0.005001) == deviation
            assert pytest.approx(-expected, abs=0.005001) == change
        else:
            assert ("invalid", "not_available", "not_available") == (
                got[f"Valid_{suffix}"],
                deviation,
                change,
            )
        assert -1e-6 <= std - min(std_mm, 5.08) < 0.02
        assert state == got[f"State_{suffix}"]
    for frame in frames:
        assert long_division_crc8(b"\xf0" + frame.data[1:]) == frame.data[0]


def test_the_counters_roll_with_every_frame_of_their_identifier() -> None:
    """Forty status frames count 0 to 15 over and over, and alarm frames count for themselves."""
    reporter = CanReporter(AlarmsConfig())
    standing = (alarm(),)
    frames = [f for i in range(14) for f in reporter.frames(float(i), report(float(i), active=standing))]
    status = [decode(f)["StatusCounter"] for f in frames if f.arbitration_id == 0x6F0]
    alarms = [decode(f)["AlarmCounter"] for f in frames if f.arbitration_id == 0x6F1]
    assert [i % 16 for i in range(42)] == status
    assert [i % 16 for i in range(14)] == alarms


def test_the_checksum_of_an_alarm_is_not_that_of_a_status() -> None:
    """Every alarm frame checks under 0xF1 and none under the status frames' 0xF0."""
    frames = CanReporter(AlarmsConfig()).frames(0.0, report(active=(alarm(),), events=(alarm(),)))
    frame = next(f for f in frames if f.arbitration_id == 0x6F1)
    assert long_division_crc8(b"\xf1" + frame.data[1:]) == frame.data[0]
    assert long_division_crc8(b"\xf0" + frame.data[1:]) != frame.data[0]


@pytest.mark.parametrize("start_s", [0.0, 1719820800.03])
@pytest.mark.parametrize(("rate_hz", "period_s"), [(10, 1.0), (10, 0.3), (100, 0.25), (1, 0.5)])
def test_status_cycles_keep_their_period_without_drift(start_s: float, rate_hz: int, period_s: float) -> None:
    """Over two minutes of ticks the cycles come as often as their period says, never two in one tick."""
    reporter = CanReporter(AlarmsConfig(status_period_s=period_s))
    ticks = [start_s + i / rate_hz for i in range(120 * rate_hz)]
    counts = [len(reporter.frames(t, report(t))) for t in ticks]
    assert {0, 3} >= set(counts)
    assert pytest.approx(120 / max(period_s, 1 / rate_hz), abs=1) == sum(counts) / 3


def test_a_pause_is_not_made_up_for_by_a_burst() -> None:
    """After ten minutes without ticks one cycle is sent, and the next a period later."""
    reporter = CanReporter(AlarmsConfig())
    sent = [len(reporter.frames(t, report(t))) for t in (0.0, 600.0, 600.1, 600.9, 601.0)]
    assert [3, 3, 0, 0, 3] == sent


def test_a_clock_that_steps_back_does_not_silence_the_bus() -> None:
    """After a step of minus an hour the status goes on at once with its period."""
    reporter = CanReporter(AlarmsConfig())
    sent = [len(reporter.frames(t, report(t))) for t in (3600.0, 3600.5, 0.5, 1.0, 1.5)]
    assert [3, 0, 3, 0, 3] == sent


def test_an_alarm_is_sent_at_once_and_repeated_while_it_stands() -> None:
    """The event goes out in its tick, then every half second under the same sequence number."""
    reporter = CanReporter(AlarmsConfig())
    raised = alarm()
    wheels = (wheel_report("rl", state=WheelState.ALARM, change_m=-0.0032, deflation_probability=0.998),)
    sent: dict[float, dict[str, Any]] = {}
    for i in range(21):
        now = i / 10
        events = (raised,) if i == 3 else ()
        out = reporter.frames(now, report(now, wheels, (raised,) if i >= 3 else (), events))
        for frame in alarm_frames(out):
            sent[now] = frame
    assert [0.3, 0.8, 1.3, 1.8] == list(sent)
    assert {1} == {frame["AlarmSequence"] for frame in sent.values()}
    first = sent[0.3]
    assert ("raised", "deflation", "rl", 1) == tuple(
        first[k] for k in ("AlarmRaised", "AlarmKind", "AlarmWheel", "ActiveAlarms")
    )
    assert pytest.approx(-3.2) == first["AlarmChange"]
    assert pytest.approx(99.5) == first["AlarmProbability"]
    assert ["Deflation_RL"] == [name for name, value in first.items() if value == "alarm"]


def test_a_cleared_alarm_is_repeated_a_few_times() -> None:
    """Clearing is an event of its own, sent at once and five times more, then there is silence."""
    reporter = CanReporter(AlarmsConfig())
    reporter.frames(0.0, report(active=(alarm(),), events=(alarm(),)))
    sent = []
    for i in range(1, 100):
        events = (alarm(state="cleared"),) if i == 1 else ()
        sent += [(i / 10, f) for f in alarm_frames(reporter.frames(i / 10, report(i / 10, events=events)))]
    assert [0.1, 0.6, 1.1, 1.6, 2.1, 2.6] == [time for time, _ in sent]
    assert {("cleared", 2, 0, "none")} == {
        (f["AlarmRaised"], f["AlarmSequence"], f["ActiveAlarms"], f["Deflation_RL"]) for _, f in sent
    }


def test_an_alarm_raised_again_ends_the_repetitions_of_its_clearing() -> None:
    """Raised, cleared and raised again leaves one alarm on the bus, under its third sequence number."""
    reporter = CanReporter(AlarmsConfig())
    reporter.frames(0.0, report(active=(alarm(),), events=(alarm(),)))
    reporter.frames(0.1, report(events=(alarm(state="cleared"),)))
    reporter.frames(0.2, report(active=(alarm(),), events=(alarm(),)))
    later = [
        f for i in range(3, 40) for f in alarm_frames(reporter.frames(i / 10, report(active=(alarm(),))))
    ]
    assert {("raised", 3)} == {(f["AlarmRaised"], f["AlarmSequence"]) for f in later}


def test_several_alarms_are_each_repeated_and_all_in_the_summary() -> None:
    """Three alarms in one tick give three frames, each with the whole summary."""
    reporter = CanReporter(AlarmsConfig())
    standing = (
        alarm(AlarmKind.DEFLATION, "fl"),
        alarm(AlarmKind.RADIUS_DEVIATION, "rr"),
        alarm(AlarmKind.MALFUNCTION, None),
    )
    frames = alarm_frames(reporter.frames(0.0, report(active=standing, events=standing)))
    assert [("deflation", "fl", 1), ("radius_deviation", "rr", 2), ("malfunction", "none", 3)] == [
        (f["AlarmKind"], f["AlarmWheel"], f["AlarmSequence"]) for f in frames
    ]
    for frame in frames:
        assert {"Deflation_FL", "RadiusDeviation_RR", "Malfunction"} == {
            name for name, value in frame.items() if value == "alarm"
        }
        assert 3 == frame["ActiveAlarms"]
    assert "not_available" == frames[2]["AlarmChange"]
    assert pytest.approx(99.5) == frames[2]["AlarmProbability"]
    assert 3 == len(alarm_frames(reporter.frames(0.5, report(active=standing))))


def test_alarms_taken_over_from_an_earlier_run_are_announced() -> None:
    """An alarm that stands without an event is announced as raised, and as cleared once it is gone."""
    reporter = CanReporter(AlarmsConfig())
    taken_over = alarm_frames(reporter.frames(0.0, report(active=(alarm(),))))
    gone = alarm_frames(reporter.frames(0.1, report()))
    assert [("raised", 1)] == [(f["AlarmRaised"], f["AlarmSequence"]) for f in taken_over]
    assert [("cleared", 2)] == [(f["AlarmRaised"], f["AlarmSequence"]) for f in gone]


def test_a_tyre_that_was_soft_before_is_not_reported_by_what_changed_since() -> None:
    """Its alarm keeps the probability and the loss of its first radii; the change since is not available."""
    since = replace(alarm(), pressure_loss=0.55, since="before the first start")
    learned = tuple(wheel_report(name, deflation_probability=0.0, pressure_loss=0.01) for name in WHEELS)
    (sent,) = alarm_frames(CanReporter(AlarmsConfig()).frames(0.0, report(0.0, learned, (since,), (since,))))

    assert "not_available" == sent["AlarmChange"]
    assert pytest.approx(99.5) == sent["AlarmProbability"]
    assert 55 == sent["AlarmPressureLoss"]


def test_an_alarm_that_names_no_wheel_lights_all_of_its_kind() -> None:
    """A deflation of no single wheel sets the four deflation bits and no other."""
    everywhere = alarm(wheel=None)
    (frame,) = alarm_frames(CanReporter(AlarmsConfig()).frames(0.0, report(active=(everywhere,))))
    assert {f"Deflation_{w.upper()}" for w in WHEELS} == {k for k, v in frame.items() if v == "alarm"}


ALARM_KEYS = [(kind, wheel) for kind in AlarmKind for wheel in (*WHEELS, None)]


@given(st.lists(st.sets(st.sampled_from(ALARM_KEYS), max_size=5), max_size=40))
@settings(derandomize=True, deadline=None)
def test_a_receiver_that_follows_the_frames_knows_what_stands(
    history: list[set[tuple[AlarmKind, str | None]]],
) -> None:
    """Whatever is raised and cleared, the last word on each alarm is true, and sequences rise by one."""
    reporter = CanReporter(AlarmsConfig())
    believed: dict[tuple[str, str], str] = {}
    sequences: list[int] = []
    previous: set[tuple[AlarmKind, str | None]] = set()
    for i, standing in enumerate(history):
        events = [alarm(*key) for key in sorted(standing - previous, key=str)]
        events += [alarm(*key, state="cleared") for key in sorted(previous - standing, key=str)]
        active = tuple(alarm(*key) for key in standing)
        for frame in alarm_frames(
            reporter.frames(0.1 * i, report(0.1 * i, active=active, events=tuple(events)))
        ):
            believed[frame["AlarmKind"], frame["AlarmWheel"]] = frame["AlarmRaised"]
            if frame["AlarmSequence"] not in sequences:
                sequences.append(frame["AlarmSequence"])
        expected = {(str(kind), wheel or "none") for kind, wheel in standing}
        assert expected == {key for key, state in believed.items() if state == "raised"}
        previous = standing
    assert list(range(1, len(sequences) + 1))[:255] == sequences[:255]


def test_the_frames_shown_in_the_documentation_are_these_very_frames() -> None:
    """The example of the page on CAN output is what the reporter sends for the situation it describes."""
    wheels = (
        wheel_report("fl", deviation_m=-0.00121, std_m=0.00012, change_m=0.00002),
        wheel_report("fr", deviation_m=-0.00118, std_m=0.00012, change_m=-0.00004),
        wheel_report("rl", state=WheelState.ALARM, deviation_m=-0.00437, std_m=0.00009, change_m=-0.00318),
        wheel_report("rr", state=WheelState.LEARNING, deviation_m=-0.00115, std_m=0.0003, change_m=NAN),
    )
    wheels = (
        *wheels[:2],
        wheels[2]._replace(deflation_probability=0.998, pressure_loss=0.37),
        wheels[3],
    )
    frames = CanReporter(AlarmsConfig()).frames(0.0, report(0.0, wheels, (alarm(),), (alarm(),)))
    documentation = (REPO / "docs" / "reference" / "can-output.md").read_text()
    shown = re.findall(r"\b6F[01]#[0-9A-F]{16}\b", documentation)
    assert [f"{frame.arbitration_id:03X}#{frame.data.hex().upper()}" for frame in frames] == shown
    code = re.search(r"```python\n(.*?)```", documentation, re.DOTALL)
    assert code is not None
    names: dict[str, Any] = {}
    exec(code[1], names)
    assert [f.data[0] for f in frames] == [
        names["checksum"](0xF1 if f.arbitration_id == 0x6F1 else 0xF0, f.data) for f in frames
    ]


def test_identifiers_and_their_format_are_the_configured_ones() -> None:
    """A J1939 user gets 29-bit identifiers of his choice, and the checksum stays the same."""
    alarms = AlarmsConfig(status_id=0x18FFF0C8, alarm_id=0x18FFF1C8, extended_ids=True)
    frames = CanReporter(alarms).frames(0.0, report(active=(alarm(),)))
    plain = CanReporter(AlarmsConfig()).frames(0.0, report(active=(alarm(),)))
    assert [(0x18FFF1C8, True)] + 3 * [(0x18FFF0C8, True)] == [(f.arbitration_id, f.extended) for f in frames]
    assert [f.data for f in plain] == [f.data for f in frames]


def test_nothing_is_sent_where_the_output_is_switched_off() -> None:
    """alarms.can = false keeps the bus silent."""
    assert [] == CanReporter(AlarmsConfig(can=False)).frames(0.0, report(active=(alarm(),)))


@pytest.mark.parametrize(
    ("alarms", "message"),
    [
        (AlarmsConfig(status_id=0x800), "alarms.status_id 0x800 does not fit 11 bits (at most 0x7FF)"),
        (
            AlarmsConfig(alarm_id=1 << 29, extended_ids=True),
            "alarms.alarm_id 0x20000000 does not fit 29 bits (at most 0x1FFFFFFF)",
        ),
        (AlarmsConfig(status_id=5, alarm_id=5), "alarms.status_id and alarms.alarm_id are both 0x5"),
    ],
)
def test_identifiers_that_cannot_be_are_refused(alarms: AlarmsConfig, message: str) -> None:
    """One line names the key, the identifier and the limit."""
    with pytest.raises(ConfigError) as error:
        CanReporter(alarms)
    assert message == str(error.value)
