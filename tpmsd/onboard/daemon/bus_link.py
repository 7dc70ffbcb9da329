"""The CAN bus as the loop sees it: open, or down and tried again.

In: a function that opens the interface. Out: frames; frames sent, or counted as not sent. Never raises
for anything that a bus can do.
"""

from __future__ import annotations

import logging
import math
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

from tpmsd.car.config.model import AlarmsConfig, CanConfig
from tpmsd.onboard.daemon.can_errors import BUS_OFF, error_names, hint_after
from tpmsd.onboard.daemon.link import Link
from tpmsd.onboard.sinks.can_frames import OutFrame
from tpmsd.onboard.sources.can.frame import CanFrame
from tpmsd.onboard.sources.can.live import CanDown, LiveCan

READ_AT_ONCE = 1000
READS_AT_ONCE = 100
"""Frames are read until there are none: after a pause they may be many, but not without end."""
_IFF_UP = 0x1
HINT_PERIOD_S = 60.0
"""A controller at the limit changes its state many times a second; the log tells of it this often."""


class BusInterface(Protocol):
    """An open interface, as `LiveCan`."""

    @property
    def dropped(self) -> int:
        """Frames that the kernel dropped."""

    @property
    def malformed(self) -> int:
        """Datagrams that were no frame."""

    def fileno(self) -> int | None:
        """Return the descriptor to wait on, if there is one."""

    def read(self, limit: int = READ_AT_ONCE) -> list[CanFrame]:
        """Return frames that have arrived."""

    def send(self, arbitration_id: int, data: bytes, extended: bool = False) -> bool:
        """Send; False if the queue is full."""

    def close(self) -> None:
        """Close the bus."""


OpenBus = Callable[[CanConfig, list[dict[str, Any]] | None, str], BusInterface]
"""Opens a channel with filters; raises `CanDown`."""


def open_can(config: CanConfig, filters: list[dict[str, Any]] | None, channel: str) -> BusInterface:
    """Open an interface of this machine; `CanDown` if it is missing or down."""
    if config.interface == "socketcan" and not _is_up(channel):
        # Such a socket opens, yet neither hears nor says anything that it is deaf.
        raise CanDown(channel, f"the interface is down (ip link set {channel} up)")
    return LiveCan(config, filters, channel)


def _is_up(channel: str, interfaces: Path = Path("/sys/class/net")) -> bool:
    """Return whether a network interface is up; True where the system does not say."""
    try:
        flags = int((interfaces / channel / "flags").read_text("ascii"), 16)
    except (OSError, ValueError):
        return True  # opening will tell better what is wrong
    return bool(flags & _IFF_UP)


def own_filters(alarms: AlarmsConfig) -> list[dict[str, Any]]:
    """Return the filters for a bus that is only sent to; python-can takes an empty list for "everything"."""
    mask = 0x1FFFFFFF if alarms.extended_ids else 0x7FF
    return [{"can_id": alarms.alarm_id, "can_mask": mask, "extended": alarms.extended_ids}]


def reset_filters(alarms: AlarmsConfig) -> list[dict[str, Any]]:
    """Return the filters that let the frame of a reset request through; none where no such frame is
    configured."""
    if alarms.reset_id is None:
        return []
    mask = 0x1FFFFFFF if alarms.extended_ids else 0x7FF
    return [{"can_id": alarms.reset_id, "can_mask": mask, "extended": alarms.extended_ids}]


