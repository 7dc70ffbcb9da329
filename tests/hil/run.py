"""`make test-hil`: the daemon on a real CAN stack, as a real service of systemd, and through power cuts.

Uses the machine's own vcan for the bus where it can be had without root (in a network namespace of its own),
else a guest of User Mode Linux; systemd and the power cuts always take a guest. Where neither can be had, it
fails and says what to install. TPMSD_SKIP_HIL=1 skips it all, and that is said, too.
"""

from __future__ import annotations

import argparse
import os
import shlex
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree import ElementTree

from tests.hil import native, powercut, uml
from tests.hil.held_up import LONG_S, MUCH, HeldUp
from tests.hil.prepare import BUILD, REPO, package, stage
from tests.hil.uml import HilError

TIMEOUT_S = 420.0
"""Of a group, on the guest's clock; a third of this is usual."""
PACE = 0.5
"""Of the guests' clock: within one of its seconds a guest has two of the machine's processor."""

_printing = threading.Lock()


@dataclass(frozen=True)
class Verdict:
    """How a group of tests went."""

    tests: int
    bad: int
    detail: str = ""
    held_up: HeldUp | None = None
    """How the machine treated the guest that it went in, if in one."""

    @property
    def good(self) -> bool:
        """At least one test, and each of them passed."""
        return self.bad == 0 and self.tests > 0


def main() -> int:
    """Run the groups that are asked for; 0 only if every test of each of them passed."""
    parser = argparse.ArgumentParser(prog="make test-hil", description=__doc__)
    parser.add_argument("groups", nargs="*", metavar="GROUP", help=f"of {', '.join(GROUPS)} (default: all)")
    parser.add_argument("--guest", action="store_true", help="a guest also where the machine has vcan")
    parser.add_argument(
        "--jobs", type=int, default=min(2, len(os.sched_getaffinity(0))), help="groups at a time"
    )
    parser.add_argument(
        "--pace",
        type=float,
        default=PACE,
        help="seconds that pass in a guest in one of the machine's; where the machine takes a processor away "
        f"({100 * MUCH:.0f} %% of the time, or {LONG_S:g} s at once), what fails is judged once more at half "
        "of it "
        "(default: %(default)s)",
    )
    parser.add_argument("-k", metavar="EXPRESSION", default="", help="handed on to pytest")
    args = parser.parse_args()
    unknown = set(args.groups) - set(GROUPS)
    if unknown:
        parser.error(f"no such group: {', '.join(sorted(unknown))}")
    if not 0.05 <= args.pace <= 1.0:
        parser.error("--pace takes 0.05 to 1")
    if os.environ.get("TPMSD_SKIP_HIL", "") not in ("", "0"):
        print("test-hil: skipped, as TPMSD_SKIP_HIL asks")
        return 0
    # One guest per processor; the groups that take longest come first.
    with ThreadPoolExecutor(args.jobs) as pool:
        return int(not all(list(pool.map(lambda name: run_group(name, args), args.groups or GROUPS))))


def run_group(name: str, args: argparse.Namespace) -> bool:
    """Run one group and say how it went; once more, slower, if the machine did not let it run."""
    verdict = _attempt(name, args)
    if not verdict.good and verdict.held_up is not None and verdict.held_up.much:
        verdict = _attempt(name, argparse.Namespace(**{**vars(args), "pace": args.pace / 2.0}))
    return verdict.good


def _attempt(name: str, args: argparse.Namespace) -> Verdict:
    began_s = time.monotonic()
    try:
        verdict = GROUPS[name](args)
    except HilError as error:
        verdict = Verdict(0, 1, str(error))
    took_s = time.monotonic() - began_s
    word = "passed" if verdict.good else "FAILED"
    passed = f"{verdict.tests - verdict.bad} of {verdict.tests}"
    how = f" (pace {args.pace:g}; {verdict.held_up})" if verdict.held_up is not None else ""
    with _printing:
        if verdict.detail:
            print(f"--- {name}\n{verdict.detail}", file=sys.stderr, flush=True)
        print(
            f"test-hil {name}: {word}, {passed} in {took_s:.0f} s{how}",
            flush=True,
        )
    return verdict


