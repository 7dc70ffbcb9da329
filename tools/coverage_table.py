"""Branch coverage by package, as a table: `make coverage` (tools/coverage_table.py COVERAGE.json PACKAGE...).

In: the JSON report of coverage.py, the packages of the core. Out: Markdown on standard output; exit code 1
where less than 90 % of the branches of the core (both ways out of each decision) were taken.
"""

from __future__ import annotations

import json
import sys
from collections import defaultdict
from pathlib import Path

MIN_PERCENT = 90.0


def main(report: Path, core: list[str]) -> int:
    """Print the table; 1 where the core as a whole has too little."""
    files = json.loads(report.read_text(encoding="utf-8"))["files"]
    sums: dict[str, list[int]] = defaultdict(lambda: [0, 0, 0, 0])
    for name, file in files.items():
        parts = Path(name).with_suffix("").parts
        package = parts[parts.index("tpmsd") + 1]
        if package in core:
            summary = file["summary"]
            keys = ("covered_lines", "num_statements", "covered_branches", "num_branches")
            for row in (sums[package], sums["together"]):
                for k, key in enumerate(keys):
                    row[k] += summary[key]
    print("| package | statements | of them run, % | branches | of them taken, % |")
    print("| --- | ---: | ---: | ---: | ---: |")
    for package in [*core, "together"]:
        run, statements, taken, branches = sums[package]
        shares = [
            100.0 * part / whole if whole else 100.0 for part, whole in ((run, statements), (taken, branches))
        ]
        print(f"| {package} | {statements} | {shares[0]:.1f} | {branches} | {shares[1]:.1f} |")
    _, _, taken, branches = sums["together"]
    return int(100.0 * taken < MIN_PERCENT * branches)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), sys.argv[2:]))
