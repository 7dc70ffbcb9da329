"""`[[can.output]]`: messages of a foreign DBC, decoded and checked by other libraries."""

from __future__ import annotations

import dataclasses
import functools
import logging
import math
from pathlib import Path
from typing import Any

import cantools
import pytest
from crccheck.crc import Crc8Autosar, Crc8SaeJ1850
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.onboard.daemon.fakes import DrivingBus, FakeBus, car
from tests.onboard.daemon.test_loop import SCALE, run
from tests.onboard.sinks.test_status_document import REPORT
from tpmsd.car.config.can_output import ALGORITHM_NAMES
from tpmsd.car.config.load import load_config
from tpmsd.car.config.output_names import NAMES
from tpmsd.foundation.errors import ConfigError
from tpmsd.interfaces.cli.main import main
from tpmsd.onboard.daemon.clock import Clock
from tpmsd.onboard.monitor.records import AlarmEvent, AlarmKind, MonitorReport
from tpmsd.onboard.sinks.can_output import LISTEN_S, CanOutputs
from tpmsd.onboard.sinks.checksums import ALGORITHMS
from tpmsd.onboard.sinks.output_values import output_values
from tpmsd.onboard.sources.can.decoder import load_database

FOREIGN = """VERSION ""
NS_ :
BS_:
BU_: BSI
BO_ 977 TYRE_LAMP: 8 BSI
 SG_ CRC : 7|8@0+ (1,0) [0|255] "" X
 SG_ CNT : 8|4@1+ (1,0) [0|14] "" X
 SG_ LAMP : 12|1@1+ (1,0) [0|1] "" X
 SG_ STATE_FL : 16|3@1+ (1,0) [0|7] "" X
 SG_ STATE_RL : 19|3@1+ (1,0) [0|7] "" X
 SG_ LOSS_RL : 31|8@0+ (0.5,0) [0|100] "%" X
 SG_ DEV_RL : 32|12@1- (0.01,0) [-20|20] "mm" X
 SG_ DEV_FR : 44|12@1- (0.01,0) [-20|20] "mm" X
 SG_ REST : 56|8@1+ (1,0) [0|255] "" X
"""
OUTPUT = """
[can.buses]
comfort = "comfort"
[[can.output]]
message = "TYRE_LAMP"
dbc = "foreign.dbc"
{more}
[can.output.signals]
CRC = {{ value = "checksum", algorithm = "{algorithm}", data_id = [0x5A] }}
CNT = {{ value = "counter", modulo = 15 }}
LAMP = "alarm"
STATE_FL = {{ value = "state_fl", map = [7, 1, 2, 4] }}
STATE_RL = "state_rl"
LOSS_RL = "pressure_loss_percent_rl"
DEV_RL = "deviation_mm_rl"
DEV_FR = {{ value = "change_mm_fr", unknown = 20 }}
REST = 165
"""


def outputs(folder: Path, text: str = "", *, ids: str = "[0x3D1]", **filled: str) -> CanOutputs:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "foreign.dbc").write_text(FOREIGN, "utf-8")
    text = text or OUTPUT.format(**{"more": "", "algorithm": "crc8_j1850", **filled})
    config, database = car(folder, text)
    toml = folder / "vehicle.toml"
    toml.write_text(
        toml.read_text("utf-8").replace('dbc = "bus.dbc"\n', f'dbc = "bus.dbc"\noutput_ids = {ids}\n', 1),
        "utf-8",
    )
    config = load_config(folder)
    return CanOutputs(config, database)


def sent(made: CanOutputs, report: MonitorReport, start_s: float = LISTEN_S, ticks: int = 1) -> list[bytes]:
    frames = []
    for k in range(ticks):
        for bus, of_bus in made.frames(start_s + 0.1 * k, report).items():
            assert 0 == bus
            frames += [frame.data for frame in of_bus]
    return frames


def quiet(report: MonitorReport) -> MonitorReport:
    return report._replace(active=())


