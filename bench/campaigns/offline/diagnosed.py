"""A drive that is made and diagnosed, as a row; rows by the half of the seeds to which they belong.

In: what writes a drive's folder. Out: a row with what is true of the drive and what the program says of it.
"""

from __future__ import annotations

import shutil
import tempfile
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from bench.campaigns.offline.diagnosis.seal import asked

Row = dict[str, Any]
OWN_TYRES = {
    *("longitudinal_slip", "lateral_slip", "load_transfer_lateral"),
    *("brake_slip", "drive_slip_curve", "inner_wheel_slip", "camber_roll", "compliance_steer"),
}
"""What tyres and axles of an origin with tyres of its own do: found there, these are true."""
LAG_STDS = 4.0
"""Some receivers are drawn with a speed older than the position: a velocity lag is true of one, right to
within so many standard deviations and the age of the wheels' own speed."""
HELD_OUT_FROM = 50_000
"""Seeds from here on belong to the held-out half."""


def diagnosed(row: Row, make: Callable[[Path], Row], program: Path, *passed: str) -> Row:
    """Make a drive, have it diagnosed; its row. A failure of the benchmark is a row as well."""
    folder = Path(tempfile.mkdtemp(prefix="drive-"))
    try:
        row = row | make(folder)
        answer = asked(folder, program, *passed)
    except Exception:
        return {**row, "benchmark_fault": traceback.format_exc().strip().splitlines()[-1]}
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    findings = [_short(each) for each in answer.document.get("findings", [])]
    return row | {
        "error": answer.error,
        "verdict": answer.document.get("verdict"),
        "findings": [each for each in findings if each["status"] == "finding"],
        "suspicions": [each for each in findings if each["status"] != "finding"],
        "remaining": (answer.document.get("certificate") or {}).get("remaining"),
        "cpu_s": round(answer.cpu_s, 2),
    }


def _short(finding: dict[str, Any]) -> dict[str, Any]:
    return {
        "effect": finding["effect"],
        "confidence": finding["confidence"],
        "status": finding.get("status", "finding"),
        "p_value": finding.get("p_value"),
        "where": finding["where"],
        "parameters": {name: [each["value"], each["std"]] for name, each in finding["parameters"].items()},
        "gain": finding["heldout"].get("loglik_gain"),
        "or": finding["indistinguishable_from"],
    }


def is_drawn_lag(found_s: float, std_s: float, drawn_s: float, wheel_age_s: float = 0.0) -> bool:
    """Return True if a velocity lag is that with which a drive's receiver was drawn."""
    return abs(found_s - drawn_s) < LAG_STDS * std_s + wheel_age_s


def parted(rows: Sequence[Row]) -> tuple[list[Row], list[Row]]:
    """Rows with a diagnosis, and those in which the program or the benchmark failed."""
    failed = [row for row in rows if row.get("error") or row.get("benchmark_fault")]
    return [row for row in rows if row not in failed], failed


def by_half(rows: Sequence[Row]) -> list[tuple[str, list[Row]]]:
    """Title and rows of each half of the seeds that has any."""
    halves = (
        ("Development seeds", [row for row in rows if row["seed"] < HELD_OUT_FROM]),
        ("Held-out seeds", [row for row in rows if row["seed"] >= HELD_OUT_FROM]),
    )
    return [(title, those) for title, those in halves if those]
