"""The figures as Markdown: all of them for `summary.md`, a page of them for `bench/results/alarms.md`.

In: what `figures` gives. Out: text.
"""

from __future__ import annotations

from typing import Any

from bench.campaigns.onboard.alarms.figures import rated
from bench.campaigns.onboard.alarms.lives import is_resized
from bench.statistics import percent
from bench.worlds.surfaces import TAGS

Figures = dict[str, Any]
MOST = 40
"""Lines of a list in the text; the JSON has all."""


def markdown(found: Figures) -> str:
    """Return the whole report."""
    return "\n".join(
        [*_bars(found), *_detections(found), *_missed(found), *_reliability(found), *_false(found), ""]
    )


def page(found: Figures) -> str:
    """Return the bars, the cases by standard, the misses and the false alarms by what confounds."""
    return "\n".join([*_bars(found), *_standards(found), *_misses(found), *_confounders(found), ""])


def _standards(found: Figures) -> list[str]:
    """Return a row for each standard's cases, with what was measured of them."""
    of_each = {name: part for name, part in found["by_standard"].items() if part["detected"]["of"]}
    optional = [name for name in ("by_law", "stands") if any(part[name]["of"] for part in of_each.values())]
    titles = ["cases", "detected in time", "median s", "95 % s", "longest s", "right wheel"]
    titles += [name.replace("_", " ") for name in optional]
    out = ["", f"| {' | '.join(titles)} |", "| --- " * len(titles) + "|"]
    for name, part in of_each.items():
        times = [part[key] for key in ("median_s", "p95_s", "longest_s")]
        cells = [name, percent(part["detected"]), *("-" if s is None else f"{s:.0f}" for s in times)]
        cells += [percent(part["right_wheel"]), *(percent(part[key]) for key in optional)]
        out.append(f"| {' | '.join(cells)} |")
    return out


def _misses(found: Figures) -> list[str]:
    """Return each missed case by its name, which `--one` plays again, under its cause."""
    out = []
    for cause in sorted(found["causes"], key=lambda cause: -found["causes"][cause]):
        names = [f"`{each['name']}`" for each in found["missed"] if each["reason"].startswith(cause)]
        out += ["", f"Missed, {cause}: {', '.join(names)}."]
    return out


def _confounders(found: Figures) -> list[str]:
    """Return the false alarms by what confounds; what has none in one line."""
    by_tag = found["false"]["by_tag"]
    none = [tag for tag, kinds in by_tag.items() if not kinds["deflation"]["events"]]
    out = []
    if len(none) < len(by_tag):
        out += ["", "| false `deflation` per 10,000 km on drives with | | |", "| --- | --- | --- |"]
        out += [
            f"| {tag} | {TAGS[tag]} | {rated(by_tag[tag]['deflation'])} |"
            for tag in by_tag
            if tag not in none
        ]
    if none:
        distances = (f"{tag} ({by_tag[tag]['deflation']['km']:.0f} km)" for tag in none)
        out += ["", f"None on drives with {', '.join(distances)}."]
    for kind in ("radius_deviation", "malfunction"):
        having = {tag: kinds[kind]["events"] for tag, kinds in by_tag.items() if kinds[kind]["events"]}
        numbers = ", ".join(f"{tag} {number}" for tag, number in having.items()) or "none"
        out += ["", f"`{kind}`: {numbers}."]
    return out


def _reliability(found: Figures) -> list[str]:
    """What was stated against what was so."""
    out = [
        "",
        "P(deflation) of each wheel every 10 s, on cases and on drives without a fault, against the loss "
        "over its threshold (at most 1):",
        "",
        "| stated | drives | instants | mean stated | mean truth |",
        "| --- | --- | --- | --- | --- |",
    ]
    for row in found["reliability"]:
        means = ["-" if row[name] is None else f"{row[name]:.4f}" for name in ("stated", "true")]
        reported = f"| {row['from']:g} to {row['to']:g} | {row['drives']} | {row['instants']} |"
        out.append(f"{reported} {means[0]} | {means[1]} |")
    return out


def _bars(found: Figures) -> list[str]:
    words = {True: "held", False: "**missed**", None: "not measured"}
    out = [
        f"{found['cases']} cases, {found['legs']} legs of the campaign, "
        f"{found['cpu_s'] / 60:.0f} minutes of one core.",
        "",
    ]
    out += ["| bar | measured | |", "| --- | --- | --- |"]
    out += [f"| {bar['bar']} | {bar['measured']} | {words[bar['held']]} |" for bar in found["bars"]]
    if found["failed"]:
        out += ["", f"{len(found['failed'])} failed:", "", *(f"- {text}" for text in found["failed"][:MOST])]
    return out


