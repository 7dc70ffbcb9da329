"""The catalogue of effects as plain values, text and a page of the docs.

In: the catalogue, and what a drive can identify. Out: a JSON document, a summary for the terminal, Markdown.
"""

from __future__ import annotations

import inspect
import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields
from typing import Any

from tpmsd.car.physics.catalogue import EFFECTS, probes, sentence_of
from tpmsd.car.physics.dynamics_catalogue import DYNAMICS_EFFECTS
from tpmsd.car.physics.dynamics_effect import DynamicsEffect
from tpmsd.car.physics.effect import AnyParameter, Effect, Kind, Parameter, VectorParameter, WheelParameter
from tpmsd.offline.diagnosis.assessment.identifiability import EffectIdentifiability


def effects_document(
    names: Sequence[str], drive: str = "", identifiable: Sequence[EffectIdentifiability] = ()
) -> dict[str, Any]:
    """Return the effects of these names; with a drive also the gain that each would have on it."""
    by_name = {one.effect: one for one in identifiable}
    out: dict[str, Any] = {"effects": [_effect_entry(name, EFFECTS[name]) for name in names]}
    if drive:
        out["drive"] = drive
        for entry in out["effects"]:
            one = by_name.get(entry["name"])
            entry["drive"] = None if one is None else _identifiability_entry(one)
    return out


def _effect_entry(name: str, effect: type[Effect]) -> dict[str, Any]:
    return {
        "name": name,
        "kind": effect.kind.value,
        "what": sentence_of(name),
        "formula": effect.wording.formula,
        "source": source_of(effect),
        "parameters": _parameter_entries(effect.parameters),
        "shows_in": {
            "channel": effect.identification.shows_in[0],
            "covariate": effect.identification.shows_in[1],
        },
        "needs": list(effect.identification.needs),
        "distinguished_by": effect.wording.distinguished_by,
        "telling_drive": effect.wording.distinguished_by,  # name of the key before
        "try": ready_command(effect),
    }


def _parameter_entries(parameters: Sequence[AnyParameter]) -> list[dict[str, Any]]:
    return [
        {
            "name": p.name,
            "unit": p.unit,
            "meaning": p.description,
            "typical": p.typical if isinstance(p, Parameter) else None,
            "range": [p.lower, p.upper] if isinstance(p, Parameter) else None,
            "prior": _prior_entry(p),
        }
        for p in parameters
    ]


def _prior_entry(parameter: object) -> dict[str, Any] | None:
    prior = parameter.prior if isinstance(parameter, Parameter) else None
    return None if prior is None else {"mean": prior.mean, "std": prior.std, "source": prior.source}


def _identifiability_entry(one: EffectIdentifiability) -> dict[str, Any]:
    return {
        "expected_gain_nats": one.expected_gain,
        "told": one.identifiable,
        "confounded_with": [{"effect": name, "cosine": cosine} for name, cosine in one.confounded_with],
        "separating_drive": one.drive,
    }


def dynamics_effect_document(name: str) -> dict[str, Any]:
    """Return an effect of the baselines of vehicle dynamics, with the keys of `effects_document`."""
    effect = DYNAMICS_EFFECTS[name]
    entry = {
        "name": name,
        "kind": effect.kind,
        "what": effect.wording.sentence,
        "formula": effect.wording.formula,
        "source": source_of(effect),
        "parameters": _parameter_entries(effect.parameters),
        "shows_in": {"channel": effect.channel, "covariate": effect.covariate},
        "distinguished_by": effect.wording.distinguished_by,
        "try": "tpmsd diagnose DRIVE --baseline " + ("three-dof" if effect.needs_forces else "single-track"),
    }
    return {"effects": [entry]}


def dynamics_effect_summary(name: str) -> str:
    """Return an effect of the baselines of vehicle dynamics for the terminal."""
    (entry,) = dynamics_effect_document(name)["effects"]
    return "\n".join([*_effect_lines(entry), f"  to look for it: {entry['try']}"])


