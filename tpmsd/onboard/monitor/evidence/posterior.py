"""One posterior of the tyres: which have lost air, which are of another size, and since when.

In: what each window of onsets says of losses and sizes (`hypotheses.Table`), and how much of what a subset
of wheels does is a loss in it. Out: `Posterior`: every probability that the monitor acts on, as marginals
of one bank. Nothing here changes anything.

A row of the bank is a size r since before the drive, a loss S, and the window w in which it began: just now,
in the last minutes, or on the drive or before it. The rows of a window's table begin with what the samples
before it say of each size (`Judge`), so a loss that began in w leaves what was seen before w as it is, and
its odds against no loss are those of w's table. With R for the longest window and e for a window's share of
the prior (the windows that have a row for S share it evenly):

    P(r, nothing) ~ P_R(r, nothing),      P(r, S, w) ~ (sum P_R(., nothing) / sum P_w(., nothing)) e P_w(r, S)

so a size hides no loss, nothing is counted twice, and minutes that say which of two tyres has changed are not
overruled by the present.
A size may also have come in a young window: a row of its own there, and an alternative of losses of the other
wheel of its axle.

What both tyres of an axle or all four do looks for a while like slip, slopes and load, of which young windows
have no model. There it counts as no loss: it *passes*, and belongs to "nothing". An active alarm is not
cleared while such a thing is seen of its tyre (`possible`).

A change of either sign is asked alike: of it a window knows P_w(S off), and P_w(none off) takes the place of
nothing.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.monitor.evidence.hypotheses import Table, Verdict
from tpmsd.onboard.monitor.evidence.kernel import compiled
from tpmsd.onboard.monitor.evidence.sizes import subsets

Over = Literal["now", "minutes", "drive"]
LEAST = 1e-300
"""Keeps a division by a probability of zero finite."""


@dataclass(frozen=True, slots=True)
class Window:
    """Changes that began in one span of time, by what was seen since."""

    over: Over
    verdict: Verdict
    loss_fraction: FloatArray
    """(s, d) share of what each of `subsets` does that is a loss of the wheel; the rest passes."""
    deviation_fraction: FloatArray
    """(s, d) the same of a change of either sign."""
    came: int = 0
    """Number of the table's last rows, of sizes that came in this window and were not there before."""


@dataclass(frozen=True, slots=True)
class Posterior:
    """Marginals of the bank; d wheels."""

    deflated: FloatArray
    """(d,) the wheel has lost air, a smaller loss than the threshold by its share of it."""
    possible: FloatArray
    """(d,) that, or something that passes and looks the same now."""
    deviates: FloatArray
    """(d,) the wheel is larger or smaller by more than the limit."""
    subsets: FloatArray
    """(s,) these wheels and no other have lost air, however little."""
    sizes: FloatArray
    """(r,) each row of sizes, what was lost beside it or not; the first: all as learned."""
    onsets: dict[Over, float]
    """Probability per window that something was lost and began in it."""
    suspicion: float
    """Log-likelihood ratio of the best loss to none, whatever its prior, by what was seen lately."""

    none: float
    """No tyre has lost air and all are of the size that was learned."""
    changed: float
    """A tyre has lost air, a smaller loss than the threshold by its share of it, or is of another size."""

    @property
    def lost(self) -> float:
        """Probability that a tyre has lost air, however little."""
        return min(float(self.subsets.sum()), 1.0)


def posterior(windows: Sequence[Window]) -> Posterior:
    """Return the marginals of the bank of these windows, the youngest first and the longest last: by compiled
    code where it was built."""
    found = by_compiled(windows) if compiled is not None else None
    return by_arrays(windows) if found is None else found


def by_compiled(windows: Sequence[Window]) -> Posterior | None:
    """Return `posterior` computed by `_evidence.c`; None for windows whose tables are not of one size."""
    s, d = windows[-1].loss_fraction.shape
    sizes, count = _rows_before(windows[-1]), len(windows)
    deflated, possible, deviates, subset = np.empty(d), np.empty(d), np.empty(d), np.empty(s)
    of_sizes, onsets = np.empty(sizes), np.empty(count)
    parts: list[FloatArray] = []
    for window in windows:
        table = window.verdict.table
        parts += [table.none, table.larger]
        parts += [np.ascontiguousarray(table.lost), np.ascontiguousarray(table.large)]
        parts += [window.loss_fraction, window.deviation_fraction, window.verdict.off]
    found = compiled.marginals(
        *(deflated, possible, deviates, subset, of_sizes, onsets, np.empty((count + 2, sizes)), _members(d)),
        *parts,
        *[float(window.came) for window in windows],
    )
    if found is None:
        return None
    none, changed = found
    return Posterior(
        deflated=deflated,
        possible=possible,
        deviates=deviates,
        subsets=subset,
        sizes=of_sizes,
        onsets={window.over: one for window, one in zip(windows, onsets.tolist(), strict=True)},
        suspicion=_largest_suspicion(windows),
        none=none,
        changed=changed,
    )


