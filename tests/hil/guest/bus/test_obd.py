"""The daemon asks a car for its speed on a real bus; what answers is a socket that knows nothing of tpmsd."""

from __future__ import annotations

import contextlib
import socket
import struct
import threading
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

from tests.beside import beside
from tests.hil.guest.rig import listening, run, running, simulating, wait_until

FRAME = struct.Struct("=IB3x8s")
"""struct can_frame of linux/can.h."""
STATED_KMH = 33


@contextlib.contextmanager
def control_unit(channel: str) -> Iterator[None]:
    """An engine control unit: answers 0x7DF, service 01, PIDs 00 and 0D, at 0x7E8."""
    answers = {0x00: bytes.fromhex("0641000008000000"), 0x0D: bytes([3, 0x41, 0x0D, STATED_KMH, 0, 0, 0, 0])}
    bus = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    bus.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, struct.pack("=II", 0x7DF, 0xC00007FF))
    bus.settimeout(0.1)
    bus.bind((channel,))

    def serve(over: threading.Event) -> None:
        while not over.is_set():
            with contextlib.suppress(TimeoutError):
                _, _, data = FRAME.unpack(bus.recv(FRAME.size))
                if data[:2] == b"\x02\x01" and data[2] in answers:
                    bus.send(FRAME.pack(0x7E8, 8, answers[data[2]]))

    with bus, beside(serve):
        yield


def test_the_car_is_asked_answers_and_is_left_to_a_tester(tmp_path: Path) -> None:
    """Requests once a second after three of listening; the answer is in the status, held against wheels and
    receiver; a tester's request ends ours."""
    pty, car = tmp_path / "gnss", tmp_path / "car"
    drive = ("--duration", "90", "--route", "motorway", "--live", "vcan0", "--pty", pty)
    with (
        simulating(car, *drive),
        control_unit("vcan0"),
        listening("vcan0", tmp_path / "heard", "7DF:7FF") as heard,
    ):
        wait_until(pty.exists, "the car drives")
        file = car / "vehicle.toml"
        text = file.read_text("utf-8").replace("[can]\n", "[can]\noutput_ids = [0x7DF]\n", 1)
        file.write_text(f"{text}\n[obd]\nspeed = true\n", "utf-8")
        with running(car, "--device", str(pty)) as daemon:
            answered = daemon.until(lambda status: status["obd"]["answered"] >= 5, "the car answers")["obd"]
            asked = [frame.data.hex() for frame in heard.frames(0x7DF)]
            times_s = [frame.time_s for frame in heard.frames(0x7DF)]
            run("cansend", "vcan0", "7DF#02010C5555555555")
            stopped = daemon.until(lambda status: status["obd"]["stopped"], "the tester is heard")["obd"]
            log = daemon.log()
        foreign = heard.frames(0x7DF)[len(asked) :]

    assert STATED_KMH == answered["speed_kmh"]
    assert {"02010d5555555555"} == set(asked)
    assert all(later - earlier > 0.9 for earlier, later in pairwise(times_s))
    assert "another node sends 0x7DF" == stopped["stopped"]
    assert "02010c5555555555" == foreign[-1].data.hex()
    assert "[obd] the car is asked for its speed: 0x7DF every 1 s on its bus" in log
