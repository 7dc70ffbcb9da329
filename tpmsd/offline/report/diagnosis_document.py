"""The diagnosis as the JSON document of `tpmsd diagnose --json`.

In: `RollingDiagnosis`. Out: plain objects.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from tpmsd.offline.diagnosis.assessment.reach import Reach
from tpmsd.offline.diagnosis.assessment.result import Finding, RadiusDrift, RollingDiagnosis, Where
from tpmsd.offline.report.alarms_compared import AlarmsCompared, alarms_document
from tpmsd.offline.report.diagnosis_sentences import summary_sentences


def diagnosis_document(
    diagnosis: RollingDiagnosis, model_file: str | None, alarms: Sequence[AlarmsCompared] = ()
) -> dict[str, Any]:
    """Return the document; `model_file` is where the extended model was written, `alarms` one entry per
    drive.
    """
    drift = diagnosis.drift
    unexplained = diagnosis.unexplained or (None if drift is None else drift.where)
    document: dict[str, Any] = {
        "summary": " ".join(summary_sentences(diagnosis)),
        "verdict": diagnosis.verdict,
        "reason": diagnosis.reason or None,
        "baseline": {
            "model": list(diagnosis.baseline),
            "heldout_rms": diagnosis.baseline_rms,
            "heldout_loglik_per_s": diagnosis.baseline_loglik_per_s,
        },
        "findings": [_finding_entry(finding) for finding in diagnosis.findings],
        "unexplained": {
            "significant": unexplained is not None,
            "where": None if unexplained is None else _location_entry(unexplained),
            "radius_drift": None if drift is None else _drift_entry(drift),
        },
        "certificate": _certificate_entry(diagnosis),
        "model_file": model_file,
        "driving_s": diagnosis.driving_s,
        "model": {"heldout_rms": diagnosis.model_rms},
        "not_detectable": _not_detectable_entries(diagnosis),
        "evidence": [{"effect": name, "gain": gain} for name, gain in diagnosis.evidence],
        "reach": None if diagnosis.reach is None else _reach_entry(diagnosis.reach),
    }
    document |= _optional_entries(diagnosis)
    if alarms:
        document["alarms"] = [alarms_document(compared) for compared in alarms]
    return document


def _optional_entries(diagnosis: RollingDiagnosis) -> dict[str, Any]:
    """Return the keys `information`, `down_weighted` and the like, each only if the diagnosis has such a
    result."""
    document: dict[str, Any] = {}
    if diagnosis.information:
        document["information"] = [
            {
                "covariate": "speed",
                "range": list(one.speed_mps),
                "driving_s": one.driving_s,
                "radius_std_m": one.radius_std_m,
            }
            for one in diagnosis.information
        ]
    if diagnosis.down_weighted is not None:
        removed = diagnosis.down_weighted
        document["down_weighted"] = {
            "share": removed.share,
            "channels": removed.by_channel,
            "time_spans": [list(span) for span in removed.time_spans],
        }
    if diagnosis.baseline == ("simulation",):
        document["simulation"] = {"effects": list(diagnosis.simulation)}
    if diagnosis.explanatory:
        document["explanatory"] = [asdict(one) for one in diagnosis.explanatory]
    if diagnosis.proposals:
        document["proposals"] = [asdict(one) for one in diagnosis.proposals]
    if diagnosis.notes:
        document["notes"] = list(diagnosis.notes)
    return document


def _not_detectable_entries(diagnosis: RollingDiagnosis) -> list[dict[str, Any]]:
    out = []
    for one in diagnosis.not_detectable:
        sizes = one.smallest.items()
        smallest = {name: {"value": value, "unit": unit} for name, (value, unit) in sizes}
        out.append({"effect": one.effect, "smallest": smallest})
    return out


def _certificate_entry(diagnosis: RollingDiagnosis) -> dict[str, Any] | None:
    if not diagnosis.replicates:
        return None
    return {
        "replicates": diagnosis.replicates,
        "negative_control": diagnosis.control,
        **({"proposals": [asdict(one) for one in diagnosis.proposals]} if diagnosis.proposals else {}),
        "remaining": None if diagnosis.remaining is None else asdict(diagnosis.remaining),
    }


def _reach_entry(reach: Reach) -> dict[str, Any]:
    return {
        "share": reach.share,
        "gain": reach.found,
        "left": reach.left,
        "left_std": reach.left_std,
        "structured": reach.structured,
        "channels": {
            name: {
                "gain": channel.found,
                "left": channel.left,
                "correlation": channel.correlation,
                "whiteness": channel.whiteness,
            }
            for name, channel in reach.channels.items()
        },
    }


def _finding_entry(finding: Finding) -> dict[str, Any]:
    out: dict[str, Any] = {
        "effect": finding.effect,
        "status": finding.status,
        "confidence": finding.confidence,
        "p_value": finding.p_value,
        **({"p_value_is_bound": True} if finding.p_value_is_bound else {}),
        "parameters": {
            name: {"value": quantity.value, "std": quantity.std, "unit": quantity.unit}
            for name, quantity in finding.parameters.items()
        },
        "where": _location_entry(finding.where),
        "heldout": {
            "rms_before": finding.rms_before,
            "rms_after": finding.rms_after,
            "loglik_gain_per_s": finding.loglik_gain_per_s,
            "loglik_gain": finding.gain,
        },
        "indistinguishable_from": list(finding.indistinguishable_from),
    }
    if finding.held_by:
        # `parameters` are the recording's values less these.
        out["held_by"] = finding.held_by
        out["simulation"] = {
            name: {"value": quantity.value, "std": quantity.std, "unit": quantity.unit}
            for name, quantity in finding.simulated.items()
        }
    if finding.drives:
        out["drives"] = list(finding.drives)
    if finding.advice:
        out["advice"] = finding.advice
    if finding.identified_by:
        out["identified_by"] = finding.identified_by
        out["told_by"] = finding.identified_by  # its former name
    if finding.shape:
        out["shape"] = [{"at": x, "value": value, "std": std} for x, value, std in finding.shape]
    return out


def _drift_entry(drift: RadiusDrift) -> dict[str, Any]:
    return {
        "relative_std": drift.relative_std,
        "time_constant_s": drift.time_constant_s,
        "drive": drift.drive or None,
    }


def _location_entry(where: Where) -> dict[str, Any]:
    return {
        "wheels": list(where.wheels),
        "channel": where.channel,
        "covariate": where.covariate,
        "range": None if where.range is None else list(where.range),
        "time_spans": [list(span) for span in where.time_spans],
    }
