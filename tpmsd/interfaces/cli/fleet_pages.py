"""Pages of the drives that raised an alarm, beside a fleet's report.

In: the report's file and the store's tables. Out: a folder `FILE-drives` with the page of each such drive as
`tpmsd replay --html` writes it, and the link to each. A drive that cannot be read is named and left out.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from tpmsd.car.config.problems import escaped_lines
from tpmsd.foundation.errors import TpmsdError


def write_drive_pages(report: Path, tables: Mapping[str, Sequence[Mapping[str, Any]]]) -> dict[str, str]:
    """Write the pages; return drive key -> link relative to the report."""
    from tpmsd.interfaces.api.functions import replay
    from tpmsd.offline.fleet.settings import SETTINGS

    paths = {row["key"]: row["path"] for row in tables["drives"]}
    keys = list(dict.fromkeys(row["key"] for row in tables["alarms"]))
    folder = report.with_name(f"{report.stem}-drives")
    links = {}
    for key in keys[: SETTINGS.max_pictures]:
        try:
            page = replay(paths[key], table=True).to_html()
        except TpmsdError as error:
            print(escaped_lines(f"tpmsd: {paths[key]}: no page of this drive: {error}"), file=sys.stderr)
            continue
        folder.mkdir(exist_ok=True)
        (folder / f"{key}.html").write_text(page, encoding="utf-8")
        links[key] = Path("/", folder.name, f"{key}.html").as_uri().removeprefix("file:///")
    if len(keys) > SETTINGS.max_pictures:
        print(f"tpmsd: pages of the first {SETTINGS.max_pictures} of {len(keys)} drives", file=sys.stderr)
    return links
