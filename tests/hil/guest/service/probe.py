"""Tries, from within the service's own confinement, what a daemon that was taken over would try.

Out: JSON on standard output, the error (or `ok`) of each attempt.
"""

from __future__ import annotations

import ctypes
import fcntl
import json
import mmap
import os
import socket
import struct
from collections.abc import Callable
from pathlib import Path

_SIOCSIFFLAGS = 0x8914
_CLONE_NEWUSER = 0x10000000
libc = ctypes.CDLL(None, use_errno=True)


def checked(result: int) -> None:
    if result < 0:
        raise OSError(ctypes.get_errno(), "refused")


def write_in(folder: str) -> None:
    (Path(folder) / "tpmsd-was-here").write_text("x")


def can_socket() -> socket.socket:
    sock = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    sock.bind(("vcan0",))
    return sock


def set_interface_down() -> None:
    fcntl.ioctl(can_socket(), _SIOCSIFFLAGS, struct.pack("16sH14x", b"vcan0", 0))


def writable_code() -> None:
    mmap.mmap(-1, 4096, prot=mmap.PROT_READ | mmap.PROT_WRITE | mmap.PROT_EXEC).close()


def other_processes() -> None:
    if [path for path in Path("/proc").iterdir() if path.name == "1"]:
        raise AssertionError("process 1 is visible")


attempts: dict[str, Callable[[], object]] = {
    "can": can_socket,
    "state directory": lambda: write_in(os.environ["STATE_DIRECTORY"]),
    "runtime directory": lambda: write_in(os.environ["RUNTIME_DIRECTORY"]),
    "null": lambda: Path("/dev/null").write_text("x"),
    "unseen others": other_processes,
    "internet": lambda: socket.socket(socket.AF_INET),
    "netlink": lambda: socket.socket(socket.AF_NETLINK, socket.SOCK_RAW),
    "packet": lambda: socket.socket(socket.AF_PACKET, socket.SOCK_RAW),
    "etc": lambda: write_in("/etc"),
    "program": lambda: write_in("/usr/lib/tpmsd"),
    "configuration": lambda: write_in("/etc/tpmsd"),
    "var": lambda: write_in("/var/lib"),
    "root's home": lambda: list(Path("/root").iterdir()),
    "memory device": lambda: os.open("/dev/mem", os.O_RDONLY),
    "block device": lambda: os.open("/dev/btrfs-control", os.O_RDONLY),
    "kernel log": lambda: os.open("/dev/kmsg", os.O_RDONLY),
    "tunables": lambda: Path("/proc/sys/kernel/hostname").write_text("x"),
    "interface down": set_interface_down,
    "writable code": writable_code,
    "user namespace": lambda: checked(libc.unshare(_CLONE_NEWUSER)),
    "mount": lambda: checked(libc.mount(b"none", b"/mnt", b"tmpfs", 0, None)),
    "root": lambda: os.setuid(0),
    "kill": lambda: os.kill(1, 0),
    "clock": lambda: checked(libc.settimeofday(struct.pack("ll", 1, 0), None)),
    "set-uid file": lambda: (Path(os.environ["STATE_DIRECTORY"]) / "tpmsd-was-here").chmod(0o4755),
    "realtime": lambda: os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1)),
}
results = {}
for name, attempt in attempts.items():
    try:
        attempt()
        results[name] = "ok"
    except Exception as error:
        results[name] = type(error).__name__
print(json.dumps(results), flush=True)
