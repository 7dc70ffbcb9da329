"""Identifiability of each effect of the catalogue on a drive, and the effects that it confounds.

In: a `Regression`. Out: per effect the log-likelihood gain to be expected at its typical value, and the
effects whose whitened sensitivities lie close to its own, by principal angles (Bjoerck and Golub, Mathematics
of Computation 27, 1973). Calibration is projected out of both. Nothing is fitted to the data but the noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.catalogue import EFFECTS
from tpmsd.car.physics.effect import Effect, Parameter
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.hypotheses.terms import Term
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.diagnosis.settings import SETTINGS


@dataclass(frozen=True)
class EffectIdentifiability:
    """One effect on one drive."""

    effect: str
    expected_gain: float
    """Nats at the usual size (the larger of the prior's mean and its standard deviation)."""
    confounded_with: tuple[tuple[str, float], ...]
    """Names and cosines, the nearest first."""
    drive: str
    """Recommended manoeuvre to separate it from the nearest; empty where nothing is near."""

    @property
    def identifiable(self) -> bool:
        """True if an effect of the usual size would gain enough log-likelihood to be identified."""
        return self.expected_gain >= SETTINGS.assessment.identifiable_nats


def identifiability(regression: Regression) -> tuple[EffectIdentifiability, ...]:
    """Return all effects that the drive has readings for, by the gain that each has at its prior's size."""
    evidence = regression.evidence()
    gram, _ = evidence.projected(regression.hypotheses.nuisance)
    terms = _fullest_terms(regression.hypotheses.catalogue)
    bases = {name: _orthonormal_basis(term, gram) for name, term in terms.items()}
    out = []
    for name, term in terms.items():
        size = np.array([prior_scale(term.kind_of, parameter) for parameter in term.parameters])
        gain = 0.5 * float(size @ term.design[1:].T @ gram @ term.design[1:] @ size)
        near = {other: _principal_cosine(bases[name], bases[other], gram) for other in terms if other != name}
        similar = tuple(
            (other, cosine)
            for other, cosine in sorted(near.items(), key=lambda e: -e[1])
            if cosine > SETTINGS.assessment.confounded_cosine
        )
        out.append(
            EffectIdentifiability(
                name, gain, similar, separating_manoeuvre(name, tuple(other for other, _ in similar))
            )
        )
    return tuple(sorted(out, key=lambda one: -one.expected_gain))


def _fullest_terms(catalogue: list[Term]) -> dict[str, Term]:
    """Return, by effect, its term with the most values, at the middle of its grid and on its first wheel
    pattern."""
    out: dict[str, Term] = {}
    for term in catalogue:
        if term.drive is None and term.typical and not term.calibrates and not term.nonparametric:
            known = out.get(term.effect)
            if known is None or term.design.shape[1] > known.design.shape[1]:
                out[term.effect] = term
    return out


def prior_scale(effect: type[Effect], parameter: str) -> float:
    """Return the usual difference of a parameter from neutral: the larger of its prior's mean and standard
    deviation."""
    for one in effect.parameters:
        if isinstance(one, Parameter) and one.name == parameter:
            if one.prior is None:
                return one.typical - one.neutral
            return max(abs(one.prior.mean - one.neutral), one.prior.std)
    return 1.0  # an effect without parameters acts or does not


def _orthonormal_basis(term: Term, gram: FloatArray) -> FloatArray:
    """Return (p, k) combinations of a term's columns that are orthonormal in the whitened data; fewer than
    its values where some have no effect on them."""
    part = term.design[1:]
    inner = part.T @ gram @ part
    values, vectors = np.linalg.eigh(inner)
    kept = values > 1e-9 * max(float(values.max()), 1e-300)
    return np.asarray(part @ (vectors[:, kept] / np.sqrt(values[kept])))


def _principal_cosine(one: FloatArray, other: FloatArray, gram: FloatArray) -> float:
    """Return the cosine of the smallest principal angle between two orthonormal bases (p, k); 0 if one is
    empty."""
    if not one.shape[1] or not other.shape[1]:
        return 0.0
    return float(min(np.linalg.svd(one.T @ gram @ other, compute_uv=False)[0], 1.0))


def separating_manoeuvre(effect: str, confounded_with: tuple[str, ...]) -> str:
    """Return the manoeuvre that separates an effect from the first one that it is confounded with.

    Empty where there is none.
    """
    if not confounded_with:
        return ""
    known = (
        EFFECTS[name].wording.distinguished_by for name in (effect, confounded_with[0]) if name in EFFECTS
    )
    order = [drive for drive in known if drive]
    return f"to tell {effect} from {confounded_with[0]}: " + "; and ".join(dict.fromkeys(order))
