"""Joins a diagnosis with the truth.

In: `Truth`, the diagnosis's document and model, the windows. Out: one plain row.

- A finding is right if its name is that of something concealed (for `radius_change` and `tone_ring_error`:
  on the same wheel; for `unknown`: of no catalogue). Every other finding is false.
- Localisation: a drive's truth and findings each are sets of cells. A cell is a place (each wheel, the
  receiver, the gyro) in a second of driving; a truth covers its places in the seconds in which it acts (95 %
  of its energy by its covariate, or its time span), a finding those that its `where` says. All four wheels
  against the receiver are the same place as the receiver's speed. F1 is that of the two unions.
- Parameters are compared where every effect that acts can be told from all others.
- Held-out gain: the log-likelihood that the found model would bring on new noise along the same road, over
  that of the true one: 1 - |true - found|^2 / |true|^2 under the known noise, calibration taken out.
- Radius bias: root mean square over minutes of what the physics other than a change of radius adds to the
  radii as wheels and receiver show them (less each wheel's mean), before and after the found model.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.campaigns.offline.diagnosed import OWN_TYRES, is_drawn_lag
from bench.campaigns.offline.diagnosis.draw import Case
from bench.campaigns.offline.diagnosis.information import gram, without
from bench.campaigns.offline.diagnosis.signals import CHANNELS, Windows
from bench.campaigns.offline.diagnosis.truth import Concealed, Truth, alone, base_name, nuisances, rolling
from bench.worlds.course import Array
from bench.worlds.origins import ORIGINS

WHEELS = ("fl", "fr", "rl", "rr")
ROWS = (*WHEELS, "gnss", "yaw_rate")
ON_WHEELS = ("radius_change", "tone_ring_error")
UNSCORED = ("phase_rad",)
BLOCK = 60


def score(case: Case, truth: Truth, document: dict[str, Any], model: dict[str, Any], windows: Windows) -> Any:
    """One row for the results."""
    findings = document.get("findings", [])
    matched = match(truth, findings)
    wanted = [k for k, each in enumerate(truth.effects) if not each.inherent]
    detectable = [k for k in wanted if truth.effects[k].detectable]
    right = {k for k in matched if k is not None}
    age_s = case.spec.doppler_age_s
    strays = [n for n, k in enumerate(matched) if k is None and not _drawn(truth, age_s, findings[n])]
    # Effects of the world itself are not asked for, and count as no false finding.
    concealed = {n: k for n, k in enumerate(matched) if k is not None and not truth.effects[k].inherent}
    own = sorted({*strays, *concealed})
    first = bool(own) and matched[own[0]] in wanted
    row: dict[str, Any] = {
        **_stated(document),
        **_wanted([truth.effects[k] for k in wanted]),
        "detectable": len(detectable),
        "detectable_found": sum(k in right for k in detectable),
        "first": first,
        **_false(findings, strays),
        "hedged": _hedged(truth, findings),
        "errors": parameter_errors(truth, findings, matched),
        "place": [_places(truth.effects[k], findings[n]) for n, k in concealed.items()],
    }
    if detectable and not document.get("reason"):
        row["f1"] = localisation(truth, findings, windows)
    if detectable and not ORIGINS[case.world].own_tyres and "tone_ring_error" not in case.kind:
        row["heldout"], row["bias_mm"] = improvement(case, model, windows)
    return row


def _stated(document: dict[str, Any]) -> dict[str, Any]:
    """Columns about what the diagnosis stated: names with their confidence, verdict, unexplained mismatch."""
    findings = document.get("findings", [])
    return {
        "names": [_label(finding) for finding in findings],
        "confidences": [round(float(finding["confidence"]), 4) for finding in findings],
        "verdict": document.get("verdict", ""),
        "unexplained": bool(document.get("unexplained", {}).get("significant", False)),
    }


def _false(findings: list[dict[str, Any]], strays: list[int]) -> dict[str, Any]:
    """Columns about false findings, whose numbers are `strays`."""
    return {
        "false": [findings[n]["effect"] for n in strays],
        "strays": strays,
        "sure_wrong": any(findings[n]["confidence"] > 0.9 for n in strays),
    }


def _wanted(effects: list[Concealed]) -> dict[str, Any]:
    """Columns about the effects that are to be found, and how far a drive identifies them."""
    return {
        "wanted": [each.key for each in effects],
        "gains": [round(each.gain, 1) for each in effects],
        "margins": [round(each.margin, 1) for each in effects],
        "rivals": [each.alternative for each in effects],
    }


def _clear(truth: Truth) -> bool:
    """Whether no two effects share what the drive shows: else the one's parameters hold the other."""
    return all(each.detectable or each.gain < 4.0 for each in truth.effects if not each.inherent)


