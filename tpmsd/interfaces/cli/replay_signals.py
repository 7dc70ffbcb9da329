"""`tpmsd replay DRIVE --vehicle-state FILTER` where DRIVE holds a table of signals and no bus.

In: `signals.csv` and the tables `[vehicle]` and `[dynamics]`. Out: the tick table with the vehicle state, a
summary, JSON. Wheels are not monitored: there are none on a bus.
"""

from __future__ import annotations

import argparse
import sys
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tpmsd.foundation.errors import ConfigError
from tpmsd.interfaces.cli.output import json_text
from tpmsd.interfaces.cli.output_files import Outputs
from tpmsd.offline.signals.columns import signals_file

if TYPE_CHECKING:
    from tpmsd.offline.report.vehicle_state_summary import StateSummary
    from tpmsd.offline.signals.read import SignalTable
    from tpmsd.offline.tables.tick_table import TickTable

SCHEMA = "tpmsd.replay/2"
TABLES = ("csv", "parquet", "mcap")
_ELSEWHERE = ("plot", "html", "model", "method")
"""Options of the radius filter."""


def has_signals_alone(folder: Path) -> bool:
    """Return True for a folder with a table of signals and no log of a bus."""
    return folder.is_dir() and signals_file(folder) is not None and not any(folder.glob("can.*"))


def run_signals(args: argparse.Namespace) -> int:
    """Run the vehicle-state filter over the table of signals; return the exit code."""
    import numpy as np

    from tpmsd.car.config.dynamics import load_car
    from tpmsd.car.config.model import VehicleStateConfig
    from tpmsd.foundation.provenance import provenance
    from tpmsd.offline.report.vehicle_state_summary import StateSummary
    from tpmsd.offline.signals.read import read_signals
    from tpmsd.offline.signals.vehicle_state import states_along
    from tpmsd.offline.tables.write import check_packages, csv_text, parquet_bytes
    from tpmsd.offline.tables.write_mcap import mcap_bytes

    for option in _ELSEWHERE:
        if getattr(args, option) is not None:
            raise ConfigError(f"--{option} needs a drive with a bus; {args.drive} holds a table of signals")
    if args.vehicle_state is None:
        raise ConfigError(f"{args.drive}: a table of signals without a bus is replayed with --vehicle-state")
    outputs = Outputs(*((f"--{kind}", getattr(args, kind)) for kind in (*TABLES, "json")))
    for kind in TABLES:
        if outputs.asked(f"--{kind}"):
            check_packages(kind)
    file = args.config if args.config is not None else args.drive
    tables, signals = load_car(file), read_signals(args.drive)
    if signals.unknown:
        left = " ".join(signals.unknown)[:200]
        print(f"tpmsd: {signals.file}: unknown columns left out: {left}", file=sys.stderr)
    rng = np.random.default_rng((args.seed or 1, 1))
    particles = VehicleStateConfig().particles
    time_s, states = states_along(signals, tables, args.vehicle_state, rng, particles)
    summary = StateSummary(args.vehicle_state)
    steps = np.diff(time_s, prepend=time_s[0])
    for dt_s, state, at_s in zip(steps.tolist(), states, time_s.tolist(), strict=True):
        summary.add(dt_s, state, at_s)
    table = cache(lambda: state_table(signals, time_s, states))
    origin = cache(lambda: provenance(SCHEMA, [args.drive], tables.file))
    if not outputs.fill_stdout:
        print(f"{args.drive.resolve().name}: {float(np.ptp(time_s)):.1f} s of signals without a bus.")
        print(summary.sentence(), flush=True)
    document = _document(args.drive.resolve().name, time_s, summary)
    outputs.write(
        {
            "--csv": lambda: csv_text(table()),
            "--parquet": lambda: parquet_bytes(table(), tables.file.read_text(encoding="utf-8")),
            "--mcap": lambda: mcap_bytes(table()),
            "--json": lambda: json_text({**origin(), **document}),
        }
    )
    return 0


def state_table(signals: SignalTable, time_s: Any, states: Any) -> TickTable:
    """Return the tick table of rows (n,) with the recorded signals and a state each; other columns are
    NaN."""
    import numpy as np

    from tpmsd.car.vehicle_state.record import VehicleState
    from tpmsd.offline.tables.columns import GNSS, INERTIAL, NUMBERS, TEXTS
    from tpmsd.offline.tables.tick_table import TickTable

    rows = len(time_s)
    numbers = {name: np.full(rows, np.nan) for name in NUMBERS}
    numbers["time_s"], numbers["drive_time_s"] = time_s, time_s - time_s[0]
    at = np.searchsorted(signals.time_s, time_s - 1e-9).clip(0, len(signals.time_s) - 1)
    for column in (*INERTIAL, *GNSS):
        if column.name in signals.columns:
            numbers[column.name] = signals.columns[column.name][at]
    known = [state or (np.nan,) * len(VehicleState._fields) for state in states]
    for name, values in zip(VehicleState._fields, np.array(known).T, strict=True):
        numbers[name] = values
    empty = {name: ("unavailable" if name.startswith("state_") else "",) * rows for name in TEXTS}
    return TickTable(numbers, empty)


def _document(name: str, time_s: Any, summary: StateSummary) -> dict[str, Any]:
    """Return the keys of a replay's document, those of radii and receiver empty."""
    return {
        "drive": name,
        "start_time": float(time_s[0]),
        "duration_s": float(time_s[-1] - time_s[0]),
        "distance_m": None,
        "realtime_factor": None,
        "wheels": {},
        "unavailable": ["fl", "fr", "rl", "rr"],
        "alarms": [],
        "active_alarms": [],
        "learning": {"fraction": 0.0, "informative_s": 0.0, "moving_s": 0.0},
        "gnss": {"fixes": 0, "outages": 0, "outage_s": 0.0, "longest_outage_s": 0.0},
        "faults": {},
        "tick_gaps": {"count": 0, "total_s": 0.0},
        "pose": None,
        "resonance": {},
        "vehicle_state": summary.to_json(),
    }
