"""`make demo`: a slow puncture, simulated, found by the real daemon, and read off a CAN bus.

In: which wheel, and a seed. Out: what a driver would see, and exit code 0 only if the right wheel, and no other, was
announced on the bus.

A simulated car plays on python-can's `virtual` bus and on a pseudo terminal; the daemon itself runs on both, in this
thread. An instrument panel that knows nothing but `dbc/tpmsd.dbc` listens to the bus.
"""

from __future__ import annotations

import argparse
import logging
import math
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import can
import cantools.database
from cantools.database.can import Database, Message

import tpmsd
from tpmsd.cli.status import colour_wanted
from tpmsd.config.load import load_config
from tpmsd.daemon.clock import Clock
from tpmsd.daemon.loop import Daemon
from tpmsd.daemon.recorder import DriveRecorder
from tpmsd.errors import TpmsdError
from tpmsd.pipeline import Step
from tpmsd.report.wording import WHEEL_NAMES, drive_time
from tpmsd.simulator.drive import DriveSpec, SimulatedDrive, simulate_drive
from tpmsd.simulator.faults import Fault
from tpmsd.simulator.live import LivePlayer, PtyPort
from tpmsd.sinks.can_layout import ALARM_DATA_ID, STATUS_DATA_ID, checksum
from tpmsd.sinks.sd_notify import Notifier
from tpmsd.sources.can_decoder import load_database
from tpmsd.wheels import WHEELS

PUNCTURE_AT_S, PUNCTURE_OVER_S, LOSS_PERCENT = 150.0, 30.0, 2.0
DURATION_S = 300.0
AFTER_ALARM_S = 40.0
"""How much longer it goes on, so that a false alarm on another wheel would show."""
SPEED_UP = 16.0
GRACE_REAL_S = 0.05
"""Player and daemon share a process here: a frame may be this late, in real time."""

_RED, _GREEN, _BOLD, _DIM = "31;1", "32", "1", "2"


# -- a drive played to a daemon ---------------------------------------------------------------------------


def watch_live(
    drive: SimulatedDrive,
    folder: Path,
    *,
    speed_up: float,
    channel: str,
    duration_s: float = math.inf,
    record: Path | None = None,
    on_start: Callable[[Clock, Daemon], None] = lambda clock, daemon: None,
    on_step: Callable[[Step], None] | None = None,
    grace_real_s: float = GRACE_REAL_S,
    log: logging.Logger | None = None,
) -> Daemon:
    """Play a drive on the virtual bus `channel` and a pseudo terminal to a daemon in this thread; returns the daemon.

    `folder` takes the daemon's configuration, socket and state. Drive and daemon share one scaled clock: frames bear
    the drive's own times, sentences are stamped when they are read.
    """
    with (
        PtyPort() as port,
        can.Bus(interface="virtual", channel=channel, preserve_timestamps=True) as bus,
    ):
        text = drive.configuration("virtual", channel, port.path)
        text += '\n[status]\nsocket = "status.sock"\n\n[state]\nfile = "state.json"\n'
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "vehicle.toml").write_text(text, encoding="utf-8")
        (folder / "bus.dbc").write_text(drive.dbc, encoding="utf-8")
        config = load_config(folder)
        player = LivePlayer(drive, bus, port, speedup=speed_up)
        player.start()
        try:
            while player.now() == player.start_host_s:
                time.sleep(0.001)
            clock = Clock(speed_up, start_s=player.now())
            daemon = Daemon(
                config,
                load_database(config.can.dbc),
                clock,
                Notifier(None),
                recorder=None if record is None else DriveRecorder(record, config),
                on_step=on_step,
                frame_time=lambda stamp_s: stamp_s,
                grace_s=grace_real_s * speed_up,
                log=log,
            )
            on_start(clock, daemon)
            daemon.run(min(duration_s, drive.spec.duration_s))
        finally:
            player.stop()
            player.join(5.0)
        return daemon


# -- the instrument panel -----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Heard:
    """An alarm as it came off the bus."""

    time_s: float
    """Since the drive's start."""
    kind: str
    wheel: str
    change_mm: float
    probability_percent: float
    frame: str
    """As `candump` shows it."""
    signals: dict[str, Any]