def source_of(effect: type[Effect] | type[DynamicsEffect]) -> str:
    """Return the `Source:` of an effect's docstring; empty without one."""
    text = " ".join(inspect.cleandoc(effect.__doc__ or "").split())
    found = re.search(r"Source: (.*)", text)
    return found[1] if found else ""


def effects_summary(
    names: Sequence[str], drive: str = "", identifiable: Sequence[EffectIdentifiability] = ()
) -> str:
    """Return the effects for the terminal: one line each, or all about a single one."""
    if drive:
        return _drive_summary(names, drive, identifiable)
    if len(names) > 1:
        width = max(len(name) for name in names)
        return "\n".join(
            f"{name:{width}}  {EFFECTS[name].kind.value:10}  {sentence_of(name)}" for name in names
        )
    entry = _effect_entry(names[0], EFFECTS[names[0]])
    return "\n".join([*_effect_lines(entry), f"  to try it: {entry['try']}"])


def _effect_lines(entry: Mapping[str, Any]) -> list[str]:
    """Return name, formula, parameters, location and source of an effect; not the command that shows it."""
    lines = [f"{entry['name']} ({entry['kind']}): {entry['what']}.", f"  {entry['formula']}"]
    for p in entry["parameters"]:
        unit = f" ({p['unit']})" if p["unit"] else ""
        lines.append(f"  {p['name']}{unit}: {p['meaning']}")
        if p["prior"]:
            lines.append(f"      {p['prior']['mean']:g} +- {p['prior']['std']:g}: {p['prior']['source']}")
    lines.append(f"  shows in {entry['shows_in']['channel']} over {entry['shows_in']['covariate'] or 'time'}")
    if entry["distinguished_by"]:
        lines.append(f"  to tell it: {entry['distinguished_by']}")
    lines.append(f"  source: {entry['source']}")
    return lines


def ready_command(effect: type[Effect]) -> str:
    """Return a command that simulates a drive in which the effect acts at its typical value."""
    known = {one.name: one for one in effect.parameters}
    wanted = [one.name for one in fields(effect) if one.default is MISSING and one.default_factory is MISSING]
    acting = [p.name for p in effect.parameters if isinstance(p, Parameter) and p.probe > 0.0]
    if known and not set(acting[:1] or list(known)[:1]) & set(wanted):
        wanted += acting[:1] or _first_scalar_parameter(effect)
    values = ",".join(f"{name}={_typical_text(known[name])}" for name in known if name in wanted)
    text = f"{effect.name}:{values}" if values else effect.name
    bus = " --bus speeds" if "speeds" in effect.identification.needs else ""
    return f"tpmsd simulate drives/try{bus} --effect {shlex.quote(text)}"


def _first_scalar_parameter(effect: type[Effect]) -> list[str]:
    """Return the name of the first scalar parameter in a list; an empty one where there is none."""
    return [p.name for p in effect.parameters if isinstance(p, Parameter)][:1]


def _typical_text(parameter: AnyParameter) -> str:
    """Return a parameter's typical value as the command line takes it."""
    if isinstance(parameter, WheelParameter):
        return "rl"
    if isinstance(parameter, VectorParameter):
        return " ".join(f"{entry:g}" for entry in parameter.typical)
    if not isinstance(parameter, Parameter):
        return parameter.typical
    if parameter.prior is None:
        return f"{parameter.typical:g}"
    prior = parameter.prior
    size = max(abs(prior.mean - parameter.neutral), prior.std)
    if prior.mean < parameter.neutral and abs(prior.mean - parameter.neutral) >= prior.std:
        size = -size
    return f"{min(max(parameter.neutral + size, parameter.lower), parameter.upper):.3g}"


