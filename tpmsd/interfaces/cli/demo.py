"""`make demo`: a slow puncture, simulated, found by the real daemon, and read off a CAN bus.

In: which wheel, and a seed. Out: what a driver would see, and exit code 0 only if the right wheel, and no
other, was announced on the bus.

A simulated car plays on python-can's `virtual` bus and on a pseudo terminal; the daemon itself runs on
both. An instrument panel that knows nothing but `dbc/tpmsd.dbc` listens to the bus.
"""

from __future__ import annotations

import argparse
import contextlib
import logging
import sys
import tempfile
import textwrap
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO, Any

import can
import cantools.database
from cantools.database.can import Database

from tpmsd.car.config.model import DEFAULT_METHOD, FILTER_METHODS
from tpmsd.foundation.errors import TpmsdError
from tpmsd.foundation.wheels import WHEELS
from tpmsd.interfaces.cli.demo_panel import GREEN, RED, Panel, listen
from tpmsd.interfaces.cli.demo_play import watch_live
from tpmsd.interfaces.cli.main import EXIT_INTERRUPTED
from tpmsd.interfaces.cli.status import colour_wanted, terminal_width
from tpmsd.offline.report.wording import WHEEL_NAMES, drive_time, wheel_name
from tpmsd.offline.simulator.drive import DriveSpec, SimulatedDrive, simulate_drive
from tpmsd.offline.simulator.faults import Fault
from tpmsd.onboard.daemon.clock import Clock
from tpmsd.onboard.daemon.loop import Daemon
from tpmsd.onboard.pipeline import Step

PUNCTURE_AT_S, PUNCTURE_OVER_S, LOSS_PERCENT = 150.0, 30.0, 2.0
DURATION_S = 300.0
AFTER_ALARM_S = 40.0
"""Time for which it goes on, so that a false alarm on another wheel would show."""
SPEED_UP = 16.0
CHANNEL = "demo"
_NEXT = "Next, the same as a recorded drive: .venv/bin/tpmsd simulate drives/nail --puncture rl"


