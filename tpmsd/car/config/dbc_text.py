"""Reads DBC files as they are in the field: statement by statement, leaving out what cannot be used.

In: the bytes of a DBC, line by line. Out: cantools' messages and signals, and notes on every statement
that was left out or mended, with its line.

cantools refuses a file for one bad statement and builds a tree of tokens that takes fifty times the size of
the file. Here each line is read once; comments, which make most of some files, are passed over. Memory is
bounded by `MAX_MESSAGES`, `MAX_SIGNALS` and `MAX_LINE_BYTES`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field

from cantools.database.can import Message, Signal
from cantools.database.conversion import BaseConversion

from tpmsd.car.config.problems import STEERS

MAX_MESSAGES = 20_000
"""Whole cars have some 2,000."""
MAX_SIGNALS = 50_000
MAX_LINE_BYTES = 1 << 20
MAX_NOTES = 50
MAX_SIGNAL_BITS = 64
MAX_FRAME_BYTES = 64
"""The longest CAN FD frame."""
MAX_BRANCHES = 4096
"""Multiplexer values of one signal."""
MAX_DEPTH = 16
"""Multiplexers of which each selects the next; cars have two or three."""
MAX_CODECS = 100_000
"""Entries of the layouts of all messages, which have one for each multiplexer value: some 1 kB each. The
largest file of opendbc has 1,087."""
_STANDARD_IDS = 0x7FF
_EXTENDED_FLAG = 1 << 31
_NO_MESSAGE = 0xC0000000
"""Identifier under which editors keep signals that belong to no message."""

# Repetitions are possessive and integers bounded: no line takes time with the square of its length.
_INT = r"\d{1,20}+(?!\d)"
_MESSAGE = re.compile(rf"BO_\s++({_INT})\s++([^\s:]++)\s*+:\s*+({_INT})\s*+(\S*+)")
_NUMBER = r"[-+]?(?:\d++\.?\d*+(?:[eE][-+]?\d++)?|\.\d++(?:[eE][-+]?\d++)?)"
_SIGNAL = re.compile(
    rf"SG_\s++([^\s:]++)(?:\s++(M|m{_INT}M?))?+\s*+:\s*+({_INT})\s*+\|\s*+({_INT})\s*+@\s*+([01])\s*+([+-])\s*+"
    rf"\(\s*+({_NUMBER})\s*+,\s*+({_NUMBER})\s*+\)\s*+"
    rf"(?:\[\s*+({_NUMBER})\s*+\|\s*+({_NUMBER})\s*+\])?\s*+"
    r'(?:"((?:[^"\\]|\\.)*+)")?'
)
_CHOICES = re.compile(rf"VAL_\s++({_INT})\s++(\S++)\s++(.*+)")
_CHOICE = re.compile(rf'(?<!\d)(-?{_INT})\s++"((?:[^"\\]|\\.)*+)"')
_PERIOD = re.compile(rf'BA_\s++"GenMsgCycleTime"\s++BO_\s++({_INT})\s++({_INT})')
_FLOAT = re.compile(rf"SIG_VALTYPE_\s++({_INT})\s++([^\s:]++)\s*+:?\s*+([012])")
_NESTED = re.compile(rf"SG_MUL_VAL_\s++({_INT})\s++(\S++)\s++(\S++)\s++([^;]*+)")
_RANGE = re.compile(rf"(?<!\d)({_INT})\s*+-\s*+({_INT})")
_KEYWORDS = re.compile(
    r"(?:VERSION|NS_|BS_|BU_|BO_|SG_|CM_|BA_DEF_DEF_|BA_DEF_|BA_|VAL_|VAL_TABLE_|SIG_VALTYPE_|SG_MUL_VAL_|EV_|"
    r"BO_TX_BU_|SIG_GROUP_|ENVVAR_DATA_|SGTYPE_|SIGTYPE_VALTYPE_|BA_REL_|BA_DEF_REL_|BA_DEF_DEF_REL_|"
    r"BA_SGTYPE_|BA_DEF_SGTYPE_|BU_SG_REL_|BU_EV_REL_|BU_BO_REL_|SG_|FILTER|CAT_|CAT_DEF_|DEF_|NS_DESC_|EV_DATA_)\b"
)


@dataclass(slots=True)
class _Signal:
    name: str
    mux: str | None
    start: int
    length: int
    big_endian: bool
    signed: bool
    factor: float
    offset: float
    low: float | None
    high: float | None
    unit: str | None
    line: int
    is_float: bool = False
    choices: dict[int, str] | None = None
    parent: str | None = None
    ranges: list[tuple[int, int]] | None = None


@dataclass(slots=True)
class _DbcMessage:
    frame_id: int
    name: str
    length: int
    sender: str
    line: int
    period_ms: int | None = None
    signals: dict[str, _Signal] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Note:
    """Something of the file that was left out or mended."""

    line: int
    what: str


class TooLargeError(Exception):
    """More messages or signals than any car has."""


_Branches = tuple[str | None, list[int] | None, str]
"""The multiplexer above a signal, the numbers that select it, and what is wrong with them."""


class DbcReader:
    """Takes a DBC line by line."""

    def __init__(self) -> None:
        self.notes: list[Note] = []
        self.noted = 0
        """Number of all notes; `notes` holds the first `MAX_NOTES`."""
        self.known = 0
        """Lines that begin as statements of a DBC do."""
        self._messages: list[_DbcMessage] = []
        self._by_id: dict[int, _DbcMessage] = {}
        self._open: _DbcMessage | None = None
        self._signals = self._values = self._codec_count = 0
        self._in_text = False

    def read(self, lines: Iterable[bytes]) -> None:
        """Read all lines of a file; `TooLargeError` beyond the limits."""
        for number, raw in enumerate(lines, 1):
            if self._in_text:
                if b'"' in raw:
                    self._in_text = not _ends_statement(raw)
            elif raw.lstrip().startswith(b"CM_"):
                self.known += 1
                self._in_text = raw.count(b'"') > 0 and not _ends_statement(raw)
            else:
                self._read_statement(_decode_line(raw).strip(), number)

    def _add_note(self, line: int, what: str) -> None:
        self.noted += 1
        if len(self.notes) < MAX_NOTES:
            self.notes.append(Note(line, what))

    def _read_statement(self, text: str, line: int) -> None:
        if not text:
            return
        keyword = _KEYWORDS.match(text)
        if keyword is None:
            # Lines of the list of new symbols, continued tables and blank-led comments say nothing.
            if self._open is not None and text.startswith(("SG", "BO")):
                self._add_note(line, "not a statement of a DBC")
            return
        self.known += 1
        word = keyword[0]
        if word == "BO_":
            self._read_message(text, line)
        elif word == "SG_":
            self._read_signal(text, line)
        elif word in ("VAL_", "BA_", "SIG_VALTYPE_", "SG_MUL_VAL_"):
            self._read_attribute(word, text, line)

    def _read_message(self, text: str, line: int) -> None:
        self._open = None
        match = _MESSAGE.match(text)
        if match is None:
            self._add_note(line, "message left out: invalid syntax")
            return
        frame_id, name, length = int(match[1]), match[2], int(match[3])
        if frame_id == _NO_MESSAGE:
            return
        if frame_id & ~_EXTENDED_FLAG > 0x1FFFFFFF:
            self._add_note(line, f"message {name} left out: identifier {frame_id:#x} has more than 29 bits")
            return
        if length > MAX_FRAME_BYTES:
            # J1939's transport carries longer ones; their first frame's signals may still be used.
            self._add_note(line, f"message {name}: {length} bytes are more than a frame has; 64 are taken")
            length = MAX_FRAME_BYTES
        if len(self._messages) >= MAX_MESSAGES:
            raise TooLargeError(f"more than {MAX_MESSAGES} messages")
        if frame_id > _STANDARD_IDS and not frame_id & _EXTENDED_FLAG:
            self._add_note(line, f"message {name}: identifier {frame_id:#x} is taken as one of 29 bits")
        self._open = _DbcMessage(frame_id, name, length, match[4], line)
        self._messages.append(self._open)
        self._by_id[frame_id] = self._open

    def _read_signal(self, text: str, line: int) -> None:
        message = self._open
        match = _SIGNAL.match(text)
        if match is None:
            self._add_note(line, "signal left out: invalid syntax")
            return
        if message is None:
            return
        name, start, length = match[1], int(match[3]), int(match[4])
        if not 1 <= length <= MAX_SIGNAL_BITS or start >= 8 * MAX_FRAME_BYTES:
            self._add_note(line, f"signal {message.name}.{name} left out: {length} bits at {start}")
            return
        self._signals += 1
        if self._signals > MAX_SIGNALS:
            raise TooLargeError(f"more than {MAX_SIGNALS} signals")
        if name in message.signals:
            self._add_note(line, f"signal {message.name}.{name} stands twice; the first is taken")
            return
        low, high = (None if number is None else float(number) for number in match.group(9, 10))
        message.signals[name] = _Signal(
            name, match[2], start, length, match[5] == "0", match[6] == "-",
            float(match[7]), float(match[8]), low, high, match[11], line,
        )  # fmt: skip

    def _read_attribute(self, word: str, text: str, line: int) -> None:
        if word == "BA_":
            if (match := _PERIOD.match(text)) and (message := self._by_id.get(int(match[1]))):
                message.period_ms = int(match[2]) or None
            return
        pattern = {"VAL_": _CHOICES, "SIG_VALTYPE_": _FLOAT, "SG_MUL_VAL_": _NESTED}[word]
        if (match := pattern.match(text)) is None:
            return
        message = self._by_id.get(int(match[1]))
        signal = None if message is None else message.signals.get(match[2])
        if signal is None:
            self._add_note(line, f"{word} of a signal that is not there: {match[2][:40]}")
        elif word == "VAL_":
            signal.choices = {int(one[1]): one[2] for one in _CHOICE.finditer(match[3])}
        elif word == "SIG_VALTYPE_":
            signal.is_float = match[3] != "0"
        else:
            signal.parent = match[3]
            signal.ranges = [(int(one[1]), int(one[2])) for one in _RANGE.finditer(match[4])]

    def messages(self) -> list[Message]:
        """Return the messages that were read, as cantools has them."""
        return [self._to_message(message) for message in self._messages]

    def _branches_within_limit(self, message: _DbcMessage, signal: _Signal, root: str | None) -> _Branches:
        """Return `_multiplexer_branches`, or a problem once the file has more than `MAX_CODECS` values."""
        found = _multiplexer_branches(message, signal, root)
        self._values += len(found[1] or ())
        return found if self._values <= MAX_CODECS else (None, None, "too many multiplexer values")

    def _to_message(self, message: _DbcMessage) -> Message:
        """Return the message as cantools has it; without multiplexed signals if they have too many
        layouts."""
        signals = []
        root = next((signal.name for signal in message.signals.values() if signal.mux == "M"), None)
        found = {
            name: self._branches_within_limit(message, signal, root)
            for name, signal in message.signals.items()
        }
        codecs = _codec_count(message, found)
        if self._codec_count + codecs > MAX_CODECS:
            what = f"message {message.name}: multiplexed signals left out: too many layouts"
            self._add_note(message.line, what)
            found = {name: entry for name, entry in found.items() if entry[1] is None}
        else:
            self._codec_count += codecs
        for name, (parent, branches, problem) in found.items():
            signal = message.signals[name]
            if problem:
                self._add_note(signal.line, f"signal {message.name}.{signal.name} left out: {problem}")
                continue
            if _bytes_needed(signal) > message.length:
                self._add_note(
                    signal.line, f"signal {message.name}.{signal.name} lies beyond the message's bytes"
                )
            signals.append(_cantools_signal(signal, parent, branches))
        return Message(
            frame_id=message.frame_id & ~_EXTENDED_FLAG,
            name=message.name,
            length=message.length,
            signals=signals,
            senders=[message.sender] if message.sender else [],
            cycle_time=message.period_ms,
            is_extended_frame=message.frame_id > _STANDARD_IDS,
            is_fd=message.length > 8,
            strict=False,
        )


def _multiplexer_branches(message: _DbcMessage, signal: _Signal, root: str | None) -> _Branches:
    """Return multiplexer, its values and '' for a multiplexed signal; the problem instead of '' if it is
    unusable."""
    if signal.mux is None or not signal.mux.startswith("m"):
        return None, None, ""
    parent = signal.parent or root
    if parent not in message.signals or (problem := _missing_root(message, signal.name, parent, root)):
        return None, None, problem if parent in message.signals else "its multiplexer is not there"
    if signal.ranges is None:
        return parent, [int(signal.mux[1:].rstrip("M")) & ((1 << 63) - 1)], ""
    most = (1 << message.signals[parent].length) - 1
    branches: set[int] = set()
    for low, high in signal.ranges:
        high = min(high, most)
        if high - low + len(branches) >= MAX_BRANCHES:
            return None, None, f"more than {MAX_BRANCHES} multiplexer values"
        branches.update(range(low, high + 1))
    return parent, sorted(branches), "" if branches else "no multiplexer value"


def _missing_root(message: _DbcMessage, name: str, parent: str, root: str | None) -> str:
    """Return why the multiplexers above a signal do not lead to one that always holds; empty if they do."""
    seen = {name}
    at: str | None = parent
    while at is not None:
        if at in seen or at not in message.signals:
            return "its multiplexer is not there"
        if len(seen) > MAX_DEPTH:
            return f"more than {MAX_DEPTH} multiplexers in a chain"
        seen.add(at)
        signal = message.signals[at]
        if signal.mux is None or not signal.mux.startswith("m"):
            return ""
        at = signal.parent or root
    return "its multiplexer is not there"


def _codec_count(message: _DbcMessage, found: dict[str, _Branches]) -> int:
    """Return how many entries cantools' layouts of a message have at most.

    cantools makes a layout for each value of a multiplexer, and in it one for each value of each multiplexer
    below: entries multiply with the depth.
    """
    below: dict[str, list[tuple[str, list[int]]]] = {}
    for name, (parent, ids, problem) in found.items():
        if parent is not None and ids is not None and not problem:
            below.setdefault(parent, []).append((name, ids))
    entries: dict[str, int] = {}

    def of(name: str) -> int:
        if not (message.signals[name].mux or "").endswith("M"):
            return 0
        if name not in entries:
            children, choices = below.get(name, []), message.signals[name].choices or {}
            values = set().union(choices, *(ids for _, ids in children))
            passed = len(values) * (1 + len(children)) + sum(len(ids) for _, ids in children)
            entries[name] = passed + sum(len(ids) * of(child) for child, ids in children)
        return entries[name]

    return sum(of(name) for name, (parent, _, problem) in found.items() if parent is None and not problem)


def _cantools_signal(signal: _Signal, parent: str | None, branches: list[int] | None) -> Signal:
    """Return the signal as cantools has it; `parent` is its multiplexer, `branches` the values that select
    it."""
    is_float = signal.is_float and signal.length in (16, 32, 64)
    scale = int(signal.factor) if signal.factor.is_integer() else signal.factor
    offset = int(signal.offset) if signal.offset.is_integer() else signal.offset
    limited = signal.low is not None and signal.high is not None and signal.low < signal.high
    return Signal(
        name=signal.name,
        start=signal.start,
        length=signal.length,
        byte_order="big_endian" if signal.big_endian else "little_endian",
        is_signed=signal.signed,
        conversion=BaseConversion.factory(scale, offset, signal.choices, is_float),  # type: ignore[arg-type]
        minimum=signal.low if limited else None,
        maximum=signal.high if limited else None,
        unit=signal.unit or None,
        is_multiplexer=signal.mux is not None and signal.mux.endswith("M"),
        multiplexer_ids=branches,
        multiplexer_signal=parent,
    )


def _bytes_needed(signal: _Signal) -> int:
    """Return the number of bytes from the frame's start to the signal's last byte."""
    if signal.big_endian:
        first = 8 * (signal.start // 8) + 7 - signal.start % 8
        return (first + signal.length + 7) // 8
    return (signal.start + signal.length + 7) // 8


def _ends_statement(raw: bytes) -> bool:
    """Return whether a text statement ends in this line; some files forget the semicolon."""
    return raw.rstrip().endswith((b'";', b'" ;', b'"'))


def _decode_line(raw: bytes) -> str:
    """Return a line's text, with U+FFFD for control characters."""
    try:
        text = raw.decode("utf-8")
    except UnicodeDecodeError:
        text = raw.decode("cp1252", errors="replace")
    return STEERS.sub("\N{REPLACEMENT CHARACTER}", text.rstrip().replace("\t", " "))
