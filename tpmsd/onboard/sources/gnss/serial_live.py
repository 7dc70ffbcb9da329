"""Reads a GNSS receiver on a serial line without ever waiting.

In: the name of a device and its baud rate. Out: bytes, as they come, for `NmeaFramer`. Everything that can go
wrong is a `ReceiverGone` with one line that says why, upon which the caller closes, waits and opens again.
"""

from __future__ import annotations

import contextlib
import errno
from types import TracebackType
from typing import Self

import serial

from tpmsd.foundation.errors import TpmsdError

READ_BYTES = 4096

_REASONS = {
    errno.ENOENT: "no such device",
    errno.ENXIO: "no such device",
    errno.ENODEV: "no such device",
    errno.EACCES: "no permission (is the user in the device's group, often 'dialout'?)",
    errno.EPERM: "no permission (is the user in the device's group, often 'dialout'?)",
    errno.EBUSY: "in use by another program",
    errno.EAGAIN: "in use by another program",
    errno.ENOTTY: "not a serial device",
    errno.EINVAL: "not a serial device, or one that refuses these settings",
    errno.EISDIR: "not a serial device",
    errno.EIO: "unplugged, or its driver has failed",
}


class ReceiverGone(TpmsdError, OSError):  # noqa: N818 -- names a state, as BrokenPipe
    """The receiver cannot be opened, or went away; opening it again later may succeed."""

    def __init__(self, device: str, reason: str) -> None:
        super().__init__(f"{device}: {reason}")
        self.device = device
        self.reason = reason

    def __str__(self) -> str:
        return f"{self.device}: {self.reason}"


class SerialReceiver:
    """One serial line. A context manager; `open` may be called again after `close`."""

    def __init__(self, device: str, baud: int = 115200) -> None:
        self.device = device
        self.baud = baud
        self._port: serial.Serial | None = None

    @property
    def is_open(self) -> bool:
        """True if the serial port is open."""
        return self._port is not None

    def open(self) -> None:
        """Open the line for this program alone. Raises `ReceiverGone`."""
        self.close()
        if not isinstance(self.baud, int) or self.baud <= 0:
            raise ReceiverGone(self.device, f"baud rate {self.baud!r} is no positive whole number")
        try:
            # Exclusive: two programs on one line would each get half of the bytes.
            self._port = serial.Serial(self.device, self.baud, timeout=0, exclusive=True)
        except (ValueError, OverflowError):
            raise ReceiverGone(self.device, f"the device does not support baud rate {self.baud}") from None
        except OSError as error:
            raise ReceiverGone(self.device, _reason(error)) from None

    def fileno(self) -> int:
        """Return the descriptor to wait on. Raises `ReceiverGone` if closed."""
        return int(self._require_open().fileno())

    def read(self) -> bytes:
        """Return the bytes that have arrived, empty if none have. Raises `ReceiverGone` when the line is
        gone."""
        port = self._require_open()
        try:
            return bytes(port.read(READ_BYTES))
        except OSError:
            # SerialException (an OSError): ready to read but no data, or the driver's EIO. Either is a hang-
            # up.
            raise ReceiverGone(self.device, "unplugged, or its driver has failed") from None
        except TypeError:
            # pyserial's own end when the descriptor was taken away beneath it.
            raise ReceiverGone(self.device, "closed") from None

    def close(self) -> None:
        """Close the line; does nothing if it is closed or gone."""
        port, self._port = self._port, None
        if port is not None:
            with contextlib.suppress(OSError):  # gone already
                port.close()

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _require_open(self) -> serial.Serial:
        """Return the serial port. Raises `ReceiverGone` if it is closed."""
        if self._port is None:
            raise ReceiverGone(self.device, "not open")
        return self._port


def _reason(error: OSError) -> str:
    """Return one line for what pyserial or the system reports."""
    # "Could not configure port" hides the number one level down, in what it was raised from.
    numbers = (error.errno, *error.args[:1], *getattr(error.__context__, "args", ())[:1])
    code = next((number for number in numbers if isinstance(number, int)), None)
    if code in _REASONS:
        return _REASONS[code]
    text = str(error).splitlines()[0] if str(error) else type(error).__name__
    if "exclusively lock" in text:
        return _REASONS[errno.EBUSY]
    return text
