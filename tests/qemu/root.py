"""A Debian of another architecture with this machine's versions of the run-time packages.

In: a folder. Out: there, `system` (Debian's Python, unpacked and not set up, so that nothing need run) and
`packages`. Made once for a set of versions; takes mmdebstrap and a network.
"""

from __future__ import annotations

import platform
import shutil
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

SYSTEM = ("python3", "libstdc++6")
BINARY = ("numpy", "scipy", "python-can", "cantools", "pyserial", "pytest", "hypothesis")


class RootError(Exception):
    """The system cannot be made; the message says why."""


def make(folder: Path, debian: str, machine: str, python: str) -> tuple[Path, Path]:
    """System and packages of `machine` (`aarch64`), which Debian calls `debian` (`arm64`).

    Raises RootError.
    """
    wanted = {name: version(name) for name in BINARY}
    stamp = folder / "made"
    text = f"{debian} {python} {sorted(wanted.items())}\n"
    system, packages = folder / "system", folder / "packages"
    if stamp.is_file() and stamp.read_text("utf-8") == text:
        return system, packages
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    suite = platform.freedesktop_os_release()["VERSION_CODENAME"]
    include = f"--include={','.join(SYSTEM)}"
    _run("mmdebstrap", "--variant=extract", f"--arch={debian}", include, suite, str(system))
    pip = [
        sys.executable,
        "-m",
        "pip",
        "--disable-pip-version-check",
        "-q",
        "install",
        "--target",
        str(packages),
    ]
    tags = [f"--platform=manylinux_{glibc}_{machine}" for glibc in ("2_28", "2_27", "2_17")]
    tags.append(f"--platform=manylinux2014_{machine}")
    exact = [f"{name}=={wanted[name]}" for name in BINARY]
    _run(*pip, "--only-binary=:all:", f"--python-version={python}", *tags, *exact)
    stamp.write_text(text, "utf-8")
    return system, packages


def _run(*command: str) -> None:
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise RootError(f"{Path(command[0]).name}: {done.stderr.strip()[-500:]}")
