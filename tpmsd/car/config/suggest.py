"""The nearest right spelling of a wrong word.

In: the word and the right ones. Out: the nearest, or None where nothing is near.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable

_CUTOFF = 0.6


def nearest(word: str, choices: Iterable[str]) -> str | None:
    """Return the choice that looks most like `word`, upper and lower case being the same; None if none
    does."""
    by_folded: dict[str, str] = {}
    for choice in choices:
        by_folded.setdefault(choice.casefold(), choice)
    # The comparison is quadratic in the word's length, and no name is that long.
    wanted = word.casefold()[:100]
    possible = [choice for choice in by_folded if _greatest_ratio(wanted, choice) >= _CUTOFF]
    matches = difflib.get_close_matches(wanted, possible, n=1, cutoff=_CUTOFF)
    return by_folded[matches[0]] if matches else None


def _greatest_ratio(word: str, choice: str) -> float:
    """Return a bound on the ratio of `difflib`, from the letters of `choice` that `word` has too: most
    choices need no comparison."""
    letters = len(word) + len(choice)
    return 2.0 * sum(map(choice.count, set(word))) / letters if letters else 1.0
