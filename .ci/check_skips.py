"""Which tests were skipped, and was that right?

In: pytest's JUnit XML and whether the real recordings are on this machine. Out: a list of the skips; exit 1
if the recordings are there and a test was skipped for want of them, or if no test ran at all.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from xml.etree import ElementTree

RECORDINGS_REASON = "recording"
"""What the reason of every skip for want of real drives holds (tests/conftest.py)."""


def skipped_tests(junit: Path) -> tuple[int, list[tuple[str, str]]]:
    """How many tests there were, and the name and reason of each that was skipped."""
    cases = list(ElementTree.parse(junit).iter("testcase"))
    skips = [
        (f"{case.get('classname')}::{case.get('name')}", skip.get("message") or "no reason given")
        for case in cases
        if (skip := case.find("skipped")) is not None
    ]
    return len(cases), skips


def main() -> int:
    """Print the skips; the exit code says whether they are acceptable."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("junit", type=Path, help="file written by pytest --junitxml")
    parser.add_argument(
        "--recordings-present", action="store_true", help="skips for want of them are failures"
    )
    args = parser.parse_args()
    count, skips = skipped_tests(args.junit)
    if count == 0:
        print("no test ran", file=sys.stderr)
        return 1
    for name, reason in skips:
        print(f"skipped {name}: {reason}")
    wrong = [name for name, reason in skips if RECORDINGS_REASON in reason.lower()]
    if args.recordings_present and wrong:
        print(
            f"the recordings are here, yet {len(wrong)} test(s) were skipped for want of them",
            file=sys.stderr,
        )
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
