"""The line of every key of a TOML file, which `tomllib` does not tell.

In: the text of a TOML file. Out: `{path: line}`, where a path is the tuple of keys (and array indices) from
the root and lines count from 1. The scanner reads structure alone (tables, dotted and quoted keys, strings,
arrays, inline tables) and leaves values to `tomllib`; where it meets something that is not TOML, it stops and
gives what it has, so that it can never be the cause of an error.
"""

from __future__ import annotations

import contextlib
import re
import tomllib
from bisect import bisect_left

PathStep = str | int
KeyPath = tuple[PathStep, ...]

_BLANK = re.compile(r"[ \t]*")
_BLANK_LINES = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")
_STRING_KEY = re.compile(r'"(?:[^"\\\n]|\\.)*"|\'[^\'\n]*\'')
_STRING = re.compile(
    r'"""(?:[^\\]|\\.)*?"{3,5}(?!")'  # up to two quotes may stand right before the closing three
    r"|'''.*?'{3,5}(?!')"
    r'|"(?:[^"\\\n]|\\.)*"'
    r"|'[^'\n]*'",
    re.DOTALL,
)
_SCALAR = re.compile(r"[^,\]}#\n]+")


class _NotTomlError(Exception):
    """Raised where the scanner does not know on."""


def locate(text: str) -> dict[KeyPath, int]:
    """Return the line of each table, key and array element of `text`; of a table made of several parts, the
    first."""
    scanner = _Scanner(text)
    with contextlib.suppress(_NotTomlError, RecursionError):
        scanner.scan()
    return scanner.lines


def line_of(lines: dict[KeyPath, int], path: KeyPath) -> int | None:
    """Return the line of `path`, or of the innermost table around it that has one; None if there is none."""
    while path:
        if path in lines:
            return lines[path]
        path = path[:-1]
    return None


class _Scanner:
    def __init__(self, text: str) -> None:
        self.lines: dict[KeyPath, int] = {}
        self._text = text
        self._at = 0
        self._line_ends = [match.start() for match in re.finditer("\n", text)]
        self._last_index: dict[KeyPath, int] = {}

    def scan(self) -> None:
        """Note the line of every key of the file."""
        table: KeyPath = ()
        while True:
            self._skip(_BLANK_LINES)
            if self._at >= len(self._text):
                return
            if self._text.startswith("[", self._at):
                table = self._read_table_header()
            else:
                self._read_key_and_value(table)

    def _read_table_header(self) -> KeyPath:
        start = self._at
        brackets = 2 if self._text.startswith("[[", start) else 1
        self._at += brackets
        keys = self._read_key_path()
        self._expect("]" * brackets)
        path: KeyPath = ()
        for key in keys[:-1]:
            path = (*path, key)
            self._note_line(path, start)
            if path in self._last_index:  # inside an array of tables, its last one is meant
                path = (*path, self._last_index[path])
        path = (*path, keys[-1])
        self._note_line(path, start)
        if brackets == 2:
            self._last_index[path] = self._last_index.get(path, -1) + 1
            path = (*path, self._last_index[path])
            self._note_line(path, start)
        return path

    def _read_key_and_value(self, table: KeyPath) -> None:
        start = self._at
        path = table
        for key in self._read_key_path():
            path = (*path, key)
            self._note_line(path, start)
        self._expect("=")
        self._skip(_BLANK)
        self._skip_value(path)

    def _read_key_path(self) -> list[str]:
        keys = []
        while True:
            self._skip(_BLANK)
            if match := _BARE_KEY.match(self._text, self._at):
                keys.append(match.group())
            elif match := _STRING_KEY.match(self._text, self._at):
                keys.append(_unquoted(match.group()))
            else:
                raise _NotTomlError
            self._at = match.end()
            self._skip(_BLANK)
            if not self._text.startswith(".", self._at):
                return keys
            self._at += 1

    def _skip_value(self, path: KeyPath) -> None:
        opening = self._text[self._at : self._at + 1]
        if opening == "[":
            self._read_array(path)
        elif opening == "{":
            self._read_inline_table(path)
        else:
            match = (_STRING if opening in ('"', "'") else _SCALAR).match(self._text, self._at)
            if match is None:
                raise _NotTomlError
            self._at = match.end()

    def _read_array(self, path: KeyPath) -> None:
        self._at += 1
        index = 0
        while not self._take_closing("]"):
            self._note_line((*path, index), self._at)
            self._skip_value((*path, index))
            index += 1
            self._take_comma("]")

    def _read_inline_table(self, path: KeyPath) -> None:
        self._at += 1
        while not self._take_closing("}"):
            self._read_key_and_value(path)
            self._take_comma("}")

    def _take_closing(self, bracket: str) -> bool:
        """Skip blanks; return whether the closing bracket follows, which is then passed."""
        self._skip(_BLANK_LINES)
        if self._text.startswith(bracket, self._at):
            self._at += 1
            return True
        return False

    def _take_comma(self, bracket: str) -> None:
        self._skip(_BLANK_LINES)
        if not self._text.startswith(bracket, self._at):
            self._expect(",")

    def _expect(self, text: str) -> None:
        if not self._text.startswith(text, self._at):
            raise _NotTomlError
        self._at += len(text)

    def _skip(self, pattern: re.Pattern[str]) -> None:
        if match := pattern.match(self._text, self._at):
            self._at = match.end()

    def _note_line(self, path: KeyPath, at: int) -> None:
        self.lines.setdefault(path, bisect_left(self._line_ends, at) + 1)


def _unquoted(key: str) -> str:
    """Return a quoted key as text; `_NotTomlError` if it is not a key."""
    try:
        return str(tomllib.loads(f"key = {key}")["key"])
    except tomllib.TOMLDecodeError:
        raise _NotTomlError from None
