"""The figures of a run of the benchmark, with their confidence intervals.

In: rows. Out: plain figures, and the same as Markdown. Shares bear 95 % intervals of Clopper and Pearson
(Biometrika 26, 1934).
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from bench.campaigns.offline.diagnosis.truth import seen_as
from bench.statistics import count, percent, share

Row = dict[str, Any]


def is_clean(row: Row) -> bool:
    """Nothing was concealed and the world rolls purely, its radii still."""
    return str(row["kind"]) == "nothing"


def summary(rows: Sequence[Row]) -> dict[str, Any]:
    """All figures."""
    failed = [row for row in rows if row.get("error")]
    done = [row for row in rows if not row.get("error")]
    judged = [row for row in done if not row.get("reason")]
    plain = [row for row in judged if not is_clean(row) and row["kind"] != "nothing_wander"]
    return {
        "drives": len(rows),
        "failed": len(failed),
        "insufficient": len(done) - len(judged),
        **_of_null_drives(judged),
        **_of_names(judged, plain),
        **_of_strange_physics(plain),
        **_of_values(plain),
        "realtime_factor": _quantiles([row["duration_s"] / row["cpu_s"] for row in judged]),
        "alarms": _alarms(judged),
        "by_kind": _by_kind(plain),
        "failures": [
            f"{row['kind']} x{row['strength']:g} seed {row['seed']}: {row['error']}" for row in failed
        ],
    }


def _of_null_drives(judged: Sequence[Row]) -> dict[str, Any]:
    """False discoveries on drives in which nothing was concealed."""
    clean = [row for row in judged if is_clean(row)]
    return {
        "clean_wrong": count(row["names"] for row in clean),
        "clean_wrong_even_doppler": count(row["names"] for row in clean if row["receiver"][2] == 0.0),
        "clean_wrong_late_doppler": count(row["names"] for row in clean if row["receiver"][2] > 0.0),
        "wander_found": count(row["names"] for row in judged if row["kind"] == "nothing_wander"),
        "multibody_clean_false": count(row["false"] for row in judged if row["kind"] == "mb/nothing"),
    }


def _of_names(judged: Sequence[Row], plain: Sequence[Row]) -> dict[str, Any]:
    """Names that were right, and false ones, where one effect or several are concealed."""
    known = [row for row in plain if _single(row) and not _strange(row)]
    several = [row for row in plain if row["detectable"] >= 2]
    findings = sum(len(row["names"]) for row in judged)
    return {
        "first_by_strength": {
            f"{size:g}": count(row["first"] for row in known if row["strength"] == size and row["detectable"])
            for size in sorted({row["strength"] for row in known})
        },
        "false_discoveries": share(sum(len(row["false"]) for row in judged), findings),
        "sure_wrong": count(row["sure_wrong"] for row in judged),
        "several_found": share(
            sum(row["detectable_found"] for row in several), sum(row["detectable"] for row in several)
        ),
        "several_all": count(row["detectable_found"] == row["detectable"] for row in several),
    }


def _of_strange_physics(plain: Sequence[Row]) -> dict[str, Any]:
    """Names where the concealed physics is in no catalogue."""
    strange = [row for row in plain if _strange(row) and row["detectable"]]
    return {
        "unknown_named": count(row["detectable_found"] > 0 for row in strange),
        "unknown_sure_wrong": count(row["sure_wrong"] for row in strange),
    }


def _of_values(plain: Sequence[Row]) -> dict[str, Any]:
    """Where and how much: localisation, parameters with their intervals, held-out gain, bias of radii."""
    errors = [error for row in plain for error in row["errors"]]
    return {
        "localisation_f1": _mean([row["f1"] for row in plain if "f1" in row]),
        "places": {
            part: count(place[part] for row in plain for place in row["place"])
            for part in ("wheels", "channel", "covariate")
        },
        "coverage": share(sum(abs(error[2]) < 1.96 for error in errors), len(errors)),
        "by_parameter": _by_parameter(errors),
        "heldout_share": _quantiles([row["heldout"] for row in plain if "heldout" in row]),
        "bias_mm": _bias(plain),
    }


def _single(row: Row) -> bool:
    return len(row["wanted"]) == 1 and not str(row["kind"]).startswith("small")


def _strange(row: Row) -> bool:
    return any(seen_as(str(key)) == "unknown" for key in row["wanted"])


def _mean(values: Sequence[float]) -> dict[str, Any]:
    if not values:
        return {"mean": None, "of": 0}
    error = float(np.std(values) / np.sqrt(len(values)))
    mean = float(np.mean(values))
    return {"mean": mean, "low": mean - 1.96 * error, "high": mean + 1.96 * error, "of": len(values)}


def _quantiles(values: Sequence[float]) -> dict[str, Any]:
    if not values:
        return {"of": 0}
    low, middle, high = (float(q) for q in np.quantile(values, [0.1, 0.5, 0.9]))
    return {"of": len(values), "p10": low, "median": middle, "p90": high, "mean": float(np.mean(values))}


def _by_parameter(errors: list[list[Any]]) -> dict[str, Any]:
    out = {}
    for key in sorted({(error[0], error[1]) for error in errors}):
        those = [error for error in errors if (error[0], error[1]) == key]
        relative = [error[3] for error in those if error[3] is not None]
        out[" ".join(key)] = {
            "coverage": share(sum(abs(error[2]) < 1.96 for error in those), len(those)),
            "median_relative": float(np.median(np.abs(relative))) if relative else None,
        }
    return out


def _bias(rows: Sequence[Row]) -> dict[str, Any]:
    pairs = [row["bias_mm"] for row in rows if "bias_mm" in row and row["bias_mm"][0] > 0.02]
    if not pairs:
        return {"of": 0}
    before, after = np.array(pairs).T
    return {"of": len(pairs), "before": float(np.median(before)), "after": float(np.median(after))}


def _alarms(rows: Sequence[Row]) -> dict[str, Any]:
    asked = [row for row in rows if row.get("alarms")]
    leaking = [row for row in asked if "radius_change" in row["kind"] or "leak" in row["kind"]]
    whole = [row for row in asked if row not in leaking]
    return {
        "false_alarms": [sum(row["alarms"][k] for row in whole) for k in (0, 1)],
        "of_drives_without_leak": len(whole),
        "drives_with_alarm_of_leaks": [sum(row["alarms"][k] > 0 for row in leaking) for k in (0, 1)],
        "of_drives_with_leak": len(leaking),
    }


def _by_kind(rows: Sequence[Row]) -> list[dict[str, Any]]:
    out = []
    for kind, size in dict.fromkeys((row["kind"], row["strength"]) for row in rows):
        those = [row for row in rows if (row["kind"], row["strength"]) == (kind, size)]
        reported = [row for row in those if row["detectable"]]
        out.append(
            {
                "kind": kind,
                "strength": size,
                "drives": len(those),
                "detectable": len(reported),
                "first": count(row["first"] for row in reported),
                "found": share(
                    sum(row["detectable_found"] for row in reported),
                    sum(row["detectable"] for row in reported),
                ),
                "false": sum(len(row["false"]) for row in those),
                "gain": float(np.median([min(row["gains"]) for row in those])) if those[0]["gains"] else None,
            }
        )
    return out


def markdown(figures: dict[str, Any]) -> str:
    """The figures as tables."""
    rows = [
        ("null drives with a finding", percent(figures["clean_wrong"]), "at most 1 %"),
        ("- receiver's Doppler as old as its position", percent(figures["clean_wrong_even_doppler"]), ""),
        ("- Doppler 20 to 100 ms older", percent(figures["clean_wrong_late_doppler"]), ""),
        (
            "- multi-body car, null drive: with a false name",
            percent(figures["multibody_clean_false"]),
            "",
        ),
        ("- radius drift of 0.02 to 0.05 %, with a finding", percent(figures["wander_found"]), ""),
    ]
    bars = {"0.5": "80 %", "1": "95 %"}
    for size, figure in figures["first_by_strength"].items():
        if size != "0":
            rows.append((f"right name first at strength {size}", percent(figure), bars.get(size, "")))
    f1 = figures["localisation_f1"]
    heldout, bias = figures["heldout_share"], figures["bias_mm"]
    rows += [
        ("false discoveries among findings", percent(figures["false_discoveries"]), "at most 5 %"),
        ("drives with a wrong name above 0.9", percent(figures["sure_wrong"]), ""),
        ("several at once: effects found", percent(figures["several_found"]), "90 %"),
        ("several at once: all found", percent(figures["several_all"]), ""),
        ("`unknown` for what no catalogue holds", percent(figures["unknown_named"]), "90 %"),
        ("- of these with a wrong name above 0.9", percent(figures["unknown_sure_wrong"]), "never"),
    ]
    if f1["of"]:
        text = f"{f1['mean']:.3f} [{f1['low']:.3f}, {f1['high']:.3f}] ({f1['of']} drives)"
        rows.append(("localisation F1, mean", text, "0.8"))
    for part, figure in figures["places"].items():
        rows.append((f"- right {part} of right names", percent(figure), ""))
    rows.append(("95 % intervals that hold the truth", percent(figures["coverage"]), "90 to 98 %"))
    if heldout["of"]:
        text = f"median {heldout['median']:.3f}, p10 {heldout['p10']:.3f} ({heldout['of']} drives)"
        rows.append(("held-out gain over that of the true model", text, "0.9"))
    if bias["of"]:
        text = f"{bias['before']:.3f} mm before, {bias['after']:.3f} mm after ({bias['of']} drives)"
        rows.append(("bias of the radii by physics, median", text, ""))
    alarms = figures["alarms"]
    if alarms["of_drives_without_leak"] + alarms["of_drives_with_leak"]:
        false, hit = alarms["false_alarms"], alarms["drives_with_alarm_of_leaks"]
        text = f"{false[0]} before, {false[1]} after, on {alarms['of_drives_without_leak']} drives"
        rows.append(("false alarms of `tpmsd replay`", text, ""))
        text = f"{hit[0]} before, {hit[1]} after, of {alarms['of_drives_with_leak']}"
        rows.append(("leaking drives with an alarm", text, ""))
    speed = figures["realtime_factor"]
    if speed["of"]:
        text = f"median {speed['median']:.0f}, p10 {speed['p10']:.0f}"
        rows.append(("times faster than real time, one core, reading included", text, "100 on two cores"))
    out = [f"{figures['drives']} drives, {figures['failed']} failed, {figures['insufficient']} refused.", ""]
    out += ["| figure | measured | bar |", "| --- | --- | --- |"]
    out += [f"| {name} | {value} | {bar} |" for name, value, bar in rows]
    out += ["", *_kinds(figures["by_kind"]), ""]
    if figures["by_parameter"]:
        parts = [_parameter(name, each) for name, each in figures["by_parameter"].items()]
        out.append(f"Median relative error (95 % intervals that miss the truth): {', '.join(parts)}.")
    if figures["failures"]:
        out += ["", "Failed:", "", *(f"- {line}" for line in figures["failures"])]
    return "\n".join(out) + "\n"


def _parameter(name: str, figures: Mapping[str, Any]) -> str:
    """Return a parameter with its median relative error, and the number of its intervals that miss."""
    relative = "" if figures["median_relative"] is None else f" {100 * figures['median_relative']:.1f} %"
    held = figures["coverage"]
    missed = held["of"] - held["hits"]
    return f"{name}{relative}" + (f" ({missed} of {held['of']})" if missed else "")


def _kinds(by_kind: Sequence[dict[str, Any]]) -> list[str]:
    """Return a table of the kinds with a miss or a false name, and lists of the others."""
    lines, blind = [], []
    kinds = drives = 0
    for each in by_kind:
        first, found = (f"{each[key]['hits']}/{each[key]['of']}" for key in ("first", "found"))
        if each["false"] or any(each[key]["hits"] < each[key]["of"] for key in ("first", "found")):
            gain = "" if each["gain"] is None else f"{each['gain']:.3g}"
            can = f"{each['kind']} | {each['strength']:g} | {each['detectable']}/{each['drives']}"
            lines.append(f"| {can} | {first} | {found} | {each['false']} | {gain} |")
        elif each["detectable"]:
            kinds, drives = kinds + 1, drives + each["detectable"]
        else:
            blind.append(f"{each['kind']} {each['drives']}")
    head = [
        "| kind missed | strength | identifiable | right name first | effects found | false names"
        " | gain, nats |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    rest = f"The right name is first on all {drives} other drives that identify it, of {kinds} kinds."
    return [*head, *lines, "", rest, f"No drive identifies: {', '.join(blind) or 'none'}."]


def wrong(row: Row) -> list[str]:
    """What is wrong with a row's diagnosis, in words."""
    if row.get("error"):
        return [str(row["error"])]
    out = []
    if row.get("reason"):
        out.append(f"refused: {row['reason']}")
    if row["false"]:
        out.append("false: " + ", ".join(row["false"]))
    if row["detectable_found"] < row["detectable"]:
        out.append("missed")
    elif row["detectable"] and not row["first"] and len(row["wanted"]) == 1:
        out.append("right name is not first")
    far = [
        f"{error[0]}.{error[1]} off by {error[2]:.1f} std" for error in row["errors"] if abs(error[2]) > 3.5
    ]
    if far:
        out.append("; ".join(far))
    if row.get("f1", 1.0) < 0.6 and row["detectable_found"] == row["detectable"]:
        out.append(f"localisation F1 {row['f1']:.2f}")
    if row.get("heldout", 1.0) < 0.8 and row["detectable_found"] == row["detectable"]:
        out.append(f"held-out share {row['heldout']:.2f}")
    return out


