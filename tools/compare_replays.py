"""Compare two JSON documents of `tpmsd replay` of one drive: radii to a micrometre, alarms to a tick.

In: two files. Out: one line; exit 1 where they differ. Kernels sum in another order than NumPy does, and the
filter hands the rounding on.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

SAME_MM = 1e-3
SAME_S = 0.11
"""A tick of 0.1 s."""


def differences(first: dict, second: dict) -> list[str]:
    """One line per wheel or alarm that differs."""
    found = [
        f"{name}: {wheel['deviation_mm']} and {second['wheels'][name]['deviation_mm']} mm"
        for name, wheel in first["wheels"].items()
        if abs(wheel["deviation_mm"] - second["wheels"][name]["deviation_mm"]) > SAME_MM
    ]
    alarms = [
        [(each["kind"], each.get("wheel"), each["state"]) for each in one["alarms"]]
        for one in (first, second)
    ]
    if alarms[0] != alarms[1]:
        return [*found, f"alarms: {alarms[0]} and {alarms[1]}"]
    times = zip(first["alarms"], second["alarms"], strict=True)
    return found + [
        f"{a['kind']} at {a['time']} and {b['time']}" for a, b in times if abs(a["time"] - b["time"]) > SAME_S
    ]


if __name__ == "__main__":
    one, other = (json.loads(Path(name).read_text("utf-8")) for name in sys.argv[1:3])
    wrong = differences(one, other)
    print("\n".join(wrong) or f"same radii of {len(one['wheels'])} wheels and {len(one['alarms'])} alarms")
    sys.exit(1 if wrong else 0)
