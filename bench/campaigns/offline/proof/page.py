"""The page of the proof: one file, no script, readable at 400 px and in the dark."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bench.campaigns.offline.proof.run import Row

STYLE = """
:root{color-scheme:light dark}
body{font:16px/1.5 system-ui,sans-serif;max-width:70em;margin:auto;padding:1em}
article{
border-left:.4em solid #888;padding:.2em 1em;margin:1em 0}article.hit{border-color:#2a8f5c}
article.wrong{border-color:#c33}
dl{display:grid;grid-template-columns:minmax(7em,max-content) 1fr;gap:.1em 1em}
dt{opacity:.7}dd{margin:0;overflow-wrap:anywhere}h2{font-size:1.1em;margin:.3em 0}
@media(max-width:30em){dl{grid-template-columns:1fr}}
"""


def headline(rows: Sequence[Row]) -> str:
    """Return the count of concealed effects found; null drives and recordings of known name do not count."""
    concealed = [row for row in rows if row.concealed != "nothing" and not row.known]
    hits, wrong = sum(row.hit for row in concealed), sum(row.wrong for row in rows)
    names = "1 drive with a wrong name" if wrong == 1 else f"{wrong} drives with a wrong name"
    return f"{hits} of {len(concealed)} concealed effects found, {names}"


def page(rows: Sequence[Row], seed: int) -> str:
    """HTML of the rows, hits and misses in the order of the drives."""
    parts = [
        '<!doctype html><html lang="en"><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width"><title>tpmsd: the proof</title>',
        f"<style>{STYLE}</style><h1>{headline(rows)}</h1>",
        "<p>Each drive of a world was made by programs that import nothing of the diagnosis. The truth was"
        " sealed before the diagnosis began, and opened after it had ended. Of"
        " recordings, the name is known from"
        f" how the drive was made, or the effect was injected. <code>make proof SEED={seed}</code></p>",
    ]
    for number, row in enumerate(rows, 1):
        kind = "wrong" if row.wrong else "hit" if row.hit else "miss"
        parts.append(f'<article class="{kind}"><h2>{number}. {escape(row.drive)}: {escape(row.verdict)}</h2>')
        parts.append("<dl>")
        for title, text in (
            ("concealed", row.concealed),
            ("truth", row.truth),
            ("named", row.named),
            ("located", row.located),
            ("value, 95 %", row.value),
            ("held-out residual, of its expected size", row.residual),
            *row.others.items(),
            ("SHA-256 of the sealed truth", row.sha256),
        ):
            if text:
                parts.append(f"<dt>{escape(title)}</dt><dd>{escape(text)}</dd>")
        parts.append("</dl></article>")
    return "".join(parts) + "</html>\n"
