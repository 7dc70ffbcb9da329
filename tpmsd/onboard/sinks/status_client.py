"""Asks a running daemon for its status.

In: the path of its socket. Out: status documents, or `StatusError` with one line that says what to do.
"""

from __future__ import annotations

import contextlib
import errno
import json
import socket
import stat
import time
from collections.abc import Generator
from pathlib import Path
from typing import Any

from tpmsd.foundation.errors import TpmsdError
from tpmsd.onboard.sinks.socket_path import check_socket_path
from tpmsd.onboard.sinks.status_version import DOCUMENT_VERSION

TIMEOUT_S = 5.0
MAX_LINE_BYTES = 1 << 20


class StatusError(TpmsdError):
    """The daemon cannot be asked, or what answers is not tpmsd."""


def read_status(path: Path, timeout_s: float = TIMEOUT_S) -> dict[str, Any]:
    """Return the present status. Raises StatusError; ConfigError for a path no socket can have."""
    with contextlib.closing(_read_documents(path, "status", timeout_s)) as documents:
        return next(documents)


def request_reset(path: Path, tyres: str | None, timeout_s: float = TIMEOUT_S) -> dict[str, Any]:
    """Request to learn the tyres again; return the status as it was when the request was taken. Raises
    StatusError."""
    with contextlib.closing(_read_documents(path, "reset", timeout_s, tyres)) as documents:
        return next(documents)


def read_explanation(path: Path, timeout_s: float = TIMEOUT_S) -> dict[str, Any]:
    """Return the reasons for which alarms are active, or for which none is. Raises StatusError."""
    with contextlib.closing(_read_documents(path, "explain", timeout_s)) as documents:
        return next(documents)


def watch_status(path: Path, timeout_s: float = TIMEOUT_S) -> Generator[dict[str, Any], None, None]:
    """Yield the status now and with every update; ends only by StatusError (the daemon has gone)."""
    return _read_documents(path, "watch", timeout_s)


def _read_documents(
    path: Path, request: str, timeout_s: float, tyres: str | None = None
) -> Generator[dict[str, Any], None, None]:
    """Connect, send a request and yield each document of the answer. Raises StatusError."""
    check_socket_path(path)
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connection:
        connection.settimeout(timeout_s)
        try:
            connection.connect(str(path))
            connection.sendall(
                json.dumps({"request": request} | ({} if tyres is None else {"tyres": tyres})).encode("ascii")
                + b"\n"
            )
        except TimeoutError as error:
            raise StatusError(_silence_text(path, timeout_s)) from error
        except BrokenPipeError:
            pass  # it may have answered before it closed
        except OSError as error:
            raise StatusError(refusal(path, error)) from error
        buffer = bytearray()
        while True:
            yield parse_status(path, _read_line(connection, buffer, path, timeout_s))


def _read_line(connection: socket.socket, buffer: bytearray, path: Path, timeout_s: float) -> bytes:
    """Return the next line; the time-out is for the whole of it, so that a slow sender cannot hold the client
    for ever."""
    until_s = time.monotonic() + timeout_s
    while (end := buffer.find(b"\n")) < 0:
        if len(buffer) > MAX_LINE_BYTES:
            raise StatusError(f"{path}: what answers is not tpmsd (more than {MAX_LINE_BYTES} bytes)")
        left_s = until_s - time.monotonic()
        try:
            if left_s <= 0:
                raise TimeoutError
            connection.settimeout(left_s)
            data = connection.recv(65536)
        except TimeoutError as error:
            raise StatusError(_silence_text(path, timeout_s)) from error
        except OSError:
            data = b""
        if not data:
            what = "what answers is not tpmsd (half a line)" if buffer else "tpmsd has closed the connection"
            raise StatusError(f"{path}: {what}")
        buffer += data
    line = bytes(buffer[:end])
    del buffer[: end + 1]
    return line


def parse_status(path: Path, line: bytes) -> dict[str, Any]:
    """Return a line of the socket as a document; StatusError where it is none, or holds a refusal."""
    try:
        document = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise StatusError(f"{path}: what answers is not tpmsd (no JSON)") from error
    if not isinstance(document, dict):
        raise StatusError(f"{path}: what answers is not tpmsd (no JSON object)")
    if isinstance(document.get("error"), str):
        raise StatusError(f"{path}: tpmsd says: {printable(document['error'])}")
    if "version" not in document:
        raise StatusError(f"{path}: what answers is not tpmsd (no version)")
    if document["version"] != DOCUMENT_VERSION:
        raise StatusError(
            f"{path}: the daemon's status has version {document['version']!r:.20}, "
            f"this tpmsd reads {DOCUMENT_VERSION}"
        )
    return document


def printable(text: str) -> str:
    """Return the text in one line without control characters: a stranger's answer must not control the
    terminal."""
    return "".join(c if c.isprintable() else " " for c in text)[:500]


def _silence_text(path: Path, timeout_s: float) -> str:
    """Return the message for a daemon that does not answer in time."""
    return f"{path}: tpmsd does not answer (waited {timeout_s:g} s)"


def refusal(path: Path, error: OSError) -> str:
    """Return the reason why a socket cannot be asked, in one line that says what to do."""
    if error.errno == errno.ENOENT:
        return f"there is no socket {path}: is tpmsd running? (--socket PATH or --config FILE names another)"
    if error.errno == errno.ECONNREFUSED:
        with contextlib.suppress(OSError):
            if not stat.S_ISSOCK(path.stat().st_mode):
                return f"{path} is not a socket"
        return f"nobody answers on {path}: tpmsd is not running"
    if error.errno in (errno.EACCES, errno.EPERM):
        return f"no permission to ask on {path}: are you in the group that owns it?"
    return f"cannot ask on {path}: {error.strerror or error}"
