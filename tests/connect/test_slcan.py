"""A slcan adapter (LAWICEL's text protocol) behind a pseudo terminal, as the daemon's bus."""

from __future__ import annotations

import logging
import os
import threading
import time
from pathlib import Path

from tests.connect.servers import raw_pty, wait_for
from tests.onboard.daemon.fakes import car
from tpmsd.car.config.load import load_config
from tpmsd.onboard.daemon.clock import Clock
from tpmsd.onboard.daemon.loop import Daemon
from tpmsd.onboard.sinks.sd_notify import Notifier
from tpmsd.onboard.sources.can.decoder import load_database

LOG = logging.getLogger("tests.connect")
LAMP = """
BO_ 977 LAMP: 2 BSI
 SG_ CNT : 0|8@1+ (1,0) [0|255] "" X
 SG_ SUM : 8|8@1+ (1,0) [0|255] "" X
"""
OUTPUT = """[[can.output]]
message = "LAMP"
period_s = 0.2
[can.output.signals]
CNT = "counter"
SUM = { value = "checksum", algorithm = "sum8", data_id = [7] }
"""


class Adapter:
    """The other end of the line: writes frames of the wheels, and reads what the daemon sends."""

    def __init__(self, master: int) -> None:
        self._master = master
        self.received = b""
        self._over = threading.Event()
        os.set_blocking(master, False)
        self._thread = threading.Thread(target=self._loop)
        self._thread.start()

    def _loop(self) -> None:
        next_s, count = time.monotonic(), 0
        while not self._over.is_set():
            if time.monotonic() >= next_s:
                next_s += 0.02
                count = (count + 10) & 0xFFFF
                data = count.to_bytes(2, "little") * 4
                os.write(self._master, b"t0B08" + data.hex().upper().encode() + b"\r")
            try:
                self.received += os.read(self._master, 4096)
            except BlockingIOError:
                time.sleep(0.002)

    def frames(self) -> list[bytes]:
        """The data of frames under 0x3D1 that were sent, from their text."""
        return [
            bytes.fromhex(line[5:].decode()) for line in self.received.split(b"\r") if line[:5] == b"t3D12"
        ]

    def close(self) -> None:
        self._over.set()
        self._thread.join()


def test_wheels_come_and_the_lamp_is_sent_over_slcan(tmp_path: Path) -> None:
    """Frames of the adapter move the daemon's ticks; a message of `[[can.output]]` leaves."""
    with raw_pty() as (master, path):
        car(tmp_path, OUTPUT, channel=path)
        dbc, toml = tmp_path / "bus.dbc", tmp_path / "vehicle.toml"
        dbc.write_text(dbc.read_text("utf-8") + LAMP, "utf-8")
        text = toml.read_text("utf-8").replace('"virtual"', '"slcan"')
        toml.write_text(
            text.replace('dbc = "bus.dbc"\n', 'dbc = "bus.dbc"\noutput_ids = [0x3D1]\n', 1), "utf-8"
        )
        config = load_config(toml)
        adapter = Adapter(master)
        daemon = Daemon(config, load_database(config.can.dbc), Clock(1.0), Notifier(None), log=LOG)
        thread = threading.Thread(target=daemon.run, args=(60.0,))
        thread.start()
        try:
            wait_for("frames of the lamp", lambda: len(adapter.frames()) >= 5, 30.0)
            document = daemon.document()
        finally:
            daemon.stop()
            thread.join(10.0)
            adapter.close()
    frames = adapter.frames()

    assert "ok" == document["can"]["state"]
    assert document["can"]["frames"] > 100 and document["ticks"] > 20
    assert list(range(5)) == [data[0] for data in frames[:5]]
    assert all((7 + data[0]) % 256 == data[1] for data in frames)
