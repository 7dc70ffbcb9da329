"""A day of driving in logical time, with one fault after the other: `make soak`.

In: hours, a seed. Out: what a daemon made of it, hour by hour. The whole daemon runs, with its loop, queue,
status socket and state file; only bus, receiver and clock are stand-ins, and the clock leaps from deadline to
deadline, so that an hour takes about a minute. The drives are simulated in processes of their own
(`soak_leg`), so that the resident memory is the daemon's.

    python -m tests.faults.soak --hours 24
    python -m tests.faults.soak --week         seven days of three legs, each a start of its own (`soak_week`)
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import functools
import gc
import json
import logging
import math
import operator
import os
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tpmsd.foundation.startup import import_on_demand, leave_out_mf4, without_openssl

leave_out_mf4()  # as the daemon does: it takes as much memory as all the rest
import_on_demand()
with without_openssl():
    from tpmsd.car.config.load import load_config
    from tpmsd.car.config.model import DEFAULT_METHOD, FILTER_METHODS, CanConfig, Config
    from tpmsd.onboard.daemon.clock import Clock
    from tpmsd.onboard.daemon.loop import Daemon
    from tpmsd.onboard.pipeline import Step
    from tpmsd.onboard.sinks.sd_notify import Notifier
    from tpmsd.onboard.sources.can.decoder import load_database
    from tpmsd.onboard.sources.can.frame import CanFrame
    from tpmsd.onboard.sources.can.live import CanDown
    from tpmsd.onboard.sources.gnss.serial_live import ReceiverGone

if TYPE_CHECKING:
    from cantools.database import Database

REPO = Path(__file__).resolve().parents[2]
WHEELS = 0xB0
OFFSET_M = (0.9e-3, -0.7e-3, -1.1e-3, 0.6e-3)
"""True minus nominal radii, the same all day."""
START_S = 1_719_820_800.0
LEG_S = 900.0
PARKED_S = 120.0
CALM_S = 150.0
"""At the beginning of a leg nothing happens, nor at the end of the last one, where a tyre goes soft."""
PUNCTURE_S = 120.0
BUS_FAULTS = ("silent", "lossy", "frozen", "noise", "spoofed", "down", "twice", "no value", "flood")
OTHER_FAULTS = ("unplugged", "garbage", "mute", "frozen fix", "jump", "clock", "clients")


@dataclass(frozen=True)
class Episode:
    """Something that is wrong for a while; times in seconds since the day's start."""

    kind: str
    from_s: float
    to_s: float


class DayClock(Clock):
    """Leaps to whatever the loop would wait for; its wall clock may be set."""

    def __init__(self, start_s: float) -> None:
        self._now_s = 0.0
        self._set_by_s = 0.0
        super().__init__(
            1.0, wall=lambda: start_s + self._set_by_s + self._now_s, monotonic=lambda: self._now_s
        )
        self.next_input_s: Callable[[], float] = lambda: float("inf")

    def set_by(self, seconds: float) -> None:
        """Set the wall clock."""
        self._set_by_s += seconds

    @property
    def stamp_offset_s(self) -> float:
        """What the wall clock shows at the day's start, as it is set now."""
        return self.now() - self._now_s

    def to_real(self, seconds: float) -> float:
        """Nothing is waited for: the time is over at once."""
        input_s = self.next_input_s()
        until_s = self._now_s + seconds
        self._now_s = input_s if self._now_s < input_s < until_s else until_s
        return 0.0


def read_frames(path: Path) -> Iterator[tuple[float, int, bytes]]:
    """Time, identifier and data of each frame of a leg."""
    with path.open(encoding="ascii") as lines:
        for line in lines:
            time_s, number, data = line.split()
            yield float(time_s), int(number), bytes.fromhex(data)


def read_sentences(path: Path) -> Iterator[tuple[float, bytes]]:
    """Time and text of each sentence of a leg."""
    with path.open("rb") as lines:
        for line in lines:
            time_s, _, text = line.rstrip(b"\n").partition(b" ")
            yield float(time_s), text


@dataclass(frozen=True)
class Special:
    """What is not as on every day."""

    offset_m: tuple[float, ...] = OFFSET_M
    start_s: float = START_S
    punctured: bool = True
    """True where the last leg ends with a puncture."""
    tyres: str | None = None
    """The set of tyres that a client names when the day has begun."""
    clock_off_s: float = 0.0
    """By so much the host's clock is wrong for the first `CLOCK_SET_S`."""


