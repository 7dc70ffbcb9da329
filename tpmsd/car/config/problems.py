"""Problems of a configuration: one record per problem, and the error that carries all of them.

In: where, what was found, what is allowed. Out: `Problem` with a one-line text; `ConfigProblems`.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from tpmsd.foundation.english import counted
from tpmsd.foundation.errors import ConfigError

_LONGEST_SHOWN = 60
MAX_SHOWN = 20
"""Problems that are shown one by one: whoever has mended these runs the check again."""


@dataclass(frozen=True, slots=True)
class Problem:
    """One thing that is wrong (or, for a warning, doubtful) and where."""

    file: str
    line: int | None
    """Counted from 1; None where no line is to blame."""
    key: str
    """Table and key, such as '[vehicle] wheel_radius_m'; '' for the file as a whole."""
    what: str
    """Description of the problem, such as 'unknown key'."""
    found: str | None = None
    allowed: str | None = None
    suggestion: str | None = None
    """The nearest right spelling or value."""

    @property
    def text(self) -> str:
        """Return the whole problem in one line."""
        where = self.file if self.line is None else f"{self.file}:{self.line}"
        parts = [where, self.key, self.what] if self.key else [where, self.what]
        line = ": ".join(parts)
        if self.found is not None:
            line += f", found {self.found}"
        if self.allowed is not None:
            line += f"; allowed: {self.allowed}"
        if self.suggestion is not None:
            line += f"; did you mean {self.suggestion}?"
        return one_line(line)


class ConfigProblems(ConfigError):  # noqa: N818 - it is all of them, not one error
    """A configuration that cannot be used; its text has one problem per line."""

    def __init__(self, problems: Iterable[Problem]) -> None:
        self.problems = tuple(problems)
        super().__init__("\n".join(shown_lines(self.problems)))


def shown_lines(problems: Sequence[Problem]) -> list[str]:
    """Return a line for each problem; of many the first, and how many more there are."""
    lines = [problem.text for problem in problems[:MAX_SHOWN]]
    more = len(problems) - len(lines)
    if more > 0:
        lines.append(f"{problems[0].file}: and {counted(more, 'more problem')}")
    return lines


def is_file(path: Path) -> bool:
    """Return whether a file exists; False too where its name is too long or its folder may not be read."""
    try:
        return path.is_file()
    except OSError:
        return False


class BadValueError(Exception):
    """A value that breaks its rule; becomes a `Problem` once file, line and key are known."""

    def __init__(
        self,
        what: str,
        found: str | None = None,
        allowed: str | None = None,
        suggestion: str | None = None,
    ) -> None:
        self.what = what
        self.found = found
        self.allowed = allowed
        self.suggestion = suggestion
        super().__init__(what)

    def at(self, file: Path | str, line: int | None, key: str) -> Problem:
        """Return the problem with file, line and key."""
        return Problem(str(file), line, key, self.what, self.found, self.allowed, self.suggestion)


STEERS = re.compile(r"[\x00-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069]")
"""Control characters, line ends, turned writing: in a name they would steer a terminal."""


def escaped_lines(text: str) -> str:
    """Return the lines of `text` with escapes in place of control characters."""
    escaped = (STEERS.sub(lambda found: ascii(found[0])[1:-1], line) for line in text.split("\n"))
    return "\n".join(escaped)


def one_line(text: str) -> str:
    """Return `text` with escapes in place of line ends and control characters."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)


def show(value: object) -> str:
    """Return a value of a TOML file as text, shortened to fit in a line."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, list):
        return "an array"
    try:
        text = json.dumps(value, ensure_ascii=False) if isinstance(value, str) else str(value)
    except ValueError:  # a hexadecimal integer of more digits than Python prints in decimal
        return "a number of thousands of digits"
    return text if len(text) <= _LONGEST_SHOWN else text[: _LONGEST_SHOWN - 3] + "..."


def show_key(key: str) -> str:
    """Return a key as TOML would write it: bare where it can be, else quoted."""
    if len(key) > _LONGEST_SHOWN:
        key = key[: _LONGEST_SHOWN - 3] + "..."
    return key if re.fullmatch(r"[A-Za-z0-9_-]+|[\w-]+\.\.\.", key) else json.dumps(key, ensure_ascii=False)
