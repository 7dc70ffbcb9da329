"""The tree that is mounted over the machine's in the guest: the Debian package, unpacked as dpkg would.

In: the sources. Out: build/hil/root. So what is tested is what is installed. Rebuilt only when the sources
have changed.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
import threading
from functools import cache
from pathlib import Path

from tests.hil.uml import HilError

REPO = Path(__file__).resolve().parent.parent.parent
BUILD = REPO / "build" / "hil"
STAGE = BUILD / "root"
_lock = threading.Lock()
KEEP = bool(os.environ.get("TPMSD_HIL_KEEP"))
"""Take the package as it was built last: for those who work on the tests alone."""
SOURCES = ("tpmsd", "dbc", "docs", "systemd", "tools", "packaging", "pyproject.toml", "README.md", "LICENSE")


def sources_id() -> str:
    """A checksum of all that goes into the package."""
    digest = hashlib.sha256()
    for name in SOURCES:
        path = REPO / name
        for file in sorted(path.rglob("*")) if path.is_dir() else [path]:
            if file.is_file() and "__pycache__" not in file.parts:
                digest.update(file.relative_to(REPO).as_posix().encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()


def package() -> Path:
    """The Debian package of the sources as they are."""
    with _lock:
        return _package()


@cache
def _package() -> Path:
    # Once: what is tested together was built together, although somebody may be at work on the sources.
    stamp, wanted = BUILD / "package.id", sources_id()
    built = sorted((REPO / "build" / "deb").glob("*.deb"))
    if built and stamp.exists() and (KEEP or stamp.read_text("ascii") == wanted):
        return built[0]
    pip = f"{sys.executable} -m pip --disable-pip-version-check -q"
    done = subprocess.run(
        ["sh", "tools/make_deb.sh"], cwd=REPO, env={**os.environ, "PIP": pip}, capture_output=True, text=True
    )
    if done.returncode:
        raise HilError(f"make deb failed: {done.stderr.strip()[-2000:]}")
    stamp.parent.mkdir(parents=True, exist_ok=True)
    stamp.write_text(wanted, "ascii")
    return REPO / done.stdout.split()[-1]


def stage() -> Path:
    """The package unpacked, with its modules compiled as its postinst does."""
    with _lock:
        return _stage()


@cache
def _stage() -> Path:
    deb = _package()
    stamp = BUILD / "stage.id"
    wanted = (BUILD / "package.id").read_text("ascii")
    if STAGE.is_dir() and stamp.exists() and stamp.read_text("ascii") == wanted:
        return STAGE
    fresh = BUILD / "root.new"
    shutil.rmtree(fresh, ignore_errors=True)
    subprocess.run(["dpkg-deb", "-x", str(deb), str(fresh)], check=True)
    # dpkg goes through the links of a merged /usr; a layer that brings a real /lib would hide the machine's.
    shutil.copytree(fresh / "lib", fresh / "usr" / "lib", dirs_exist_ok=True)
    shutil.rmtree(fresh / "lib")
    control = fresh / "var" / "lib" / "dpkg" / "info"
    control.parent.mkdir(parents=True)
    subprocess.run(["dpkg-deb", "-e", str(deb), str(control)], check=True)
    for script in list(control.iterdir()):
        script.rename(control / f"tpmsd.{script.name}")
    compile_modules(fresh, STAGE)
    shutil.rmtree(STAGE, ignore_errors=True)
    fresh.rename(STAGE)
    stamp.write_text(wanted, "ascii")
    return STAGE


def compile_modules(fresh: Path, before: Path) -> None:
    """Compile as postinst does; what others published is taken over from before where it is the same."""
    environment = fresh / "usr" / "lib" / "tpmsd"
    (modules,) = environment.glob("lib/python3.*/site-packages")
    old = before / modules.relative_to(fresh)
    todo = [str(environment / "lib")]
    if old.is_dir() and published(old) == published(modules):
        for folder in old.rglob("__pycache__"):
            target = modules / folder.relative_to(old)
            if target.parent.is_dir() and folder.relative_to(old).parts[0] != "tpmsd":
                folder.rename(target)
        todo = [str(modules / "tpmsd")]
    settings = dict(
        line.split(" = ", 1) for line in (environment / "pyvenv.cfg").read_text("utf-8").splitlines()
    )
    # Without a look at times: they change with every build.
    options = ["-q", "-f", "-j", "0", "--invalidation-mode", "unchecked-hash", "-s", str(fresh), "-p", "/"]
    command = [settings["executable"], "-m", "compileall", *options, *todo]
    subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def published(modules: Path) -> set[str]:
    """Names and versions of the packages of others."""
    return {path.name for path in modules.glob("*.dist-info") if not path.name.startswith("tpmsd-")}
