"""A guest of User Mode Linux: a kernel with CAN and systemd that runs as an ordinary process.

In: a job for the inside, the folder that it may write to. Out: its exit code, or `HilError` with the tail of
the console. Nothing here needs root, and nothing is written to the machine but below that folder.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from tests.hil.held_up import HeldUp, watched

HERE = Path(__file__).resolve().parent
KERNEL = "linux.uml"
MODULES = Path("/usr/lib/uml/modules")
PACKAGES = "user-mode-linux kmod can-utils iproute2 util-linux systemd libnss-systemd udev e2fsprogs"
TAIL_LINES = 40
_MEMORY = "512M"
_NICE = -15
_taken: set[int] = set()
_lock = threading.Lock()


class HilError(Exception):
    """What was wanted cannot be had, or the guest did not say how it ended."""


def missing() -> str:
    """Why there can be no guest on this machine; empty if there can."""
    if os.uname().machine != "x86_64":
        return f"User Mode Linux is for x86_64, this is {os.uname().machine}"
    if shutil.which(KERNEL) is None or not MODULES.is_dir():
        return f"no User Mode Linux ({KERNEL}); on Debian 12: apt-get install {PACKAGES}"
    tools = [tool for tool in ("insmod", "ip", "candump", "cangen", "canplayer") if _which(tool) is None]
    if tools:
        return f"no {', '.join(tools)}; on Debian 12: apt-get install {PACKAGES}"
    if shutil.which("gcc") is None:
        return "host_shim.c must be compiled; on Debian 12: apt-get install gcc libc6-dev"
    return ""


def _which(tool: str) -> str | None:
    return shutil.which(tool, path=f"{os.environ.get('PATH', '')}:/usr/sbin:/sbin")


def shim(build: Path) -> Path:
    """`host_shim.c`, compiled if it was not yet."""
    source, library = HERE / "host_shim.c", build / "host_shim.so"
    with _lock:
        if not library.exists() or library.stat().st_mtime < source.stat().st_mtime:
            build.mkdir(parents=True, exist_ok=True)
            command = ["gcc", "-O2", "-shared", "-fPIC", "-o", str(library), str(source)]
            try:
                done = subprocess.run(command, capture_output=True, text=True)
            except OSError as error:
                raise HilError(f"host_shim.c cannot be compiled: {error}") from None
            if done.returncode:
                raise HilError(f"host_shim.c cannot be compiled: {done.stderr.strip()[-300:]}")
    return library


def idlest_cpu(read: Callable[[], str] = lambda: Path("/proc/stat").read_text("ascii")) -> int:
    """Of the processors that this process may use, the one with the most idle time lately.

    A guest that wanders between processors is several times slower than one that stays.
    """
    before = _idle_ticks(read())
    time.sleep(0.2)
    after = _idle_ticks(read())
    allowed = sorted(os.sched_getaffinity(0) - _taken) or sorted(os.sched_getaffinity(0))
    return max(allowed, key=lambda cpu: after.get(cpu, 0) - before.get(cpu, 0))


@contextlib.contextmanager
def _own_cpu() -> Iterator[int]:
    """A processor that no other guest of this process has."""
    with _lock:
        cpu = idlest_cpu()
        _taken.add(cpu)
    try:
        yield cpu
    finally:
        _taken.discard(cpu)


def _idle_ticks(stat: str) -> dict[int, int]:
    rows = [line.split() for line in stat.splitlines() if line.startswith("cpu") and line[3:4].isdigit()]
    return {int(row[0][3:]): int(row[4]) for row in rows}


def _claim(cpu: int) -> None:
    """Stay on one processor, and before others where that may be said: a car does not wait for a build."""
    os.sched_setaffinity(0, {cpu})
    with contextlib.suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, 0, _NICE)
        # Sessions share a processor as groups; within one's own alone the above has a meaning.
        Path("/proc/self/autogroup").write_text(str(_NICE), "ascii")


@dataclass
class Guest:
    """A running guest; `stop` it, or `wait` for its end."""

    process: subprocess.Popen[bytes]
    out: Path
    console: Path
    folder: Path
    """Where the kernel keeps its pid file; gone after the end."""
    cat: subprocess.Popen[bytes]
    """Writes the console."""
    held_up: HeldUp
    """How the machine treated its processor so far."""

    def cut_power(self) -> None:
        """End it at once, as a power cut would: every process of it, without a last word."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.cat.wait(10.0)
        shutil.rmtree(self.folder, ignore_errors=True)

    def wait(self, timeout_s: float) -> int:
        """The job's exit code; `HilError` if the guest ends without one, or not in time."""
        try:
            self.process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            self.cut_power()
            raise HilError(f"the guest did not end within {timeout_s:.0f} s\n{self.tail()}") from None
        self.cut_power()
        try:
            return int((self.out / "status").read_text("ascii"))
        except (OSError, ValueError):
            raise HilError(f"the guest ended without a status\n{self.tail()}") from None

    def tail(self) -> str:
        """The last lines of console and job."""
        parts = []
        for file in (self.console, self.out / "job.log"):
            with contextlib.suppress(OSError):
                lines = file.read_text("utf-8", "replace").splitlines()[-TAIL_LINES:]
                parts += [f"--- {file.name}", *lines]
        return "\n".join(parts)


