"""`make test-from-nothing`: what README and docs promise, on a Debian on which nothing was done before.

In: the sources as committed, the name of a Debian (`--suite bookworm`, `trixie`). Out: build/from-nothing/SUITE with
the transcript, a table of steps with their times on standard output, and the exit code: 0 only if every step
went well. Takes root, mmdebstrap, a network for apt and pip, and for the service User Mode Linux; some ten minutes.

The steps are the commands of README, docs/tutorial and docs/how-to/running.md, in their order; the service, the
upgrade from an earlier commit and the removal of the package run in a guest whose root is that Debian.
"""

from __future__ import annotations

import argparse
import os
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
EARLIER = "438989a"
"""The commit that is upgraded from."""
MIRROR = "http://deb.debian.org/debian"
SUITES = {"bookworm": "Debian 12", "trixie": "Debian 13"}
GUEST_S = 900.0
PACE = 0.5
MEMORY = "3G"
"""Of the guest: its file system holds the package twice, the earlier and the present one."""

RECORDING = "van-motorway-a"
STEPS: tuple[tuple[str, str], ...] = (
    ("apt-get install make python3-venv git", "apt-get -q update && {apt} make python3-venv git"),
    ("git clone", "git clone -q /srv/tpmsd.bundle /srv/tpmsd"),
    ("make demo", "cd /srv/tpmsd && make demo"),
    ("pip install -e '.[report]'", "cd /srv/tpmsd && .venv/bin/pip install -q -e '.[report]'"),
    (
        "first alarm: simulate, check, replay --html, explain",
        "cd /srv && . tpmsd/.venv/bin/activate && tpmsd simulate drives/first --duration 600 --puncture rl --at 300 --seed 1"
        " && tpmsd check drives/first/vehicle.toml"
        " && tpmsd replay drives/first --plot first.png --json first.json --html first.html"
        " && tpmsd explain drives/first && ls -l first.png first.json first.html && grep -q deflation first.json",
    ),
    (
        "discover on a recording",
        "cd /srv && . tpmsd/.venv/bin/activate && mkdir car && tpmsd discover recording --write car/vehicle.toml --json found.json"
        " && tpmsd check car/vehicle.toml && grep -c wheel_ car/vehicle.toml",
    ),
    (
        "first report: diagnose the recording",
        "cd /srv && . tpmsd/.venv/bin/activate && tpmsd diagnose recording --certify 0 --html report.html --json report.json"
        " && ls -l report.html report.json",
    ),
    ("make install", "cd /srv/tpmsd && make install && cd / && tpmsd --version && tpmsd check /srv/drives/first"),
    ("make uninstall", "cd /srv/tpmsd && make uninstall && ! command -v tpmsd && ! test -e /opt/tpmsd"),
    ("apt-get install debhelper dpkg-dev", "{apt} debhelper dpkg-dev"),
    ("make deb", "cd /srv/tpmsd && make deb"),
    (
        "apt install the package, and remove it",
        "cd /srv/tpmsd && apt-get -qy install ./build/deb/tpmsd_*.deb && tpmsd --version"
        " && man_page=/usr/share/man/man1/tpmsd.1.gz && test -e $man_page"
        " && apt-get -qy purge tpmsd && ! test -e /usr/bin/tpmsd",
    ),
    (
        "make deb of the earlier version",
        "git clone -q /srv/tpmsd.bundle /srv/earlier && cd /srv/earlier && git checkout -q {earlier} && make deb",
    ),
    (
        "what the guest takes",
        "{apt} systemd systemd-sysv libnss-systemd udev dbus kmod iproute2 can-utils util-linux procps",
    ),
)
"""Name of each step, and its commands in the new Debian."""

SERVICE = r"""
set -e
exec >>/out/job.log 2>&1
began=$(cut -d' ' -f1 /proc/uptime)
step() { # NAME: the time since the last one, for the table
    now=$(cut -d' ' -f1 /proc/uptime)
    echo "STEP $(awk "BEGIN {print $now - $began}") $1"
    began=$now
}
status() { tpmsd status --json 2>/dev/null; }
wait_for() { # SECONDS PATTERN: until the status shows it
    for _ in $(seq $1); do
        status | tr -d ' \n' | grep -qE "$2" && return
        sleep 1
    done
    echo "not within $1 s: $2"; tpmsd status || true; journalctl -u tpmsd --no-pager -o cat | tail -n 20; exit 1
}
alarm='"kind":"(deflation|radius_deviation)"'

dpkg --force-unsafe-io -i /srv/earlier/build/deb/tpmsd_*.deb
step "install the package of the earlier version"

mkdir -p /run/udev; cd /run
chrt -f 10 /srv/earlier/.venv/bin/tpmsd simulate /run/car --duration 1200 --route test-track --seed 4 --live vcan0 \
    --pty /run/gnss --puncture rl --at 150 >/out/car.log 2>&1 &
car=$!
for _ in $(seq 60); do test -e /run/gnss && break; sleep 1; done
chgrp dialout "$(readlink -f /run/gnss)"; chmod 660 "$(readlink -f /run/gnss)"
mkdir -p /etc/tpmsd /etc/systemd/system/tpmsd.service.d
cp /run/car/bus.dbc /etc/tpmsd
{ cat /run/car/vehicle.toml; printf '\n[monitor]\nlearn_s = 10.0\n\n[state]\ninterval_s = 2.0\n'; } >/etc/tpmsd/tpmsd.toml
printf '[Service]\nDeviceAllow=char-pts rw\n' >/etc/systemd/system/tpmsd.service.d/pty.conf
systemctl daemon-reload
tpmsd check /etc/tpmsd/tpmsd.toml
systemctl enable --now tpmsd
systemctl --no-pager status tpmsd
timeout 30 candump -L -n 3 vcan0,6F0:7FE
step "configure, enable --now: frames on vcan0"

wait_for 400 "$alarm"
tpmsd status
step "the car loses air: alarm in tpmsd status"
sleep 3
earlier=$(systemctl show --value -p MainPID tpmsd)

dpkg --force-unsafe-io -i /srv/tpmsd/build/deb/tpmsd_*.deb
sleep 5
now=$(systemctl show --value -p MainPID tpmsd)
echo "main process $earlier before the upgrade, $now after it"
[ "$now" -ne 0 ] && [ "$now" -ne "$earlier" ]
wait_for 120 "$alarm"
tpmsd status
journalctl -u tpmsd --no-pager -o cat | grep "taken up what was learned before"
systemctl is-enabled tpmsd
step "upgrade: restarted, the state taken up, the alarm stands"

dpkg -r tpmsd
! systemctl is-active tpmsd
! test -e /usr/bin/tpmsd
test -e /etc/tpmsd/tpmsd.toml
test -e /var/lib/private/tpmsd/state.json
dpkg -P tpmsd
! test -e /var/lib/private/tpmsd
test -e /etc/tpmsd/tpmsd.toml
step "remove: service gone, configuration kept; purge: state gone"
kill $car
"""


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
        words |= {"LANG": "C.UTF-8", "DEBIAN_FRONTEND": "noninteractive", **kept}
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
            SERVICE,
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
    apt = "apt-get -qy install --no-install-recommends"
    for name, commands in STEPS:
        if "recording" in name and not recording.is_dir():
            continue
        yield machine.step(name, commands.replace("{apt}", apt).replace("{earlier}", EARLIER))
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
