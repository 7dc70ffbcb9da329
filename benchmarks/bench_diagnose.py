"""How well the diagnosis does on drives of worlds that share nothing with its catalogue.

    python benchmarks/bench_diagnose.py            a drive of each common kind: minutes
    python benchmarks/bench_diagnose.py --each     a drive of each kind, the multi-body cars too: an hour
    python benchmarks/bench_diagnose.py --full     200 drives of nothing, 20 per effect and strength: a day
    python benchmarks/bench_diagnose.py --help     parts of it, resumed, with alarms, with another program

Everything is in `benchmarks/diagnosis_bench`.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from benchmarks.diagnosis_bench.run import main

if __name__ == "__main__":
    main()
