"""An instrument panel for the demonstration: hears the bus as any other control unit would.

In: CAN frames, decoded by `dbc/tpmsd.dbc` alone. Out: what a driver would see, as text; the alarms heard.
"""

from __future__ import annotations

import textwrap
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import IO

import can
from cantools.database.can import Database

from tpmsd.foundation.wheels import WHEELS
from tpmsd.interfaces.cli.status import can_move, terminal_width
from tpmsd.offline.report.wording import drive_time, wheel_name
from tpmsd.onboard.sinks.can_layout import ALARM_DATA_ID, STATUS_DATA_ID, checksum

RED, GREEN, DIM = "31;1", "32", "2"
MARGIN, INDENT = 8, 12
"""Columns before a line, for the time; and before what goes on from the line above."""
WIDTH = 100
"""Columns where there is no terminal."""
_UNSPOKEN = ("AlarmChecksum", "AlarmCounter")
_NOTHING = {"none", "0"}


@dataclass(frozen=True, slots=True)
class ReceivedAlarm:
    """An alarm as it came off the bus."""

    time_s: float
    """Since the drive's start."""
    kind: str
    wheel: str | None
    frame: str
    """Frame as `candump` shows it."""


class Panel:
    """Shows what it hears; `alarms`: those raised so far, `damaged`: frames with a wrong checksum."""

    def __init__(
        self, database: Database, out: IO[str], colour: bool, now: Callable[[], float], puncture_s: float
    ) -> None:
        """`now`: seconds since the drive's start; `puncture_s`: when the tyre begins to lose air, as well."""
        self.alarms: list[ReceivedAlarm] = []
        self.damaged = 0
        self.now = now
        self._database = database
        self._out = out
        self._colour = colour
        self._puncture_s = puncture_s
        self._words: dict[str, str] = {}
        """Every signal of the status frames, as last heard."""
        self._sequences: set[str] = set()
        self._learned = False

    def decode(self, frame: can.Message) -> None:
        """Decode one frame: count it as damaged, show an alarm, or keep the status."""
        message = self._database.get_message_by_frame_id(frame.arbitration_id)
        data = bytes(frame.data)
        is_alarm = message.name == "TPMSD_ALARM"
        if checksum(ALARM_DATA_ID if is_alarm else STATUS_DATA_ID, data) != data[0]:
            self.damaged += 1
            return
        decoded = message.decode(data)
        assert isinstance(decoded, dict)
        words = {
            name: f"{value:g}" if isinstance(value, float) else str(value) for name, value in decoded.items()
        }
        if not is_alarm:
            self._words |= words
        elif words["AlarmSequence"] not in self._sequences:
            # The first frame of this alarm; the others repeat it.
            self._sequences.add(words["AlarmSequence"])
            self._show_alarm(words, f"{frame.arbitration_id:03X}#{data.hex().upper()}")

    def _show_alarm(self, words: dict[str, str], frame: str) -> None:
        raised = words["AlarmRaised"] == "raised"
        wheel = words["AlarmWheel"] if words["AlarmWheel"] in WHEELS else None
        received = ReceivedAlarm(self.now(), words["AlarmKind"], wheel, frame)
        if raised:
            self.alarms.append(received)
        what = f"{wheel_name(wheel)} {received.kind.replace('_', ' ')}"
        if words["AlarmChange"] != "not_available":
            what += f" {float(words['AlarmChange']):+.1f} mm ({words['AlarmProbability']} %)"
        since_s = received.time_s - self._puncture_s
        if since_s >= 0.0:
            what += f", {since_s:.0f} s after the puncture began"
        verb = "ALARM" if raised else "cleared"
        self._overwrite("")
        for number, line in enumerate(self._wrap_beyond_margin(f"{verb:<11} {what}")):
            margin = f"{drive_time(received.time_s):>6}  " if number == 0 else " " * MARGIN
            self._print(margin + self.paint(line, RED if raised else GREEN))
        self._print(f"{'':8}frame       {frame}")
        words_shown = [f"{k}={v}" for k, v in words.items() if k not in _UNSPOKEN and v not in _NOTHING]
        for line in self._wrap_beyond_margin(f"{'decoded':<11} {'  '.join(words_shown)}"):
            self._print(" " * MARGIN + line)

    def show(self) -> None:
        """Show the tyre status in one line."""
        states = {wheel: self._words.get(f"State_{wheel.upper()}", "unavailable") for wheel in WHEELS}
        learned = not {"learning", "unavailable"} & set(states.values())
        tyres = []
        for wheel in WHEELS:
            value = self._words.get(
                f"{'Change' if learned else 'Deviation'}_{wheel.upper()}", "not_available"
            )
            text = f"{wheel} " + (f"{'-':>6}" if value == "not_available" else f"{float(value):+6.2f}")
            style = RED if states[wheel] == "alarm" else GREEN if learned else DIM
            tyres.append(self.paint(text, style))
        if learned and not self._learned:
            self._overwrite("")
            words_shown = self._wrap_beyond_margin(
                f"{'monitoring':<11} the radii of all four wheels are learned"
            )
            self._print(f"{drive_time(self.now()):>6}  " + f"\n{'':{MARGIN}}".join(words_shown))
            self._learned = True
        word = "ALARM" if "alarm" in states.values() else "monitoring" if learned else "learning"
        against = "  mm since learned" if learned else "  mm from nominal"
        room = self._columns() - (MARGIN + INDENT + 9 * len(tyres))
        gap = "  " if room >= 2 * (len(tyres) - 1) else " "
        unit = against if room >= len(gap) * (len(tyres) - 1) + len(against) else ""
        self._overwrite(f"{drive_time(self.now()):>6}  {word:<11} {gap.join(tyres)}{unit}")

    def paint(self, text: str, style: str) -> str:
        """Return the text in the style of a terminal; unchanged without colours."""
        return f"\x1b[{style}m{text}\x1b[0m" if self._colour else text

    def _columns(self) -> int:
        """Return the terminal's columns less one: a full line would move the cursor on."""
        return (terminal_width(self._out) or WIDTH + 1) - 1

    def _wrap_beyond_margin(self, text: str) -> list[str]:
        """Return the text in lines that fit right of the margin."""
        width = max(self._columns() - MARGIN, 30)
        return textwrap.wrap(
            text, width, subsequent_indent=" " * INDENT, drop_whitespace=True, break_on_hyphens=False
        )

    def _overwrite(self, text: str) -> None:
        """Show a line that the next one replaces; where there is no terminal, a line like others."""
        if can_move(self._out):
            self._out.write("\r\x1b[K" + text)
            self._out.flush()
        elif text:
            self._print(text)

    def _print(self, text: str) -> None:
        self._out.write(text + "\n")
        self._out.flush()


def listen(bus: can.BusABC, panel: Panel, stop: threading.Event) -> None:
    """Pass frames of the bus to the panel and redraw it once a second, until `stop` is set."""
    shown_s = time.monotonic()
    while not stop.is_set():
        frame = bus.recv(0.05)
        if frame is not None:
            panel.decode(frame)
        if time.monotonic() - shown_s >= 1.0:
            shown_s = time.monotonic()
            panel.show()
