"""Closed forms for terms without a name, and the file of the catalogue that says so.

In: a selection with a term without a name. Out: `ClosedForm`s: the expressions over covariates that bring
most on held-out blocks with that term taken out; `dynamics_effect_file`, a module that defines the effect.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tpmsd.car.physics.baselines.base import UNITS
from tpmsd.car.physics.dynamics_effects.time_spline import COVARIATES, EQUATIONS, DynamicsUnknown
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.proposal.effect_file import EFFECT, OPENING, PARAMETER, module_fields
from tpmsd.offline.diagnosis.proposal.expressions import Expression, expressions, shaped_expressions
from tpmsd.offline.dynamics.arrays import IntArray
from tpmsd.offline.dynamics.columns import Probe, gram
from tpmsd.offline.dynamics.evidence import PriorColumns, Statistics, join_columns
from tpmsd.offline.dynamics.model_statistics import fold_blocks
from tpmsd.offline.dynamics.result import ClosedForm
from tpmsd.offline.dynamics.search import Search

REACH = 20.0
"""Limits of the coefficient, in units of what was fitted."""
MOST = 3
"""Proposals, each over other covariates than those before it."""
NATS_PER_COVARIATE = 3.0
"""Gain that one more covariate has to bring: odds of twenty."""
LATERAL = {"force_y", "moment", "force_front", "force_rear"}
_RAISED = 1e-3


def proposals(search: Search) -> tuple[ClosedForm, ...]:
    """Return the best closed forms for terms without a name; empty if there is none."""
    unnamed = [k for k, term in enumerate(search.terms) if isinstance(term.effect, DynamicsUnknown)]
    if not unnamed:
        return ()
    forms = _forms(search, unnamed)
    found = [
        (NATS_PER_COVARIATE * (len(form.covariates) + len(form.numbers)) - one.heldout_gain, one)
        for on in _equations(search, unnamed)
        for form, one in _forms_on(search, unnamed, forms, on)
    ]
    best: list[ClosedForm] = []
    for _, one in sorted(found, key=lambda each: each[0]):
        new = all(set(one.covariates) != set(other.covariates) for other in best)
        if new and one.heldout_gain > 0.0 and len(best) < MOST:
            best.append(one)
    return tuple(best)


def _forms(search: Search, unnamed: Sequence[int]) -> list[Expression]:
    """Return the plain forms of all covariates, and over those of the unnamed terms the shaped ones too."""
    over = sorted({str(getattr(search.terms[k].effect, "over", "")) for k in unnamed} & {*COVARIATES})
    forms = expressions([name for name in COVARIATES if name != "time"])
    return forms + [form for name in over for form in shaped_expressions(name, search.covariates[name])]


def _forms_on(
    search: Search, unnamed: Sequence[int], forms: Sequence[Expression], on: str
) -> list[tuple[Expression, ClosedForm]]:
    """Return every form on one equation or output, fitted in the place of the terms without a name."""
    columns, probes = search.own(0)
    held = tuple(index for k in unnamed for index in columns[k].index)
    values = tuple(-float(v) for k in unnamed for v in search.terms[k].values())
    stay = join_columns([one for k, one in enumerate(columns) if k not in unnamed])
    covariates = search.covariates
    weights = [np.asarray(form.values(covariates)) for form in forms]
    probes += _probes(search, on, weights)
    statistics = Statistics(gram(search.setup, search.theta, search.at, search.noise, probes))
    out = []
    for k, form in enumerate(forms):
        size = float(np.sqrt(np.mean(weights[k] ** 2)))
        if size > 0.0:
            index = (len(probes) - len(forms) + k,)
            added = PriorColumns(index, np.zeros(1), np.array([(size / 10.0) ** 2]))
            out.append((form, _fit_form(statistics, stay, added, held, values, form, on)))
    return out


def _equations(search: Search, unnamed: Sequence[int]) -> list[str]:
    """Return the outputs that are named, and every lateral equation where one of them is."""
    named = {str(getattr(search.terms[k].effect, "on", "")) for k in unnamed}
    if named & LATERAL:
        named |= LATERAL
    return sorted(named)


def _probes(search: Search, on: str, weights: Sequence[FloatArray]) -> list[Probe]:
    """Return the probes of a term on this equation or output, one for each set of weights (n,)."""
    time = search.setup.drive.time_s
    ends = (float(time[0]), float(time[-1]))
    raised = DynamicsUnknown(knots=ends, heights=(_RAISED, _RAISED), on=on, over="time")
    moved = (*search.theta, raised)
    return [Probe(moved, _RAISED, one) for one in weights]


def _fit_form(
    statistics: Statistics,
    stay: PriorColumns,
    added: PriorColumns,
    held: tuple[int, ...],
    values: tuple[float, ...],
    form: Expression,
    on: str,
) -> ClosedForm:
    """Return a form fitted to all blocks, with its gain on blocks that took no part in the fit."""
    both = join_columns([stay, added])
    estimate, covariance = statistics.fit(both, held, values)
    ratio = statistics.addition(stay, added, held, values).overdispersion
    folds = fold_blocks(len(statistics.blocks.gradient))
    fixed: FloatArray = np.array(values, dtype=np.float64)

    def gained(blocks: IntArray | None, left_out: IntArray | None) -> float:
        """Return the log-likelihood gain of the added columns on these blocks, `left_out` not fitted."""
        total = 0.0
        for sign, free in ((1.0, both), (-1.0, stay)):
            fitted = statistics.fit(free, held, values, left_out)[0] if free.index else np.zeros(0)
            columns = (*free.index, *held)
            total += sign * statistics.log_likelihood(columns, np.concatenate([fitted, fixed]), blocks)
        return total

    return ClosedForm(
        name=f"{on}_{form.name}" if on in EQUATIONS else f"{on}_reading_{form.name}",
        formula=form.formula,
        covariates=form.covariates,
        unit=form.unit,
        on=on,
        on_unit=EQUATIONS.get(on) or UNITS[on],
        coefficient=float(estimate[-1]),
        std=float(np.sqrt(covariance[-1, -1] * ratio)),
        gain=gained(None, None),
        heldout_gain=sum(gained(blocks, blocks) for blocks in folds),
    )


TEMPLATE = (
    OPENING
    + """from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import DynamicsEffect
