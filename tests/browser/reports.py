"""One file per kind of HTML report, small and made without a drive's estimation.

In: a folder. Out: their paths by name.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.offline.fleet.test_report import fleet_tables
from tests.offline.report.drives import puncture
from tests.offline.report.pages import ORIGIN
from tests.offline.report.test_diagnosis_page import FOUND
from tpmsd.offline.fleet.report import report_document
from tpmsd.offline.fleet.report_page import report_page
from tpmsd.offline.report.diagnosis_page import diagnosis_page
from tpmsd.offline.report.replay_charts import replay_track
from tpmsd.offline.report.replay_page import replay_page


def write_reports(folder: Path) -> dict[str, Path]:
    """`replay`, `diagnosis` and `fleet`."""
    result = puncture().record().result(2.0)
    turn = np.linspace(0.0, 2.0 * np.pi, 200)
    track = replay_track(result, 300.0 * np.cos(turn), 100.0 * np.sin(turn), turn, 100.0 * turn)
    tables = fleet_tables()
    pages = {
        "replay": replay_page(result, ORIGIN, track),
        "diagnosis": diagnosis_page(FOUND, ["monday", "tuesday"], ORIGIN),
        "fleet": report_page(report_document(tables), tables),
    }
    paths = {}
    for name, page in pages.items():
        paths[name] = folder / f"{name}.html"
        paths[name].write_text(page, encoding="utf-8")
    return paths
