"""The settings of fleets, with their units and reasons.

In: nothing. Out: `FleetSettings`.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class FleetSettings:
    """Defaults of all commands."""

    tries: int = 2
    """Starts of a drive in one run after which it is set aside: a worker may be killed for another reason."""
    tries_in_all: int = 4
    """Tries over all runs, for a drive that takes the machine down with the run itself."""
    memory_per_worker: str = "2GiB"
    """A drive of two hours takes 0.6 GiB, with the libraries 0.3 GiB."""
    tasks_ahead: int = 2
    """Drives handed to each worker at a time: it never waits, and the scheduler never holds the fleet."""
    progress_s: float = 30.0
    """Between two lines of progress where nobody watches a terminal."""
    false_discovery_rate: float = 0.01
    """Expected share of false findings among those of the fleet (Benjamini and Hochberg 1995)."""
    min_drives_trend: int = 5
    """Drives of a car that a trend takes: two parameters and a spread, with some to spare."""
    min_span_days: float = 1.0
    """Between the first and the last drive, for a trend: tyres warm up and cool down within a day."""
    drive_scales: float = 0.5
    """Least spread of radii from drive to drive, in scales: 0.05 % left against right (sun, a
    passenger), 0.25 % front against rear and in the mean (load, and 10 K by night: 0.1 %)."""
    min_changes: int = 8
    """Between successive drives, for a median that says what is usual of a model."""
    grown_nats: float = 3.0
    """A tyre that became larger than the others (changed alone, or inflated) is twenty times as rare as one
    that lost air, and of two on one axle the drives hardly identify which it was."""
    outlier_p: float = 1e-3
    """Cars that differ at this level by themselves do not take part in estimating what cars of the model are
    like: a faulty car would widen the spread that it is held against."""
    outlier_rounds: int = 5
    """Rounds of leaving such cars out and judging all of them again."""
    well_known_scales: float = 3.0
    """A value whose standard deviation is beyond so many scales is not known at all, and not tested."""
    max_iterations: int = 60
    """Iterations of the spreads' estimate (EM)."""
    converged_share: float = 2e-3
    """Converged when no standard deviation moves by more than this share of itself, or of `small_scales`."""
    small_scales: float = 0.2
    """Standard deviations below need no more than this precision."""
    spread_drives: int = 3_000
    """Drives (whole cars, evenly chosen) from which the spreads are estimated, to some per cent."""
    ridge: float = 1e-8
    """Information, in scaled units, that everything has: what no drive determines gets a standard deviation
    of 10,000 scales instead of a singular matrix."""
    first_scales: float = 0.3
    """First standard deviations of cars and drives, in scales."""
    models_at_once: int = 2
    """Models that are fitted at a time; each takes some 100 MB per 10,000 drives."""
    chunk_drives: int = 10_000
    """Drives whose matrices are in work at a time."""
    digits: int = 12
    """Significant digits that are kept: sums in another order differ in the last ones."""
    connect_s: float = 20.0
    """For a scheduler to answer."""
    max_drives: int = 2_000
    """Drives of which a page shows details, the newest of each car first; some megabytes."""
    max_pictures: int = 20
    """Cars whose plot is a picture too, those that need attention first; each takes 0.1 s and 20 kB. The
    others' plots take JavaScript; their tables do not."""
    first_date_s: float = 1e9
    """Host times before September 2001 are of a clock that was not set."""
    key_letters: int = 10
    """Letters of a drive's key that are shown; `where key like '0123456789%'` finds the drive."""
    query_s: float = 30.0
    """Time that a question in SQL may take."""
    query_memory: str = "512MB"
    """Memory of a question in SQL: the tables of 100,000 drives take a fifth of it."""
    query_rows: int = 100_000
    """Rows of an answer, which is held in memory."""
    cell_chars: int = 1000
    """Characters of a cell on a terminal."""
    named_confidence: float = 0.5
    """Confidence from which an effect is named: below, something else is likelier."""
    result_bytes: int = 64 << 20
    """Size of a stored result that is read; a result of a drive takes some 100 kB."""
    largest_information: float = 1e30
    """Largest number that a stored result may hold; that of a radius known to a micrometre is 1e12."""
    result_rows: int = 100_000
    """Rows of a list in a stored result."""
    result_names: int = 200
    """Parameters of a drive's statistics."""
    indefinite: float = 1e-6
    """Negative eigenvalue of an information matrix of unit diagonal that is rounding, per row."""


SETTINGS = FleetSettings()
