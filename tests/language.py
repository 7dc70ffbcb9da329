"""One term per concept: the wordings that are not used, because a reader from outside cannot search for them.

In: a text. Out: what of it is on the list, with the term of the field. `tests/test_house.py` asks it of
every file; the changelog keeps the names of its time, and texts of others keep their words.
"""

from __future__ import annotations

import re

NOT_USED: dict[str, str] = {
    r"\bold(er)? fix(es)?\b|fixes are older than": "GNSS latency",
    r"\bolder speed|doppler alone is older": "velocity lag",
    r"drives? of nothing|nothing (is )?missing": "null drive",
    r"nature (does|knows|makes|has)|as in nature": "physically possible; effect",
    r"free.shapes?\b|\bhumps?\b": "nonparametric term, spline term; dip",
    r"radi(i|us) that wander|wandering radi|wheels that wander|slow wander|\brestless": "radius drift",
    r"levels? of drift": "process-noise level",
    r"what it brings|\bits price\b|what it must pay|must pay for": "log-likelihood gain; penalty",
    r"gains? nothing sure|nothing sure beyond": "no significant gain",
    r"best addition|\bregroup": "forward, exchange and backward step",
    r"\bfeign|\bimitat(e|es|ed)\b": "is confounded with; resembles",
    r"whitened rows|count's error with itself": "innovations; errors in variables",
    r"supposed changes?\b|particles as histories|one history branches off": "jump hypothesis",
    r"\bteach(es|ing)?\b|\bof use for the radii": "informative",
    r"learned aside|\blessons\b(?!\")": "shadow baseline",
    r"laid.over|lay over": "injected effect",
    r"\bcars? of cases": "scenario, trip, vehicle",
    r"kept away|not believed": "rejected, gated, down-weighted",
    r"wheel against wheel|one against the other": "left-right difference; differences between wheels",
    r"\bpapers? 00\d": "author and year, resolved in the bibliography",
    r"still has structure|not enough to go by": "varies systematically; insufficient data",
    r"estimated along\b|\bticks run\b|where on the way|noise lets expect": "also estimated; first tick",
    r"what comes and goes|comes and goes (with|within)|grip comes and goes": "fluctuations, fluctuates",
    r"\b(is|are|was|were|be) believed\b": "trusted, used, accepted or estimated",
    r"\b(its|the|their|a) fellows?\b": "the other wheel of the axle",
    r"a witness's|cr(y|ies) wolf": "an independent measurement; false alarms",
}
"""Pattern, in any case -> the term that is used instead."""

OTHERS = re.compile(
    r"CHANGELOG\.md|LICENSE|tests/interfaces/web/vendor/|tpmsd/interfaces/web/static/vendor/|tests/language\.py"
)
"""Files that keep their words."""


_ANY = re.compile("|".join(re.sub(r"(?<=\|)\\b|^\\b", "", pattern) for pattern in NOT_USED))
"""Any pattern, in lower case and wherever a word begins: a text without it holds none of the wordings."""


def found_in(text: str) -> list[tuple[int, str, str]]:
    """Line, wording and the term instead, for each wording that is not used; line breaks count as blanks."""
    flat = re.sub(r"\s", " ", text)
    if not _ANY.search(flat.lower()):
        return []
    return [
        (text.count("\n", 0, match.start()) + 1, match.group(), term)
        for pattern, term in NOT_USED.items()
        for match in re.finditer(pattern, flat, re.IGNORECASE)
    ]
