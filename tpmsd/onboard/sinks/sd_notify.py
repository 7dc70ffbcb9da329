"""Reports the daemon's state to systemd (sd_notify(3)), without a library.

In: NOTIFY_SOCKET and WATCHDOG_USEC of the environment. Out: datagrams such as `READY=1`.
Without a service manager every call does nothing. No call ever raises or blocks: the monitor goes on even if
nobody listens.
"""

from __future__ import annotations

import contextlib
import os
import socket
from collections.abc import Mapping

_MAX_STATUS = 256


class Notifier:
    """A line to the service manager. Every method returns whether the message went out."""

    def __init__(self, address: str | None, watchdog_usec: int | None = None) -> None:
        """`address` is a path, or `@name` for an abstract socket; anything else switches the notifier off."""
        self._address: str | None = None
        if address is not None and len(address) > 1 and address[0] in "/@":
            self._address = "\0" + address[1:] if address[0] == "@" else address
        self._watchdog_usec = watchdog_usec if watchdog_usec is not None and watchdog_usec > 0 else None
        self._socket: socket.socket | None = None

    @classmethod
    def from_environment(
        cls, environment: Mapping[str, str] | None = None, pid: int | None = None
    ) -> Notifier:
        """Return the notifier of systemd's variables; a watchdog meant for another process is left out."""
        environment = os.environ if environment is None else environment
        pid = os.getpid() if pid is None else pid
        usec = environment.get("WATCHDOG_USEC", "")
        mine = environment.get("WATCHDOG_PID", str(pid)) == str(pid)
        watchdog = int(usec) if mine and usec.isascii() and usec.isdecimal() and len(usec) < 20 else None
        return cls(environment.get("NOTIFY_SOCKET"), watchdog)

    @property
    def enabled(self) -> bool:
        """True if there is a service manager to report to."""
        return self._address is not None

    @property
    def watchdog_period_s(self) -> float | None:
        """Period at which to call `watchdog`, s: half the time-out, as sd_watchdog_enabled(3) advises; None
        if no watchdog waits."""
        if self._address is None or self._watchdog_usec is None:
            return None
        return self._watchdog_usec / 2e6

    def ready(self, status: str = "") -> bool:
        """Report that start-up is over."""
        return self._send(["READY=1", *self._status_assignment(status)])

    def status(self, text: str) -> bool:
        """Report one line for `systemctl status`."""
        return self._send(self._status_assignment(text))

    def watchdog(self) -> bool:
        """Feed systemd's watchdog; call only while the estimator advances."""
        return self._send(["WATCHDOG=1"])

    def stopping(self, status: str = "") -> bool:
        """Report that shut-down has begun."""
        return self._send(["STOPPING=1", *self._status_assignment(status)])

    def close(self) -> None:
        """Close the socket; later calls open it again."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    @staticmethod
    def _status_assignment(text: str) -> list[str]:
        """Return the STATUS assignment as a list of one; empty for an empty text."""
        # One line only: a line break would smuggle in another assignment.
        line = " ".join(text.split())[:_MAX_STATUS]
        return [f"STATUS={line}"] if line else []

    def _send(self, assignments: list[str]) -> bool:
        """Send assignments; return whether the message went out."""
        if self._address is None or not assignments:
            return False
        message = "\n".join(assignments).encode("utf-8", "replace")
        try:
            if self._socket is None:
                self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
                self._socket.setblocking(False)
            return self._socket.sendto(message, self._address) == len(message)
        except (OSError, ValueError):  # ValueError: a path with a NUL in it
            with contextlib.suppress(OSError):
                self.close()
            return False