def _largest_suspicion(windows: Sequence[Window]) -> float:
    """Return the largest suspicion of the windows but that of the whole drive."""
    return max(window.verdict.suspicion for window in windows if window.over != "drive")


def by_arrays(windows: Sequence[Window]) -> Posterior:
    """Return `posterior` computed by NumPy, the reference."""
    longest = windows[-1]
    any_wheel = [_any_wheel_fraction(window.loss_fraction) for window in windows]
    of_sizes = [_log_no_loss(*one) for one in zip(windows, any_wheel, strict=True)]
    at_rest, rest = _log_no_loss_by_size(longest.verdict.table, of_sizes[-1])
    odds = _log_odds_of_longest(at_rest, of_sizes[:-1])
    parts = zip(windows, [*odds, 0.0], _prior_shares(any_wheel), any_wheel, strict=True)
    rows = [_log_losses(window, known, share * of_any) for window, known, share, of_any in parts]
    young = [_log_enlarged(*one) - np.log(len(windows)) for one in zip(windows, odds, strict=False)]
    came = longest.verdict.table.none[at_rest.size :]
    terms = [at_rest, rest, came, *[lost.ravel() for lost, _ in rows], *young]
    top = max(float(np.max(term, initial=-np.inf)) for term in terms)
    total = sum(float(np.exp(term - top).sum()) for term in terms)
    scale = top + np.log(total)
    lost = [np.exp(plain - scale) for plain, _ in rows]
    large = [np.exp(weighed - scale) for _, weighed in rows]
    quiet = np.exp(at_rest - scale)
    resized = float(np.exp(of_sizes[-1][1:] - scale).sum())
    deflated = np.zeros(longest.loss_fraction.shape[1])
    for one, window, of_any in zip(large, windows, any_wheel, strict=True):
        deflated += np.add.reduce(one) @ _wheel_fractions(window.loss_fraction, of_any)
    passing = quiet @ _passing_fractions(windows[0], of_sizes[0], any_wheel[0])
    by_row = quiet + sum(
        (_merge_new_sizes(one.sum(axis=1), quiet.size) for one in lost), np.zeros(quiet.size)
    )
    return Posterior(
        deflated=np.minimum(deflated, 1.0),
        possible=np.minimum(deflated + passing, 1.0),
        deviates=_deviation_probability(windows, any_wheel),
        subsets=sum((np.add.reduce(one) for one in lost), np.zeros(longest.loss_fraction.shape[0])),
        sizes=by_row / by_row.sum(),
        onsets={window.over: float(one.sum()) for window, one in zip(windows, lost, strict=True)},
        suspicion=_largest_suspicion(windows),
        none=min(float(quiet[0]), 1.0),
        changed=min(sum(float(one.sum()) for one in large) + resized, 1.0),
    )


def _any_wheel_fraction(loss_fraction: FloatArray) -> FloatArray:
    """Return the (s,) fraction of each subset's change that is a loss of any wheel."""
    return np.asarray(np.maximum.reduce(loss_fraction, axis=1))


def _wheel_fractions(loss_fraction: FloatArray, any_wheel: FloatArray) -> FloatArray:
    """Return the (s, d) fraction of a subset's loss that counts for each wheel; `any_wheel` (s,) as
    `_any_wheel_fraction`."""
    return np.asarray(loss_fraction / np.maximum(any_wheel, LEAST)[:, None])


def _prior_shares(loss_fraction: list[FloatArray]) -> list[FloatArray]:
    """Return the (s,) share of the prior of each window: those that have a row for a subset share it
    evenly."""
    count = sum((one > 0.0).astype(float) for one in loss_fraction)
    return [np.where(one > 0.0, 1.0 / np.maximum(count, 1.0), 0.0) for one in loss_fraction]


def _log_no_loss(window: Window, any_wheel: FloatArray) -> FloatArray:
    """Return the (r,) log probability of nothing lost, or of what passes, under each size that was there
    before; `any_wheel` (s,) as `_any_wheel_fraction`."""
    table = window.verdict.table
    passing = _log_or_minus_infinity(1.0 - any_wheel) + table.lost
    return np.asarray(np.logaddexp(table.none, np.logaddexp.reduce(passing, axis=1))[: _rows_before(window)])