USUAL = Special()
CLOCK_SET_S, ASK_S = 45.0, 10.0


@dataclass
class Day:
    """What bus and receiver deliver, leg by leg."""

    folder: Path
    seed: int
    legs: int
    clock: DayClock
    leg_s: float = LEG_S
    special: Special = USUAL
    episodes: list[Episode] = field(default_factory=list)
    happened: Counter[str] = field(default_factory=Counter)
    leg: int = -1

    def __post_init__(self) -> None:
        self._rng = np.random.default_rng(self.seed)
        self._place = (50.11, 8.68)
        self._frames: Iterator[tuple[float, int, bytes]] = iter(())
        self._lines: Iterator[tuple[float, bytes]] = iter(())
        self._frame: tuple[float, int, bytes] | None = None
        self._line: tuple[float, bytes] | None = None
        self._held: dict[str, bytes] = {}
        self._own = np.zeros(4)
        self._before = np.zeros(4, dtype=np.int64)
        self._clients: list[socket.socket] = []
        self._clock_done: set[float] = set()
        self._clock_right = False
        self._asking: socket.socket | None = None
        self.answer = b""
        """What the daemon said of the new tyres."""
        self.clock.set_by(self.special.clock_off_s)
        self.clock.next_input_s = lambda: self._line[0] if self._line is not None else float("inf")

    @property
    def period_s(self) -> float:
        """From leg to leg."""
        return self.leg_s + PARKED_S

    def next_leg(self) -> None:
        """Take the next leg."""
        self.leg += 1
        special = self.special
        legs = self.legs if special.punctured else self.legs + 1
        arguments = (self.folder, self.leg, legs, self.seed, self.leg_s, *self._place)
        arguments += (*special.offset_m, special.start_s)
        made = subprocess.run(
            [sys.executable, "-m", "tests.faults.soak_leg", *map(str, arguments)],
            check=True,
            capture_output=True,
            cwd=REPO,
        )
        latitude_deg, longitude_deg = json.loads(made.stdout)
        self._place = (latitude_deg, longitude_deg)
        self._frames = read_frames(self.folder / "frames")
        self._lines = read_sentences(self.folder / "sentences")
        self._frame, self._line = next(self._frames, None), next(self._lines, None)
        self.episodes = list(self._draw(self.leg * self.period_s))

    def hold(self) -> None:
        """Take the leg into memory, without faults, so that a process that is forked has it of its own."""
        self._frames, self._lines = iter(list(self._frames)), iter(list(self._lines))
        self.episodes = []

    def _draw(self, begin_s: float) -> Iterator[Episode]:
        end_s = begin_s + self.leg_s - (2.0 * CALM_S if self.leg == self.legs - 1 else 30.0)
        at_s = begin_s + CALM_S
        while at_s < end_s:
            kinds = BUS_FAULTS + OTHER_FAULTS
            kind = kinds[int(self._rng.integers(len(kinds)))]
            length_s = float(self._rng.uniform(1.0, 40.0))
            yield Episode(kind, at_s, at_s + (min(length_s, 5.0) if kind == "flood" else length_s))
            self.happened[kind] += 1
            at_s += length_s + float(self._rng.uniform(20.0, 90.0))

    def now(self, time_s: float) -> Episode | None:
        """What is wrong now."""
        return next((e for e in self.episodes if e.from_s <= time_s < e.to_s), None)

    def frames(self, until_s: float, limit: int) -> list[CanFrame]:
        """What came on the bus."""
        out: list[CanFrame] = []
        while self._frame is not None and self._frame[0] <= until_s and len(out) < limit:
            time_s, number, data = self._frame
            episode = self.now(time_s)
            kind = "" if episode is None else episode.kind
            if kind not in ("frozen", "spoofed"):
                self._held.pop("frame", None)
            for later_s, identifier, payload in self._changed(kind, time_s, number, data):
                stamp_s = later_s + self.clock.stamp_offset_s
                out.append(CanFrame(stamp_s, "day", identifier, False, False, False, False, payload))
            self._frame = next(self._frames, None)
        return out

    def _changed(self, kind: str, time_s: float, number: int, data: bytes) -> list[tuple[float, int, bytes]]:
        plain = (time_s, number, data)
        if kind == "silent":
            return []
        if number != WHEELS:
            return [plain]
        if kind == "lossy":
            return [plain] if self._rng.random() < 0.7 else []
        if kind == "frozen":
            return [(time_s, number, self._held.setdefault("frame", data))]
        if kind == "noise":
            return [plain if self._rng.random() < 0.9 else (time_s, number, self._rng.bytes(8))]
        if kind == "no value":
            return [(time_s, number, b"\xff" * 8)]
        if kind == "twice":
            return [plain, plain]
        if kind == "flood":
            return [plain, *((time_s, 0x100 + k, bytes(8)) for k in range(100))]
        if kind == "spoofed":
            counts = np.frombuffer(data, "<u2").astype(np.int64)
            if "frame" not in self._held:
                self._held["frame"] = data
                self._own[:] = self._rng.integers(0, 65536, 4)
                self._before = counts
            self._own += (counts - self._before) % 65536 * np.array([1.0, 1.0, 1.02, 1.0])
            self._before = counts
            other = (self._own.astype(np.int64) % 65536).astype("<u2").tobytes()
            return [plain, (time_s + 0.007, number, other)]
        return [plain]

    def sentences(self, until_s: float) -> bytes:
        """What came from the receiver."""
        out = b""
        while self._line is not None and self._line[0] <= until_s:
            time_s, text = self._line
            episode = self.now(time_s)
            kind = "" if episode is None else episode.kind
            if kind != "frozen fix":
                for key in ("RMC", "GGA"):
                    self._held.pop(key, None)
            if kind == "garbage":
                out += self._rng.bytes(60)
            elif kind == "frozen fix":
                out += self._held.setdefault(text[3:6].decode(), text) + b"\r\n"
            elif kind == "jump":
                out += _sealed(text.replace(b",N,", b",S,")) + b"\r\n"
            elif kind not in ("mute", "unplugged"):
                out += text + b"\r\n"
            self._line = next(self._lines, None)
        return out

    def play(self, time_s: float, socket_path: Path) -> None:
        """Clock steps and clients: what concerns neither bus nor receiver."""
        self._begin(time_s, socket_path)
        episode = self.now(time_s)
        kind = "" if episode is None else episode.kind
        if episode is not None and kind == "clock" and episode.from_s not in self._clock_done:
            self._clock_done.add(episode.from_s)
            self.clock.set_by(float(self._rng.choice([-3600.0, -5.0, 5.0, 3600.0])))
        if kind == "clients" and not self._clients:
            for number in range(20):
                client = socket.socket(socket.AF_UNIX)
                client.setblocking(False)
                with contextlib.suppress(BlockingIOError, OSError):
                    client.connect(str(socket_path))
                    client.send((b"watch\n", b"status\n", b"{[\n", b"x" * 5000)[number % 4])
                self._clients.append(client)
        elif kind != "clients" and self._clients:
            for client in self._clients:
                client.close()
            self._clients.clear()

    def _begin(self, time_s: float, socket_path: Path) -> None:
        """What belongs to the beginning of a special day."""
        if self.special.clock_off_s and not self._clock_right and time_s >= CLOCK_SET_S:
            self._clock_right = True
            self.clock.set_by(-self.special.clock_off_s)
        if self.special.tyres is not None and self._asking is None and time_s >= ASK_S:
            self._asking = socket.socket(socket.AF_UNIX)
            self._asking.setblocking(False)
            self._asking.connect(str(socket_path))
            request = {"request": "reset", "tyres": self.special.tyres}
            self._asking.send(json.dumps(request).encode() + b"\n")
        elif self._asking is not None and self._asking.fileno() >= 0 and time_s >= ASK_S + 5.0:
            self.answer = self._asking.recv(4096)
            self._asking.close()


