"""The tables of the campaign `origins`.

In: rows of one state of the program. Out: Markdown. Shares bear 95 % intervals of Clopper and Pearson;
whether an origin differs from the others is Fisher's exact test; whether p-values of null drives are uniform
is the test of Kolmogorov and Smirnov.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from bench.campaigns.offline import origins_coverage
from bench.campaigns.offline.diagnosed import OWN_TYRES, Row, by_half, is_drawn_lag, parted
from bench.statistics import apart, count, even_p_value, percent, uniform
from bench.worlds import awkward, real_drives
from bench.worlds.origins import ORIGINS
from tpmsd.offline.diagnosis.settings import SETTINGS

REAL = "real"
EXPECTED = {
    "spin_on_ice": "wheel_spin",
    "counts_lost_at_low_speed": "counter_lost_low_speed",
    "teeth_44_as_48": "tone_ring_error",
}
"""The catalogue's name of a fault; effects injected into recordings bear it already."""
SLIPPING = {origin.name for origin in ORIGINS.values() if origin.own_tyres}
OWN_COVARIATES = ("accel_long", "accel_lat")
"""So is a term without a name over these on that origin."""
ACTING = (REAL, "multibody")
"""Origins in whose null drives something acts: there no p-value is uniform."""
SMALL = 0.05
"""Of p-values: so large a share lies below where they are uniform."""
SURE = 0.9
SPAN_S = 5.0
"""An event's span counts as found when both ends are right to within this time."""


def markdown(rows: Sequence[Row]) -> str:
    """All tables."""
    done, failed = parted(rows)
    parts = []
    halves = by_half(done)
    for title, those in halves:
        parts += [f"### {title}\n", _null_table(those, len(halves) == 1 or those is halves[-1][1])]
        parts.append(_faults_table(those))
        parts += [origins_coverage.table(those), _conditions_table(those)]
    parts.append(_speed(done))
    if failed:
        reported = [f"{row['origin']}/{row['kind']} {row['seed']}" for row in failed]
        parts.append(f"Not diagnosed, the program or the benchmark failed: {', '.join(reported)}.\n")
    return "\n".join(part for part in parts if part)


def _null_table(rows: Sequence[Row], by_origin: bool) -> str:
    """Return the table of the null drives, with a row for each origin or for all of them alone."""
    null = [row for row in rows if row["kind"] == "null"]
    judged = [row for row in null if row["verdict"] != "insufficient_data"]
    lines = [
        "| null drives of | with a finding | p-values uniform (p) | p-values below 0.05 |",
        "| --- | --- | --- | --- |",
    ]
    simulated = [row for row in judged if row["origin"] != REAL]
    for origin in [*ORIGINS, REAL] if by_origin else []:
        those = [row for row in judged if row["origin"] == origin]
        if any(row["origin"] == origin for row in null):
            lines.append(_null_row(origin, those))
    lines.append(_null_row("all simulated", simulated))
    return "\n".join([*lines, "", _remarks(null, judged), *_apart(simulated)])


def _remarks(null: Sequence[Row], judged: Sequence[Row]) -> str:
    """Return by origin the drives that were not judged, suspicions without a finding and false names."""
    refused = Counter(row["origin"] for row in null if row["verdict"] == "insufficient_data")
    suspected = Counter(row["origin"] for row in judged if row["suspicions"] and not row["findings"])
    false = Counter(f"{each['effect']} ({row['origin']})" for row in judged for each in _false(row))
    parts = []
    for title, numbers in (
        ("too little data", refused),
        ("a suspicion alone", suspected),
        ("false names", false),
    ):
        listed = ", ".join(f"{name} {number}" for name, number in numbers.most_common())
        parts.append(f"{title}: {listed or 'none'}")
    return f"{'; '.join(parts).capitalize()}.\n"


def _apart(simulated: Sequence[Row]) -> list[str]:
    """Return Fisher's exact test of each origin against the others in a line; none without findings."""
    reported = []
    for origin in dict.fromkeys(row["origin"] for row in simulated):
        parts = [[row for row in simulated if (row["origin"] == origin) == own] for own in (True, False)]
        if parts[1] and any(_found(part)["hits"] for part in parts):
            reported.append(f"{origin} {apart(*map(_found, parts)):.2g}")
    return [f"An origin against the others, p: {', '.join(reported)}.\n"] if reported else []


def _null_row(name: str, judged: Sequence[Row]) -> str:
    nothing = [row for row in judged if row["origin"] not in ACTING]
    known = [value for row in nothing if (value := p_of_the_rest(row)) is not None]
    tested = uniform(known)
    cells = [name, percent(_found(judged)), "-" if tested is None else f"{tested:.2g} of {len(known)}"]
    cells.append(str(sum(value < SMALL for value in known)))
    return f"| {' | '.join(cells)} |"