def match(truth: Truth, findings: list[dict[str, Any]]) -> list[int | None]:
    """For each finding, which of the truth's effects it is; each effect is found but once."""
    out: list[int | None] = []
    for finding in findings:
        hit = None
        for k, each in enumerate(truth.effects):
            if k in out or each.effect != finding["effect"]:
                continue
            if each.effect in ON_WHEELS and _wheel(finding) != each.parameters.get("wheel"):
                continue
            hit = k
            break
        if hit is None and finding["effect"] == "unknown":
            # several terms may describe one strange piece of physics
            again = [k for k, each in enumerate(truth.effects) if each.effect == "unknown"]
            hit = again[0] if again else None
        out.append(hit)
    return out


def _wheel(finding: dict[str, Any]) -> Any:
    return finding.get("parameters", {}).get("wheel", {}).get("value")


def _label(finding: dict[str, Any]) -> str:
    wheel = _wheel(finding)
    place = finding.get("where", {})
    if finding["effect"] == "unknown":
        return f"unknown {'/'.join(place.get('wheels', [])) or place.get('channel')} {place.get('covariate')}"
    return f"{finding['effect']} {wheel}" if wheel else str(finding["effect"])


def _drawn(truth: Truth, age_s: float, finding: dict[str, Any]) -> bool:
    """Return True if it may be what the world's own tyres do beyond the concealed effects, or is the lag of a
    receiver whose Doppler is `age_s` old."""
    if finding["effect"] == "velocity_lag" and age_s > 0.0:
        lag = finding["parameters"]["lag_s"]
        return is_drawn_lag(float(lag["value"]), float(lag["std"]), age_s)
    return truth.beyond > 16.0 and finding["effect"] in {"unknown", *OWN_TYRES}


def _hedged(truth: Truth, findings: list[dict[str, Any]]) -> bool:
    """Whether a name that is wanted stands in the first finding's list of what fits as well."""
    names = {each.effect for each in truth.effects}
    return bool(findings) and bool(names & set(findings[0].get("indistinguishable_from", [])))


def parameter_errors(
    truth: Truth, findings: list[dict[str, Any]], matched: list[int | None]
) -> list[list[Any]]:
    """[effect, parameter, error in standard deviations, relative error] of each parameter that was found;
    none where effects share what the drive shows."""
    out: list[list[Any]] = []
    if not _clear(truth):
        return out
    for finding, k in zip(findings, matched, strict=True):
        if k is None:
            continue
        for name, true in truth.effects[k].parameters.items():
            got = finding["parameters"].get(name)
            if name in UNSCORED or got is None or not isinstance(true, float):
                continue
            if isinstance(got["value"], str) or not got.get("std"):
                continue
            size = abs(true - 1.0) if name == "scale" else abs(true)
            error = float(got["value"]) - true
            relative = abs(error) / size if size > 0 else None
            out.append([finding["effect"], name, round(error / float(got["std"]), 3), relative])
    return out


def _places(each: Concealed, finding: dict[str, Any]) -> dict[str, bool]:
    where = finding["where"]
    return {
        "wheels": set(where["wheels"]) == set(each.wheels) or not each.wheels,
        "channel": where["channel"] in each.channels,
        "covariate": where["covariate"] in each.covariates
        or (where["covariate"] is None and "time" in each.covariates),
    }


def localisation(truth: Truth, findings: list[dict[str, Any]], windows: Windows) -> float:
    """F1 of the cells."""
    read = windows.read[:, 0]
    true, found = _true_cells(truth, len(windows))[:, read], _found_cells(truth, findings, windows)[:, read]
    both = int((true & found).sum())
    return round(2.0 * both / max(int(true.sum()) + int(found.sum()), 1), 4)


def _true_cells(truth: Truth, count: int) -> NDArray[np.bool_]:
    """(6, n) cells in which a detectable effect acts."""
    true = np.zeros((len(ROWS), count), bool)
    for each in truth.effects:
        if each.detectable:
            inside = _in_spans(each.spans, count)
            for place in each.wheels or (["yaw_rate"] if each.channels == ["yaw_rate"] else ["gnss"]):
                true[ROWS.index(place)] |= inside
    return true


