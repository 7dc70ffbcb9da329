"""One daemon per state file: an advisory lock beside it, held for as long as the daemon runs.

In: the state file's name. Out: a context in which no other daemon has it. The lock is the kernel's (`flock`),
and goes with the process, however that ends, so that nothing stale stands in the way of a restart.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import stat
from collections.abc import Iterator
from pathlib import Path

from tpmsd.foundation.errors import TpmsdError

SUFFIX = ".lock"


class StateInUseError(TpmsdError):
    """Another daemon keeps its state in the same file."""


@contextlib.contextmanager
def state_lock(file: Path | None) -> Iterator[None]:
    """Hold the lock of a state file; does nothing where there is no file, or no lock can be made beside it.

    (A folder that cannot be written to takes no state either; the daemon runs all the same and says so.)

    Raises:
        StateInUseError: another process holds it; the line names the process.
    """
    descriptor = None if file is None else _open_lock(file.with_name(f".{file.name}{SUFFIX}"))
    if file is None or descriptor is None:
        yield
        return
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            if error.errno not in (errno.EWOULDBLOCK, errno.EACCES):
                yield  # a file system without locks
                return
            raise StateInUseError(
                f"{file}: another tpmsd{_holder_text(descriptor)} keeps its state there; "
                "--state FILE gives this one a file of its own"
            ) from None
        with contextlib.suppress(OSError):  # a full disk: the lock holds without its holder's name
            os.ftruncate(descriptor, 0)
            os.pwrite(descriptor, f"{os.getpid()}\n".encode("ascii"), 0)
        yield
    finally:
        os.close(descriptor)


def _open_lock(lock: Path) -> int | None:
    """Return a descriptor of the lock file; None if it cannot be made."""
    # Not blocking and no links: a pipe or a link of that name must not hang the start or lead elsewhere.
    flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
    try:
        lock.parent.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(lock, flags, 0o640)
    except OSError:
        return None
    if stat.S_ISREG(os.fstat(descriptor).st_mode):
        return descriptor
    os.close(descriptor)
    return None


def _holder_text(descriptor: int) -> str:
    """Return the process that holds the lock, in brackets; empty if it is not known."""
    try:
        text = os.pread(descriptor, 32, 0).decode("ascii").strip()
    except (OSError, UnicodeDecodeError):
        return ""
    return f" (process {text})" if text.isdecimal() else ""
