"""The page of the proof: one file, no script, readable at 400 px and in the dark.

In: the rows of the drives. Out: HTML. The verdict and the clearest hit's picture come first, then a table
with a line for each drive, misses beside hits, then each drive in full.
"""

from __future__ import annotations

import base64
from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bench.campaigns.offline.proof.run import Row

STYLE = """
:root{color-scheme:light dark}
body{font:16px/1.5 system-ui,sans-serif;max-width:70em;margin:auto;padding:1em}
h1{font-size:1.5em;line-height:1.25}
figure{margin:1em 0}figure img{max-width:100%;background:#fff}
.picture{overflow-x:auto}code{overflow-wrap:anywhere}
.table{overflow-x:auto}table{border-collapse:collapse;width:100%}
th,td{text-align:left;vertical-align:top;padding:.3em .6em;border-bottom:1px solid #8886}
article{border-left:.4em solid #888;padding:.2em 1em;margin:1em 0}
.hit{border-color:#2a8f5c}.wrong{border-color:#c33}td.hit{color:#2a8f5c}td.wrong{color:#c33}
dl{display:grid;grid-template-columns:minmax(7em,max-content) 1fr;gap:.1em 1em}
dt{opacity:.7}dd{margin:0;overflow-wrap:anywhere}h2{font-size:1.1em;margin:.3em 0}
@media(max-width:34em){
dl{grid-template-columns:1fr}dt{margin-top:.4em}.picture img{max-width:none;width:44em}
table,tbody,tr,td{display:block}tr:first-child{display:none}tr{border-bottom:1px solid #888;padding:.4em 0}
td{display:grid;grid-template-columns:7em 1fr;padding:.1em 0;border:0;overflow-wrap:anywhere}
td::before{content:attr(data-head);opacity:.7}td:empty{display:none}
}
"""


def concealed(rows: Sequence[Row]) -> list[Row]:
    """Return the rows that count: neither null drives nor recordings of which the name was known."""
    return [row for row in rows if row.concealed != "nothing" and not row.known]


def headline(rows: Sequence[Row]) -> str:
    """Return the verdict: concealed effects found of those that are identifiable, of all, and wrong names."""
    asked = concealed(rows)
    identifiable = [row for row in asked if row.identifiable]
    wrong = sum(row.wrong for row in rows)
    names = "no wrong name" if not wrong else f"{wrong} drive{'s' if wrong > 1 else ''} with a wrong name"
    return (
        f"{sum(row.hit for row in identifiable)} of {len(identifiable)} concealed effects that"
        f" their drives identify are named first, {sum(row.hit for row in asked)} of {len(asked)} in all,"
        f" {names}"
    )


def page(rows: Sequence[Row], seed: int) -> str:
    """HTML of the rows, hits and misses in the order of the drives."""
    parts = [
        '<!doctype html><html lang="en"><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width"><title>tpmsd: the proof</title>',
        f"<style>{STYLE}</style><h1>{headline(rows)}</h1>",
        _best(rows),
        _table(rows),
        "<p>Each drive of a world was made by programs that import nothing of the diagnosis. The truth was"
        " sealed before the diagnosis began, and opened after it: <code>sha256sum truth-1.json</code>"
        " gives what was printed first. An oracle, a best-case fit that"
        " knows motion, noise and the form of every effect, says which drives identify theirs at all: those"
        " with 64 nats, and 8 more than the best alternative brings. Recordings do not count: of each one"
        " name is known, from the road, from the driving or since it was injected, and a real car has others"
        " beside it. Worlds: <i>kinematic</i> has a receiver with drawn errors, <i>receiver</i> one with"
        " errors of recorded receivers, <i>mems</i> a drawn gyro, <i>latched</i> counts read in a"
        " rhythm of their own.</p>"
        "<p>Numbers after names are confidences. In sentences ± is one standard deviation, in"
        " the rows it is a 95 % interval. Residuals are over the size of the fitted noise: 1 is noise"
        f" alone. <code>make proof SEED={seed}</code></p>",
    ]
    parts += [_article(number, row) for number, row in enumerate(rows, 1)]
    return "".join(parts) + "</html>\n"


def _best(rows: Sequence[Row]) -> str:
    """The picture of the first hit that has one, with what the diagnosis said and what was concealed."""
    hits = [row for row in concealed(rows) if row.hit and row.picture]
    if not hits:
        return ""
    row = hits[0]
    data = base64.b64encode(row.picture.encode("utf-8")).decode("ascii")
    said = _text(row.said)
    return (
        '<figure><div class="picture">'
        f'<img src="data:image/svg+xml;base64,{data}" alt="residual before and after"></div>'
        f"<figcaption>The diagnosis: “{said}” Concealed was {escape(row.concealed)}:"
        f" {escape(row.truth)}.</figcaption></figure>"
    )


def _table(rows: Sequence[Row]) -> str:
    heads = ("drive", "concealed", "truth", "named", "value, 95 %", "verdict")
    body = "".join(
        f'<tr><td data-head="drive"><a href="#drive-{number}">{number}. {escape(row.drive)}</a></td>'
        + "".join(
            f'<td data-head="{name}">{_text(each)}</td>'
            for name, each in zip(heads[1:5], (row.concealed, row.truth, row.named, row.value), strict=True)
        )
        + f'<td class="{_kind(row)}" data-head="verdict">{escape(row.verdict)}</td></tr>'
        for number, row in enumerate(rows, 1)
    )
    head = "".join(f"<th>{one}</th>" for one in heads)
    return f'<div class="table"><table><tr>{head}</tr>{body}</table></div>'


def _text(words: str) -> str:
    """Return words as HTML, with the sign of a page for plus or minus."""
    return escape(words.replace("+-", "±"))


def _kind(row: Row) -> str:
    return "wrong" if row.wrong else "hit" if row.hit else "miss"


def _article(number: int, row: Row) -> str:
    lines = [
        f'<article id="drive-{number}" class="{_kind(row)}">'
        f"<h2>{number}. {escape(row.drive)}: {escape(row.verdict)}</h2><dl>"
    ]
    for title, text in (
        ("concealed", row.concealed),
        ("truth", row.truth),
        ("also there, part of the receiver, not scored", row.inherent),
        ("the oracle's evidence", row.oracle),
        ("the diagnosis", row.said),
        ("named", row.named),
        ("located", row.located),
        ("value, 95 %", row.value),
        ("held-out residual", row.residual),
        *row.others.items(),
        ("SHA-256 of the sealed truth", f"{row.sha256} ({row.file})" if row.file else row.sha256),
    ):
        if text:
            lines.append(f"<dt>{escape(title)}</dt><dd>{_text(text)}</dd>")
    return "".join(lines) + "</dl></article>"
