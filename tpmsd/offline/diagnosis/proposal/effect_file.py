"""A proposal as a file of the catalogue, to be reviewed and dropped in.

In: a `Proposal`. Out: the name and the text of a module that defines the effect.
"""

from __future__ import annotations

import re
from typing import Any

from tpmsd.car.physics.effect import Effect
from tpmsd.offline.diagnosis.assessment.result import Proposal
from tpmsd.offline.diagnosis.settings import SETTINGS

PREFIX = "proposed_"
HOOKS = {
    "gnss_speed": (Effect.gnss_speed_error_mps, "m/s"),
    "gnss_course": (Effect.gnss_course_error_rad, "rad"),
    "yaw_rate": (Effect.yaw_rate_error_radps, "rad/s"),
}
"""Hooks by reading: the one through which an effect acts on it, and its unit."""

OPENING = '''"""Proposed by tpmsd diagnose --propose: {formula} on {on}."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

'''
EFFECT = '''    """{what} = coefficient * {formula}.

    Source: none yet. It was fitted to {source}, where it brings {heldout:.1f} nats on
    held-out blocks; find the physics, its usual size and a better name before it is kept.
    """

    name = "{name}"
    wording = Wording(
        formula="{what} = coefficient * {formula}",
        sentence="a closed form that was proposed and has no physics yet",
'''
PARAMETER = """    parameters = (
        Parameter(
            "coefficient",
            "{unit}",
            {value!r},
            {lower!r},
            {upper!r},
            "fitted: {value:.4g} +- {std:.2g}",
            probe={probe!r},
"""

TEMPLATE = (
    OPENING
    + """from tpmsd.car.physics.covariates import covariate
from tpmsd.car.physics.effect import Effect, Identification, Parameter, Wording
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.foundation.wheels import FloatArray


@dataclass(frozen=True)
class {title}(Effect):
"""
    + EFFECT
    + """    )
    identification = Identification(shows_in=("{channel}", "{covariate}"))
"""
    + PARAMETER
    + '''        ),
    )
    coefficient: float

    def {hook}(self, motion: Motion, car: Car) -> FloatArray:
        """{shape}; zero where a covariate is not known."""
{reading}
        value = np.nan_to_num(self.coefficient * ({formula}))
        return np.asarray({result})
'''
)


def module_fields(proposal: Proposal, source: str, unit: str, reach: float) -> dict[str, Any]:
    """Return the values by name that the file of a proposed effect holds, whatever its kind.

    `source` says what was fitted, `unit` is that of what the effect acts on, and the coefficient's limits are
    `reach` times what was fitted.
    """
    name = PREFIX + proposal.name
    value = float(f"{proposal.coefficient:.4g}")
    return {
        "title": "".join(word.capitalize() for word in name.split("_")),
        "name": name,
        "formula": proposal.formula,
        "on": proposal.on,
        "source": re.sub(r"[^\w .,-]", "_", source),
        "heldout": proposal.heldout_gain,
        "covariate": proposal.covariates[0],
        "unit": unit if proposal.unit == "1" else f"{unit}/({proposal.unit})",
        "value": value,
        "lower": -reach * abs(value),
        "upper": reach * abs(value),
        "std": proposal.std,
    }


def effect_file(proposal: Proposal, source: str) -> tuple[str, str]:
    """Return the name of the effect (its file is called so) and the module's text; `source` says what was
    fitted."""
    signs = {word.removeprefix("-"): -1.0 if word[0] == "-" else 1.0 for word in proposal.on.split()}
    hook, unit = Effect.radius_change_m, "m"
    what, result, shape = "delta_r", "", "(n, 4) change of the radii in metres"
    if proposal.on in HOOKS:
        hook, unit = HOOKS[proposal.on]
        what, result, shape = f"error of {proposal.on}", "value", "(n,) what is read more"
        channel = proposal.on
    else:
        weights = [signs.get(wheel, 0.0) for wheel in ("fl", "fr", "rl", "rr")]
        result = f"value[:, None] * np.array({weights})"
        channel = "wheel" if len(set(weights)) == 1 else "wheel_ratio"
    reading = "\n".join(f'        {each} = covariate(motion, car, "{each}")' for each in proposal.covariates)
    fields = module_fields(proposal, source, unit, SETTINGS.report.proposed_reach)
    return fields["name"], TEMPLATE.format(
        **fields,
        what=what,
        channel=channel,
        probe=0.1 * abs(fields["value"]),
        hook=hook.__name__,
        shape=shape,
        reading=reading,
        result=result,
    )