def _sealed(text: bytes) -> bytes:
    """The sentence with the checksum that it should have."""
    body = text[1 : text.rindex(b"*")]
    return b"$%s*%02X" % (body, functools.reduce(operator.xor, body))


class DayBus:
    """The bus of the day, as `LiveCan`."""

    def __init__(self, day: Day) -> None:
        self._day = day
        self.dropped = self.malformed = 0
        self.sent: Counter[int] = Counter()

    def _is_down(self) -> bool:
        episode = self._day.now(self._day.clock.monotonic())
        return episode is not None and episode.kind == "down"

    def open(self, config: CanConfig, filters: list[dict[str, Any]] | None, channel: str) -> DayBus:
        """`CanDown` while it is down."""
        if self._is_down():
            raise CanDown(channel, "Network is down")
        return self

    def fileno(self) -> int | None:
        """None: it is looked at."""
        return None

    def read(self, limit: int = 1000) -> list[CanFrame]:
        """Frames up to now."""
        frames = self._day.frames(self._day.clock.monotonic(), limit)
        if self._is_down():
            raise CanDown("day", "Network is down")
        return frames

    def send(self, arbitration_id: int, data: bytes, extended: bool = False) -> bool:
        """Counts."""
        self.sent[arbitration_id] += 1
        return True

    def close(self) -> None:
        """Nothing to close."""


