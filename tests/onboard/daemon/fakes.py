"""Stand-ins for what the daemon's loop meets: a bus, a clock, a service manager, a car."""

from __future__ import annotations

import signal
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any

from cantools.database.can import Database

from tests.onboard.sources_can.build import COUNTERS_DBC
from tpmsd.car.config.load import load_config
from tpmsd.car.config.model import CanConfig, Config
from tpmsd.onboard.daemon.bus_link import OpenBus
from tpmsd.onboard.daemon.clock import Clock
from tpmsd.onboard.daemon.loop import Daemon
from tpmsd.onboard.pipeline import Step
from tpmsd.onboard.sinks.sd_notify import Notifier
from tpmsd.onboard.sources.can.decoder import load_database
from tpmsd.onboard.sources.can.frame import CanFrame
from tpmsd.onboard.sources.can.live import CanDown

VEHICLE = """[vehicle]
wheel_radius_m = 0.3
track_front_m = 1.5
track_rear_m = 1.5
wheelbase_m = 2.6
teeth_per_rev = 48
[can]
interface = "virtual"
channel = "{channel}"
dbc = "bus.dbc"
[can.signals]
wheel_count_fl = "WHEELS.FL"
wheel_count_fr = "WHEELS.FR"
wheel_count_rl = "WHEELS.RL"
wheel_count_rr = "WHEELS.RR"
[filter]
particles = 10
[status]
socket = "status.sock"
[state]
file = "state.json"
"""


def car(folder: Path, extra: str = "", channel: str = "fake") -> tuple[Config, Database]:
    """A configuration in a folder, with `extra` tables behind it."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "bus.dbc").write_text(COUNTERS_DBC, encoding="utf-8")
    (folder / "vehicle.toml").write_text(VEHICLE.format(channel=channel) + extra, encoding="utf-8")
    config = load_config(folder)
    return config, load_database(config.can.dbc)


def listening(
    config: Config,
    database: Database,
    clock: Clock,
    open_bus: OpenBus,
    watch: Callable[[Step], None],
    **more: Any,
) -> Daemon:
    """A daemon without a service manager that takes the bus's own stamps and tells `watch` of every step."""
    same = {"open_bus": open_bus, "on_step": watch, "frame_time": lambda stamp_s: stamp_s}
    return Daemon(config, database, clock, Notifier(None), **same, **more)


def wheels_frame(time_s: float, turned_rad: float = 0.0) -> CanFrame:
    """All four wheels at the same angle."""
    count = int(turned_rad / 6.283185307 * 48) & 0xFFFF
    return CanFrame(time_s, "fake", 0xB0, False, False, False, False, count.to_bytes(2, "little") * 4)


class FakeBus:
    """A bus without a descriptor that goes down and comes up when a test says so."""

    def __init__(self) -> None:
        self.is_up = True
        self.full = False
        self.waiting: list[CanFrame] = []
        self.sent: list[tuple[int, bytes]] = []
        self.opened = 0
        self.closed = 0
        self.dropped = self.malformed = 0

    def opener(self) -> OpenBus:
        def open_bus(config: CanConfig, filters: list[dict[str, Any]] | None, channel: str) -> FakeBus:
            if not self.is_up:
                raise CanDown(channel, "Network is down")
            self.opened += 1
            return self

        return open_bus

    def fileno(self) -> int | None:
        return None

    def read(self, limit: int = 1000) -> list[CanFrame]:
        if not self.is_up:
            raise CanDown("fake", "Network is down")
        frames, self.waiting = self.waiting[:limit], self.waiting[limit:]
        return frames

    def send(self, arbitration_id: int, data: bytes, extended: bool = False) -> bool:
        if not self.is_up:
            raise CanDown("fake", "Network is down")
        if self.full:
            return False
        self.sent.append((arbitration_id, data))
        return True

    def close(self) -> None:
        self.closed += 1


class ServiceManagerSocket:
    """The other end of NOTIFY_SOCKET."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(str(path))
        self._socket.setblocking(False)

    def received(self) -> list[str]:
        """Everything said since the last call, one entry per assignment."""
        messages: list[str] = []
        while True:
            try:
                messages += self._socket.recv(4096).decode("utf-8").split("\n")
            except BlockingIOError:
                return messages

    def close(self) -> None:
        self._socket.close()


class HandClock:
    """Readings of a clock that only the test moves."""

    def __init__(self, now_s: float = 1000.0) -> None:
        self.now_s = now_s

    def __call__(self) -> float:
        return self.now_s


class LeapingClock(Clock):
    """Leaps by what the loop would wait, at most `POLL_S`, so that no pause of the machine is seen.

    Whatever the process does takes `LOOK_S` per look at the clock.
    """

    POLL_S = 0.04
    LOOK_S = 1e-5

    def __init__(self) -> None:
        self.leapt_s = 0.0
        super().__init__(wall=lambda: 1.7e9 + self.leapt_s, monotonic=self._look)

    def _look(self) -> float:
        self.leapt_s += self.LOOK_S
        return self.leapt_s

    def to_real(self, seconds: float) -> float:
        """Nothing is waited for: the time is over at once."""
        self.leapt_s += min(seconds, self.POLL_S)
        return 0.0


class DrivingBus(FakeBus):
    """The bus of a car at 20 m/s: a frame of all wheels every 20 ms of the given clock."""

    def __init__(self, now: Callable[[], float]) -> None:
        super().__init__()
        self._now = now
        self._next_s = now()
        self._origin_s = self._next_s

    def read(self, limit: int = 1000) -> list[CanFrame]:
        now_s = self._now()
        if not -1.0 < now_s - self._next_s < 60.0:
            self._next_s = now_s  # the clock was set
        while self._next_s <= now_s:
            turned_rad = 20.0 / 0.3 * ((self._next_s - self._origin_s) % 1000.0)
            self.waiting.append(wheels_frame(self._next_s, turned_rad))
            self._next_s += 0.02
        return super().read(limit)


def hear_signals() -> None:
    """For `preexec_fn`: a program hears what stops it, also where the tests run under `nohup`.

    That, or a shell's background, makes children ignore SIGHUP or SIGINT, and a daemon leaves ignored what it
    finds ignored.
    """
    for number in (signal.SIGHUP, signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_DFL)
