"""`make test-hil` says what is missing, and never takes silence for success."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import REPO
from tests.hil import uml
from tests.hil.run import judge


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


def test_a_guest_that_leaves_no_status_has_failed(tmp_path: Path) -> None:
    """Its console's tail says what it said last, and nothing of it is left behind."""
    kernel = tmp_path / "kernel"
    kernel.write_text("#!/bin/sh\necho panic: no init\n")
    kernel.chmod(0o755)
    with (
        uml.guest("true", out=tmp_path / "out", stage=tmp_path, kernel=str(kernel), build=tmp_path) as guest,
        pytest.raises(uml.HilError, match="ended without a status") as raised,
    ):
        guest.wait(30.0)

    assert "panic: no init" in str(raised.value)
    assert not guest.folder.exists()


def test_a_guest_that_does_not_end_is_ended(tmp_path: Path) -> None:
    """All its processes go, and it counts as failed."""
    kernel = tmp_path / "kernel"
    kernel.write_text("#!/bin/sh\nsleep 1000 & echo $! >$(dirname $0)/child; wait\n")
    kernel.chmod(0o755)
    with (
        uml.guest("true", out=tmp_path / "out", stage=tmp_path, kernel=str(kernel), build=tmp_path) as guest,
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
