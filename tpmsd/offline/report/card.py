"""Records as one line and as a small card for notebooks.

In: a headline, tables of texts. Out: text, HTML. Pure.

The HTML takes colours and fonts from the page around it, so it is readable on dark pages as well; it loads
nothing. All texts are escaped.
"""

from __future__ import annotations

import html
from collections.abc import Sequence

MAX_CHARS = 400
"""Length of one line: longer ones wrap several times on a terminal."""
MAX_ROWS = 20
"""Rows of a table on a card; the whole is in `to_dict()` and `to_pandas()`."""
_CARD = (
    "display:inline-block;border:1px solid;border-radius:6px;padding:.5em 1em;max-width:100%;overflow:auto"
)

Row = Sequence[object]


def one_line(kind: str, *parts: str) -> str:
    """Return `Kind(part, part)`, cut where it is longer than `MAX_CHARS`."""
    text = f"{kind}({' '.join(', '.join(part for part in parts if part).split())})"
    return text if len(text) <= MAX_CHARS else f"{text[: MAX_CHARS - 4]}...)"


def card(head: str, *tables: tuple[Row, Sequence[Row]]) -> str:
    """Return a headline and tables (titles and rows; those without rows are left out) as HTML."""
    parts = [f'<div class="tpmsd-card" style="{_CARD}">', f"<p><b>{_escaped_cell(head)}</b></p>"]
    for titles, rows in tables:
        if not rows:
            continue
        heads = "".join(f"<th>{_escaped_cell(title)}</th>" for title in titles)
        body = "".join(_html_row(row) for row in rows[:MAX_ROWS])
        if len(rows) > MAX_ROWS:
            body += _html_row([f"and {len(rows) - MAX_ROWS} more"])
        parts.append(f"<table><thead><tr>{heads}</tr></thead><tbody>{body}</tbody></table>")
    return "".join([*parts, "</div>"])


def _html_row(row: Row) -> str:
    return f"<tr>{''.join(f'<td>{_escaped_cell(cell)}</td>' for cell in row)}</tr>"


def _escaped_cell(cell: object) -> str:
    """Return a cell as HTML text, cut where it is longer than `MAX_CHARS`."""
    text = str(cell)
    return html.escape(text if len(text) <= MAX_CHARS else f"{text[: MAX_CHARS - 3]}...")