def p_of_the_rest(row: Row) -> float | None:
    """p-value of the best hypothesis that was not chosen, as `even_p_value`; None without a certificate.

    Drawing stopped with the replicates that reached it only if nothing else was asked.
    """
    rest = row.get("remaining")
    if rest is None:
        return None
    drawn, exceeded = rest["replicates"], rest["exceeded"]
    stopped = exceeded == SETTINGS.robustness.exceeded and not row["findings"] and not row["suspicions"]
    rng = np.random.default_rng([row["seed"], *row["origin"].encode()])
    return even_p_value(exceeded, drawn, stopped, rng)


def _false(row: Row) -> list[dict[str, Any]]:
    """Findings that are not true of a null drive."""

    def own(each: dict[str, Any]) -> bool:
        if each["effect"] == "velocity_lag":
            found_s, std_s = each["parameters"]["lag_s"]
            return is_drawn_lag(found_s, std_s, row.get("velocity_lag_s", 0.0), row.get("wheel_age_s", 0.0))
        unnamed = each["effect"] == "unknown" and each["where"]["covariate"] in OWN_COVARIATES
        return row["origin"] in SLIPPING and (unnamed or each["effect"] in OWN_TYRES)

    return [each for each in row["findings"] if not own(each)]


def _found(rows: Sequence[Row]) -> dict[str, Any]:
    return count(bool(_false(row)) for row in rows)


def _faults_table(rows: Sequence[Row]) -> str:
    lines = [
        "| fault or event | drives | named | named first | wheels and span right | `unknown` alone "
        f"| a wrong name above {SURE:g} | missed |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for kind in (*awkward.FAULTS, *real_drives.INJECTED):
        those = [row for row in rows if row["kind"] == kind and row["verdict"] != "insufficient_data"]
        if not those:
            continue
        wanted = EXPECTED.get(kind, kind)
        names = [[each["effect"] for each in row["findings"]] for row in those]
        cells = [
            f"{kind} ({those[0]['origin']})",
            str(len(those)),
            percent(count(wanted in found for found in names)),
            percent(count(found[:1] == [wanted] for found in names)),
            percent(count(_placed(row, wanted) for row in those)) if wanted == "wheel_spin" else "-",
            percent(count(bool(found) and set(found) == {"unknown"} for found in names)),
            percent(count(_sure_wrong(row, wanted) for row in those)),
            percent(count(not found for found in names)),
        ]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n" if len(lines) > 2 else ""


def _sure_wrong(row: Row, wanted: str) -> bool:
    return any(
        each["effect"] not in (wanted, "unknown") and each["confidence"] > SURE for each in row["findings"]
    )


def _placed(row: Row, wanted: str) -> bool:
    """Whether an event's wheels and span are right."""
    truth = row["truth"]
    begin, end = truth["onset_s"], truth["onset_s"] + truth["duration_s"]
    for each in row["findings"]:
        if each["effect"] == wanted and sorted(each["where"]["wheels"]) == sorted(truth["wheels"]):
            onset, long = (each["parameters"][key][0] for key in ("onset_s", "duration_s"))
            if abs(onset - begin) < SPAN_S and abs(onset + long - end) < SPAN_S:
                return True
    return False


def _conditions_table(rows: Sequence[Row]) -> str:
    """Return a table of the conditions with findings on either side, and a sentence with the others."""
    lines = ["| null drives of | condition | with it | without it |", "| --- | --- | --- | --- |"]
    quiet = []
    for origin in ("wheels", "awkward"):
        null = [row for row in rows if row["kind"] == "null" and row["origin"] == origin]
        judged = [row for row in null if row["verdict"] != "insufficient_data"]
        for tag in sorted({tag for row in judged for tag in row["tags"]}):
            having = [row for row in judged if tag in row["tags"]]
            lacking = [row for row in judged if tag not in row["tags"]]
            if _found(having)["hits"] or _found(lacking)["hits"]:
                lines.append(f"| {origin} | {tag} | {percent(_found(having))} | {percent(_found(lacking))} |")
            else:
                quiet += having
    table = "\n".join(lines) + "\n" if len(lines) > 2 else ""
    return table + ("No finding on null drives with or without any other condition.\n" if quiet else "")


def _speed(rows: Sequence[Row]) -> str:
    if not rows:
        return ""
    times = np.array([row["duration_s"] / row["cpu_s"] for row in rows if row["cpu_s"] > 0.0])
    low, middle, high = np.quantile(times, [0.1, 0.5, 0.9])
    return (
        f"One core, reading included: median {middle:.0f} times faster than real time "
        f"(tenths {low:.0f} and {high:.0f}, {len(times)} drives).\n"
    )
