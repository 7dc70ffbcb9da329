"""A file for a native library, read in a process of its own with limits of memory and time.

In: the name of a function that reads, and a path. Out: the messages that it sends. Libraries that parse in C
(asammdf, HDF5, Arrow) may crash, hang or take memory without end on a damaged file: then the child ends, and
the parent says so in one line. Messages are bytes with their length in front; nothing of them is executed.
"""

from __future__ import annotations

import importlib
import json
import os
import resource
import signal
import struct
import subprocess
import sys
from collections.abc import Callable, Iterator
from importlib.machinery import PathFinder
from pathlib import Path
from typing import Any

CPU_S = 8
"""CPU time of a small file, s: a sound one takes a tenth; a damaged one may keep its library for ever."""
CPU_S_PER_MB = 4
"""CPU time beyond `CPU_S` for each MB of the file, s: python-can takes 1 to 2 s per MB of packed MF4."""
MEMORY_BYTES = 512 << 20
MEMORY_PER_BYTE = 8
"""Address space for each byte of the file, beyond what the imports took."""
MAX_MESSAGE_BYTES = 256 << 20
_HEADER = struct.Struct("<cQ")
_DATA, _END, _FAILED = b"D", b"E", b"X"
_START = (
    "import sys, json; sys.path[:] = json.loads(sys.argv[1]); "
    "from tpmsd.foundation.child_reader import serve; serve(sys.argv[2], sys.argv[3])"
)

Send = Callable[[bytes], None]
Worker = Callable[[Path, Iterator[str], Send], None]
"""Function that reads the path, answers the requests (lines), sends messages. It calls `limit` once all is
imported."""


class ChildReadError(ValueError):
    """Failure of the child to read to the end, in one line."""


class ChildReader:
    """A child that reads one file."""

    def __init__(self, worker: str, path: Path) -> None:
        """`worker` is the function's name, as `package.module:function`."""
        arguments = [json.dumps(sys.path), worker, str(path)]
        threads = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
        self._child = subprocess.Popen(
            [sys.executable, "-P", "-c", _START, *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, **threads},
        )

    def __enter__(self) -> ChildReader:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def ask(self, request: str) -> None:
        """Send a request, one line."""
        assert self._child.stdin is not None
        try:
            self._child.stdin.write(request.encode() + b"\n")
            self._child.stdin.flush()
        except OSError:
            raise ChildReadError(self._end_reason()) from None

    def receive(self) -> bytes | None:
        """Return the next message, None after the last; ChildReadError where the child failed."""
        assert self._child.stdout is not None
        header = self._child.stdout.read(_HEADER.size)
        if len(header) < _HEADER.size:
            raise ChildReadError(self._end_reason())
        kind, size = _HEADER.unpack(header)
        if size > MAX_MESSAGE_BYTES:
            raise ChildReadError(f"a message of {size} bytes of its reader")
        body = self._child.stdout.read(size)
        if len(body) < size:
            raise ChildReadError(self._end_reason())
        if kind == _FAILED:
            raise ChildReadError(body.decode("utf-8", "replace"))
        return body if kind == _DATA else None

    def close(self) -> None:
        """Kill the child, whatever it is doing."""
        self._child.kill()
        self._child.wait()
        for pipe in (self._child.stdin, self._child.stdout):
            if pipe is not None:
                # What is still to be written to a child that is gone is of no use.
                try:
                    pipe.close()
                except OSError:
                    continue

    def _end_reason(self) -> str:
        """Return why the child has ended, in a line; waits for its end."""
        code = self._child.wait()
        if code == -signal.SIGXCPU:
            return "takes more time than a file of its size may"
        return f"its reader was ended by {signal.Signals(-code).name}" if code < 0 else "its reader ended"


def installed(module: str) -> bool:
    """Return whether a child process can import this module; nothing is imported here."""
    root = module.partition(".")[0]
    if root in sys.modules:
        return sys.modules[root] is not None
    return PathFinder.find_spec(root) is not None


def limit(path: Path) -> None:
    """Limit the CPU time and address space of this process from now on, by the file's size."""
    size = path.stat().st_size
    used = resource.getrusage(resource.RUSAGE_SELF)
    cpu_s = int(used.ru_utime + used.ru_stime) + 1 + CPU_S + CPU_S_PER_MB * (size >> 20)
    _lower_limit(resource.RLIMIT_CPU, cpu_s)
    _lower_limit(resource.RLIMIT_CORE, 0)
    statm = Path("/proc/self/statm")
    if statm.is_file():  # Linux
        pages = int(statm.read_text("ascii").split()[0])
        _lower_limit(
            resource.RLIMIT_AS, pages * resource.getpagesize() + MEMORY_BYTES + MEMORY_PER_BYTE * size
        )


def _lower_limit(what: int, value: int) -> None:
    hard = resource.getrlimit(what)[1]
    value = value if hard == resource.RLIM_INFINITY else min(value, hard)
    resource.setrlimit(what, (value, hard))


def serve(worker: str, path: str) -> None:
    """Run a worker in the child process: write its messages, then the end or the error, to the parent."""
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints is no message

    def write_message(kind: bytes, body: bytes) -> None:
        out.write(_HEADER.pack(kind, len(body)) + body)

    def send(body: bytes) -> None:
        write_message(_DATA, body)

    def requests() -> Iterator[str]:
        while True:
            out.flush()
            line = sys.stdin.readline()
            if not line:
                return
            yield line.rstrip("\n")

    try:
        module, _, function = worker.partition(":")
        work: Any = getattr(importlib.import_module(module), function)
        work(Path(path), requests(), send)
    except BrokenPipeError:
        return
    except Exception as error:
        # The libraries raise dozens of types on damaged files.
        write_message(_FAILED, _error_line(error).encode())
    else:
        write_message(_END, b"")
    out.flush()
    os._exit(0)  # destructors of half-made objects may fail


def _error_line(error: Exception) -> str:
    text = " ".join(str(error).split())
    if isinstance(error, ValueError) and text:
        return text[:300]
    return f"{type(error).__name__}{f' ({text[:120]})' if text else ''}"
