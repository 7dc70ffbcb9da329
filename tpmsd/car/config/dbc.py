"""The DBC: read it, and find a signal in it or the nearest name.

In: the path of a DBC (or KCD, SYM, ARXML) file, a 'Message.Signal'. Out: cantools' database, message and
signal; `ConfigProblems` or `BadValueError` with what is wrong.
"""

from __future__ import annotations

import codecs
import logging
import re
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

import cantools
from cantools.database.can import Database, Message, Signal

from tpmsd.car.config.dbc_text import MAX_LINE_BYTES, DbcReader, Note, TooLargeError
from tpmsd.car.config.problems import BadValueError, ConfigProblems, Problem, show
from tpmsd.car.config.suggest import nearest

_MAX_LISTED = 8
_OTHER_FORMATS = (".kcd", ".sym", ".arxml", ".xml", ".cdd")
MAX_BYTES = 64 << 20
"""The greatest ARXML files of whole cars come near this."""


class NotedDatabase(Database):
    """A database that knows what of its file could not be used."""

    notes: tuple[Note, ...] = ()
    noted: int = 0
    """Number of all notes; `notes` holds the first ones."""


def load_dbc(path: Path) -> Database:
    """Read a bus description; what of it cannot be used is left out (`NotedDatabase.notes`).

    `ConfigProblems` where nothing of it can be used. A DBC is read by `dbc_text`, other formats by cantools.
    """
    if path.suffix.lower() in _OTHER_FORMATS:
        return _load_with_cantools(path)
    reader = DbcReader()
    try:
        if path.stat().st_size > MAX_BYTES:
            raise _unusable_error(path, f"longer than {MAX_BYTES} bytes: this is no description of a bus")
        with path.open("rb") as file:
            reader.read(_line_pieces(file))
        messages = reader.messages()
    except OSError as error:
        raise _unusable_error(path, f"cannot be read: {error.strerror or error}") from None
    except TooLargeError as error:
        raise _unusable_error(path, f"{error}: this is no description of a car's bus") from None
    if not messages:
        reason = "holds no messages" if reader.known else "not a bus description"
        raise _unusable_error(path, reason, reader.notes[0].line if reader.notes else None)
    with _quiet_cantools():
        database = NotedDatabase(messages, strict=False)
    database.notes, database.noted = tuple(reader.notes), reader.noted
    return database


def _line_pieces(file: IO[bytes]) -> Iterator[bytes]:
    """Yield lines behind a byte order mark; one of more than `MAX_LINE_BYTES` in pieces."""
    yield file.readline(MAX_LINE_BYTES).removeprefix(codecs.BOM_UTF8)
    while piece := file.readline(MAX_LINE_BYTES):
        yield piece


def _load_with_cantools(path: Path) -> Database:
    """Return the database of a file in another format than DBC."""
    try:
        if path.stat().st_size > MAX_BYTES:
            raise _unusable_error(path, f"longer than {MAX_BYTES} bytes: this is no description of a bus")
        with _quiet_cantools():
            database = cantools.database.load_file(path, strict=False)
    except OSError as error:
        raise _unusable_error(path, f"cannot be read: {error.strerror or error}") from None
    except RecursionError:
        raise _unusable_error(path, "nested too deeply") from None
    except ConfigProblems:
        raise
    except Exception as error:  # cantools lets KeyError, ValueError and others of its parsers through
        raise _unusable_error(path, *_cantools_reason(error)) from None
    if not isinstance(database, Database):
        raise _unusable_error(path, "describes diagnostics, not a CAN bus")
    if not database.messages:
        raise _unusable_error(path, "holds no messages")
    return database


