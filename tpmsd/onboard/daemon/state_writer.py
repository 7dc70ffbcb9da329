"""Writes the state beside the loop: a slow disk holds up no tick.

In: a file and its content. Out: whether it is on the disk. Old SD cards take seconds to sync a file, and a
save syncs twice; in the loop that would hold up the ticks, and systemd's watchdog would end the daemon.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path

from tpmsd.onboard.sinks.state_file import StateError, write_state


class StateWriter:
    """One write at a time, in a thread of its own."""

    def __init__(self, write: Callable[[Path, bytes], None] = write_state) -> None:
        """`write` raises StateError where it fails; anything else that it raises is reported as one."""
        self._write = write
        self._done = threading.Event()
        self._error: StateError | None = None
        self.busy = False
        """True if a write is under way, or `finished` has not yet reported its outcome."""

    def begin(self, file: Path, content: bytes) -> None:
        """Start a write in a thread; only while none is under way."""
        assert not self.busy
        self.busy, self._error = True, None
        self._done.clear()
        # A daemon thread: a disk that hangs for ever must not keep the process from its end.
        thread = threading.Thread(
            target=self._write_or_keep_error, args=(file, content), name="state", daemon=True
        )
        try:
            thread.start()
        except RuntimeError:  # no memory for its stack
            self._write_or_keep_error(file, content)

    def _write_or_keep_error(self, file: Path, content: bytes) -> None:
        try:
            self._write(file, content)
        except StateError as error:
            self._error = error
        except Exception as error:  # no memory, a defect: nothing is on the disk, which the loop must hear
            self._error = StateError(f"{file}: cannot save the state: {type(error).__name__}: {error}")
        finally:
            self._done.set()

    def finished(self, wait_s: float = 0.0) -> bool:
        """Return whether the write is finished, within `wait_s`. Raises StateError once if it has failed."""
        if not self._done.wait(wait_s):
            return False
        self.busy = False
        if self._error is not None:
            raise self._error
        return True
