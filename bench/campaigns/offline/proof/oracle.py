"""Which concealed effects a drive identifies at all, by an oracle that knows the form of each.

In: a concealed effect with what `diagnosis.truth` computes of it. Out: yes or no. The oracle knows the true
motion, the size of all noise, the form of the concealed effect and of every alternative, and fits only these:
the log-likelihood gain of the effect beside calibration (`gain`), and its gain beyond that of its best
alternative of the catalogue (`margin`). A diagnosis knows none of this. It estimates motion and noise from
the same data, and chooses among some fifty effects and hundreds of shapes; so four times the gain is asked
for from which the oracle itself is sure.
"""

from __future__ import annotations

from collections.abc import Sequence

from bench.campaigns.offline.diagnosis.truth import TELLS_GAIN, TELLS_MARGIN, Concealed

GAIN = 4.0 * TELLS_GAIN
"""Nats: a shift of eleven standard deviations."""
MARGIN = TELLS_MARGIN
"""Nats: an alternative that wins by chance in 2 of 100 drives."""


def are_identifiable(wanted: Sequence[Concealed]) -> bool:
    """Return True where the drive distinguishes every one of the concealed effects from its alternatives."""
    return all(each.gain >= GAIN and each.margin >= MARGIN for each in wanted)


def bounds(wanted: Sequence[Concealed]) -> str:
    """Return the oracle's numbers: of each effect its gain and the margin over its best alternative."""
    return ", ".join(
        f"{each.gain:.0f} nats, {each.margin:.0f} more than {each.alternative or 'any alternative'}"
        for each in wanted
    )