def run_package(args: argparse.Namespace) -> Verdict:
    """Installation into a folder, and the Debian package looked at from outside."""
    out = BUILD / "package"
    out.mkdir(parents=True, exist_ok=True)
    environment = {**os.environ, "TPMSD_HIL": "1", "TPMSD_DEB": str(package())}
    command = pytest_command("tests/hil/package", out / "junit.xml", args.k)
    done = subprocess.run(command, cwd=REPO, env=environment, capture_output=True, text=True)
    return judge(out / "junit.xml", done.returncode, done.stdout[-6000:] + done.stderr[-2000:])


def run_bus(args: argparse.Namespace) -> Verdict:
    """Processes on vcan0 and vcan1."""
    if not args.guest and native.available():
        out = BUILD / "bus"
        command = pytest_command("tests/hil/guest/bus", out / "junit.xml", args.k)
        code, said = native.run(command, out, TIMEOUT_S)
        return judge(out / "junit.xml", code, said)
    return in_guest("bus", "plain", args)


def run_service(args: argparse.Namespace) -> Verdict:
    """The units in the guest's systemd."""
    return in_guest("service", "systemd", args)


def run_powercut(args: argparse.Namespace) -> Verdict:
    """The state file on a disk whose machine goes off while it is saved."""
    require_guest()
    cuts, problems = powercut.run(BUILD / "powercut", stage(), BUILD)
    return Verdict(cuts, len(problems), "\n".join(problems))


GROUPS: dict[str, Callable[[argparse.Namespace], Verdict]] = {
    "bus": run_bus,
    "service": run_service,
    "package": run_package,
    "powercut": run_powercut,
}


def require_guest() -> None:
    """HilError if there can be no guest here."""
    reason = uml.missing()
    if reason:
        raise HilError(f"neither vcan nor a guest: {reason} (TPMSD_SKIP_HIL=1 skips these tests)")


def pytest_command(folder: str, junit: Path, expression: str) -> list[str]:
    """pytest on one folder of tests, without traces in the sources."""
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-p",
        "no:cacheprovider",
        "-p",
        "no:xdist",
        "--durations=8",
    ]
    command += [f"--junitxml={junit}", folder]
    return command + (["-k", expression] if expression else [])


def in_guest(group: str, mode: str, args: argparse.Namespace) -> Verdict:
    """Boot a guest for one group of tests."""
    require_guest()
    out = BUILD / group
    command = [
        *pytest_command(f"tests/hil/guest/{group}", Path("/out/junit.xml"), args.k),
        "--basetemp=/run/pytest",
    ]
    words = {
        "TPMSD_HIL": "1",
        "PYTHONDONTWRITEBYTECODE": "1",
        "TPMSD_HIL_COMMAND": "tpmsd",
        "TPMSD_HIL_PROMPT": "chrt -f 10",
        "TPMSD_RECORDINGS": os.environ.get("TPMSD_RECORDINGS", str(REPO.parent / "shared" / "recordings")),
    }
    job = "".join(f"export {name}={shlex.quote(value)}\n" for name, value in words.items())
    job = f"exec >>/out/job.log 2>&1\ncd {shlex.quote(str(REPO))}\n{job}{shlex.join(command)}\n"
    with uml.guest(job, out=out, stage=stage(), mode=mode, build=BUILD, pace=args.pace) as guest:
        try:
            code = guest.wait(TIMEOUT_S / args.pace)
        except HilError as error:
            return Verdict(0, 1, str(error), guest.held_up)
    said = (out / "job.log").read_text("utf-8", "replace")[-12000:]
    return replace(judge(out / "junit.xml", code, said), held_up=guest.held_up)


def judge(junit: Path, code: int, said: str) -> Verdict:
    """What pytest found; a skipped test is one that did not pass, since here everything must be there."""
    try:
        cases = list(ElementTree.parse(junit).iter("testcase"))
    except (OSError, ElementTree.ParseError) as error:
        return Verdict(0, 1, f"{said}\nno result of the tests: {error}")
    bad = sum(any(case.find(tag) is not None for tag in ("failure", "error", "skipped")) for case in cases)
    if code and not bad:
        bad = 1
    return Verdict(len(cases), bad, said if bad else "")


if __name__ == "__main__":
    sys.exit(main())