@pytest.mark.parametrize("algorithm", ALGORITHM_NAMES)
def test_another_decoder_reads_what_was_meant(algorithm: str, tmp_path: Path) -> None:
    """State, bits, numbers, counter and a constant come out of cantools; the checksum is independent."""
    made = outputs(tmp_path, algorithm=algorithm)
    made.frames(0.0, REPORT)
    frames = sent(made, REPORT, ticks=17)
    message = cantools.database.load_file(tmp_path / "foreign.dbc").get_message_by_name("TYRE_LAMP")
    decoded: list[dict[str, Any]] = [dict(message.decode(data)) for data in frames]  # type: ignore[arg-type]

    assert [*range(15), 0, 1] == [one["CNT"] for one in decoded]
    first = decoded[0]
    assert (1, 2, 3, 165) == tuple(int(first[name]) for name in ("LAMP", "STATE_FL", "STATE_RL", "REST"))
    assert (-3.2, -0.9, 0.0) == pytest.approx((first["DEV_RL"], first["DEV_FR"], first["LOSS_RL"]))
    for data in frames:
        others = b"\x5a" + data[1:]
        expected = {
            "crc8_j1850": Crc8SaeJ1850.calc(others),
            "crc8_autosar": Crc8Autosar.calc(others),
            "xor8": functools.reduce(int.__xor__, others),
            "sum8": sum(others) % 256,
            "sum8_inverted": 255 - sum(others) % 256,
            "toyota": (0x3 + 0xD1 + 8 + sum(others)) % 256,
        }
        assert expected[algorithm] == data[0]


def test_the_lists_of_algorithms_and_values_are_those_that_there_are() -> None:
    """What the configuration allows is what can be made, no more and no less."""
    assert set(ALGORITHM_NAMES) == set(ALGORITHMS)
    assert set(NAMES) == set(output_values(REPORT))


def test_unknown_numbers_are_what_the_configuration_says(tmp_path: Path) -> None:
    """Without a value the configured one is sent, else the initial one; out of range is the limit."""
    made = outputs(tmp_path)
    wheels = tuple(wheel._replace(change_m=math.nan, deviation_m=-1.0) for wheel in REPORT.wheels)
    made.frames(0.0, REPORT)
    (data,) = sent(made, REPORT._replace(wheels=wheels))
    decoded: Any = cantools.database.load_file(tmp_path / "foreign.dbc").decode_message(977, data)

    assert (20.0, -20.0) == pytest.approx((decoded["DEV_FR"], decoded["DEV_RL"]))


def test_nothing_is_sent_before_the_bus_was_listened_to(tmp_path: Path) -> None:
    """For three seconds the daemon only listens; then it sends at its period."""
    made = outputs(tmp_path, more="period_s = 0.5")
    times = [k / 10 for k in range(60) if made.frames(k / 10, REPORT)]

    assert [LISTEN_S + 0.5 * k for k in range(6)] == pytest.approx(times)


def test_changes_are_sent_at_once(tmp_path: Path) -> None:
    """On change: once at first, then only when a state or a bit changes; numbers alone change nothing."""
    made = outputs(tmp_path, more='when = "change"')
    made.frames(0.0, REPORT)
    other = tuple(wheel._replace(deviation_m=0.001) for wheel in REPORT.wheels)
    reports = [
        REPORT,
        REPORT,
        REPORT._replace(wheels=other),
        quiet(REPORT),
        quiet(REPORT),
        REPORT,
    ]

    assert [1, 0, 0, 1, 0, 1] == [len(sent(made, report, 10.0 + k)) for k, report in enumerate(reports)]


def test_another_sender_ends_the_output_for_good(tmp_path: Path) -> None:
    """One frame of another node under our identifier, and nothing is sent under it again; said once."""
    made = outputs(tmp_path)
    made.frames(0.0, REPORT)
    before = len(sent(made, REPORT))
    said = [made.received(0, 0x3D1, False), made.received(0, 0x3D1, False), made.received(0, 0x3D1, True)]

    assert (1, 0) == (before, len(sent(made, REPORT, 100.0, 50)))
    assert ["[[can.output]] TYRE_LAMP is stopped: another node sends 0x3D1", "", ""] == said
    assert "another node sends 0x3D1" == made.status()[0]["stopped"]


