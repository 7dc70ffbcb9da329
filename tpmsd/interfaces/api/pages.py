"""Results as HTML pages: what `to_html()`, `--html` and `tpmsd web` share.

In: the records of a result, where it comes from. Out: HTML.
"""

from __future__ import annotations

from tpmsd.offline.report.page import Origin
from tpmsd.offline.report.replay_charts import replay_track
from tpmsd.offline.report.replay_page import replay_page
from tpmsd.offline.report.replay_result import ReplayResult
from tpmsd.offline.tables.tick_table import TickTable


def replay_html(
    result: ReplayResult, table: TickTable | None, origin: Origin, notes: tuple[str, ...] = ()
) -> str:
    """Return the page of `tpmsd replay --html`; with the track where the ticks were kept."""
    track = None
    if table is not None:
        columns = (table[name] for name in ("east_m", "north_m", "speed_mps", "drive_time_s"))
        track = replay_track(result, *columns)
    return replay_page(result, origin, track, notes)
