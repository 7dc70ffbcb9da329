"""`make test-from-nothing`: what README and docs promise, on a Debian on which nothing was done before.

In: the sources as committed, the name of a Debian (`--suite bookworm`, `trixie`), a recorded drive where
there is one. Out: build/from-nothing/SUITE with the transcript, a table of steps with their times on standard
output, and the exit code: 0 only if every step went well. Takes root, mmdebstrap, a network for apt and pip,
and for the service User Mode Linux; some fifteen minutes.

The steps are in `nothing/steps.sh`; service, upgrade from an earlier commit and removal of the package
(`nothing/service.sh`) run in a guest whose root is that Debian.
"""

from __future__ import annotations

import argparse
import os
import re
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from tests.hil import uml
from tests.hil.prepare import BUILD, REPO
from tests.hil.uml import HilError

OUT = REPO / "build" / "from-nothing"
EARLIER = "03ed116"
"""Version 0.1.0, which is upgraded from."""
MIRROR = "http://deb.debian.org/debian"
SUITES = {"bookworm": "Debian 12", "trixie": "Debian 13"}
GUEST_S = 900.0
PACE = 0.5
MEMORY = "3G"
"""Of the guest: its file system holds the package twice, the earlier and the present one."""

RECORDING = "van-motorway-a"
HERE = Path(__file__).resolve().parent / "nothing"


def steps_of(text: str) -> list[tuple[str, str]]:
    """Name of each step of steps.sh, and its commands."""
    parts = re.split(r"^#= (.*)\n", text, flags=re.MULTILINE)[1:]
    return list(zip(parts[::2], parts[1::2], strict=True))


@dataclass(frozen=True)
class Step:
    """How one step went."""

    name: str
    seconds: float
    good: bool


class Machine:
    """A Debian in a folder."""

    def __init__(self, folder: Path, suite: str) -> None:
        self.root = folder / "root"
        self.transcript = folder / "transcript.txt"
        self._folder, self._suite = folder, suite

    def make(self, mirror: str) -> Step:
        """The least of that Debian, as it comes."""
        shutil.rmtree(self._folder, ignore_errors=True)
        self._folder.mkdir(parents=True)
        command = ["mmdebstrap", "--variant=minbase", "--include=ca-certificates", self._suite]
        return self._run("the least Debian (mmdebstrap)", [*command, str(self.root), mirror])

    def settle(self, recording: Path | None) -> None:
        """What the owner brings: the network's names and certificates, the sources, a recorded drive."""
        for name in ("/etc/resolv.conf", "/etc/ssl/certs/ca-certificates.crt"):
            shutil.copyfile(name, self.root / name.lstrip("/"))
        bundle = ["git", "bundle", "create", "-q", str(self.root / "srv/tpmsd.bundle"), "HEAD"]
        subprocess.run(bundle, cwd=REPO, check=True)
        if recording is not None:
            shutil.copytree(recording, self.root / "srv/recording")
        shutil.copytree(uml.MODULES, self.root / str(uml.MODULES).lstrip("/"))
        shutil.copy(REPO / "tests/hil/init.sh", self.root / "hil-init.sh")

    def step(self, name: str, commands: str) -> Step:
        """Commands of a shell in it, as root."""
        kept = {name: value for name, value in os.environ.items() if name.startswith("PIP_")}
        words = {"HOME": "/root", "PATH": "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"}
        words |= {"LANG": "C.UTF-8", "DEBIAN_FRONTEND": "noninteractive", "EARLIER": EARLIER, **kept}
        settings = [f"{key}={value}" for key, value in words.items()]
        inside = ["chroot", str(self.root), "env", "-i", *settings, "sh", "-ec", commands]
        mounts = f"mount -t proc proc {self.root}/proc && mount --rbind /dev {self.root}/dev"
        return self._run(name, ["unshare", "--mount", "sh", "-ec", f"{mounts} && exec {shlex.join(inside)}"])

    def _run(self, name: str, command: list[str]) -> Step:
        began_s = time.monotonic()
        with self.transcript.open("a", encoding="utf-8") as out:
            out.write(f"\n=== {name}\n")
            out.flush()
            done = subprocess.run(command, stdin=subprocess.DEVNULL, stdout=out, stderr=subprocess.STDOUT)
            seconds = time.monotonic() - began_s
            out.write(f"=== exit {done.returncode}, {seconds:.1f} s\n")
        return Step(name, seconds, done.returncode == 0)

    def service(self) -> Iterator[Step]:
        """The service in its systemd, on vcan."""
        out = self._folder / "guest"
        with uml.guest(
            (HERE / "service.sh").read_text("utf-8"),
            out=out,
            stage=self.root / "media",
            mode="systemd",
            memory=MEMORY,
            build=BUILD,
            pace=PACE,
            root=self.root,
            init=Path("/hil-init.sh"),
        ) as guest:
            try:
                good = guest.wait(GUEST_S / PACE) == 0
            except HilError as error:
                good = False
                with self.transcript.open("a", encoding="utf-8") as text:
                    text.write(f"{error}\n")
        said = (out / "job.log").read_text("utf-8", "replace") if (out / "job.log").exists() else ""
        with self.transcript.open("a", encoding="utf-8") as text:
            text.write(f"\n=== in the guest (seconds by its own clock)\n{said}")
        for line in said.splitlines():
            if line.startswith("STEP "):
                _, seconds, name = line.split(" ", 2)
                yield Step(name, float(seconds), True)
        if not good:
            yield Step("the service", 0.0, False)


def steps(machine: Machine, args: argparse.Namespace) -> Iterator[Step]:
    """One after the other, up to the first that fails."""
    yield machine.make(args.mirror)
    folder = Path(os.environ.get("TPMSD_RECORDINGS", REPO.parent / "shared" / "recordings"))
    recording = folder / RECORDING
    machine.settle(recording if recording.is_dir() else None)
    for name, commands in steps_of((HERE / "steps.sh").read_text("utf-8")):
        if recording.is_dir() or "recording" not in name:
            yield machine.step(name, commands)
    if not args.no_service:
        yield from machine.service()


def main() -> int:
    """All steps on one Debian; 0 if all went well."""
    parser = argparse.ArgumentParser(prog="python -m tests.hil.from_nothing", description=__doc__)
    parser.add_argument("--suite", choices=SUITES, default="bookworm")
    parser.add_argument("--mirror", default=MIRROR)
    parser.add_argument("--no-service", action="store_true", help="leave out what takes a guest")
    args = parser.parse_args()
    absent = [tool for tool in ("mmdebstrap", "unshare", "git") if shutil.which(tool) is None]
    reason = f"no {', '.join(absent)}" if absent else "" if args.no_service else uml.missing()
    if os.geteuid() != 0 or reason:
        print(f"takes root{'; ' + reason if reason else ''}", file=sys.stderr)
        return 2
    machine = Machine(OUT / args.suite, args.suite)
    print(f"{SUITES[args.suite]} ({args.suite})\n\n| step | s |\n| --- | ---: |", flush=True)
    for step in steps(machine, args):
        print(f"| {step.name} | {step.seconds:.1f} |{'' if step.good else ' FAILED'}", flush=True)
        if not step.good:
            print(f"see {machine.transcript}", file=sys.stderr)
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
