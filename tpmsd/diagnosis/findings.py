"""From chosen terms to findings that a reader understands.

In: a `Study` and its `Selection`. Out: `Diagnosis`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from tpmsd.diagnosis.advice import advice
from tpmsd.diagnosis.channels import CHANNEL_NAMES
from tpmsd.diagnosis.empirical import empirical_effect, shape_of
from tpmsd.diagnosis.evidence import Evidence, Fit
from tpmsd.diagnosis.reach import reach
from tpmsd.diagnosis.result import CONSISTENT, MISMATCH, Diagnosis, Finding, Inner, Quantity, Where
from tpmsd.diagnosis.selection import ADMIT, Chosen, Selection, Selector
from tpmsd.diagnosis.tangent import nonlinear_stds
from tpmsd.diagnosis.terms import ANTISYMMETRIC, PATTERNS, Term, group_gain
from tpmsd.diagnosis.tone_ring import ripples, wrong_teeth
from tpmsd.diagnosis.traces import ground, traces
from tpmsd.physics.catalogue import make_effect, parameters_of
from tpmsd.physics.effect import Effect, Parameter, Std
from tpmsd.physics.model import ExtendedModel
from tpmsd.wheels import WHEELS, FloatArray

if TYPE_CHECKING:
    from tpmsd.diagnosis.diagnose import Study

PLACE: dict[str, tuple[str, str | None]] = {
    "radius_change": ("wheel_ratio", "time"),
    "centrifugal_growth": ("wheel", "speed"),
    "thermal_growth": ("wheel", "time"),
    "load_transfer_longitudinal": ("wheel_ratio", "accel_long"),
    "load_transfer_lateral": ("wheel_ratio", "accel_lat"),
    "longitudinal_slip": ("wheel_ratio", "accel_long"),
    "lateral_slip": ("gnss_course", "accel_lat"),
    "road_grade": ("wheel", "grade"),
    "gnss_latency": ("gnss_speed", "accel_long"),
    "antenna_lever_arm": ("gnss_course", "yaw_rate"),
    "track_width_error": ("wheel_ratio", "yaw_rate"),
    "tone_ring_error": ("wheel_ratio", "wheel_angle"),
    "yaw_rate_bias": ("yaw_rate", "time"),
    "yaw_rate_scale": ("yaw_rate", "yaw_rate"),
}
"""Channel and covariate over which an effect shows."""
UNITS = {"gnss_speed": "m/s", "gnss_course": "rad", "yaw_rate": "rad/s"}
NEUTRAL = {"scale": 1.0}
"""What a parameter is where nothing is missing; fitted is the difference from it."""
STEP_S = 3.0
"""A ramp shorter than this is a step."""


def report(study: Study, selection: Selection, evidence: Evidence) -> Diagnosis:
    """Write the answer down."""
    seconds = float(len(study.reader.windows))
    rows = int(np.isfinite(study.reader.windows.measured).sum())
    stds = nonlinear_stds(study, selection)
    terms = [one.term for one in selection.chosen]
    selector = Selector(evidence, study.hypotheses)
    whole = float(selection.heldout.sum())
    findings = []
    effects: list[Effect] = []
    effect_stds: list[Mapping[str, Std]] = []
    for k, one in enumerate(selection.chosen):
        rest = terms[:k] + terms[k + 1 :]
        without = float(evidence.heldout(selector.design(rest)).sum())
        quantities = _quantities(one, stds.get(k, {}))
        where = _where(study, one, evidence, selection)
        findings.append(
            Finding(
                effect=one.term.effect,
                confidence=one.confidence,
                parameters=quantities,
                where=where,
                rms_before=_rms(without, rows),
                rms_after=_rms(whole, rows),
                loglik_gain_per_s=one.heldout_gain / seconds,
                gain=one.heldout_gain,
                indistinguishable_from=one.rivals,
                advice=advice(one.term.effect, one.rivals),
                shape=_shape(study, one),
            )
        )
        if one.term.effect == "unknown":
            free, heights = empirical_effect(one, study.smooth_knots[one.term.covariate])
            effects.append(free)
            effect_stds.append(heights)
        else:
            effect, known = _effect(one, quantities)
            effects.append(effect)
            effect_stds.append(known)
    covariates = [finding.where.covariate for finding in findings]
    for finding in _tone_rings(study, evidence.fit(study.hypotheses.nuisance), seconds):
        findings.append(finding)
        values = {name: quantity.value for name, quantity in finding.parameters.items()}
        effects.append(make_effect(finding.effect, **values))
        effect_stds.append(
            {name: q.std for name, q in finding.parameters.items() if q.std is not None and q.std > 0.0}
        )
    baseline = float(selection.baseline_heldout.sum())
    constant = -0.5 * study.log_variance - 0.5 * rows * math.log(2 * math.pi)
    return Diagnosis(
        verdict=MISMATCH if findings else CONSISTENT,
        reason="",
        findings=tuple(sorted(findings, key=lambda finding: -finding.gain)),
        driving_s=seconds,
        baseline_rms=_rms(baseline, rows),
        baseline_loglik_per_s=(baseline + constant) / seconds,
        model_rms=_rms(whole, rows),
        unexplained=_unexplained(study, selector, terms),
        model=ExtendedModel(tuple(effects), tuple(effect_stds)),
        evidence=_alone(study, selector),
        reach=reach(
            study.white,
            np.isfinite(study.reader.windows.measured),
            study.blocks,
            study.names,
            evidence,
            study.hypotheses.nuisance,
            selection.fit.design,
        ),
        inner=Inner(
            _by_channel(study, selection),
            tuple(traces(study, selection, evidence, covariates)),
            ground(study, selection, evidence),
        ),
    )


def _tone_rings(study: Study, calibration: Fit, seconds: float) -> list[Finding]:
    """Uneven or miscounted teeth, which are looked for apart from all else."""
    recording, reference = study.reader.recording, study.reader.reference
    out = []
    channel, covariate = PLACE["tone_ring_error"]
    for ripple in ripples(recording, reference):
        out.append(
            Finding(
                effect="tone_ring_error",
                confidence=1.0 - math.exp(-ripple.gain),
                parameters={
                    "wheel": Quantity(ripple.wheel, None, ""),
                    "amplitude_rad": Quantity(ripple.amplitude_rad, ripple.std_rad, "rad"),
                    "phase_rad": Quantity(ripple.phase_rad, ripple.phase_std_rad, "rad"),
                },
                where=Where((ripple.wheel,), channel, covariate, (0.0, 2.0 * math.pi)),
                rms_before=ripple.rms_before,
                rms_after=ripple.rms_after,
                loglik_gain_per_s=ripple.gain / seconds,
                gain=ripple.gain,
                indistinguishable_from=(),
            )
        )
    radii = reference.car.radius_m.copy()
    for k, wheel in enumerate(recording.wheels):
        radii[wheel] += calibration.values[k]
    for name, teeth in wrong_teeth(recording, radii):
        out.append(
            Finding(
                effect="tone_ring_error",
                confidence=0.9,
                parameters={
                    "wheel": Quantity(name, None, ""),
                    "teeth_per_rev": Quantity(teeth, 0.0, "1"),
                },
                where=Where((name,), channel, None, None),
                rms_before=1.0,
                rms_after=1.0,
                loglik_gain_per_s=0.0,
                gain=0.0,
                indistinguishable_from=(),
                advice="count the ring's teeth: a tyre of another size looks the same on the bus",
            )
        )
    return out


def _rms(score: float, rows: int) -> float:
    return math.sqrt(max(-2.0 * score, 0.0) / max(rows, 1))


def _quantities(one: Chosen, nonlinear: dict[str, float]) -> dict[str, Quantity]:
    term = one.term
    if term.effect == "unknown":
        return {}
    known = parameters_of(term.effect)
    out: dict[str, Quantity] = {}
    if term.wheel:
        out["wheel"] = Quantity(term.wheel, None, "")
    for name, value, std in zip(term.parameters, one.values, one.stds, strict=True):
        if name:
            wider = max(float(std), nonlinear.get(name, 0.0))
            out[name] = Quantity(float(value) + NEUTRAL.get(name, 0.0), wider, known[name].unit)
    if term.effect == "thermal_growth":
        std = nonlinear.get("time_constant_s", term.time_constant_s)
        out["time_constant_s"] = Quantity(term.time_constant_s, std, "s")
    if term.effect == "radius_change":
        onset, duration = term.span_s[0], term.span_s[1] - term.span_s[0]
        out["onset_s"] = Quantity(onset, nonlinear.get("onset_s", STEP_S), "s")
        step = duration < STEP_S
        out["duration_s"] = Quantity(0.0 if step else duration, nonlinear.get("duration_s", STEP_S), "s")
    return out


def _effect(one: Chosen, quantities: dict[str, Quantity]) -> tuple[Effect, dict[str, float]]:
    """The effect for the model file, within its bounds."""
    values: dict[str, float | str] = {}
    stds: dict[str, float] = {}
    for name, quantity in quantities.items():
        parameter = parameters_of(one.term.effect)[name]
        if isinstance(parameter, Parameter) and isinstance(quantity.value, float):
            values[name] = min(max(quantity.value, parameter.lower), parameter.upper)
            if quantity.std is not None and math.isfinite(quantity.std):
                stds[name] = quantity.std
        else:
            values[name] = quantity.value
    return make_effect(one.term.effect, **values), stds


def _where(study: Study, one: Chosen, evidence: Evidence, selection: Selection) -> Where:
    term = one.term
    wheels, channel, covariate = _place(study, term)
    if term.effect == "radius_change":
        spans = _spans(study, one)
        return Where(wheels, channel, "time", (spans[0][0], spans[-1][1]), spans)
    if term.effect == "unknown" and covariate == "time":
        return Where(wheels, channel, None, None, _spans(study, one))
    if covariate is None or covariate not in study.reader.windows.covariates:
        return Where(wheels, channel, None, None)
    values = study.reader.windows.covariates[covariate]
    weight = _energy(study, one, selection)
    return Where(wheels, channel, covariate, _quantiles(values, weight, 0.025, 0.975))


def _place(study: Study, term: Term) -> tuple[tuple[str, ...], str, str | None]:
    read = [WHEELS[k] for k in study.reader.recording.wheels]
    if term.effect == "unknown":
        if term.place in UNITS:
            return (), term.place, term.covariate
        if term.place in ANTISYMMETRIC:
            return tuple(read), "wheel_ratio", term.covariate
        wheels = PATTERNS[term.place]
        channel = "wheel" if set(wheels) == set(read) or len(read) < 4 else "wheel_ratio"
        return tuple(wheels), channel, term.covariate
    channel, covariate = PLACE[term.effect]
    car = study.reader.reference.car
    driven = tuple(w for k, w in enumerate(WHEELS) if car.driven[k] and w in read)
    if term.effect == "radius_change":
        return (term.wheel,), channel if len(read) == 4 else "wheel", covariate
    if term.effect == "longitudinal_slip":
        return driven, channel if len(driven) < len(read) else "wheel", covariate
    if term.effect == "track_width_error":
        rear = "rear_m" in term.parameters
        front = "front_m" in term.parameters
        on = {"rl": rear, "rr": rear, "fl": front, "fr": front}
        return tuple(w for w in read if on[w]), channel, covariate
    if channel.startswith(("gnss", "yaw")):
        measured = np.isfinite(study.reader.windows.measured)
        if channel == "gnss_speed" and measured[:, 5].sum() < 30:
            channel, covariate = "gnss_position", "speed"
        if channel == "gnss_course" and measured[:, 6].sum() < 30:
            channel = "gnss_position"
        return (), channel, covariate
    return tuple(read), channel, covariate


def _energy(study: Study, one: Chosen, selection: Selection) -> FloatArray:
    """(w,) how much each window says for the term, once calibration has taken up its mean."""
    response = study.white @ (one.term.design @ one.values)
    flat = response.reshape(-1)
    nuisance = (study.white @ study.hypotheses.nuisance).reshape(flat.size, -1)
    left = flat - nuisance @ np.linalg.lstsq(nuisance, flat, rcond=None)[0]
    return np.asarray((left.reshape(response.shape) ** 2).sum(axis=1))


def _quantiles(values: FloatArray, weight: FloatArray, low: float, high: float) -> tuple[float, float]:
    order = np.argsort(values)
    share = np.cumsum(weight[order]) / max(float(weight.sum()), 1e-300)
    a, b = np.interp([low, high], share, values[order])
    return float(a), float(b)


def _spans(study: Study, one: Chosen) -> tuple[tuple[float, float], ...]:
    """When the mismatch stands: from a ramp's onset on; where a smooth term over time is beyond half its
    height.
    """
    end = float(study.reader.recording.edges_s[-1])
    if one.term.effect == "radius_change":
        return ((max(one.term.span_s[0], 0.0), end),)
    knots = study.smooth_knots[one.term.covariate]
    level = np.concatenate([[0.0], one.values])
    level = level - np.median(level)
    grid = np.linspace(0.0, end, 400)
    on = np.abs(np.interp(grid, knots, level)) > 0.5 * np.abs(level).max()
    edge = np.diff(np.concatenate([[0], on.astype(int), [0]]))
    starts, ends = np.flatnonzero(edge == 1), np.flatnonzero(edge == -1) - 1
    return tuple((float(grid[a]), float(grid[b])) for a, b in zip(starts, ends, strict=True))


def _shape(study: Study, one: Chosen) -> tuple[tuple[float, float, float], ...]:
    if one.term.effect != "unknown":
        return ()
    return shape_of(one, study.smooth_knots[one.term.covariate])


def _unexplained(study: Study, selector: Selector, terms: list[Term]) -> Where | None:
    """Structure that is still significant after the chosen terms."""
    options = selector.candidates(terms)
    for net, found in options[:3]:
        term = found[0]
        ratio = selector.ratio([*terms, term], len(terms))
        gain = (net + term.penalty) / ratio - term.penalty
        rest = evidence_gain(selector, terms, term)
        if gain > 2 * ADMIT and rest > ADMIT:
            wheels, channel, covariate = _place(study, term)
            if covariate is None or covariate not in study.reader.windows.covariates:
                return Where(wheels, channel, None, None)
            values = study.reader.windows.covariates[covariate]
            return Where(wheels, channel, covariate, (float(values.min()), float(values.max())))
    return None


def evidence_gain(selector: Selector, terms: list[Term], more: Term) -> float:
    """Held-out gain of one more term."""
    evidence = selector.evidence
    with_it = evidence.heldout(selector.design([*terms, more])).sum()
    return float(with_it - evidence.heldout(selector.design(terms)).sum())


def _alone(study: Study, selector: Selector) -> tuple[tuple[str, float], ...]:
    """Gain of each effect alone."""
    gram, b = selector.evidence.projected(selector.design([]))
    best: dict[str, float] = {}
    for term in study.hypotheses.catalogue:
        gain, _ = group_gain(term.design[1:], gram, b)
        best[term.effect] = max(best.get(term.effect, 0.0), gain)
    for gain, term in study.hypotheses.ramp_gains(gram, b):
        name = f"radius_change {term.wheel}"
        best[name] = max(best.get(name, 0.0), gain)
    return tuple(sorted(best.items(), key=lambda entry: -entry[1]))


def _by_channel(study: Study, selection: Selection) -> dict[str, tuple[float, float]]:
    """Root mean square of the whitened residual by channel, before and after."""
    nuisance = study.hypotheses.nuisance
    rows = study.white.reshape(-1, nuisance.shape[0])
    values = np.asarray(np.linalg.lstsq(rows @ nuisance, rows[:, 0], rcond=None)[0], dtype=np.float64)
    before = study.residual(nuisance, values)
    after = study.residual(selection.fit.design, selection.fit.values)
    out: dict[str, tuple[float, float]] = {}
    here = np.isfinite(study.reader.windows.measured)
    for name in dict.fromkeys(CHANNEL_NAMES):
        mask = here & np.array([channel == name for channel in CHANNEL_NAMES])[None, :]
        if mask.any():
            out[name] = (
                float(np.sqrt((before[mask] ** 2).mean())),
                float(np.sqrt((after[mask] ** 2).mean())),
            )
    return out