from tpmsd.car.physics.dynamics_effects.time_spline import covariate_of
from tpmsd.car.physics.effect_records import Wording
from tpmsd.car.physics.parameters import Parameter, Prior


@dataclass(frozen=True)
class {title}(DynamicsEffect):
"""
    + EFFECT
    + """        distinguished_by="repeat the drive with other values of {covariates}",
    )
    channel = "{channel}"
    covariate = "{covariate}"
"""
    + PARAMETER
    + '''            prior=Prior(0.0, {prior!r}, "the size that was fitted"),
        ),
    )
    coefficient: float = 0.0

    def {hook}(self, frame: Frame) -> None:
        """Add it."""
{reading}
        value = self.coefficient * np.asarray({formula})
        {result}
'''
)


def dynamics_effect_file(proposal: ClosedForm, source: str) -> tuple[str, str]:
    """Return the name of the effect (its file is called so) and the module's text; `source` says what was
    fitted."""
    on = proposal.on
    if on in EQUATIONS:
        size = "inertia" if on == "moment" else "mass"
        what, hook, result = f"{on} / {size}", "add_forces", f"frame.{on} = frame.{on} + frame.{size} * value"
        channel = {"force_x": "speed", "force_y": "accel_lat"}.get(on, "yaw_rate")
        if lever := {"force_front": "frame.front", "force_rear": "-frame.rear"}.get(on):
            result = (
                "frame.force_y = frame.force_y + frame.mass * value\n"
                f"        frame.moment = frame.moment + {lever} * frame.mass * value"
            )
    else:
        what, hook, channel = f"error of {on}", "read", on
        result = (
            f'if "{on}" in frame.outputs:\n            frame.outputs["{on}"] = frame.outputs["{on}"] + value'
        )
    fields = module_fields(proposal, source, proposal.on_unit, REACH)
    return fields["name"], TEMPLATE.format(
        **fields,
        what=what,
        covariates=" and ".join(word.replace("_", " ") for word in proposal.covariates),
        channel=channel,
        probe=0.01 * abs(fields["value"]),
        prior=2.0 * abs(fields["value"]),
        hook=hook,
        reading="\n".join(f'        {each} = covariate_of(frame, "{each}")' for each in proposal.covariates),
        result=result,
    )