@contextlib.contextmanager
def guest(
    job: str,
    *,
    out: Path,
    stage: Path,
    mode: str = "plain",
    disk: Path | None = None,
    kernel: str = KERNEL,
    memory: str = _MEMORY,
    build: Path,
    pace: float = 1.0,
    root: Path = Path("/"),
    init: Path = HERE / "init.sh",
) -> Iterator[Guest]:
    """Boot a guest that runs `job` (a shell script) in `mode` with `out` as its /out; ended by all means.

    `pace` is how many seconds pass in it in a second of the machine (host_shim.c). `root` is the system that
    it has below, with the kernel's modules in it; `init` its process 1, a path in that system.
    """
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    script = out / "job.sh"
    script.write_text(job, encoding="utf-8")
    folder = Path(tempfile.mkdtemp(prefix="uml-", dir="/tmp"))  # the path of a socket must be short
    words = [
        *(
            f"mem={memory}",
            "root=/dev/root",
            "rootfstype=hostfs",
            f"rootflags={root}",
            "ro",
            "con=null",
            "con0=null,fd:1",
        ),
        *("quiet", "loglevel=1", "noreboot", f"init={init}", f"uml_dir={folder}", "umid=guest"),
        *(f"HIL_STAGE={stage}", f"HIL_OUT={out}", f"HIL_JOB=/out/{script.name}", f"HIL_MODE={mode}"),
    ]
    if mode == "systemd":
        words += ["systemd.unit=hil.target", "systemd.show_status=false", "systemd.log_level=warning"]
    if disk is not None:
        words += [f"ubd0={disk}", "HIL_DISK=ubda"]
    environment = {"PATH": os.environ.get("PATH", "/usr/bin:/bin"), "HOME": "/"}
    environment |= {"LD_PRELOAD": str(shim(build)), "HIL_PACE": f"{pace:g}"}
    console = out / "console.log"
    with _own_cpu() as cpu, watched(cpu) as held_up, console.open("wb") as log:
        # Through a pipe: the guest's console driver does not poll files.
        cat = subprocess.Popen(["cat"], stdin=subprocess.PIPE, stdout=log, start_new_session=True)
        process = subprocess.Popen(
            [shutil.which(kernel) or kernel, *words],
            stdin=subprocess.DEVNULL,
            stdout=cat.stdin,
            stderr=subprocess.STDOUT,
            env=environment,
            start_new_session=True,
            preexec_fn=lambda: _claim(cpu),
        )
        assert cat.stdin is not None
        cat.stdin.close()
        running = Guest(process, out, console, folder, cat, held_up)
        try:
            yield running
        finally:
            running.cut_power()
