"""Everything that takes bytes from outside, as functions of bytes that must never raise.

In: any bytes. Out: nothing; an exception, a hang or memory without bound is a finding. `TARGETS` has a
function by name, and `SEEDS` some sound inputs for each, from which a fuzzer starts.
"""

from __future__ import annotations

import atexit
import dataclasses
import functools
import io
import itertools
import json
import logging
import math
import shutil
import socket
import tempfile
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import can as can_module
import numpy as np
from cantools.database.can import Database

from tests.interfaces.api.test_from_tables import straight
from tests.interfaces.api.test_tables import MAP, frame_of
from tests.interfaces.api.test_tables import hdf5 as write_hdf5
from tests.interfaces.bridges.documents import alarm
from tests.offline.fleet.test_damaged_store import KEYS, RESULT, store_of
from tests.onboard.daemon.fakes import VEHICLE
from tests.onboard.gnss import sentences
from tests.onboard.gnss.test_gpsd_json import GST, SKY, TPV
from tests.onboard.gnss.test_ubx import frame
from tpmsd.car.config.check import check
from tpmsd.car.config.dynamics import load_car
from tpmsd.car.config.load import load_config
from tpmsd.car.config.model import Config
from tpmsd.car.physics.dynamics_model import format_dynamics_model, parse_dynamics_model
from tpmsd.car.physics.model_file import load_model
from tpmsd.foundation.errors import InputError, TpmsdError
from tpmsd.interfaces.api.import_table import load_table
from tpmsd.interfaces.bridges.mqtt_messages import alarms_of_payload
from tpmsd.offline.drives.reading import ignore_note
from tpmsd.offline.fleet.store import Store
from tpmsd.offline.fleet.tables import parquet_of, rows_of
from tpmsd.offline.signals.drive import make_drive
from tpmsd.offline.signals.fmu import unpack
from tpmsd.offline.signals.read import read_signals
from tpmsd.offline.signals.vbo import read_vbo
from tpmsd.onboard.daemon.state_keeper import StateKeeper, fingerprint
from tpmsd.onboard.pipeline import Pipeline
from tpmsd.onboard.sinks.state_file import load_state, save_state
from tpmsd.onboard.sinks.status_client import StatusError, parse_status
from tpmsd.onboard.sinks.status_server import MAX_REQUEST_BYTES, StatusServer
from tpmsd.onboard.sources.can.candump_line import parse_candump_line
from tpmsd.onboard.sources.can.decoder import CanDecoder, load_database
from tpmsd.onboard.sources.can.log import read_can_log
from tpmsd.onboard.sources.events import GnssFix, InertialSample, RotationSample
from tpmsd.onboard.sources.gnss import nmea_sentence
from tpmsd.onboard.sources.gnss.nmea_epoch import NmeaAssembler
from tpmsd.onboard.sources.gnss.nmea_framer import MAX_LINE_BYTES, NmeaFramer
from tpmsd.onboard.sources.gnss.nmea_log import read_nmea_log
from tpmsd.onboard.sources.gnss.stream import GpsdStream, NmeaStream
from tpmsd.onboard.timeline.tick_source import TickSource

MAX_EVENTS_PER_FRAME = 40
DBC = """VERSION ""
NS_ :
BS_:
BU_: CAR
BO_ 176 COUNTS: 8 CAR
 SG_ FL : 0|16@1+ (1,0) [0|65535] "" CAR
 SG_ FR : 16|8@1+ (1,0) [0|254] "" CAR
BO_ 177 MUXED: 8 CAR
 SG_ WHICH M : 0|4@1+ (1,0) [0|15] "" CAR
 SG_ RL m1 : 8|32@1+ (1,0) [0|4294967295] "" CAR
BO_ 178 SPEEDS: 8 CAR
 SG_ RR : 7|16@0+ (0.01,0) [0|300] "km/h" CAR
 SG_ YAW : 16|32@1- (1,0) [-10|10] "rad/s" CAR
BO_ 2566844926 TEMPERATURE: 8 CAR
 SG_ OUTSIDE : 0|8@1+ (0.5,-40) [-40|87] "degC" CAR
SIG_VALTYPE_ 178 YAW : 1;
"""
SIGNALS = {
    "wheel_count_fl": "COUNTS.FL",
    "wheel_count_fr": "COUNTS.FR",
    "wheel_count_rl": "MUXED.RL",
    "wheel_speed_rr": "SPEEDS.RR",
    "yaw_rate": "SPEEDS.YAW",
    "ambient_temp": "TEMPERATURE.OUTSIDE",
}
IDENTIFIERS = ((176, False), (177, False), (178, False), (2566844926 & 0x1FFFFFFF, True), (999, False))


