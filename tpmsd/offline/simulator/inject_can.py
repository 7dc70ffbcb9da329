"""A CAN log with effects in it.

In: a log, the plans of the needed signals, an `Injection`. Out: the log with other bits in the signals on
which effects act; every other byte stays what it was. Two passes: the first gathers the readings of each
signal, the second writes. A log of another format than candump's (`.asc .blf .trc .mf4`) becomes one of
candump, frame by frame, if anything changes.
"""

from __future__ import annotations

import codecs
import gzip
import re
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

import numpy as np

from tpmsd.foundation.errors import InputError, TpmsdError
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.simulator.injection import (
    Injection,
    add_counts,
    add_to_rounded_readings,
    smoothing_readings,
)
from tpmsd.onboard.sources.can.candump_line import ERROR_FLAG, LINE, parse_candump_line
from tpmsd.onboard.sources.can.frame import CanFrame
from tpmsd.onboard.sources.can.log import read_can_log
from tpmsd.onboard.sources.can.signal_plan import (
    BUS_SHIFT,
    EXTENDED,
    BitField,
    MessagePlan,
    SignalGroup,
    SignalPlan,
)

SUFFIXES = (".log", ".log.gz")
DEFAULT_CHANNEL = "can0"
"""Channel of frames whose log names none."""
AGAIN = 0.25
"""Share of a message's period within which the same bytes are the same frame, sent or recorded twice."""
PROBED_S = 60.0
"""Time since the first frame (s) at which a clock's error is looked for: it has none at the start."""
_STAMP = re.compile(rb"\((\d+)\.(\d+)\)")


@dataclass
class LoggedSignal:
    """The readings of one signal in the order of the log."""

    signal: SignalPlan
    host_s: list[float] = field(default_factory=list)
    bits: list[int] = field(default_factory=list)
    again: list[bool] = field(default_factory=list)
    """True if the frame holds the same bits as the one before it."""
    new: list[int] = field(default_factory=list)
    at: int = 0
    """Index of the next reading to be written."""


