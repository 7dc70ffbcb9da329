"""The errors a user can meet, each with the exit code it ends in.

    TpmsdError            1  anything else
     +-- ConfigError      2  wrong usage or configuration (also a ValueError)
     +-- InputError       3  unusable input: names file, line and reason (also a ValueError)

The command line prints `str(error)` as one line on standard error and exits with `error.exit_code`;
a traceback is a defect. Library code raises these and lets them through.
"""

from __future__ import annotations

from pathlib import Path


class TpmsdError(Exception):
    """Base of all errors that end a command with one clear line."""

    exit_code = 1


class ConfigError(TpmsdError, ValueError):
    """Wrong usage or configuration."""

    exit_code = 2


class InputError(TpmsdError, ValueError):
    """Input that cannot be used; says which file, which line (if one is to blame) and why."""

    exit_code = 3

    def __init__(self, file: str | Path, reason: str, line: int | None = None) -> None:
        self.file = str(file)
        self.line = line
        self.reason = reason
        where = self.file if line is None else f"{self.file}:{line}"
        super().__init__(f"{where}: {reason}")
