"""`make test-hil` says what is missing, and never takes silence for success."""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
from contextlib import AbstractContextManager
from pathlib import Path

import pytest

from tests.conftest import REPO
from tests.hil import run, uml
from tests.hil.held_up import GLANCE_S, HeldUp
from tests.hil.run import Verdict, judge

needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="host_shim.c takes a compiler")


def runner(**environment: str) -> subprocess.CompletedProcess[str]:
    """The runner for the one group that needs nothing to be built, with that environment."""
    kept = {key: value for key, value in os.environ.items() if not key.startswith("TPMSD_")}
    return subprocess.run(
        [sys.executable, "-m", "tests.hil.run", "powercut"],
        cwd=REPO,
        capture_output=True,
        text=True,
        env={**kept, **environment},
    )


def test_without_vcan_and_guest_it_fails_loudly(tmp_path: Path) -> None:
    """A machine without User Mode Linux: exit code 1 and the packages that it takes."""
    said = runner(PATH=str(tmp_path))

    assert 1 == said.returncode
    assert "apt-get install user-mode-linux" in said.stderr or "is for x86_64" in said.stderr
    assert "test-hil powercut: FAILED" in said.stdout


def test_it_is_skipped_only_when_asked(tmp_path: Path) -> None:
    """TPMSD_SKIP_HIL=1 skips, and says so; 0 does not."""
    asked = runner(PATH=str(tmp_path), TPMSD_SKIP_HIL="1")
    not_asked = runner(PATH=str(tmp_path), TPMSD_SKIP_HIL="0")

    assert (0, "test-hil: skipped, as TPMSD_SKIP_HIL asks\n") == (asked.returncode, asked.stdout)
    assert 1 == not_asked.returncode


def test_an_unknown_group_is_a_usage_error() -> None:
    """Exit code 2, and the groups that there are."""
    said = subprocess.run(
        [sys.executable, "-m", "tests.hil.run", "buss"], cwd=REPO, capture_output=True, text=True
    )

    assert 2 == said.returncode
    assert "no such group: buss" in said.stderr


JUNIT = "<testsuites><testsuite>{}</testsuite></testsuites>"


@pytest.mark.parametrize(
    ("cases", "code", "tests", "bad"),
    [
        ("<testcase/><testcase/>", 0, 2, 0),
        ("<testcase/><testcase><failure/></testcase>", 1, 2, 1),
        ("<testcase/><testcase><error/></testcase>", 1, 2, 1),
        ("<testcase/><testcase><skipped/></testcase>", 0, 2, 1),
        ("<testcase/>", 3, 1, 1),
    ],
)
def test_what_did_not_pass_is_bad(tmp_path: Path, cases: str, code: int, tests: int, bad: int) -> None:
    """Failures, errors, skips, and an exit code that no test accounts for."""
    junit = tmp_path / "junit.xml"
    junit.write_text(JUNIT.format(cases))
    verdict = judge(junit, code, "said")

    assert (tests, bad) == (verdict.tests, verdict.bad)


def test_no_result_is_no_success(tmp_path: Path) -> None:
    """Where pytest left nothing, the group has failed, whatever its exit code."""
    verdict = judge(tmp_path / "none.xml", 0, "said this")

    assert (0, 1) == (verdict.tests, verdict.bad)
    assert "said this" in verdict.detail


def guest_of(folder: Path, script: str) -> AbstractContextManager[uml.Guest]:
    """A guest whose kernel is a script of the shell."""
    kernel = folder / "kernel"
    kernel.write_text(f"#!/bin/sh\n{script}\n")
    kernel.chmod(0o755)
    return uml.guest("true", out=folder / "out", stage=folder, kernel=str(kernel), build=folder)


@needs_gcc
def test_a_guest_that_leaves_no_status_has_failed(tmp_path: Path) -> None:
    """Its console's tail says what it said last, and nothing of it is left behind."""
    with (
        guest_of(tmp_path, "echo panic: no init") as guest,
        pytest.raises(uml.HilError, match="ended without a status") as raised,
    ):
        guest.wait(30.0)

    assert "panic: no init" in str(raised.value)
    assert not guest.folder.exists()