class CanRewriter:
    """Rewrites one log."""

    def __init__(
        self,
        plans: Mapping[int, MessagePlan],
        injection: Injection,
        teeth_per_rev: float,
        channel: str | None = None,
        buses: Mapping[str, int] | None = None,
    ) -> None:
        """`channel` and `buses` as a drive has them: frames of other channels are left alone."""
        self._plans = plans
        self._injection = injection
        self._teeth_per_rev = teeth_per_rev
        self._channel = channel
        self._buses = buses or {}
        self._series = {
            (key, signal.role): LoggedSignal(signal)
            for key, plan in plans.items()
            for group in plan.groups
            for signal in group.signals
        }
        self._before: dict[tuple[int, str], bytes] = {}

    def rewrite(self, source: Path, folder: Path) -> str:
        """Write the log with the effects into a folder; return the name of the file if anything in it
        changed. Otherwise the file is a copy, and the name is empty.

        Raises:
            InputError: the log cannot be read.
        """
        target = folder / source.name
        as_text = source.name.lower().endswith(SUFFIXES)
        read = log_lines if as_text else frame_lines
        for line in read(source):
            self._collect_signals(line)
        moved = [series for series in self._series.values() if self._compute_new_bits(series)]
        probe = np.array([time for series in self._series.values() for time in series.host_s[:1]])
        shifted = bool(self._injection.clock_error_s(probe + PROBED_S).any())
        if not moved and not shifted:
            copy_file(source, target)
            return ""
        if not as_text:
            target = folder / "can.log"
        with open_for_writing(target) as file:
            for line in read(source):
                file.write(self._rewritten_line(line, shifted))
        return target.name

    def _collect_signals(self, line: bytes) -> None:
        """Append a line's readings of the needed signals to their series."""
        for key, frame, group in self._groups(line):
            for signal in group.signals:
                if signal.field.min_bytes > len(frame.data):
                    continue
                bits = signal.field.bits(frame.data)
                if bits in signal.invalid or (signal.modulus and bits >= signal.modulus):
                    continue
                series = self._series[key, signal.role]
                series.again.append(self._before.get((key, signal.role)) == frame.data)
                self._before[key, signal.role] = frame.data
                series.host_s.append(frame.time_s)
                series.bits.append(bits)

    def _groups(self, line: bytes) -> Iterator[tuple[int, CanFrame, SignalGroup]]:
        """Yield the groups of needed signals that a line's frame holds."""
        frame = parse_candump_line(line.decode("latin-1").rstrip("\r\n"))
        if frame is None or frame.is_error or frame.is_remote:
            return
        if self._channel is not None and frame.channel != (self._channel or DEFAULT_CHANNEL):
            return
        bus = self._buses.get(frame.channel, 0)
        key = bus << BUS_SHIFT | frame.arbitration_id | (EXTENDED if frame.is_extended else 0)
        plan = self._plans.get(key)
        if plan is None:
            return
        for group in plan.groups:
            if all(
                layout.min_bytes <= len(frame.data) and layout.number(layout.bits(frame.data)) in numbers
                for layout, numbers in group.selectors
            ):
                yield key, frame, group

    def _compute_new_bits(self, series: LoggedSignal) -> bool:
        """Compute the new bits of a signal; return whether any differ."""
        series.new = series.bits
        if len(series.bits) < 2:
            return False
        host_s = np.array(series.host_s)
        counted = series.signal.modulus > 0
        new = self._changed_counts(series, host_s) if counted else self._changed_readings(series, host_s)
        if new is None:
            return False
        period_s = float(np.median(np.diff(host_s)))
        for k in np.flatnonzero(series.again):
            if k > 0 and host_s[k] - host_s[k - 1] < AGAIN * period_s:
                new[k] = new[k - 1]
        series.new = new
        return new != series.bits

    def _changed_counts(self, series: LoggedSignal, host_s: FloatArray) -> list[int] | None:
        """Return the new counts of a wheel's counter; None where no effect acts on it."""
        signal = series.signal
        assert signal.wheel is not None
        unsigned = signal.backward_when is not None
        more_rad = self._injection.added_angle_rad(signal.wheel, host_s, unsigned)
        if not more_rad.any():
            return None
        more = more_rad * self._teeth_per_rev / (2.0 * np.pi * signal.gain)
        counts = np.array(series.bits, dtype=np.float64)
        made = add_counts(counts, more, smoothing_readings(host_s), signal.modulus)
        return [int(count) for count in made.tolist()]

    def _changed_readings(self, series: LoggedSignal, host_s: FloatArray) -> list[int] | None:
        """Return the new bits of a sensor's or speed's readings; None where no effect acts on them."""
        signal = series.signal
        layout = signal.field
        numbers = np.array([layout.number(bits) for bits in series.bits], dtype=np.float64)
        values = signal.gain * numbers + signal.bias
        if signal.wheel is not None:
            factor = self._injection.speed_factor(signal.wheel, host_s)
            wanted = np.where(factor == 1.0, values, values * factor)
        else:
            wanted = self._injection.changed_sensor_values(signal.role, host_s, values)
        more = (wanted - values) / signal.gain
        if not more.any():
            return None
        if layout.is_float:
            return [float_bits(number, layout) for number in (numbers + more).tolist()]
        made = add_to_rounded_readings(numbers, more)
        low, high = (-(1 << layout.length - 1), layout.mask >> 1) if layout.signed else (0, layout.mask)
        return [
            _valid_bits(int(number), bits, signal)
            for number, bits in zip(np.clip(made, low, high).tolist(), series.bits, strict=True)
        ]

    def _rewritten_line(self, line: bytes, shifted: bool) -> bytes:
        """Return the line with the new bits, and its stamp on the changed clock if `shifted`."""
        data: bytearray | None = None
        for key, frame, group in self._groups(line):
            for signal in group.signals:
                if signal.field.min_bytes > len(frame.data):
                    continue
                bits = signal.field.bits(frame.data)
                if bits in signal.invalid or (signal.modulus and bits >= signal.modulus):
                    continue
                series = self._series[key, signal.role]
                new = series.new[series.at]
                series.at += 1
                if new != bits:
                    data = bytearray(frame.data) if data is None else data
                    put_bits(data, signal.field, new)
        if data is not None:
            line = _replace_data(line, bytes(data))
        if shifted and (match := _STAMP.search(line)) is not None:
            host_s = float(match[1] + b"." + match[2])
            error = float(self._injection.clock_error_s(np.array([host_s]))[0])
            stamp = f"({host_s + error:.{len(match[2])}f})".encode("ascii")
            line = line[: match.start()] + stamp + line[match.end() :]
        return line