def _drive_summary(names: Sequence[str], drive: str, identifiable: Sequence[EffectIdentifiability]) -> str:
    lines = [f"What {drive} tells, at the usual size of each effect (nats of log-likelihood):"]
    for one in identifiable:
        if one.effect not in names:
            continue
        near = ", ".join(f"{name} ({cosine:.2f})" for name, cosine in one.confounded_with)
        near = f"  confounded with {near}" if near else ""
        lines.append(f"  {one.effect:28} {one.expected_gain:9.1f}{near}")
        if one.drive:
            lines.append(f"      {one.drive}")
    silent = [name for name in names if name not in {one.effect for one in identifiable}]
    if silent:
        lines.append(f"  without the readings for, or looked for apart: {' '.join(silent)}")
    return "\n".join(lines)


def effects_page() -> str:
    """Return the catalogue in Markdown: one row per effect with formula, parameters, priors and source."""
    lines = [
        "# The effects",
        "",
        "Generated by `tpmsd effects --markdown`; each row is one file of `tpmsd/car/physics/effects`.",
        "delta_r is the change of a wheel's effective rolling radius, a_x and a_y are specific",
        "forces (ISO 8855), v the speed.",
        "",
        "| effect | formula | parameters (unit): mean±standard deviation | source |",
        "|---|---|---|---|",
    ]
    for name, effect in EFFECTS.items():
        needs = f"<br>needs: {', '.join(effect.identification.needs)}" if effect.identification.needs else ""
        cells = [
            f"`{name}`",
            f"{effect.kind.value}: {sentence_of(name)}: {effect.wording.formula}{needs}",
            "<br>".join(_parameter_cell(p) for p in effect.parameters) or "none",
            source_of(effect),
        ]
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join([*lines, *_coverage_lines()]) + "\n"


def _coverage_lines() -> list[str]:
    """Return lines of Markdown: the data in which each effect is looked for, and what no effect covers."""
    lines = [
        "",
        "## Where effects are looked for",
        "",
        "In windows of a second, but for these. `tpmsd effects NAME` says which drive shows an effect.",
        "",
    ]
    windows = {probe.effect for probe in probes()}
    for name, effect in EFFECTS.items():
        if effect.kind not in (Kind.NUISANCE, Kind.NONPARAMETRIC):
            notes = [_looked_for_in(effect, name in windows)]
            if effect.confounding.confounded:
                same = ", ".join(f"`{other}`" for other in effect.confounding.confounded)
                notes.append(f"confounded with {same} on every drive")
            if note := "; ".join(filter(None, notes)):
                lines.append(f"- `{name}`: {note}")
    return [
        *lines,
        "",
        "## What no effect covers",
        "",
        "Not in the catalogue, since no drive that cars record shows it or no size is known:",
        "",
        *OPEN,
    ]


def _looked_for_in(effect: type[Effect], windows: bool) -> str:
    """Return the data in which an effect is looked for, in words; empty for windows of a second."""
    if effect.identification.reads:
        return "readings of " + ", ".join(f"`{one}`" for one in effect.identification.reads)
    if effect.identification.by_teeth:
        return "turns of each wheel"
    if effect.identification.at_walking_pace:
        return "fixes at walking pace"
    if effect.nonlinear.span:
        return "spans of time"
    if effect.nonlinear.ramp:
        return "steps and ramps over time"
    return "" if windows else "nothing: calibration takes it up"


OPEN = (
    "- temperature of each tyre: without a sensor in it, warm-up, sun and brakes are one number each",
    "- toe and camber as they are set: constants, which calibration takes up",
    "- gusts and crosswind: the wind of a whole drive is one vector, and shows beside free wheels alone",
    "- grip used up by braking and cornering together: the slips of axles are taken as independent of a_y",
    "- roll and bump steer, locks that close for a while, torque vectoring, brakes of a stability program",
    "- trailers that sway, and wheels out of balance: faster than a window of a second",
)
"""Physics of a car that no effect holds, and why."""


def _parameter_cell(p: Any) -> str:
    unit = f" ({p.unit})" if p.unit else ""
    usual = f": {p.prior.mean:g}±{p.prior.std:g}" if isinstance(p, Parameter) and p.prior else ""
    return f"`{p.name}`{unit} {p.description}{usual}"