@functools.cache
def folder() -> Path:
    """A folder for what has to be a file; it goes with the process."""
    made = Path(tempfile.mkdtemp(prefix="tpmsd-fuzz-"))
    atexit.register(shutil.rmtree, made, ignore_errors=True)
    (made / "bus.dbc").write_text(DBC, encoding="utf-8")
    return made


@functools.cache
def car() -> Config:
    """A car with signals of every kind."""
    head = VEHICLE.split("[can.signals]")[0].format(channel="fuzz")
    lines = "".join(f'{role} = "{name}"\n' for role, name in SIGNALS.items())
    (folder() / "car.toml").write_text(f"{head}[can.signals]\n{lines}[filter]\nparticles = 10\n", "utf-8")
    return load_config(folder() / "car.toml")


def file(name: str, content: bytes) -> Path:
    """The content as a file."""
    path = folder() / name
    path.write_bytes(content)
    return path


def nmea(data: bytes) -> None:
    """Bytes of a serial line, in pieces, with time going by in between, forward and back."""
    framer, assembler = NmeaFramer(), NmeaAssembler()
    time_s = 1.7e9
    for start in range(0, len(data), 97):
        piece = data[start : start + 97]
        time_s += (piece[0] - 100) / 50.0
        for line in framer.feed(piece):
            assert len(line) <= MAX_LINE_BYTES
            same_sentence(line)
            for event in assembler.feed(time_s, line):
                if isinstance(event, GnssFix) and not math.isnan(event.latitude_deg):
                    assert abs(event.latitude_deg) <= 90.0 and abs(event.longitude_deg) <= 180.0
                    assert 0.0 < event.position_std_m < math.inf
        assembler.advance(time_s + 0.3)
        assert len(framer._partial) <= MAX_LINE_BYTES
    assembler.flush()


def same_sentence(line: bytes) -> None:
    """A line that compiled code reads is read alike without it."""
    values = None if nmea_sentence.compiled is None else nmea_sentence.compiled.decode(line, math.nan)
    if values is not None:
        assert repr(values) == repr(tuple(nmea_sentence._decode_by_fields(line)))


def stream(data: bytes) -> Iterator[tuple[float, int, bool, bytes]]:
    """Bytes as frames: a step of time, an identifier, a length, and so many bytes."""
    time_s, at = 1.7e9, 0
    while at + 3 <= len(data):
        step, which, size = data[at : at + 3]
        time_s += (0.0, -0.004, 0.01, 0.02, 0.3, 5.0, -2.0, 3600.0)[step % 8] + step * 1e-5
        number, extended = IDENTIFIERS[which % len(IDENTIFIERS)]
        size = min(size, 64) if size & 0x80 else 8
        yield time_s, number, extended, data[at + 3 : at + 3 + size]
        at += 3 + size


def can(data: bytes) -> None:
    """Frames of any payload at any time: samples are finite, and never more than there are signals."""
    decoder = CanDecoder(car(), load())
    segments: dict[int, int] = {}
    for time_s, number, extended, payload in stream(data):
        events = decoder.decode(time_s, number, extended, payload)
        assert len(events) <= MAX_EVENTS_PER_FRAME
        for event in events:
            if isinstance(event, RotationSample):
                assert math.isfinite(event.angle_rad)
                assert event.segment >= segments.get(event.wheel, -1)
                segments[event.wheel] = event.segment
            elif isinstance(event, InertialSample):
                assert math.isfinite(event.value)
        decoder.poll(time_s)
    assert len(decoder.counts) < 200


@functools.cache
def load() -> Database:
    """The database of the car."""
    return load_database(folder() / "bus.dbc")