def failing(rows: Sequence[Row], state: str) -> str:
    """The drives whose diagnosis is wrong, each with the command that writes its folder again."""
    bad = [(row, wrong(row)) for row in rows if wrong(row)]
    out = [f"{len(rows)} drives, the last by the program's state {state}; wrong: {len(bad)}", ""]
    late = [
        row
        for row, _ in bad
        if (row.get("receiver") or [0, 0, 0])[2] > 0 and "gnss_latency" in row.get("false", [])
    ]
    out += [f"Of these with gnss_latency where only the Doppler is old: {len(late)}", ""]
    for row, reasons in sorted(bad, key=lambda entry: (str(entry[0]["kind"]), entry[0]["strength"])):
        out.append(f"## {row['kind']} x{row['strength']:g} seed {row['seed']}: {' | '.join(reasons)}")
        out.append(f"- truth: {json.dumps(row.get('truth', {}))}")
        out.append(
            f"- identifiable {row.get('detectable')} of {row.get('wanted')}: gains {row.get('gains')}, "
            f"margins {row.get('margins')} against {row.get('rivals')}"
        )
        for finding in row.get("found", []):
            out.append(f"- found: {json.dumps(finding)}")
        out.append(
            f"- receiver (Hz, course, Doppler age) {row.get('receiver')}, bus (signal, Hz, teeth, gyro, "
            f"accelerometers) {row.get('bus')}, held-out {row.get('heldout')}, F1 {row.get('f1')}"
        )
        out.append(
            f"- `python -m bench run diagnosis --write CASE --kind {row['kind']} "
            f"--strength {row['strength']:g} --seed {row['seed']}`"
        )
        out.append("")
    return "\n".join(out)