@needs_gcc
def test_a_guest_that_does_not_end_is_ended(tmp_path: Path) -> None:
    """All its processes go, and it counts as failed."""
    with (
        guest_of(tmp_path, "sleep 1000 & echo $! >$(dirname $0)/child; wait") as guest,
        pytest.raises(uml.HilError, match="did not end within 1 s"),
    ):
        guest.wait(1.0)
    child = int((tmp_path / "child").read_text())

    stat = Path(f"/proc/{child}/stat")
    assert not stat.exists() or stat.read_text().split(") ")[1][0] in "ZX"


def test_the_idlest_processor_is_taken() -> None:
    """The one whose idle time has risen the most."""
    cpus = sorted(os.sched_getaffinity(0))
    readings = iter(
        [
            "".join(f"cpu{cpu} 0 0 0 100 0\n" for cpu in cpus),
            "".join(f"cpu{cpu} 0 0 0 {120 if cpu == cpus[-1] else 101} 0\n" for cpu in cpus),
        ]
    )

    assert cpus[-1] == uml.idlest_cpu(lambda: next(readings))


def looking(*late_s: float) -> HeldUp:
    """What a watch has seen whose sleeps ended so much too late, one after the other."""
    now_s, delays = 0.0, iter(late_s)

    def sleep(seconds: float) -> None:
        nonlocal now_s
        now_s += seconds + next(delays)

    seen = HeldUp(lambda: now_s, sleep)
    for _ in late_s:
        seen.look()
    return seen


def test_what_the_machine_took_away_is_counted() -> None:
    """Sleeps that end late by more than timers are: their share of the time, and the longest."""
    seen = looking(0.0, 0.001, 0.004, 0.0, 0.012)

    assert pytest.approx(0.016 / (5 * GLANCE_S + 0.017)) == seen.share
    assert pytest.approx(0.012) == seen.worst_s


@pytest.mark.parametrize(
    ("late_s", "much"),
    [((0.0,) * 9 + (0.003,), False), ((0.0, 0.003), True), ((0.0,) * 999 + (0.26,), True)],
)
def test_much_is_a_share_or_a_long_time(late_s: tuple[float, ...], much: bool) -> None:
    """7 % in pieces is borne; 27 % is not, nor is a quarter of a second at once."""
    assert much is looking(*late_s).much


@pytest.mark.parametrize(
    ("verdicts", "good", "paces"),
    [
        ([Verdict(2, 0)], True, [0.5]),
        ([Verdict(2, 1)], False, [0.5]),
        ([Verdict(2, 1, "", looking(0.0))], False, [0.5]),
        ([Verdict(2, 1, "", looking(0.5)), Verdict(2, 0)], True, [0.5, 0.25]),
        ([Verdict(2, 1, "", looking(0.5)), Verdict(2, 1, "", looking(0.5))], False, [0.5, 0.25]),
        ([Verdict(2, 0, "", looking(0.5))], True, [0.5]),
    ],
)
def test_only_where_the_machine_held_it_up_is_a_group_judged_again(
    monkeypatch: pytest.MonkeyPatch, verdicts: list[Verdict], good: bool, paces: list[float]
) -> None:
    """A failure on a machine that let the guest run stands; another is judged once more, at half the pace."""
    left, seen = iter(verdicts), []

    def group(args: argparse.Namespace) -> Verdict:
        seen.append(args.pace)
        return next(left)

    monkeypatch.setitem(run.GROUPS, "made up", group)

    assert good is run.run_group("made up", argparse.Namespace(pace=0.5))
    assert paces == seen


@needs_gcc
@pytest.mark.parametrize("pace", [1.0, 0.25])
def test_the_guests_clocks_run_at_their_pace(tmp_path: Path, pace: float) -> None:
    """Both clocks of a program that has the shim, against the machine's, over a time of the machine's."""
    program = (
        "import select, time\n"
        "def read(): return [time.clock_gettime(c) for c in "
        "(time.CLOCK_MONOTONIC, time.CLOCK_REALTIME, time.CLOCK_BOOTTIME)]\n"
        "a = read(); select.select([], [], [], 0.4); b = read()\n"
        "print(*[y - x for x, y in zip(a, b)])"
    )
    said = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        check=True,
        env={"LD_PRELOAD": str(uml.shim(tmp_path)), "HIL_PACE": str(pace)},
    )
    monotonic_s, realtime_s, machine_s = map(float, said.stdout.split())

    assert machine_s >= 0.4
    assert [monotonic_s, realtime_s] == pytest.approx([pace * machine_s] * 2, rel=0.05)