def _row(name: str, part: Figures) -> str:
    def seconds(value: float | None) -> str:
        return "-" if value is None else f"{value:.0f}"

    cells = [
        name,
        percent(part["detected"]),
        percent(part["by_law"]),
        seconds(part["median_s"]),
        seconds(part["p95_s"]),
    ]
    return (
        "| "
        + " | ".join(
            [
                *cells,
                seconds(part["longest_s"]),
                percent(part["right_wheel"]),
                str(part["early"]),
                percent(part["stands"]),
            ]
        )
        + " |"
    )


def _detections(found: Figures) -> list[str]:
    head = [
        "",
        "Times are seconds of driving above 40 km/h from when all the air is lost that will be; a "
        "case without an alarm counts as longer than all others (-: not reached). `early`: alarm while "
        "the air still went. `By law`: within the time that the regulation allows, of the driving that it "
        "counts; `stands`: of those detected, the alarm is active after five minutes with the ignition off.",
        "",
        "| cases | detected in time | by law | median s | 95 % s | longest s | right wheels of those named "
        "| early | stands |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    out = head + [_row(name, part) for name, part in found["by_standard"].items() if part["detected"]["of"]]
    lost = found["malfunction"]
    if lost["by_law"]["of"]:
        out.append(
            f"| a wheel's signal is missing | - | {percent(lost['by_law'])} | - | - | - | - | - "
            f"| {percent(lost['stands'])} |"
        )
    for title, groups in found["by"].items():
        out += [_row(f"{title}: {name}", part) for name, part in groups.items()]
    return out


def _missed(found: Figures) -> list[str]:
    out = ["", "Missed, by cause:", ""]
    out += [
        f"- {number} x {cause}"
        for cause, number in sorted(found["causes"].items(), key=lambda item: -item[1])
    ] or ["- none"]
    out += ["", *(f"- `{each['name']}`: {each['reason']}" for each in found["missed"][:MOST])]
    if found["wrong_wheel"]:
        out += ["", "Wheels named that were in order:", ""]
        out += [
            f"- `{each['name']}`: named {', '.join(each['named'])}, soft {', '.join(each['soft'])}"
            for each in found["wrong_wheel"][:MOST]
        ]
    return out


def _false(found: Figures) -> list[str]:
    false = found["false"]
    out = [
        "",
        "False alarms per 10,000 km, with the 95 % interval of Poisson:",
        "",
        "| drives | false alarms |",
        "| --- | --- |",
    ]
    out += [
        f"| all, tyres as learned: `deflation` | {rated(false['deflation'])} |",
        f"| all, tyres as learned: `radius_deviation` | {rated(false['radius_deviation'])} |",
        f"| with all signals there: `malfunction` | {rated(false['malfunction'])} |",
        f"| nothing that confounds: `deflation` | {rated(false['single'])} |",
        f"| real recordings: any alarm of a tyre | {rated(false['recorded'])} |",
    ]
    out += [
        "",
        f"Besides, {false['learning_drives']} on drives of learning, {false['before_onset']} before the air "
        "was let out; "
        f"{false['not_learned']} legs ended without a baseline.",
        "",
        "| what confounds | | `deflation` | `radius_deviation` | `malfunction` |",
        "| --- | --- | --- | --- | --- |",
    ]
    for tag, kinds in false["by_tag"].items():
        cells = [
            rated(kinds["deflation"]),
            str(kinds["radius_deviation"]["events"]),
            str(kinds["malfunction"]["events"]),
        ]
        name = f"{tag} (a wheel of another size)" if is_resized([tag]) else tag
        out.append("| " + " | ".join([name, TAGS[tag], *cells]) + " |")
    listed = [each for each in false["incidents"] if each["kind"] != "malfunction"]
    out += ["", "Incidents:", ""]
    out += [
        f"- `{each['name']}` ({', '.join(each['tags'])}): {each['kind']} of "
        f"{', '.join(map(str, each['wheels']))} at {each['at_s']:.0f} s"
        for each in listed[:MOST]
    ] or ["- none"]
    return out
