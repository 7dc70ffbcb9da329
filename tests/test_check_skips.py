"""CI's look at the skipped tests: wanting recordings is an excuse only where there are none."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).resolve().parent.parent / ".ci" / "check_skips.py"
PASSED = '<testcase classname="tests.test_a" name="test_one"/>'
NO_RECORDINGS = (
    '<testcase classname="tests.test_b" name="test_drive">'
    '<skipped type="pytest.skip" message="no real recordings at ../shared/recordings"/></testcase>'
)
NO_VCAN = (
    '<testcase classname="tests.test_c" name="test_bus">'
    '<skipped type="pytest.skip" message="no vcan interface on this machine"/></testcase>'
)


def check(folder: Path, cases: str, *options: str) -> subprocess.CompletedProcess[str]:
    """Run the script on a report with these test cases."""
    junit = folder / "junit.xml"
    junit.write_text(f"<testsuites><testsuite>{cases}</testsuite></testsuites>", encoding="utf-8")
    command = [sys.executable, str(SCRIPT), str(junit), *options]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.mark.parametrize(
    ("cases", "options", "code"),
    [
        (PASSED, ["--recordings-present"], 0),
        (PASSED + NO_VCAN, ["--recordings-present"], 0),
        (PASSED + NO_RECORDINGS, [], 0),
        (PASSED + NO_RECORDINGS, ["--recordings-present"], 1),
        ("", [], 1),
    ],
)
def test_only_wrong_skips_fail(tmp_path: Path, cases: str, options: list[str], code: int) -> None:
    """Recordings that are there must be used; other skips, and a machine without recordings, pass."""
    assert code == check(tmp_path, cases, *options).returncode


def test_every_skip_is_listed_with_its_reason(tmp_path: Path) -> None:
    """The log of CI says what was skipped and why."""
    done = check(tmp_path, PASSED + NO_VCAN)

    assert "skipped tests.test_c::test_bus: no vcan interface on this machine\n" == done.stdout
