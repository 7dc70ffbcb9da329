"""The diagnosis of vehicle dynamics for JSON.

In: `DynamicsDiagnosis`. Out: plain objects with the keys of `tpmsd.diagnosis/2`, and those of section 6 of
the public formats.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from tpmsd.car.physics.dynamics_effect import DynamicsEffect
from tpmsd.offline.dynamics.result import (
    FINDING,
    DynamicsDiagnosis,
    DynamicsFinding,
    FittedNuisance,
    FittedNumber,
)
from tpmsd.offline.dynamics.summary import summary_sentences


def dynamics_document(diagnosis: DynamicsDiagnosis, model_file: str | None) -> dict[str, Any]:
    """Return the document; `model_file` is where the extended model was written."""
    unknown = next((one for one in diagnosis.findings if one.effect == "unknown"), None)
    first = next(iter(diagnosis.outputs.values()), None)
    return {
        "verdict": diagnosis.verdict,
        "reason": diagnosis.reason or None,
        "summary": " ".join(summary_sentences(diagnosis)),
        "baseline": {
            "name": diagnosis.baseline,
            "model": [diagnosis.baseline, *diagnosis.given],
            "speed": "output" if diagnosis.forces else "input",
            "heldout_rms": None if first is None else first.rms_before,
            "heldout_loglik_per_s": None,
        },
        "findings": [_finding(one) for one in diagnosis.findings],
        "outputs": {
            name: {
                "unit": fit.unit,
                "rms_before": fit.rms_before,
                "rms_after": fit.rms_after,
                "rating_before": fit.rating_before,
                "rating_after": fit.rating_after,
            }
            for name, fit in diagnosis.outputs.items()
        },
        "steps": [{"effects": list(step.effects), "rms": dict(step.rms)} for step in diagnosis.steps],
        "unexplained": {
            "significant": unknown is not None,
            "where": None if unknown is None else _where(unknown),
        },
        "not_detectable": [
            {
                "effect": one.effect,
                "smallest": {
                    name: {"value": size, "unit": unit} for name, (size, unit) in one.smallest.items()
                },
            }
            for one in diagnosis.not_detectable
        ],
        "certificate": _certificate(diagnosis),
        "model_file": model_file,
        "driving_s": diagnosis.driving_s,
        "model": {
            "effects": [one.effect for one in diagnosis.findings if one.status == FINDING],
            "heldout_rms": None if first is None else first.rms_after,
            "loglik_gain_per_s": diagnosis.loglik_gain_per_s,
            "noise": dict(diagnosis.noise),
        },
        **_nonempty_lists(diagnosis),
    }


def _nonempty_lists(diagnosis: DynamicsDiagnosis) -> dict[str, Any]:
    """Return the lists of the document that are left out where they are empty."""
    lists = {
        "proposals": [asdict(one) for one in diagnosis.proposals],
        "notes": list(diagnosis.notes),
        "nuisances": [_nuisance(one) for one in diagnosis.nuisances],
        "simulation_effects": [_effect(one) for one in diagnosis.simulated or ()],
    }
    return {name: entries for name, entries in lists.items() if entries}


def _effect(one: DynamicsEffect) -> dict[str, Any]:
    """Return the entry of an effect of the extended model."""
    return {
        "effect": one.name,
        "parameters": {p.name: {"value": getattr(one, p.name), "unit": p.unit} for p in one.numbers()},
    }


def _nuisance(one: FittedNuisance) -> dict[str, Any]:
    """Return the entry of a fitted nuisance."""
    return {"effect": one.effect, "parameters": _parameters(one.parameters)}


def _parameters(parameters: Mapping[str, FittedNumber]) -> dict[str, Any]:
    """Return value, standard deviation and unit of each parameter, by name."""
    return {name: {"value": one.value, "std": one.std, "unit": one.unit} for name, one in parameters.items()}


def _certificate(diagnosis: DynamicsDiagnosis) -> dict[str, Any] | None:
    """Return the entry of the certificate; None without one."""
    one = diagnosis.certificate
    if one is None:
        return None
    return {
        "replicates": one.replicates,
        "remaining": {
            "gain": one.remaining_gain,
            "p_value": one.remaining_p_value,
            "exceeded": one.remaining_exceeded,
            "replicates": one.remaining_replicates,
        },
    }


def _where(finding: DynamicsFinding) -> dict[str, Any]:
    """Return the entry of a finding's location."""
    where = finding.where
    return {
        "wheels": [],
        "channel": where.channel,
        "covariate": where.covariate,
        "range": None if where.range is None else list(where.range),
        "time_spans": [list(span) for span in where.time_spans],
    }


def _finding(finding: DynamicsFinding) -> dict[str, Any]:
    """Return the entry of a finding."""
    out: dict[str, Any] = {
        "effect": finding.effect,
        "status": finding.status,
        "confidence": finding.confidence,
        "p_value": finding.p_value,
        **({"p_value_is_bound": True} if finding.p_value_is_bound else {}),
        "parameters": _parameters(finding.parameters),
        "where": _where(finding),
        "heldout": {
            "rms_before": finding.rms_before,
            "rms_after": finding.rms_after,
            "loglik_gain_per_s": finding.loglik_gain_per_s,
            "loglik_gain": finding.loglik_gain,
        },
        "log_evidence": finding.evidence,
        "indistinguishable_from": list(finding.indistinguishable_from),
    }
    if finding.may_be_proxy:
        out["stand_in"] = True  # the former name of the next one
        out["may_be_proxy"] = True
    if finding.acts_on:
        out["acts_on"] = finding.acts_on
    if finding.shape:
        out["shape"] = [{"at": x, "value": value, "std": std} for x, value, std in finding.shape]
    if finding.indistinguishable_from and finding.distinguished_by:
        out["advice"] = finding.distinguished_by
    return out
