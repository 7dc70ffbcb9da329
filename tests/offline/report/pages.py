"""What a report's page holds, read by a parser."""

from __future__ import annotations

import datetime
import json
from collections import Counter
from html.parser import HTMLParser
from typing import Any

from tpmsd.offline.report.page import Origin

MADE_AT = datetime.datetime(2026, 3, 1, 12, 30, tzinfo=datetime.UTC)
ORIGIN = Origin(
    MADE_AT,
    {
        "program": {"name": "tpmsd", "version": "9.9", "commit": None},
        "input": {
            "paths": ["/d"],
            "configuration": "/d/vehicle.toml",
            "configuration_hash": "sha256:c",
            "hash": None,
        },
    },
)
_ENDS = {**dict.fromkeys(("td", "th", "dt", "dd"), "|"), **dict.fromkeys(("p", "tr", "h1", "h2", "h3"), "\n")}
_VOID = {"meta", "link", "br", "img", "input", "hr"}


class Page(HTMLParser):
    """Tags by count, visible text with a bar between cells, data of figures, and what would be loaded."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tags: Counter[str] = Counter()
        self.ids: Counter[str] = Counter()
        self.text = ""
        self.data: list[dict[str, Any]] = []
        self.loaded: list[str] = []
        self.links: list[str] = []
        self._open: list[tuple[str, dict[str, str | None]]] = []
        self.feed(html)
        self.close()
        assert [] == [tag for tag, _ in self._open], "tags that nobody closes"

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        self.tags[tag] += 1
        if (one := values.get("id")) is not None:
            self.ids[one] += 1
        self.loaded += [str(values[name]) for name in ("src", "srcset", "action") if name in values]
        href = values.get("href") or ""
        if href and not href.startswith("#"):
            self.loaded.append(href)
        elif tag == "a" and href:
            self.links.append(href[1:])
        if tag not in _VOID:
            self._open.append((tag, values))

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        self.handle_endtag(tag)

    def handle_endtag(self, tag: str) -> None:
        opened, _ = self._open.pop()
        assert opened == tag
        self.text += (
            "|" if tag in ("td", "th", "dt", "dd") else "\n" if tag in ("p", "tr", "h1", "h2", "h3") else ""
        )

    def handle_data(self, data: str) -> None:
        if not self._open:
            return
        tag, values = self._open[-1]
        if tag == "script" and values.get("type") == "application/json":
            self.data.append(json.loads(data))
        elif tag not in ("script", "style"):
            self.text += " ".join(data.split()) if data.strip() else ""
