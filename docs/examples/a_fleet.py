"""A fleet: three vans, two drives each, worked on in parallel, asked in SQL and put into a report.

    python docs/examples/a_fleet.py

Everything is in a folder `fleet-example`; run it twice, and the second run finds nothing left to do.
"""

from __future__ import annotations

from pathlib import Path

import tpmsd
from tpmsd.offline.fleet.find_drives import find_drives
from tpmsd.offline.fleet.report import report_document, report_text
from tpmsd.offline.fleet.report_page import report_page
from tpmsd.offline.fleet.run import run
from tpmsd.offline.fleet.sql_query import as_text, ask
from tpmsd.offline.fleet.store import Store
from tpmsd.offline.fleet.tables import rows_of, write_tables


def main(folder: Path = Path("fleet-example")) -> None:
    """Simulate, work, ask, report."""
    for van in range(3):
        for day in range(2):
            nail = tpmsd.Fault("puncture", 2.0, wheel="rr", onset_s=60.0)
            faults = (nail,) if (van, day) == (1, 1) else ()
            drive = tpmsd.simulate(duration_s=120.0, seed=10 * van + day, faults=faults)
            drive.save(folder / "drives" / f"van-{van}" / f"day-{day}")

    store = Store.create(folder / "store")
    for entry in find_drives([str(folder / "drives")]):
        store.add(entry)
    tally = run(store, jobs=2, stages=("replay",))  # all stages: replay, calibrate, diagnose
    print(f"{tally.done} drives worked on: {tally.outcomes}")
    write_tables(store)

    print(as_text(*ask(store, "select car, kind, wheel from alarms where state = 'raised' order by time")))
    tables = rows_of(store)
    document = report_document(tables)
    print(report_text(document))
    (folder / "report.html").write_text(report_page(document, tables), encoding="utf-8")


if __name__ == "__main__":
    main()