class DayReceiver:
    """The receiver of the day, as `SerialReceiver`."""

    def __init__(self, day: Day) -> None:
        self._day = day
        self._pair: tuple[socket.socket, socket.socket] | None = None

    def _is_gone(self) -> bool:
        episode = self._day.now(self._day.clock.monotonic())
        return episode is not None and episode.kind == "unplugged"

    def open(self) -> None:
        """`ReceiverGone` while it is unplugged."""
        self.close()
        if self._is_gone():
            raise ReceiverGone("day", "no such device")
        self._pair = socket.socketpair()

    def fileno(self) -> int:
        """A descriptor of its own with each opening."""
        if self._pair is None:
            raise ReceiverGone("day", "not open")
        return self._pair[0].fileno()

    def read(self) -> bytes:
        """Sentences up to now."""
        data = self._day.sentences(self._day.clock.monotonic())
        if self._is_gone():
            raise ReceiverGone("day", "unplugged")
        return data

    def close(self) -> None:
        """Give the descriptors back."""
        if self._pair is not None:
            for end in self._pair:
                end.close()
            self._pair = None


@dataclass
class Mark:
    """How the process was at the end of a leg."""

    leg: int
    ticks: int
    elapsed_s: float
    rss_kb: int
    descriptors: int
    deviation_m: list[float]
    std_m: list[float]


@dataclass
class Soaked:
    """The day in figures."""

    puncture_s: float
    """When the tyre goes soft; infinite if none does."""
    marks: list[Mark] = field(default_factory=list)
    alarms: list[tuple[float, str, str | None, str]] = field(default_factory=list)
    happened: Counter[str] = field(default_factory=Counter)
    document: dict[str, Any] = field(default_factory=dict)
    real_s: float = 0.0
    offset_m: tuple[float, ...] = OFFSET_M
    answer: bytes = b""
    """What the daemon said of new tyres."""

    @property
    def tyre_alarms(self) -> list[tuple[float, str, str | None, str]]:
        """Those that accuse a tyre."""
        return [alarm for alarm in self.alarms if alarm[1] != "malfunction"]


def configuration(folder: Path, of_state: str = "") -> Config:
    """The configuration of the simulator's car, with a socket and a state file of its own."""
    file = folder / "vehicle.toml"
    text = file.read_text("utf-8")
    if "[state]" not in text:
        text += '\n[status]\nsocket = "status.sock"\n\n[state]\nfile = "state.json"\n' + of_state
    file.write_text(text, encoding="utf-8")
    config = load_config(folder)
    signals = {r: s for r, s in config.can.signals.items() if r.startswith("wheel_") or r == "yaw_rate"}
    return dataclasses.replace(config, can=dataclasses.replace(config.can, signals=signals))


def day_daemon(
    day: Day, config: Config, database: Database, watch: Callable[[Step], None], log: logging.Logger
) -> Daemon:
    """A daemon in the day's logical time, on its bus and receiver; it tells `watch` of every step."""
    return Daemon(
        config,
        database,
        day.clock,
        Notifier(None),
        open_bus=DayBus(day).open,
        open_receiver=lambda _: DayReceiver(day),
        on_step=watch,
        frame_time=lambda stamp_s: stamp_s,
        log=log,
    )