def put_bits(data: bytearray, layout: BitField, bits: int) -> None:
    """Put the bits of a field into a frame's data; all other bits stay."""
    order = "big" if layout.big_endian else "little"
    shift = layout.shift - 8 * (layout.word_bytes - layout.min_bytes) if layout.big_endian else layout.shift
    word = int.from_bytes(data[: layout.min_bytes], order)  # type: ignore[arg-type]
    word = word & ~(layout.mask << shift) | bits << shift
    data[: layout.min_bytes] = word.to_bytes(layout.min_bytes, order)  # type: ignore[arg-type]


def float_bits(number: float, layout: BitField) -> int:
    """Return the bits of an IEEE 754 number of the field's length."""
    kind = {16: ">f2", 32: ">f4", 64: ">f8"}[layout.length]
    return int.from_bytes(np.array(number, dtype=kind).tobytes(), "big")


def lines_of(path: Path) -> Iterator[bytes]:
    """Yield the lines of a file, compressed or not, with their ends; a truncated compressed file ends
    early.
    """
    try:
        with open_for_reading(path) as file:
            try:
                for chunk in file:
                    yield from chunk.splitlines(keepends=True)
            except (EOFError, zlib.error):
                return
    except OSError as error:
        raise InputError(path, f"cannot be read: {error.strerror or error}") from None


def log_lines(path: Path) -> Iterator[bytes]:
    """Yield the lines of a log; a byte order mark in front of the first is a line of its own."""
    for number, line in enumerate(lines_of(path)):
        if number == 0 and line.startswith(codecs.BOM_UTF8):
            yield codecs.BOM_UTF8
            line = line.removeprefix(codecs.BOM_UTF8)
        yield line


def frame_lines(path: Path) -> Iterator[bytes]:
    """Yield the frames of a log of any format as lines of candump."""
    for frame in read_can_log(path):
        identifier = f"{frame.arbitration_id:08X}" if frame.is_extended else f"{frame.arbitration_id:03X}"
        if frame.is_error:
            identifier = f"{frame.arbitration_id | ERROR_FLAG:08X}"
        data = "R" if frame.is_remote else frame.data.hex().upper()
        mark = "##0" if frame.is_fd else "#"
        channel = frame.channel or DEFAULT_CHANNEL
        yield f"({frame.time_s:.6f}) {channel} {identifier}{mark}{data}\n".encode("ascii")


def open_for_reading(path: Path) -> IO[bytes]:
    """Return a file to read bytes from, decompressed where its name says so."""
    if path.name.lower().endswith(".gz"):
        return gzip.GzipFile(path, "rb")  # type: ignore[return-value]
    return path.open("rb")


def open_for_writing(path: Path) -> IO[bytes]:
    """Return a file to write bytes to, compressed where its name says so, without the time of writing
    in it.
    """
    try:
        if path.name.lower().endswith(".gz"):
            return gzip.GzipFile(path, "wb", mtime=0)  # type: ignore[return-value]
        return path.open("wb")
    except OSError as error:
        raise TpmsdError(f"{path}: cannot be written: {error.strerror}") from None


def copy_file(source: Path, target: Path) -> None:
    """Copy the bytes to a new file, which is writable even if the source is not."""
    try:
        with source.open("rb") as reading, target.open("wb") as writing:
            while chunk := reading.read(1 << 20):
                writing.write(chunk)
    except OSError as error:
        raise TpmsdError(f"{error.filename or target}: cannot be written: {error.strerror}") from None


def _valid_bits(number: int, bits: int, signal: SignalPlan) -> int:
    """Return the bits of a number; the reading's own bits where the new ones would mean that there is no
    value.
    """
    made = number & signal.field.mask
    return bits if made in signal.invalid else made


def _replace_data(line: bytes, data: bytes) -> bytes:
    """Return the line with other data, written in the digits (upper or lower case) that were there."""
    text = line.decode("latin-1")
    match = LINE.match(text.rstrip("\r\n"))
    assert match is not None
    group = 7 if match[7] is not None else 5
    digits = data.hex()
    if match[group].upper() == match[group]:
        digits = digits.upper()
    return (text[: match.start(group)] + digits + text[match.end(group) :]).encode("latin-1")