def main(argv: Sequence[str] | None = None) -> int:
    """Run the demonstration; the exit code says whether the right wheel was found."""
    args = _parser().parse_args(argv)
    try:
        return demonstrate(args.wheel, args.seed, args.speed_up, sys.stdout, args.record, args.method)
    except TpmsdError as error:
        print(f"demo: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED


def demonstrate(
    wheel: str,
    seed: int,
    speed_up: float,
    out: IO[str],
    record: Path | None = None,
    method: str = DEFAULT_METHOD,
) -> int:
    """Simulate a puncture, play it to the daemon, and return 0 if the right wheel was found."""
    fault = Fault("puncture", LOSS_PERCENT, "percent", wheel, PUNCTURE_AT_S, PUNCTURE_OVER_S)
    drive = simulate_drive(DriveSpec(duration_s=DURATION_S, seed=seed, faults=(fault,)))
    loss_mm = LOSS_PERCENT / 100.0 * drive.spec.vehicle.wheel_radius_m[WHEELS.index(wheel)] * 1e3
    introduction = (
        f"A drive of {DURATION_S / 60:.0f} minutes at {speed_up:g} times real time, at most "
        f"{DURATION_S / speed_up:.0f} s, on a virtual CAN bus and a pseudo terminal.",
        f"At {drive_time(PUNCTURE_AT_S)} the {WHEEL_NAMES[wheel]} tyre begins to lose "
        f"{loss_mm:.1f} mm of radius ({LOSS_PERCENT:g} %) over {PUNCTURE_OVER_S:g} s.",
        "This is what an instrument panel hears on the bus:",
    )
    for line in introduction:
        print(_wrap_to_terminal(line, out), file=out)
    print(file=out, flush=True)
    show = _DemoDisplay(drive, out)
    with tempfile.TemporaryDirectory(prefix="tpmsd-demo-") as folder, show.listening():
        daemon = watch_live(
            drive,
            Path(folder),
            speed_up=speed_up,
            channel=CHANNEL,
            record=record,
            method=method,
            on_start=show.start,
            on_step=show.enough,
            log=_silent_log(),
        )
    if daemon.stopped_by == "SIGINT":
        raise KeyboardInterrupt
    return show.judge(wheel)


class _DemoDisplay:
    """The panel and its listener."""

    def __init__(self, drive: SimulatedDrive, out: IO[str]) -> None:
        self._start_s = float(drive.truth()["start_host_s"])
        self._out = out
        self._stop = threading.Event()
        self._daemon: Daemon | None = None
        self._clock: Clock | None = None
        dbc = Path(__file__).parents[3] / "dbc" / "tpmsd.dbc"
        if not dbc.is_file():
            raise TpmsdError(f"{dbc} is missing: the demonstration runs from a clone")
        database = cantools.database.load_file(str(dbc))
        assert isinstance(database, Database)
        self._ids = [message.frame_id for message in database.messages]
        self._panel = Panel(database, out, colour_wanted(out), self._drive_time_s, PUNCTURE_AT_S)

    def _drive_time_s(self) -> float:
        return 0.0 if self._clock is None else self._clock.now() - self._start_s

    @contextlib.contextmanager
    def listening(self) -> Iterator[None]:
        """Let the panel receive the bus in a thread of its own while the block runs: it is another device."""
        filters: Any = [{"can_id": i, "can_mask": 0x7FF, "extended": False} for i in self._ids]
        with can.Bus(interface="virtual", channel=CHANNEL, can_filters=filters) as bus:
            thread = threading.Thread(target=listen, args=(bus, self._panel, self._stop), daemon=True)
            thread.start()
            try:
                yield
            finally:
                self._stop.set()
                thread.join(2.0)

    def start(self, clock: Clock, daemon: Daemon) -> None:
        """Note that the drive has begun."""
        self._clock, self._daemon = clock, daemon

    def enough(self, step: Step) -> None:
        """Stop the daemon some time after the alarm."""
        found = next((alarm for alarm in self._panel.alarms if alarm.kind == "deflation"), None)
        if (
            found is not None
            and self._drive_time_s() > found.time_s + AFTER_ALARM_S
            and self._daemon is not None
        ):
            self._daemon.stop("shown")

    def judge(self, wheel: str) -> int:
        """Print the verdict; return 0 if the right wheel and no other was found on the bus."""
        panel = self._panel
        alarms = [alarm for alarm in panel.alarms if alarm.kind != "malfunction"]
        found = next((a for a in alarms if a.kind == "deflation" and a.wheel == wheel), None)
        wrong = [alarm for alarm in alarms if alarm.wheel != wheel or alarm.time_s < PUNCTURE_AT_S]
        good = found is not None and not wrong and not panel.damaged
        if found is None:
            verdict = f"Not found: the puncture of the {WHEEL_NAMES[wheel]} tyre was not announced."
        else:
            since_s = found.time_s - PUNCTURE_AT_S
            verdict = f"Found on the bus: {WHEEL_NAMES[wheel]}, {since_s:.0f} s after the puncture began."
        if wrong:
            others = ", ".join(f"{wheel_name(a.wheel)} at {drive_time(a.time_s)}" for a in wrong)
            verdict += f" Wrongly announced: {others}."
        elif found is not None:
            verdict += " No other wheel was announced."
        if panel.damaged:
            verdict += f" {panel.damaged} frames had a wrong checksum."
        print("\n\n" if self._out.isatty() else "\n", end="", file=self._out)
        print(
            panel.paint(_wrap_to_terminal(verdict, self._out), GREEN if good else RED),
            file=self._out,
            flush=True,
        )
        if good:
            print(_wrap_to_terminal(_NEXT, self._out), file=self._out, flush=True)
        return 0 if good else 1


def _wrap_to_terminal(text: str, out: IO[str]) -> str:
    """Return the text in lines that fit the terminal; unchanged where `out` is none."""
    width = terminal_width(out)
    return text if width is None else textwrap.fill(text, width - 1)


def _silent_log() -> logging.Logger:
    log = logging.getLogger("tpmsd.demo")
    log.propagate = False
    log.addHandler(logging.NullHandler())
    return log


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m tpmsd.interfaces.cli.demo",
        description="Simulates a slow puncture and shows how the daemon finds and announces it on a CAN bus.",
    )
    parser.add_argument("--wheel", choices=WHEELS, default="rl", help="which tyre (default: rl)")
    parser.add_argument("--seed", metavar="N", type=int, default=1, help="another drive (default: 1)")
    parser.add_argument(
        "--speed-up", metavar="X", type=float, default=SPEED_UP, help=f"default: {SPEED_UP:g}"
    )
    parser.add_argument(
        "--method",
        choices=FILTER_METHODS,
        default=DEFAULT_METHOD,
        help="estimator (default: %(default)s)",
    )
    parser.add_argument("--record", metavar="DIR", type=Path, help="also record it as a drive folder")
    return parser


if __name__ == "__main__":
    sys.exit(main())