@dataclass
class Panel:
    """Listens to the bus as any other control unit would, and shows what it hears."""

    database: Database
    out: IO[str]
    colour: bool
    time: Callable[[], float]
    """Seconds since the drive's start."""
    puncture_s: float = PUNCTURE_AT_S
    alarms: list[Heard] = field(default_factory=list)
    """Those raised, in their order."""
    damaged: int = 0
    """Frames with a wrong checksum."""
    _wheels: dict[str, Any] = field(default_factory=dict)
    _sequences: set[int] = field(default_factory=set)
    _shown: str = ""

    def take(self, frame: can.Message) -> None:
        """Decode one frame."""
        message = self.database.get_message_by_frame_id(frame.arbitration_id)
        data = bytes(frame.data)
        is_alarm = message.name == "TPMSD_ALARM"
        if checksum(ALARM_DATA_ID if is_alarm else STATUS_DATA_ID, data) != data[0]:
            self.damaged += 1
            return
        signals = dict(message.decode(data, decode_choices=True))  # type: ignore[arg-type]
        if is_alarm:
            self._take_alarm(message, frame, signals)
        else:
            self._wheels |= signals

    def _take_alarm(self, message: Message, frame: can.Message, signals: dict[str, Any]) -> None:
        """Show an alarm with the first of its frames; the others repeat it."""
        sequence = int(signals["AlarmSequence"])
        if sequence in self._sequences:
            return
        self._sequences.add(sequence)
        raw = message.decode(bytes(frame.data), decode_choices=False)
        codes = {code: name for code, name in enumerate(WHEELS)}
        heard = Heard(
            self.time(),
            str(signals["AlarmKind"]),
            codes.get(int(raw["AlarmWheel"]), ""),  # type: ignore[index,call-overload,arg-type]
            float(raw["AlarmChange"]),  # type: ignore[index,call-overload,arg-type]
            float(raw["AlarmProbability"]),  # type: ignore[index,call-overload,arg-type]
            f"{frame.arbitration_id:03X}#{bytes(frame.data).hex().upper()}",
            signals,
        )
        raised = bool(raw["AlarmRaised"])  # type: ignore[index,call-overload]
        if raised:
            self.alarms.append(heard)
        self._line("")
        since_s = heard.time_s - self.puncture_s
        since = f", {since_s:.0f} s after the puncture began" if since_s >= 0.0 else ""
        word = "ALARM  " if raised else "cleared"
        what = f"{WHEEL_NAMES.get(heard.wheel, 'car')} {heard.kind} {heard.change_mm:+.1f} mm"
        self._print(
            f"{drive_time(heard.time_s):>6}  "
            + self._paint(f"{word} {what} ({heard.probability_percent:.1f} %){since}", _RED if raised else _GREEN)
        )
        self._print(f"        frame    {heard.frame}")
        told = {name: value for name, value in signals.items() if not (isinstance(value, int) and value == 0)}
        words = [f"{name}={value}" for name, value in told.items()]
        for begin in range(0, len(words), 4):
            self._print(f"        {'signals ' if begin == 0 else '        '} {'  '.join(words[begin : begin + 4])}")

    def show(self) -> None:
        """One line of how the tyres are."""
        states = {str(self._wheels.get(f"State_{wheel.upper()}", "unavailable")) for wheel in WHEELS}
        learned = not states & {"learning", "unavailable"}
        values = []
        for wheel in WHEELS:
            name = f"{'Change' if learned else 'Deviation'}_{wheel.upper()}"
            value = self._wheels.get(name)
            known = value is not None and abs(float(value)) <= 20.47
            text = f"{wheel} {f'{float(value):+6.2f}' if known and value is not None else '     -'}"
            alarmed = str(self._wheels.get(f"State_{wheel.upper()}")) == "alarm"
            values.append(self._paint(text, _RED if alarmed else _GREEN if learned else _DIM))
        word = "ALARM" if "alarm" in states else "monitoring" if learned else "learning"
        against = "mm since learned" if learned else "mm from nominal"
        self._line(f"{drive_time(self.time()):>6}  {word:<11} {'  '.join(values)}  {against}")

    def _line(self, text: str) -> None:
        """On a terminal the line stays in place."""
        if not self.out.isatty():
            if text:
                self._print(text)
            return
        self.out.write("\r\x1b[K" + text)
        self.out.flush()

    def _print(self, text: str) -> None:
        self.out.write(text + "\n")
        self.out.flush()

    def _paint(self, text: str, style: str) -> str:
        return f"\x1b[{style}m{text}\x1b[0m" if self.colour else text


def listen(bus: can.BusABC, panel: Panel, stop: threading.Event) -> None:
    """Give the panel what comes, and have it show itself once a second, until told to stop."""
    shown_s = time.monotonic()
    while not stop.is_set():
        frame = bus.recv(0.05)
        if frame is not None:
            panel.take(frame)
        if time.monotonic() - shown_s >= 1.0:
            shown_s = time.monotonic()
            panel.show()


# -- the command --------------------------------------------------------------------------------------------


def main(argv: Sequence[str] | None = None) -> int:
    """Run the demonstration; the exit code says whether the right wheel was found."""
    args = _parser().parse_args(argv)
    try:
        return demonstrate(args.wheel, args.seed, args.speed_up, sys.stdout, args.record)
    except TpmsdError as error:
        print(f"demo: {error}", file=sys.stderr)
        return error.exit_code


