"""What mkdocs adds to the pages: the reference that is made from the code, and links out of the folder as
plain paths.

In: mkdocs' events. Out: pages. `reference_pages` is pure of mkdocs, so that tests read it.
"""

from __future__ import annotations

import argparse
import json
import posixpath
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

REPO = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPO))


def reference_pages() -> dict[str, str]:
    """Path below docs -> text of each page that is made from the code."""
    from tpmsd.offline.tables.columns import markdown

    return {
        "reference/commands.md": "# Commands\n\n" + "\n".join(_commands()),
        "reference/configuration.md": "# Configuration\n\n" + "\n".join(_configuration()),
        "reference/json.md": "# JSON documents\n\n" + "\n".join(_documents()),
        "reference/can-frames.md": "# Frames on the bus\n\n" + "\n".join(_frames()),
        "reference/metrics.md": "# Prometheus metrics\n\n" + "\n".join(_metrics()),
        "reference/tick-table.md": "# The tick table\n\n" + markdown() + "\n",
    }


def _commands() -> Iterator[str]:
    from tpmsd.interfaces.cli.main import full_parser

    parser = full_parser()
    yield f"```text\n{parser.format_help()}```\n"
    (group,) = (each for each in parser._actions if isinstance(each, argparse._SubParsersAction))
    for name, each in group.choices.items():
        yield f"## tpmsd {name}\n\n```text\n{each.format_help()}```\n"


def _configuration() -> Iterator[str]:
    from tpmsd.car.config.json_schema import vehicle_schema

    for table, schema in vehicle_schema()["properties"].items():
        yield f"## [{table}]\n\n| key | what it may be | default |\n| --- | --- | --- |"
        for key, rule in schema["properties"].items():
            shown = {name: value for name, value in rule.items() if name != "default"}
            text = json.dumps(shown) if len(json.dumps(shown)) < 200 else "a table (`tpmsd check --schema`)"
            yield f"| `{key}` | {text.replace('|', chr(92) + '|')} | {json.dumps(rule.get('default', ''))} |"
        yield ""


def _documents() -> Iterator[str]:
    from tpmsd.foundation.schemas import NAMES, schema_of

    for name in NAMES:
        schema = schema_of(name)
        yield f"## {name}\n\n| key | type |\n| --- | --- |"
        for key, value in schema["properties"].items():
            kinds = value.get("type", "any")
            always = "" if key in schema.get("required", ()) else " (not always)"
            yield f"| `{key}` | {kinds if isinstance(kinds, str) else ' or '.join(kinds)}{always} |"
        yield ""


def _frames() -> Iterator[str]:
    import cantools.database

    database: Any = cantools.database.load_file(REPO / "dbc" / "tpmsd.dbc")
    for message in database.messages:
        yield f"## {message.name} (0x{message.frame_id:X})\n\n{message.comment or ''}\n"
        yield "| signal | bits | unit | meaning |\n| --- | --- | --- | --- |"
        for signal in message.signals:
            bits = f"{signal.start} + {signal.length}"
            yield f"| `{signal.name}` | {bits} | {signal.unit or ''} | {signal.comment or ''} |"
        yield ""


def _metrics() -> Iterator[str]:
    text = (REPO / "docs" / "how-to" / "prometheus.md").read_text(encoding="utf-8")
    yield from (line for line in text.splitlines() if line.startswith("|"))


def on_files(files: Any, config: Any) -> Any:
    """Add the pages that are made from the code."""
    from mkdocs.structure.files import File

    for path, text in reference_pages().items():
        files.append(File.generated(config, path, content=text))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Any) -> str:
    """Links to files of the repository that are no pages become plain paths."""
    folder = posixpath.dirname(page.file.src_uri)

    def plain(match: re.Match[str]) -> str:
        target = posixpath.normpath(posixpath.join("docs", folder, match[2].partition("#")[0]))
        inside = target.startswith("docs/") and not target.startswith(("docs/examples", "docs/layouts"))
        return match[0] if "://" in match[2] or inside else f"{match[1]} (`{target}`)"

    return re.sub(r"(?<!!)\[([^\]]*)\]\(([^)\s]+)\)", plain, markdown)