def test_the_daemon_sends_and_stops(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """On the daemon's own bus: frames after listening, none after a stranger's, one line in the log."""
    outputs(tmp_path)
    config = load_config(tmp_path)
    clock = Clock(SCALE)
    config = dataclasses.replace(config, can=dataclasses.replace(config.can, buses={}))

    class Bus(DrivingBus):
        asked = 0

        def send(self, arbitration_id: int, data: bytes, extended: bool = False) -> bool:
            if arbitration_id == 0x3D1:
                Bus.asked += 1
                if Bus.asked == 20:
                    frame = self.waiting[-1] if self.waiting else None
                    stranger = (frame or self.last)._replace(arbitration_id=0x3D1)
                    self.waiting.append(stranger)
            return super().send(arbitration_id, data, extended)

        def read(self, limit: int = 1000) -> list[Any]:
            frames = super().read(limit)
            if frames:
                self.last = frames[-1]
            return frames

    bus = Bus(clock.now)
    daemon = run(config, load_database(config.can.dbc), clock, bus, 20.0)
    mine = [data for identifier, data in bus.sent if identifier == 0x3D1]

    # What one tick of the daemon, late on a busy machine, may still send before it hears of the stranger.
    assert 20 <= len(mine) < 60
    assert 1 == sum("TYRE_LAMP is stopped" in text for text in caplog.messages)
    assert "another node sends 0x3D1" == daemon.document()["can_output"][0]["stopped"]
    assert isinstance(bus, FakeBus) and logging.WARNING == caplog.records[0].levelno


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ("[0x3D1]", "[]", "0x3D1 is not in [can] output_ids"),
        ("[0x3D1]", "[0x20000000]", "[can] output_ids: out of range"),
        ('"TYRE_LAMP"', '"LAMP"', "foreign.dbc has no message 'LAMP'"),
        ("REST = 165", "RESTS = 165", "TYRE_LAMP has no signal 'RESTS'"),
        ('"alarm"', '"alarms_fl"', "[[can.output]] 1: signals.LAMP: no such value"),
        ('"crc8_j1850"', '"crc8"', "signals.CRC: algorithm: not one of the choices"),
        ("modulo = 15", "algorithm = 'xor8'", "signals.CNT: algorithm: is of a checksum only"),
        ('message = "TYRE_LAMP"', 'message = "TYRE_LAMP"\nbus = "x"', "no such bus"),
        ('message = "TYRE_LAMP"', 'message = "TYRE_LAMP"\nevery = 1', "every: unknown key"),
        ('message = "TYRE_LAMP"', 'j1939 = "tire"\nsource_address = 1', "signals: stands beside j1939"),
        ('"foreign.dbc"', '"bus.dbc"\nperiod_s = 0.001', "period_s: out of range"),
        ('message = "TYRE_LAMP"\ndbc = "foreign.dbc"', 'message = "WHEELS"', "has no signal 'CRC'"),
    ],
)  # fmt: skip
def test_what_cannot_be_sent_is_refused(
    old: str, new: str, reason: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`check` names what is wrong with an output, and where; exit code 2."""
    outputs(tmp_path)
    toml = tmp_path / "vehicle.toml"
    text = toml.read_text("utf-8")
    assert old in text
    toml.write_text(text.replace(old, new, 1), "utf-8")

    assert 2 == main(["check", str(toml)])
    error = capsys.readouterr().err
    assert reason in error
    assert "vehicle.toml" in error


def test_frames_of_the_car_that_are_read_are_never_sent(tmp_path: Path) -> None:
    """The wheels' own message is no output, and two outputs are not one identifier."""
    text = '[[can.output]]\nmessage = "WHEELS"\n[can.output.signals]\nFL = 1\n'
    with pytest.raises(ConfigError, match="tpmsd reads 0xB0 from the car itself"):
        outputs(tmp_path, text, ids="[0xB0]")
    twice = (
        OUTPUT.format(more="", algorithm="xor8")
        + OUTPUT.format(more="", algorithm="xor8").partition('comfort"\n')[2]
    )
    with pytest.raises(ConfigError, match="the same identifier on the same bus"):
        outputs(tmp_path, twice)


def test_check_says_what_would_be_sent(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A right configuration names its outputs in the plan."""
    outputs(tmp_path, more='bus = "comfort"\nwhen = "both"')

    assert 0 == main(["check", str(tmp_path)])
    assert "TYRE_LAMP on comfort, both every 0.1 s" in capsys.readouterr().out


def test_nothing_is_sent_by_default(tmp_path: Path) -> None:
    """Without [[can.output]] there is no output, whatever the allow-list says."""
    config, database = car(tmp_path)

    assert not CanOutputs(config, database)
    assert {} == CanOutputs(config, database).frames(100.0, REPORT)


J1939 = '[[can.output]]\nj1939 = "{kind}"\nsource_address = 0x33\nwhen = "both"\nperiod_s = 1.0\n'


def test_j1939_tire_is_what_the_table_says(tmp_path: Path) -> None:
    """Four frames with priority 6; the soft tyre leaks and is under pressure, pressures are not available."""
    made = outputs(tmp_path, J1939.format(kind="tire"), ids="[0x18FEF433]")
    made.frames(0.0, REPORT)
    (frames,) = made.frames(LISTEN_S, REPORT).values()

    assert {(0x18FEF433, True)} == {(frame.arbitration_id, frame.extended) for frame in frames}
    assert ["00fffffff3ffffff", "01fffffff3ffffff", "10fffffff7ffff7f", "11ffffffffffffff"] == [
        frame.data.hex() for frame in frames
    ]


def test_j1939_trouble_codes_are_read_by_another_library(tmp_path: Path) -> None:
    """DM1 names SPN 241 with the failure of the moment, and nothing when all is well."""
    j1939 = pytest.importorskip("j1939")
    made = outputs(tmp_path, J1939.format(kind="dm1"), ids="[0x18FECA33]")
    malfunction = AlarmEvent(1.0, AlarmKind.MALFUNCTION, None, "raised", math.nan, math.nan, 1.0, "no fixes")
    made.frames(0.0, REPORT)
    seen = []
    for k, report in enumerate((REPORT, quiet(REPORT), REPORT._replace(active=(malfunction,)))):
        (frames,) = made.frames(10.0 + k, report).values()
        parser = j1939.Dm1(_Application())
        received: list[tuple[Any, ...]] = []
        parser.subscribe(lambda *said, received=received: received.append(said))
        parser._receive(6, 65226, 0x33, 0.0, list(frames[0].data))
        lamps, codes = received[0][1:3]
        seen.append((lamps["awl"] != 0, [(code["spn"], code["fmi"]) for code in codes]))

    assert [(True, [(241, 18)]), (False, [(0, 0)]), (True, [(241, 12)])] == seen


class _Application:
    def subscribe(self, *_: object) -> None: ...


@settings(derandomize=True, deadline=None, max_examples=100)
@given(st.lists(st.floats(), min_size=24, max_size=24))
def test_any_report_makes_a_frame(tmp_path_factory: pytest.TempPathFactory, numbers: list[float]) -> None:
    """Numbers that are none, or too great, never keep a frame from being made."""
    made = outputs(tmp_path_factory.getbasetemp() / "any")
    wheels = tuple(
        wheel._replace(
            deviation_m=numbers[k],
            std_m=numbers[4 + k],
            change_m=numbers[8 + k],
            pressure_loss=numbers[12 + k],
        )
        for k, wheel in enumerate(REPORT.wheels)
    )
    report = REPORT._replace(wheels=wheels)
    made.frames(0.0, report)

    assert [8] == [len(data) for data in sent(made, report)]
