"""The files that a command was asked to write: checked before the work, written whole after the report.

In: options with their targets; after the work, what goes into each. Out: the files, or one line for each that
could not be written. A long computation never loses its result to a folder that is not there: what cannot
work is said before it starts, a file appears under its name only when it is complete, and one that fails (a
full disk) does not keep the others from being written.
"""

from __future__ import annotations

import contextlib
import os
import stat
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

from tpmsd.foundation.errors import TpmsdError
from tpmsd.foundation.text_file import names_configuration
from tpmsd.interfaces.cli.terminal_lines import fitted_to

Content = Callable[[], str | bytes | None]
"""Makes what goes into a file; None where there is nothing to write."""

STDOUT = "-"
EXIT_UNUSABLE = 3


class OutputError(TpmsdError):
    """A file that was asked for cannot be written; one line for each."""


class Outputs:
    """The outputs of one command, by option; `-` is standard output.

    Args:
        targets: option and target of every output the command knows; None where it was not asked for.
        configuration: the option that writes a configuration; the others replace none, nor a recording.

    Raises:
        OutputError: a target cannot be written, or two outputs have the same one; nothing was touched.
    """

    def __init__(self, *targets: tuple[str, str | Path | None], configuration: str = "") -> None:
        self._targets = {option: str(target) for option, target in targets if target is not None}
        problems = [
            line
            for option, target in self._targets.items()
            if (line := _why_unwritable(option, target, option == configuration))
        ]
        seen: dict[str, str] = {}
        for option, target in self._targets.items():
            destination = STDOUT if target == STDOUT else str(Path(target).resolve())
            if destination in seen:
                problems.append(f"{option} {target}: {seen[destination]} goes there already")
            seen.setdefault(destination, option)
        if problems:
            raise OutputError("\n".join(problems))

    @property
    def fill_stdout(self) -> bool:
        """Return whether an output goes to standard output, so that the report for people must not."""
        return STDOUT in self._targets.values()

    def say(self, text: str, end: str = "\n") -> None:
        """Print the report for people, unless an output goes to standard output.

        A reader that has gone (`| head`) is no error: the files are written all the same.
        """
        if self.fill_stdout:
            return
        try:
            print(fitted_to(sys.stdout, text), end=end, flush=True)
        except BrokenPipeError:
            forget_stdout()

    def asked(self, option: str) -> bool:
        """Return whether this output was asked for on the command line."""
        return option in self._targets

    def write(self, contents: Mapping[str, Content]) -> None:
        """Write every output that was asked for; `contents` makes each one's text or bytes.

        Raises:
            OutputError: with one line for each that could not be written; the others are written.
        """
        problems: list[str] = []
        for option, target in self._targets.items():
            try:
                content = contents[option]()
                if content is None:
                    continue
                if target == STDOUT:
                    _write_stdout(content)
                else:
                    write_whole(Path(target), content)
            except TpmsdError as error:
                problems.append(str(error))
        if problems:
            raise OutputError("\n".join(problems))


def write_whole(target: Path, content: str | bytes, backup: bool = False) -> None:
    """Write beside the target and rename, so that a failure leaves the old file; a link stays one.

    With `backup`, what was there before is kept as `<name>.bak`. A target that is no regular file (a device,
    a pipe) is written to as it is.

    Raises:
        OutputError: it cannot be written; the old file is whole.
    """
    data = content.encode("utf-8") if isinstance(content, str) else content
    temporary: str | None = None
    try:
        if target.exists() and not stat.S_ISREG(target.stat().st_mode):
            target.write_bytes(data)
            return
        import tempfile  # a tenth of what `tpmsd status` takes, which writes no files

        real = target.resolve()
        handle, temporary = tempfile.mkstemp(prefix=f".{real.name}.", suffix=".new", dir=real.parent)
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        Path(temporary).chmod(real.stat().st_mode & 0o777 if real.exists() else 0o666 & ~_current_umask())
        if backup and real.exists():
            kept = real.with_name(f"{real.name}.bak")
            kept.unlink(missing_ok=True)
            os.link(real, kept)
        Path(temporary).replace(real)
        temporary = None
    except (OSError, ValueError) as error:
        reason = (error.strerror if isinstance(error, OSError) else None) or str(error)
        raise OutputError(f"{target}: cannot be written: {reason}") from None
    finally:
        if temporary is not None:
            with contextlib.suppress(OSError):
                Path(temporary).unlink()


def _why_unwritable(option: str, target: str, configuration: bool) -> str | None:
    """Return why the output cannot be written there, in one line; None if nothing prevents it."""
    if target == STDOUT:
        return None
    if not target.strip():
        return f"{option}: the name of a file is wanted"
    path = Path(target)
    try:
        if path.is_dir():
            return f"{option} {target}: a folder; the name of a file is wanted"
        if path.exists() and not os.access(path, os.W_OK):
            return f"{option} {target}: cannot be written: no permission"
        if path.exists() and not path.is_file():
            return None  # a device or a pipe
        if path.exists() and (kept := _protected_kind(path, configuration)):
            return f"{option} {target}: {kept} is there, which no report replaces"
        if not path.resolve().parent.is_dir():
            return f"{option} {target}: there is no folder {path.parent}"
        import tempfile

        # Permissions say little (root on a read-only disk, /proc): a file is made and removed.
        tempfile.TemporaryFile(dir=path.resolve().parent).close()
    except (OSError, ValueError) as error:
        reason = (error.strerror if isinstance(error, OSError) else None) or error
        return f"{option} {target}: cannot be written: {reason}"
    return None


def _protected_kind(path: Path, configuration: bool) -> str:
    """Return the kind of an input file that must not be overwritten (`a recording`, `a DBC`); empty if
    none."""
    from tpmsd.onboard.sources.can.log import is_can_log
    from tpmsd.onboard.sources.drive import NMEA_LOGS

    if is_can_log(path) or path.name in NMEA_LOGS:
        return "a recording"
    if path.suffix.lower() == ".dbc":
        return "a DBC"
    return "a configuration" if not configuration and names_configuration(path) else ""


def _write_stdout(content: str | bytes) -> None:
    if sys.stdout is None:
        raise OutputError("standard output is closed")
    sys.stdout.write(content if isinstance(content, str) else content.decode("utf-8"))
    sys.stdout.flush()


def forget_stdout() -> None:
    """Point standard output to the null device, so that the interpreter's last flush does not fail once
    more."""
    with contextlib.suppress(OSError, ValueError):
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, sys.stdout.fileno())
        os.close(null)


def _current_umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def say_verdict(reason: str | None, summary: Callable[[], str], outputs: Outputs) -> int:
    """Print the summary of a diagnosis, or one line on standard error where its data are insufficient.

    Returns:
        The exit code: 0, or 3 where there is a `reason` why the data are insufficient.
    """
    if reason is not None:
        print(f"tpmsd: insufficient data: {reason}", file=sys.stderr)
        return EXIT_UNUSABLE
    outputs.say(summary())
    return 0