def soak(
    legs: int,
    seed: int,
    folder: Path,
    reported: Callable[[Mark, Soaked], None] = lambda mark, so_far: None,
    leg_s: float = LEG_S,
    method: str = DEFAULT_METHOD,
    special: Special = USUAL,
) -> Soaked:
    """Drive so many legs with this filter; `reported` is called with each. What `folder` holds of an
    earlier day, the state above all, is restored."""
    clock = DayClock(special.start_s)
    day = Day(folder, seed, legs, clock, leg_s, special)
    day.next_leg()
    config = configuration(folder)
    config = dataclasses.replace(config, filter=dataclasses.replace(config.filter, method=method))
    end_s = legs * day.period_s - PARKED_S
    result = Soaked(end_s - PUNCTURE_S if special.punctured else math.inf, offset_m=special.offset_m)
    began = time.monotonic()
    log = logging.getLogger("tests.soak")
    log.setLevel(logging.CRITICAL + 1)

    def watch(step: Step) -> None:
        now_s = clock.monotonic()
        result.alarms += [(now_s, str(e.kind), e.wheel, e.state) for e in step.report.events]
        day.play(now_s, config.status.socket)
        if now_s >= (day.leg + 1) * day.period_s - 1.0 and len(result.marks) == day.leg:
            mark(step)
            if day.leg + 1 < legs:
                day.next_leg()

    def mark(step: Step) -> None:
        gc.collect()
        pages = int(Path("/proc/self/statm").read_text("ascii").split()[1])
        made = Mark(
            day.leg,
            daemon.ticks,
            clock.monotonic(),
            pages * os.sysconf("SC_PAGE_SIZE") // 1024,
            len(list(Path("/proc/self/fd").iterdir())),
            step.estimate.deviation_m.tolist(),
            np.sqrt(np.diag(step.estimate.covariance_m2)).tolist(),
        )
        result.marks.append(made)
        reported(made, result)

    daemon = day_daemon(day, config, load_database(config.can.dbc), watch, log)
    daemon.run(legs * day.period_s)
    result.document = daemon.document()
    result.happened = day.happened
    result.answer = day.answer
    result.real_s = time.monotonic() - began
    return result


