"""The machine's own vcan, in user and network namespaces of our own: without root, and beside no other bus.

In: a command. Out: its exit code, run where vcan0 exists and may be taken down and deleted.
"""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

# The machine's /sys shows the machine's interfaces; the daemon looks there whether its own is up.
_MAKE = (
    "{ mount -t sysfs sysfs /sys || true; } && ip link set lo up && ip link add dev vcan0 type vcan "
    "&& ip link set vcan0 mtu 72 up"
)
_UNSHARE = ["unshare", "--user", "--map-root-user", "--net", "--mount"]


def available() -> bool:
    """Whether such a bus can be made and a socket bound to it."""
    if shutil.which("unshare") is None or shutil.which("candump") is None:
        return False
    probe = "import socket; socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).bind(('vcan0',))"
    command = [*_UNSHARE, "sh", "-c", f"{_MAKE} && exec {shlex.join([sys.executable, '-c', probe])}"]
    return subprocess.run(command, capture_output=True, env=_environment()).returncode == 0


def run(command: list[str], out: Path, timeout_s: float) -> tuple[int, str]:
    """Exit code and output of a command beside a fresh vcan0."""
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    shell = f"{_MAKE} && exec {shlex.join(command)}"
    log = out / "job.log"
    with log.open("wb") as file:
        process = subprocess.Popen(
            [*_UNSHARE, "sh", "-c", shell], stdout=file, stderr=subprocess.STDOUT, env=_environment()
        )
        try:
            code = process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            process.kill()
            code = process.wait() or 1
    return code, log.read_text("utf-8", "replace")[-12000:]


def _environment() -> dict[str, str]:
    return {
        **os.environ,
        "PATH": f"{os.environ.get('PATH', '')}:/usr/sbin:/sbin",
        "TPMSD_HIL_COMMAND": shlex.join([sys.executable, "-m", "tpmsd"]),
        "PYTHONDONTWRITEBYTECODE": "1",
        "TPMSD_HIL": "1",
    }