class BusLink(Link):
    """One channel.

    `counts`: `frames` read, `error_frames`, `sent`, `tx_full` (queue full) and `tx_down` (bus down) not sent.
    `error_counts`: errors in the error frames, by the names of `can_errors`.
    """

    def __init__(
        self,
        open_bus: Callable[[], BusInterface],
        label: str,
        log: logging.Logger,
        error_classes: bool = True,
    ) -> None:
        """`error_classes`: error frames are SocketCAN's, whose identifiers tell what is wrong."""
        super().__init__(label, log)
        self._open_bus = open_bus
        self._error_classes = error_classes
        self._bus: BusInterface | None = None
        self._dropped_before = self._malformed_before = 0
        self._full = False
        self._hint_logged_s = -math.inf
        self.hint = ""
        """Problem of a bus that is not down, in a few words."""
        self.counts: Counter[str] = Counter()
        self.error_counts: Counter[str] = Counter()

    @property
    def dropped(self) -> int:
        """Frames that the kernel dropped because nobody read, since the start."""
        return self._dropped_before + (self._bus.dropped if self._bus is not None else 0)

    @property
    def malformed(self) -> int:
        """Datagrams of a network bus that were no frame and were skipped, since the start."""
        return self._malformed_before + (self._bus.malformed if self._bus is not None else 0)

    def fileno(self) -> int | None:
        """Return the descriptor to wait on; None if it is down or has to be polled."""
        return None if self._bus is None else self._bus.fileno()

    def service(self, now_s: float) -> None:
        """Open the channel if an attempt is due."""
        if self._bus is None and now_s >= self._next_try_s:
            try:
                self._bus = self._open_bus()
            except CanDown as error:
                self._note_failure(now_s, error.reason)
            else:
                self._note_opened(now_s)

    def read(self, now_s: float) -> list[CanFrame]:
        """Return all data frames that have arrived; error frames are counted, remote frames left out."""
        frames: list[CanFrame] = []
        for _ in range(READS_AT_ONCE):
            if self._bus is None:
                break
            try:
                got = self._bus.read(READ_AT_ONCE)
            except CanDown as error:
                self._close_failed(now_s, error.reason)
                break
            frames += got
            if len(got) < READ_AT_ONCE:
                # Error frames are no sign of life: a bus-off that comes again and again is one, not many.
                self._note_working(now_s, any(not frame.is_error for frame in frames))
                break
        self.counts["frames"] += len(frames)
        errors = [frame for frame in frames if frame.is_error]
        if errors:
            self._take_errors(errors, frames[-1], now_s)
        return [frame for frame in frames if not frame.is_error and not frame.is_remote]

    def _take_errors(self, errors: list[CanFrame], last: CanFrame, now_s: float) -> None:
        """Count error frames; close the bus if its controller has switched itself off."""
        self.counts["error_frames"] += len(errors)
        if not self._error_classes:
            return
        off, hint = False, self.hint
        for frame in errors:
            names = error_names(frame.arbitration_id, frame.data)
            self.error_counts.update(names)
            off |= BUS_OFF in names
            hint = hint_after(names, hint)
        # Data after it: the controller has been restarted meanwhile.
        if off and last.is_error and self._bus is not None:
            self.close()
            self._note_failure(now_s, "bus-off: the controller has switched itself off", until_data=True)
        elif hint != self.hint:
            self.hint = hint
            if hint and now_s >= self._hint_logged_s + HINT_PERIOD_S:
                self._hint_logged_s = now_s
                self._log.warning("%s: %s", self.label, hint)

    def send(self, frames: list[OutFrame], now_s: float) -> None:
        """Send as many frames as the queue takes; the others are counted."""
        for frame in frames:
            if self._bus is None:
                self.counts["tx_down"] += 1
                continue
            try:
                sent = self._bus.send(frame.arbitration_id, frame.data, frame.extended)
            except CanDown as error:
                self.counts["tx_down"] += 1
                self._close_failed(now_s, error.reason)
                continue
            self.counts["sent" if sent else "tx_full"] += 1
            if sent == self._full:
                self._full = not sent
                if self._full:
                    self._log.warning("%s: the transmit queue is full: nobody acknowledges", self.label)
                else:
                    self._log.info("%s: frames are being sent again", self.label)

    def close(self) -> None:
        """Close the channel for good."""
        bus, self._bus = self._bus, None
        self._is_open = False
        self.hint = ""
        self.generation += 1
        if bus is not None:
            self._dropped_before += bus.dropped
            self._malformed_before += bus.malformed
            bus.close()

    def _close_failed(self, now_s: float, reason: str) -> None:
        """Close the channel after a failure; it is tried again later."""
        self.close()
        self._note_failure(now_s, reason)