def settled(marks: list[Mark]) -> list[Mark]:
    """The last two thirds of a day; in them nothing is seen for the first time."""
    return marks[len(marks) // 3 :]


def slope_mb_per_h(marks: list[Mark]) -> tuple[float, float]:
    """Slope of the resident memory over the settled part, and its standard error (least squares)."""
    warm = settled(marks)
    if len(warm) < 3:
        return math.nan, math.nan
    hours = np.array([mark.elapsed_s for mark in warm]) / 3600.0
    megabytes = np.array([mark.rss_kb for mark in warm]) / 1024.0
    hours -= hours.mean()
    slope = float(hours @ megabytes / (hours @ hours))
    rest = megabytes - megabytes.mean() - slope * hours
    return slope, math.sqrt(float(rest @ rest) / (len(warm) - 2) / float(hours @ hours))


def main() -> int:
    """Soak, and say how it went; 1 if something is not as it should be."""
    parser = argparse.ArgumentParser(description="a day of driving in logical time, with faults")
    parser.add_argument("--hours", type=float, default=24.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--method", choices=FILTER_METHODS, default=DEFAULT_METHOD)
    parser.add_argument(
        "--week", action="store_true", help="days with restarts, tyre changes, seasons, clocks"
    )
    parser.add_argument("--days", type=int, default=7, help="of the week")
    args = parser.parse_args()
    if args.week:
        from tests.faults.soak_week import main as week

        return week(args.days, args.seed, args.method)
    legs = max(2, round(args.hours * 3600.0 / (LEG_S + PARKED_S)))

    def reported(mark: Mark, so_far: Soaked) -> None:
        off_mm = 1e3 * (np.array(mark.deviation_m) - OFFSET_M)
        print(
            f"leg {mark.leg + 1:3d}/{legs}  {mark.elapsed_s / 3600:5.2f} h  {mark.ticks:7d} ticks  "
            f"{mark.rss_kb / 1024:6.1f} MB  {mark.descriptors:3d} fds  "
            f"radii off {np.array2string(off_mm, precision=2, floatmode='fixed')} mm "
            f"(+- {1e3 * max(mark.std_m):.2f})  "
            f"{len(so_far.alarms)} alarm events, {len(so_far.tyre_alarms)} of tyres",
            flush=True,
        )

    with tempfile.TemporaryDirectory(prefix="tpmsd-soak-") as folder:
        result = soak(legs, args.seed, Path(folder), reported, method=args.method)
    wrong = problems(result)
    print(f"\nfaults: {dict(sorted(result.happened.items()))}")
    print(f"bus: {result.document['can']['faults']}")
    print(f"receiver: {result.document['gnss']['faults']}")
    print(f"tyre alarms: {[(round(t), *rest) for t, *rest in result.tyre_alarms]}")
    print(f"{result.marks[-1].elapsed_s / 3600:.2f} h in {result.real_s / 60:.1f} min")
    highest_mb = max(mark.rss_kb for mark in result.marks) / 1024.0
    slope, error = slope_mb_per_h(result.marks)
    print(f"memory: at most {highest_mb:.1f} MB; slope {slope:+.2f} +- {error:.2f} MB/h")
    for problem in wrong:
        print(f"WRONG: {problem}")
    return 1 if wrong else 0


GROWTH_KB, MANY_LEGS = 2 * 1024, 12
"""Between the thirds of the settled part, the first of them and the last."""
FEW_LEGS_KB = 40 * 1024
"""In a few legs most is seen for the first time."""
RADIUS_STDS = 4.0
"""What a radius may be off by at the end of a leg, in its own standard deviations: a fault may have ended
half a minute ago, and the estimate says so. One radius in 16,000 is off by more."""
LARGEST_STD_M = 1.0e-3
"""Beyond, a tyre that has lost 20 % of its pressure (1.4 mm) would not be seen."""


def problems(result: Soaked) -> list[str]:
    """Return the defects of a run, one line each."""
    return [
        *alarm_problems(result),
        *resource_problems(result),
        *radius_problems(result),
        *tick_problems(result),
    ]


def alarm_problems(result: Soaked) -> list[str]:
    """Return false alarms before the puncture at the end, and what is wrong about its own."""
    wrong: list[str] = []
    puncture_s = result.puncture_s
    false = [alarm for alarm in result.tyre_alarms if alarm[0] < puncture_s]
    if false:
        wrong.append(f"{len(false)} false alarms, first {false[0]}")
    found = [alarm for alarm in result.tyre_alarms if alarm[0] >= puncture_s]
    named = [(kind, wheel, state) for _, kind, wheel, state in found]
    if math.isfinite(puncture_s) and ("deflation", "rr", "raised") not in named:
        wrong.append("the puncture at the end was not found")
    if any(wheel != "rr" for _, _, wheel, _ in found):
        wrong.append(f"another wheel was accused at the end: {found}")
    return wrong


def resource_problems(result: Soaked) -> list[str]:
    """Return growth of memory and of open descriptors."""
    wrong: list[str] = []
    warm = settled(result.marks)
    third = max(len(warm) // 3, 1)
    early, late = (statistics.median(m.rss_kb for m in part) for part in (warm[:third], warm[-third:]))
    growth_kb = late - early
    if growth_kb > (GROWTH_KB if len(warm) >= MANY_LEGS else FEW_LEGS_KB):
        wrong.append(f"memory grew by {growth_kb:.0f} kB")
    if max(m.descriptors for m in warm) - min(m.descriptors for m in warm) > 2:
        wrong.append(f"descriptors: {sorted({m.descriptors for m in warm})}")
    return wrong


def radius_problems(result: Soaked) -> list[str]:
    """Return legs at whose end a radius is off by more than it states, or hardly known."""
    wrong: list[str] = []
    for before, after in zip(result.marks[:-2], result.marks[1:-1], strict=True):
        off = np.abs(np.array(after.deviation_m) - result.offset_m)
        if before.leg > 0 and np.max(off / after.std_m) > RADIUS_STDS:
            wrong.append(
                f"leg {after.leg + 1}: radii off by {1e3 * np.max(off):.2f} mm, "
                f"{np.max(off / after.std_m):.1f} of their standard deviations"
            )
        if max(after.std_m) > LARGEST_STD_M:
            wrong.append(f"leg {after.leg + 1}: a radius is known to {1e3 * max(after.std_m):.2f} mm")
    return wrong


def tick_problems(result: Soaked) -> list[str]:
    """Return a number of ticks that does not fit the time that went by."""
    expected = 10.0 * result.marks[-1].elapsed_s
    # A clock that is set forward by five seconds makes ticks for them, and one set back takes none away.
    set_forward = 50 * result.happened["clock"]
    if 0.99 * expected <= result.marks[-1].ticks <= expected + 1 + set_forward:
        return []
    return [f"{result.marks[-1].ticks} ticks instead of {expected:.0f}"]


if __name__ == "__main__":
    sys.exit(main())