def ticks(data: bytes) -> None:
    """Frames and lines together: ticks whose index and time only rise, with finite or unknown rotations."""
    source = TickSource(car(), load(), 10.0)
    made = []
    for number, (time_s, identifier, extended, payload) in enumerate(stream(data[:4000])):
        made += source.on_frame(time_s, identifier, extended, payload)
        if number % 7 == 3:
            made += source.on_sentence(time_s, b"$" + payload)
    made += source.finish()
    assert len(made) <= 10.0 * 5.5 * (len(data) // 3 + 2)
    for before, after in itertools.pairwise(made):
        assert after.index == before.index + 1
        assert after.time_s > before.time_s
    assert all(not np.any(np.isinf(tick.rotation_rad)) for tick in made)


def candump(data: bytes) -> None:
    """Lines of a candump log: a frame within CAN's limits, or none."""
    for line in data.decode("latin-1").splitlines():
        frame = parse_candump_line(line)
        if frame is not None:
            assert 0 <= frame.arbitration_id <= 0x1FFFFFFF
            assert len(frame.data) <= 64
            assert math.isfinite(frame.time_s)
    log("log", data)


def log(suffix: str, data: bytes) -> None:
    """A whole log in a format."""
    try:
        for frame in read_can_log(file(f"can.{suffix}", data)):
            assert math.isfinite(frame.time_s)
    except InputError as error:
        assert "\n" not in str(error)


def asc(data: bytes) -> None:
    """Lines of an ASC log."""
    log("asc", data)


def trc(data: bytes) -> None:
    """Lines of a TRC log."""
    log("trc", data)


def blf(data: bytes) -> None:
    """A BLF file."""
    log("blf", data)


def mf4(data: bytes) -> None:
    """An MF4 file."""
    log("mf4", data)


def dbc(data: bytes) -> None:
    """A DBC file: read with notes, or refused with a line."""
    try:
        for message in load_database(file("any.dbc", data)).messages:
            assert all(1 <= signal.length <= 64 for signal in message.signals)
    except TpmsdError as error:
        assert "\n" not in str(error)


@functools.cache
def packed(suffix: str) -> bytes:
    """A small log by python-can's own writers."""
    path = folder() / f"seed.{suffix}"
    with can_module.Logger(path) as writer:
        for k in range(20):
            data = bytes([k] * (k % 9))
            writer.on_message_received(
                can_module.Message(1719820800.0 + 0.01 * k, 0xB0 + k, bool(k % 2), data=data, channel=0)
            )
    return path.read_bytes()


def nmea_log(data: bytes) -> None:
    """Lines of a log of sentences."""
    try:
        for time_s, _, _ in read_nmea_log(file("gnss.nmea", data)):
            assert math.isfinite(time_s)
    except InputError as error:
        assert "\n" not in str(error)


def vbo(data: bytes) -> None:
    """A Racelogic VBO file: a table of columns of one length, or refused with a line."""
    try:
        table = read_vbo(file("any.vbo", data), ignore_note)
        assert 1 == len({len(values) for values in table.columns.values()})
    except InputError as error:
        assert "\n" not in str(error)


def toml(data: bytes) -> None:
    """A configuration: read, or refused with lines that say why."""
    path = file("vehicle.toml", data)
    try:
        load_config(path)
    except TpmsdError as error:
        assert 2 == error.exit_code
        assert str(error)
    check(path)


def model(data: bytes) -> None:
    """A model file: read, or refused with a line that says why."""
    try:
        load_model(file("model.toml", data))
    except TpmsdError as error:
        assert 2 == error.exit_code
        assert "\n" not in str(error)


@functools.cache
def quiet() -> logging.Logger:
    """A log that nobody reads."""
    logger = logging.getLogger("tests.fuzz")
    logger.addHandler(logging.NullHandler())
    logger.propagate = False
    return logger


def state(data: bytes) -> None:
    """A state file of these bytes; and, if they are JSON, one with them as its sealed snapshot."""
    path = file("state.json", data)
    load_state(path, on_damaged=lambda damaged: None)
    try:
        snapshot = json.loads(data)
    except (ValueError, RecursionError):
        return
    config = dataclasses.replace(car(), state=dataclasses.replace(car().state, file=path))
    try:
        save_state(path, {"fingerprint": fingerprint(config), "pipeline": snapshot})
    except TpmsdError:
        return
    pipeline = StateKeeper(config, quiet()).restored(lambda: Pipeline(config, load()))
    pipeline.on_frame(1.7e9, 176, False, bytes(8))
    pipeline.advance(1.7e9 + 2.0)
    json.dumps(pipeline.snapshot())


@functools.cache
def server() -> StatusServer:
    """A server that is asked again and again."""
    made = StatusServer(folder() / "status.sock", lambda: {"version": 1})
    made.open()
    return made


def status(data: bytes) -> None:
    """A request to the daemon, in two pieces: at most one line of an answer; and an answer to the client."""
    served = server()
    with socket.socket(socket.AF_UNIX) as client:
        client.setblocking(False)
        client.connect(str(folder() / "status.sock"))
        served.service(0.0)
        for piece in (data[: len(data) // 2], data[len(data) // 2 :]):
            try:
                client.send(piece[: 2 * MAX_REQUEST_BYTES])
            except OSError:
                break
            served.service(0.0)
        for now_s in (2.0, 20.0):
            served.service(now_s)
        try:
            answer = client.recv(65536)
        except OSError:
            answer = b""
        assert answer == b"" or answer.endswith(b"\n")
        assert all(isinstance(json.loads(line), dict) for line in answer.splitlines())
    served.service(40.0)
    served.publish(41.0)
    assert served.clients == 0
    try:
        parse_status(folder() / "status.sock", data)
    except StatusError as error:
        assert "\n" not in str(error)


RMC = "GNRMC,080000.00,A,5006.70,N,00841.04,E,31.2,325.6,010724,,,A"
GGA = "GNGGA,080000.00,5006.70,N,00841.04,E,1,17,0.67,116.2,M,47.0,M,,"
LOG = (
    b"(1719820800.012345) can0 0B0#1122334455667788\n(1719820800.1) can0 18FEF100#11 R\n"
    b"(1.0) c 123##1001122\n"
)
VBO = (
    b"File created on 01/07/2024 at 10:00:00\n[header]\nsatellites\ntime\nlatitude\nlongitude\nvelocity kmh\n"
    b"heading\nYawRate\n[channel units]\ndeg/s\n"
    b"[column names]\nsats time lat long velocity heading YawRate\n[data]\n"
) + b"".join(b"9 1200%04.1f +3119.1 -58.5 72.0 %05.1f +1.0E+00\n" % (0.1 * k, 0.1 * k) for k in range(40))
ASC = (
    b"date Mon Jul 1 10:00:00.000 am 2024\nbase hex timestamps absolute\ninternal events logged\n"
    b"   0.010000 1  B0              Rx   d 8 11 22 33 44 55 66 77 88\n"
    b"   0.020000 CANFD 1 Rx 123 1 0 8 8 01 02 03 04 05 06 07 08 0 0 0 0 0 0\n   0.03 1 ErrorFrame\n"
)
TRC = (
    b";$FILEVERSION=1.1\n;$STARTTIME=43008.920986006946\n"
    b"     1)       10.5  Rx         00B0  8  11 22 33 44 55 66 77 88\n"
)
SIGNAL_ROWS = (
    b"time_s,steering_wheel_angle_rad,yaw_rate_radps,accel_lat_mps2,speed_mps,drive_force_n,brake_force_n,oil\n"
) + b"".join(b"%.2f,%.2f,%.3f,,%d,100,0,a\n" % (0.1 * k, 0.01 * k, 0.02 * k, 20 + k) for k in range(15))
DYNAMICS = b"""[vehicle]
wheel_radius_m = { fl = 0.31, fr = 0.31, rl = 0.32, rr = 0.32 }
steering_ratio = 15.5
[dynamics]
mass_kg = 1480.0
yaw_inertia_kgm2 = 2350.0
cg_to_front_m = 1.18
cg_to_rear_m = 1.46
cornering_stiffness_front_n_per_rad = 105000.0
cornering_stiffness_rear_n_per_rad = 128000.0
"""
MODEL = (
    b'[[effect]]\nname = "tyre_relaxation"\nlength_m = 0.5\n[effect.std]\nlength_m = 0.1\n'
    b'[[effect]]\nname = "road_grade"\n'
)
MEMORY = {
    "estimator": {"order": [2, 3, 0, 1], "nominal_m": [0.3] * 4, "mean_m": [0.0] * 4},
    "monitor": {"sets": {"baseline": None, "others": {}}, "wheels": ["fl", "fr", "rl", "rr"], "alarms": []},
}


def _state_seed() -> bytes:
    return json.dumps(Pipeline(car(), load()).snapshot()).encode("ascii")


def _configuration_seed() -> bytes:
    car()
    return (folder() / "car.toml").read_bytes()


def receiver(data: bytes) -> None:
    """Bytes of a receiver or a server, in pieces, as UBX with NMEA in between and as gpsd's reports."""
    for stream in (NmeaStream(), GpsdStream()):
        assembler = NmeaAssembler()
        for start in range(0, len(data), 97):
            for stamp_s, line in stream.feed(data[start : start + 97], 1.7e9 + start):
                for event in assembler.feed(stamp_s, line):
                    if isinstance(event, GnssFix) and not math.isnan(event.latitude_deg):
                        assert abs(event.latitude_deg) <= 90.0 and abs(event.longitude_deg) <= 180.0
                        assert 0.0 < event.position_std_m < math.inf
        assert isinstance(stream.hint, str)


def signals(data: bytes) -> None:
    """A table of signals of a drive of vehicle dynamics, or one line."""
    file("signals.csv", data)
    try:
        found = read_signals(folder() / "signals.csv")
        assert all(np.isfinite(found.time_s)) and np.all(np.diff(found.time_s) > 0.0)
        assert 1 == len({len(values) for values in found.columns.values()})
        make_drive(found, load_car(file("dynamics.toml", DYNAMICS)), "three-dof", "fuzz")
    except TpmsdError as error:
        assert 3 == error.exit_code
        assert "\n" not in str(error)


def dynamics(data: bytes) -> None:
    """The tables `[vehicle]` and `[dynamics]`: a car, or lines that say why not."""
    try:
        found = load_car(file("any-dynamics.toml", data))
        assert 0.1 < found.wheel_radius_m < 1.0
    except TpmsdError as error:
        assert 2 == error.exit_code
        assert str(error)


def dynamics_model(data: bytes) -> None:
    """A model of vehicle dynamics: read and written again, or one line."""
    try:
        model = parse_dynamics_model(data.decode("latin-1"))
        assert parse_dynamics_model(format_dynamics_model(model)) == model
    except TpmsdError as error:
        assert 2 == error.exit_code
        assert "\n" not in str(error)


def fmu(data: bytes) -> None:
    """An archive of an FMU: unpacked into its folder, or one line."""
    where = folder() / "fmu"
    try:
        unpack(file("any.fmu", data), where / "in")
    except InputError as error:
        assert "\n" not in str(error)
    assert {path.name for path in where.glob("*")} <= {"in"}
    shutil.rmtree(where, ignore_errors=True)


def table(name: str, data: bytes, map_text: bytes = MAP.encode()) -> None:
    """A table of a user's logger: a drive, or one line."""
    try:
        load_table(file(name, data), file("map.toml", map_text))
    except TpmsdError as error:
        assert str(error)


def csv(data: bytes) -> None:
    """A CSV table."""
    table("log.csv", data)


def parquet(data: bytes) -> None:
    """A Parquet table, read in a child."""
    table("log.parquet", data)


def hdf5(data: bytes) -> None:
    """A MATLAB v7.3 table, read in a child."""
    table("log.mat", data)


def table_map(data: bytes) -> None:
    """A map of a sound table."""
    table("sound.csv", _table_seed("csv"), data)


def _archive_seed(method: int) -> bytes:
    """An archive with a description and a folder."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", method) as archive:
        archive.writestr("modelDescription.xml", b"<fmiModelDescription fmiVersion='2.0'/>")
        archive.writestr("binaries/linux64/model.so", bytes(200))
    return packed.getvalue()


@functools.cache
def _table_seed(kind: str) -> bytes:
    """A table of some seconds."""
    frame = frame_of(*straight(0.5 if kind == "csv" else 2.0))
    path = folder() / f"seed.{kind}"
    if kind == "csv":
        frame.to_csv(path, index=False)
    elif kind == "parquet":
        frame.to_parquet(path)
    else:
        write_hdf5(frame, path)
    return path.read_bytes()


@functools.cache
def fleet() -> Store:
    """A store of two drives."""
    return store_of(folder() / "fleet")


def store(data: bytes) -> None:
    """The result of one drive of a fleet: the other drive has its rows all the same."""
    (fleet().results / f"{KEYS[0]}.json").write_bytes(data)
    fleet().damaged.clear()
    rows = rows_of(fleet())
    assert all(parquet_of(name, made) for name, made in rows.items())
    assert ["done"] == [row["status"] for row in rows["drives"] if row["key"] == KEYS[1]]


def retained(data: bytes) -> None:
    """A broker's retained message of the alarms: names of kinds and wheels and finite times, or nothing."""
    for one in alarms_of_payload(data):
        json.dumps([one.kind, one.wheel, one.time_s], allow_nan=False)


TARGETS: dict[str, Callable[[bytes], None]] = {
    "nmea": nmea,
    "receiver": receiver,
    "can": can,
    "ticks": ticks,
    "candump": candump,
    "asc": asc,
    "trc": trc,
    "blf": blf,
    "mf4": mf4,
    "dbc": dbc,
    "nmea_log": nmea_log,
    "vbo": vbo,
    "toml": toml,
    "model": model,
    "state": state,
    "status": status,
    "csv": csv,
    "parquet": parquet,
    "hdf5": hdf5,
    "map": table_map,
    "store": store,
    "retained": retained,
    "signals": signals,
    "dynamics": dynamics,
    "dynamics_model": dynamics_model,
    "fmu": fmu,
}
IN_A_CHILD = ("parquet", "hdf5")
"""Targets whose reader is a process of its own, which takes a second each."""
SEEDS: dict[str, Callable[[], list[bytes]]] = {
    "nmea": lambda: [
        sentences.nmea(RMC) + b"\r\n" + sentences.nmea(GGA) + b"\r\n",
        b"\xb5b\x01\x07$GPGGA,,*00\n",
    ],
    "receiver": lambda: [
        frame(),
        b"".join(json.dumps(report).encode("ascii") + b"\n" for report in (SKY, GST, TPV)),
    ],
    "can": lambda: [bytes(range(256)), b"\x02\x00\x08" + bytes(8) + b"\x02\x02\x08" + b"\xff" * 8],
    "ticks": lambda: [bytes(range(256)), (b"\x03\x00\x08" + bytes(8)) * 30],
    "candump": lambda: [LOG],
    "asc": lambda: [ASC],
    "trc": lambda: [TRC],
    "blf": lambda: [packed("blf")],
    "mf4": lambda: [packed("mf4")],
    "dbc": lambda: [DBC.encode("ascii")],
    "nmea_log": lambda: [b"(1719820800.1) " + sentences.nmea(RMC) + b"\n", sentences.nmea(RMC) + b"\n"],
    "vbo": lambda: [VBO],
    "toml": lambda: [_configuration_seed()],
    "model": lambda: [b'[[effect]]\nname = "centrifugal_growth"\ncoefficient = 2e-06\n[effect.std]\n'],
    "state": lambda: [_state_seed(), json.dumps(MEMORY).encode("ascii")],
    "status": lambda: [b"status\n", b'{"request": "watch"}\n', b'{"version": 1}'],
    "csv": lambda: [_table_seed("csv")],
    "parquet": lambda: [_table_seed("parquet")],
    "hdf5": lambda: [_table_seed("mat")],
    "map": lambda: [MAP.encode()],
    "store": lambda: [json.dumps(RESULT).encode()],
    "retained": lambda: [json.dumps([alarm()]).encode(), b"[]"],
    "signals": lambda: [SIGNAL_ROWS],
    "dynamics": lambda: [DYNAMICS],
    "dynamics_model": lambda: [MODEL],
    "fmu": lambda: [_archive_seed(method) for method in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)],
}