def _log_odds_of_longest(at_rest: FloatArray, of_sizes: Sequence[FloatArray]) -> list[float]:
    """Return, for each young window, the log of the longest window's probability of nothing lost over its
    own, summed over sizes."""
    usual = np.logaddexp.reduce(at_rest)
    return [float(usual - np.logaddexp.reduce(of_size)) for of_size in of_sizes]


def _rows_before(window: Window) -> int:
    """Return the number of the rows of sizes that were there before the window."""
    return window.verdict.table.none.size - window.came


def _merge_new_sizes(of_row: FloatArray, sizes: int) -> FloatArray:
    """Return the (r,) values by size, from those of a window's rows; sizes that came in it are added to the
    row of the same wheels."""
    out = of_row[:sizes].copy()
    out[1 : 1 + of_row.size - sizes] += of_row[sizes:]
    return out


def _log_no_loss_by_size(table: Table, nothing: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the log probability of each size with nothing lost (r,), and of larger wheels where no sizes are
    compared (k,).

    A wheel that is larger by any amount is a row of its size: what is lost beside it depends little on how
    large it was thought to be beforehand. In every window alike: the odds of a loss are against all of its
    row, so that a bank of one window is its table."""
    if nothing.size == 1 or not np.isfinite(table.larger).any():
        return nothing, table.larger
    out, d = nothing.copy(), table.larger.size
    out[1 : d + 1] = np.logaddexp(out[1 : d + 1], table.larger)
    return out, np.empty(0)


def _log_losses(window: Window, known: float, share: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the (r, s) log probabilities of a loss in this window under each size, and the same weighed by
    `severity`; `share` (s,) of the prior, times what is a loss."""
    table = window.verdict.table
    odds = known + _log_or_minus_infinity(share)
    return odds + table.lost, odds + table.large


def _log_enlarged(window: Window, known: float) -> FloatArray:
    """Return the (k,) log probabilities of wheels that became larger in this window, with nothing lost."""
    table = window.verdict.table
    return np.concatenate([table.larger, table.none[_rows_before(window) :]]) + known


def _passing_fractions(window: Window, of_size: FloatArray, any_wheel: FloatArray) -> FloatArray:
    """Return the (r, d) fraction of nothing lost in which a passing change looks like a loss of the wheel;
    `of_size` (r,) as of `_log_no_loss`, `any_wheel` (s,) as `_any_wheel_fraction`."""
    nothing = _log_no_loss_by_size(window.verdict.table, of_size)[0]
    known = np.isfinite(nothing)
    passing = window.verdict.table.large[: of_size.size] + _log_or_minus_infinity(1.0 - any_wheel)
    share = np.exp(np.where(known[:, None], passing - np.where(known, nothing, 0.0)[:, None], -np.inf))
    return np.asarray(share @ _members(window.loss_fraction.shape[1]))


@functools.cache
def _members(d: int) -> FloatArray:
    """Return the (s, d) matrix that is 1 for the wheels of each subset."""
    return np.array([[float(wheel in one) for wheel in range(d)] for one in subsets(d)])


def _deviation_probability(windows: Sequence[Window], any_loss: Sequence[FloatArray]) -> FloatArray:
    """Return the (d,) probability of a change of either sign, in any of the windows; `any_loss` (s,) each,
    `_any_wheel_fraction` of losses."""
    any_wheel = [
        of_any
        if window.deviation_fraction is window.loss_fraction
        else _any_wheel_fraction(window.deviation_fraction)
        for window, of_any in zip(windows, any_loss, strict=True)
    ]
    found, total = np.zeros(windows[-1].loss_fraction.shape[1]), 1.0
    for window, share, of_any in zip(windows, _prior_shares(any_wheel), any_wheel, strict=True):
        loss_fraction = np.minimum(window.verdict.off * of_any, 1.0)
        odds = share * loss_fraction / max(1.0 - float(loss_fraction.sum()), 1e-12)
        found += odds @ _wheel_fractions(window.deviation_fraction, of_any)
        total += float(odds.sum())
    return np.minimum(found / total, 1.0)


def _log_or_minus_infinity(values: FloatArray) -> FloatArray:
    """Return the logarithm, -inf of 0 without a warning."""
    with np.errstate(divide="ignore"):
        return np.log(values)