def demonstrate(wheel: str, seed: int, speed_up: float, out: IO[str], record: Path | None = None) -> int:
    """Simulate, play, watch, judge."""
    colour = colour_wanted(out)
    database = cantools.database.load_file(str(Path(tpmsd.__file__).parents[1] / "dbc" / "tpmsd.dbc"))
    assert isinstance(database, Database)
    fault = Fault("puncture", LOSS_PERCENT, "percent", wheel, PUNCTURE_AT_S, PUNCTURE_OVER_S)
    drive = simulate_drive(DriveSpec(duration_s=DURATION_S, seed=seed, faults=(fault,)))
    loss_mm = LOSS_PERCENT / 100.0 * drive.spec.vehicle.wheel_radius_m[WHEELS.index(wheel)] * 1e3
    print(
        f"A drive of {DURATION_S / 60:.0f} minutes at {speed_up:g} times real time, on a virtual CAN bus and a\n"
        f"pseudo terminal. At {drive_time(PUNCTURE_AT_S)} the {WHEEL_NAMES[wheel]} tyre begins to lose "
        f"{loss_mm:.1f} mm of radius ({LOSS_PERCENT:g} %) over {PUNCTURE_OVER_S:g} s.\n"
        "This is what an instrument panel hears on the bus (dbc/tpmsd.dbc):\n",
        file=out,
        flush=True,
    )
    start_s = float(drive.truth()["start_host_s"])
    ids = [message.frame_id for message in database.messages]
    filters: Any = [{"can_id": i, "can_mask": 0x7FF, "extended": False} for i in ids]
    panel: Panel | None = None
    stop = threading.Event()
    listener: threading.Thread | None = None
    with (
        tempfile.TemporaryDirectory(prefix="tpmsd-demo-") as folder,
        can.Bus(interface="virtual", channel="demo", can_filters=filters) as bus,
    ):

        def start(clock: Clock, daemon: Daemon) -> None:
            nonlocal panel, listener, running
            running = daemon
            panel = Panel(database, out, colour, lambda: clock.now() - start_s)
            listener = threading.Thread(target=listen, args=(bus, panel, stop), daemon=True)
            listener.start()

        def enough(step: Step) -> None:
            found = [alarm for alarm in panel.alarms if alarm.kind == "deflation"] if panel else []
            if found and panel is not None and panel.time() > found[0].time_s + AFTER_ALARM_S:
                assert running is not None
                running.stop("shown")

        running: Daemon | None = None
        quiet = logging.getLogger("tpmsd.demo")
        quiet.propagate = False
        quiet.addHandler(logging.NullHandler())
        try:
            watch_live(
                drive,
                Path(folder),
                speed_up=speed_up,
                channel="demo",
                record=record,
                on_start=start,
                on_step=enough,
                log=quiet,
            )
        finally:
            stop.set()
            if listener is not None:
                listener.join(2.0)
    assert panel is not None
    return _judge(panel, wheel, out, colour)


def _judge(panel: Panel, wheel: str, out: IO[str], colour: bool) -> int:
    tyre_alarms = [alarm for alarm in panel.alarms if alarm.kind != "malfunction"]
    found = next((a for a in tyre_alarms if a.kind == "deflation" and a.wheel == wheel), None)
    wrong = [alarm for alarm in tyre_alarms if alarm.wheel != wheel or alarm.time_s < panel.puncture_s]
    good = found is not None and not wrong and not panel.damaged
    if found is None:
        verdict = f"The puncture of the {WHEEL_NAMES[wheel]} tyre was not announced."
    else:
        verdict = (
            f"Found: {WHEEL_NAMES[wheel]}, {found.time_s - panel.puncture_s:.0f} s after the puncture began, "
            f"announced on the bus as {found.frame}."
        )
    if wrong:
        others = ", ".join(f"{WHEEL_NAMES.get(a.wheel, 'car')} at {drive_time(a.time_s)}" for a in wrong)
        verdict += f" Wrongly announced: {others}."
    elif found is not None:
        verdict += " No other wheel was."
    if panel.damaged:
        verdict += f" {panel.damaged} frames had a wrong checksum."
    text = f"\x1b[{_GREEN if good else _RED}m{verdict}\x1b[0m" if colour else verdict
    print(("\r\x1b[K" if out.isatty() else "") + "\n" + text, file=out, flush=True)
    return 0 if good else 1


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m tpmsd.cli.demo",
        description="Simulates a slow puncture and shows how the daemon finds and announces it on a CAN bus.",
    )
    parser.add_argument("--wheel", choices=WHEELS, default="rl", help="which tyre (default: rl)")
    parser.add_argument("--seed", metavar="N", type=int, default=1, help="another drive (default: 1)")
    parser.add_argument("--speed-up", metavar="X", type=float, default=SPEED_UP, help=f"default: {SPEED_UP:g}")
    parser.add_argument("--record", metavar="DIR", type=Path, help="also record it as a drive folder")
    return parser


if __name__ == "__main__":
    sys.exit(main())