def _found_cells(truth: Truth, findings: list[dict[str, Any]], windows: Windows) -> NDArray[np.bool_]:
    """(6, n) cells that the findings say."""
    count = len(windows)
    found = np.zeros((len(ROWS), count), bool)
    free_receiver = any(each.effect == "unknown" and not each.wheels for each in truth.effects)
    for finding in findings:
        where = finding["where"]
        inside = _in_spans(where["time_spans"], count) if where["time_spans"] else np.ones(count, bool)
        values = windows.covariates.get(where["covariate"] or "")
        if values is not None and where["range"] is not None:
            inside &= (values >= where["range"][0] - 1e-9) & (values <= where["range"][1] + 1e-9)
        places = where["wheels"] or (["yaw_rate"] if where["channel"] == "yaw_rate" else ["gnss"])
        if free_receiver and where["channel"] == "wheel" and len(places) == 4:
            places = ["gnss"]
        for place in places:
            found[ROWS.index(place)] |= inside
    return found


def _in_spans(spans: list[list[float]], count: int) -> np.ndarray:
    middle = np.arange(count) + 0.5
    inside = np.zeros(count, bool)
    for begin, end in spans:
        inside |= (middle >= begin) & (middle <= end)
    return inside


def found_change(case: Case, model: dict[str, Any], windows: Windows, radii: bool) -> Array:
    """(w, 9) what the found model adds to pure rolling; `radii` tells whether changes of radius count."""
    physics: dict[str, dict[str, Any]] = dict(rolling(case))
    free = np.zeros((len(windows), CHANNELS))
    still = windows.channels({})
    for number, effect in enumerate(model.get("effect", [])):
        name = effect["name"]
        values = {key: value for key, value in effect.items() if key not in ("name", "std")}
        if name == "unknown":
            free += _free(values, windows, still)
        elif name == "road_grade":
            physics.pop("no_shortening", None)
        elif name == "radius_change":
            if radii:
                physics[f"radius_change_{number}"] = values
        elif name != "tone_ring_error":
            physics[name] = values
    return np.asarray(windows.channels(physics) - windows.channels(rolling(case)) + free)


def _free(values: dict[str, Any], windows: Windows, still: Array) -> Array:
    out = np.zeros((len(windows), CHANNELS))
    x = windows.covariates.get(values["covariate"])
    if x is None:
        return out
    height = np.interp(x, values["knots"], values["heights"])
    rows = {"yaw_rate": 4, "gnss_speed": 5, "gnss_course": 6}
    if values["on"] in rows:
        out[:, rows[values["on"]]] = height
        return out
    for word in values["on"].split():
        wheel = WHEELS.index(word.removeprefix("-"))
        sign = -1.0 if word.startswith("-") else 1.0
        out[:, wheel] = -still[:, wheel] / windows.spec.radius_m * sign * height
    return out


def improvement(case: Case, model: dict[str, Any], windows: Windows) -> tuple[float, list[float]]:
    """Share of the reachable gain that was reached; bias of the radii in mm before and after."""
    own = windows.channels(rolling(case))
    keys = [key for key in case.wanted if base_name(key) != "tone_ring_error"]
    true = sum((windows.channels(alone(case, key)) - own for key in keys), np.zeros_like(own))
    left = true - found_change(case, model, windows, radii=True)
    columns = np.stack([true, left], axis=2)
    fixed = nuisances(windows)
    inner = without(
        gram(windows, np.concatenate([columns, fixed], axis=2)), list(range(2, 2 + fixed.shape[2]))
    )
    share = 1.0 - float(inner[1, 1]) / max(float(inner[0, 0]), 1e-300)
    physics = [key for key in keys if base_name(key) != "radius_change"]
    before = sum((windows.channels(alone(case, key)) - own for key in physics), np.zeros_like(own))
    after = before - found_change(case, model, windows, radii=False)
    return round(share, 4), [round(apparent_radius_mm(each, own, windows), 4) for each in (before, after)]


def apparent_radius_mm(change: Array, own: Array, windows: Windows) -> float:
    """Root mean square over minutes and wheels of the radius error that a change of the channels makes."""
    read = windows.read[:, 0]
    if read.sum() < BLOCK:
        return 0.0
    speed = np.where(windows.read[:, 5:6], change[:, 5:6], 0.0)
    distance = np.maximum(own[:, :4], 1.0)
    resembled = (windows.spec.radius_m * (speed - change[:, :4]) / distance)[read]
    blocks = resembled[: len(resembled) // BLOCK * BLOCK].reshape(-1, BLOCK, 4).mean(axis=1)
    return 1e3 * float(np.sqrt(((blocks - blocks.mean(axis=0)) ** 2).mean()))
