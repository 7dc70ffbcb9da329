"""A drive of ten hours behind `tpmsd web`'s server: `python -m tests.browser.long_drive`.

In: nothing. Out: a server on a free port, whose address is the first line. The replay is made of arrays:
what is timed is the page, not ten hours of estimation.
"""

from __future__ import annotations

import sys

import numpy as np

from tests.offline.report.drives import Drive, alarm
from tpmsd.foundation.wheels import WHEELS
from tpmsd.interfaces.api.results import Replay
from tpmsd.interfaces.web.app import drive_app
from tpmsd.interfaces.web.server import make_server, port_of
from tpmsd.interfaces.web.settings import WebSettings
from tpmsd.offline.tables.columns import COLUMNS, NUMBERS, TEXTS
from tpmsd.offline.tables.tick_table import TickTable

ROWS, PERIOD_S = 360_000, 0.1


def ten_hours() -> TickTable:
    """360,000 ticks with every column."""
    rng = np.random.default_rng(5)
    time_s = PERIOD_S * np.arange(1.0, ROWS + 1.0)
    numbers = {name: rng.normal(size=ROWS) for name in NUMBERS}
    numbers |= {"drive_time_s": time_s, "time_s": 1.7e9 + time_s}
    numbers["speed_mps"] = 20.0 + 8.0 * np.sin(time_s / 300.0)
    angle = np.cumsum(0.002 * rng.normal(size=ROWS))
    for name, part in (("east_m", np.cos(angle)), ("north_m", np.sin(angle))):
        numbers[name] = np.cumsum(PERIOD_S * numbers["speed_mps"] * part)
    for wheel in WHEELS:
        numbers[f"deviation_{wheel}_m"] = 1e-4 * np.cumsum(0.01 * rng.normal(size=ROWS))
        numbers[f"change_{wheel}_m"] = numbers[f"deviation_{wheel}_m"] - 2e-4
    texts = dict.fromkeys(TEXTS, ("",) * ROWS)
    assert len(numbers) + len(texts) == len(COLUMNS)
    return TickTable(numbers, texts)


if __name__ == "__main__":
    result = Drive(duration_s=36_000.0, dt_s=10.0, events={9: (alarm(90.0),)}).record().result(1.0)
    app = drive_app(Replay(result, ten_hours()), WebSettings())
    server, listener = make_server(app, WebSettings(port=0))
    print(f"http://127.0.0.1:{port_of(listener)}/", flush=True)
    sys.exit(server.run(sockets=[listener]))