def find_signal(database: Database, name: str, taken: Collection[str] = ()) -> tuple[Message, Signal]:
    """Return the message and signal of 'Message.Signal'; `BadValueError` with the nearest name if there is
    none.

    `taken` are the names that other roles have; where several are near, one that is free is suggested.
    """
    message_name, _, signal_name = name.partition(".")
    homes = [message for message in database.messages if any(s.name == signal_name for s in message.signals)]
    message = next((m for m in reversed(database.messages) if m.name == message_name), None)
    if message is None:
        raise _unknown_message_error(database, name, homes, taken)
    signal = next((s for s in message.signals if s.name == signal_name), None)
    if signal is not None:
        return message, signal
    what = f"no signal {signal_name} in message {message_name}"
    if homes:
        what += f" (but in {_first_names([home.name for home in homes])})"
        raise BadValueError(what, show(name), suggestion=f"{homes[0].name}.{signal_name}")
    near = _nearest_signal(message, signal_name, taken)
    if near is not None:
        raise BadValueError(what, show(name), suggestion=f"{message_name}.{near}")
    raise BadValueError(what, show(name), _first_names([s.name for s in message.signals]))


def _unknown_message_error(
    database: Database, name: str, homes: list[Message], taken: Collection[str]
) -> BadValueError:
    """Return the error for the unknown message of `name`; `homes` are the messages that have its signal."""
    message_name, _, signal_name = name.partition(".")
    names = [message.name for message in database.messages]
    what = f"no message {message_name} in the DBC"
    of_homes = [home.name for home in homes]
    other = nearest(message_name, of_homes) or next(iter(of_homes), None) or nearest(message_name, names)
    if other is None:
        return BadValueError(what, show(name), _first_names(names))
    suggestion = f"{other}.{_same_or_nearest_signal(database, other, signal_name, taken)}"
    return BadValueError(what, show(name), suggestion=suggestion)


def counter_modulus(signal: Signal) -> int:
    """Return the number of values of a counter: by its width, or by the DBC's greatest value where that is a
    hint.

    Some counters roll over before their width is full, and keep the values above for errors (0 to 1000 in 10
    bits). The greatest value is taken if it needs all the bits; a lesser one is a limit of another kind.
    """
    full = 1 << signal.length
    if signal.maximum is None or not signal.scale or signal.minimum not in (0, None):
        return full
    greatest = (float(signal.maximum) - float(signal.offset)) / float(signal.scale)
    if not greatest.is_integer() or not full // 2 <= greatest < full - 1:
        return full
    return int(greatest) + 1


def _same_or_nearest_signal(
    database: Database, message_name: str, signal_name: str, taken: Collection[str]
) -> str:
    """Return the signal's name if the message has it, else the most similar name that is not taken."""
    message = next(m for m in database.messages if m.name == message_name)
    if any(signal.name == signal_name for signal in message.signals):
        return signal_name
    return _nearest_signal(message, signal_name, taken) or signal_name


def _nearest_signal(message: Message, signal_name: str, taken: Collection[str]) -> str | None:
    """Return the most similar signal of a message, one that no role has yet if any resembles."""
    names = [signal.name for signal in message.signals]
    free = [name for name in names if f"{message.name}.{name}" not in taken]
    return nearest(signal_name, free) or nearest(signal_name, names)


def _first_names(names: list[str]) -> str:
    """Return the first names, and how many more there are."""
    more = len(names) - _MAX_LISTED
    return " ".join(names[:_MAX_LISTED]) + (f" and {more} more" if more > 0 else "")


def _cantools_reason(error: Exception) -> tuple[str, int | None]:
    """Return cantools's message without its quotation of the line, and the line if it gave one."""
    text = " ".join(str(error).split())
    if match := re.match(r'[A-Z]+: "(.*)"$', text):
        text = match[1]
    if match := re.search(r"Invalid syntax at line (\d+), column (\d+)", text):
        return f"not a bus description: invalid syntax (column {match[2]})", int(match[1])
    return f"not a bus description: {text or type(error).__name__}"[:200], None


def _unusable_error(path: Path, what: str, line: int | None = None) -> ConfigProblems:
    return ConfigProblems([Problem(str(path), line, "", what)])


@contextmanager
def _quiet_cantools() -> Iterator[None]:
    """Suppress cantools' warnings of signals with the same name while the block runs; `check` warns of
    them."""
    logger = logging.getLogger("cantools")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.setLevel(level)
