"""The diagnosis of vehicle dynamics: from a baseline and a drive to findings.

In: `Baseline`, `DynamicsDrive`, effects that belong to the baseline. Out: `DynamicsDiagnosis`. No I/O.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from tpmsd.car.physics.baselines.base import UNITS, Baseline
from tpmsd.car.physics.dynamics_effect import DynamicsEffect
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.dynamics.certify import Replicates, certify_findings
from tpmsd.offline.dynamics.competitors import exchange_for_likelier
from tpmsd.offline.dynamics.drive import DynamicsDrive
from tpmsd.offline.dynamics.findings import findings_of, not_detectable, nuisances_of
from tpmsd.offline.dynamics.model_statistics import ModelStatistics, fold_blocks, threshold_of
from tpmsd.offline.dynamics.path import Setup
from tpmsd.offline.dynamics.predict import predicted
from tpmsd.offline.dynamics.proposals import proposals
from tpmsd.offline.dynamics.rating import rating
from tpmsd.offline.dynamics.result import (
    CONSISTENT,
    FINDING,
    INSUFFICIENT,
    MISMATCH,
    Curves,
    DynamicsDiagnosis,
    DynamicsFinding,
    OutputFit,
    SelectionStep,
)
from tpmsd.offline.dynamics.search import Search, SelectionState
from tpmsd.offline.dynamics.settings import SETTINGS
from tpmsd.offline.dynamics.stages import select_model


def _ignore_progress(share: float) -> None:
    """Ignore the progress."""


@np.errstate(over="ignore", invalid="ignore")  # BandedFactor refuses what overflows
def diagnose_dynamics(
    baseline: Baseline,
    drive: DynamicsDrive,
    given: Sequence[DynamicsEffect] = (),
    say: Callable[[float], None] = _ignore_progress,
    replicates: Replicates | None = None,
    propose: bool = False,
    simulated: tuple[DynamicsEffect, ...] | None = None,
) -> DynamicsDiagnosis:
    """Return the effects that the drive shows and the baseline with the given effects lacks.

    With `replicates` each finding has a p-value that is counted; `propose` looks for a closed form of what
    has no name. `simulated` are the effects with which the baseline moves like the user's simulation that the
    drive is compared with (`against_simulation`).
    """
    names = tuple(effect.name for effect in given)
    drive = drive.bounded(SETTINGS.max_rows)
    moving = _moving_s(drive)
    if reason := _reason_to_abstain(drive, moving):
        return DynamicsDiagnosis(
            INSUFFICIENT, reason, baseline.name, baseline.forces, names, moving, notes=drive.notes
        )
    channels = tuple(
        name for name in UNITS if name in drive.outputs and name in baseline.outputs(tuple(given))
    )
    setup = Setup(baseline, drive, channels)
    likeliest = exchange_for_likelier(select_model(setup, tuple(given), say, simulated or ()))
    search, look = likeliest.search, likeliest.look
    found = findings_of(search, look, likeliest.competitors, likeliest.selections_without())
    threshold = threshold_of(len({term.name for term in look.offered}) + len(search.terms))
    steps, outputs, curves = _evaluate_stages(search)
    certificate = None
    if replicates is not None and replicates.most > 0:
        found, certificate = certify_findings(search, found, replicates, lambda share: say(0.7 + 0.3 * share))
    verdict = MISMATCH if any(one.status == FINDING for one in found) else CONSISTENT
    effects, stds = _extended_model(search, look, found)
    return DynamicsDiagnosis(
        verdict,
        "",
        baseline.name,
        baseline.forces,
        names,
        moving,
        found,
        outputs,
        steps,
        not_detectable(search, look, threshold),
        effects,
        stds,
        dict(zip(channels, map(float, search.noise.outputs), strict=True)),
        sum(one.loglik_gain for one in found) / max(moving, 1.0),
        drive.notes,
        drive.time_s,
        curves,
        proposals(search) if propose else (),
        certificate,
        nuisances_of(search, look),
        simulated,
    )


@np.errstate(over="ignore", invalid="ignore")
def effects_of_simulation(
    baseline: Baseline, simulation: DynamicsDrive, say: Callable[[float], None] = _ignore_progress
) -> tuple[DynamicsEffect, ...]:
    """Return the effects with which the baseline moves like a simulation (`as_recorded`).

    Effects change a car to first order about what it is: about the simulation, not about a configured car
    that moves otherwise.
    """
    simulation = simulation.bounded(SETTINGS.max_rows)
    if _reason_to_abstain(simulation, _moving_s(simulation)):
        return ()
    channels = tuple(name for name in UNITS if name in simulation.outputs and name in baseline.outputs())
    return exchange_for_likelier(select_model(Setup(baseline, simulation, channels), (), say)).search.theta


def _extended_model(
    search: Search, look: ModelStatistics, found: Sequence[DynamicsFinding]
) -> tuple[tuple[DynamicsEffect, ...], tuple[dict[str, float], ...]]:
    """Return the effects of the extended model with their standard deviations; suspicions stay out of it."""
    effects, stds = list(search.fixed), [dict[str, float]() for _ in search.fixed]
    certain = {one.term for one in found if one.status == FINDING}
    for k, term in enumerate(search.terms):
        if k in certain or term.nuisance:
            pairs = zip(term.free, map(float, look.slot(k).std), strict=True)
            effects.append(term.effect)
            stds.append({name: std for name, std in pairs if not name.startswith("heights[")})
    return tuple(effects), tuple(stds)


def _moving_s(drive: DynamicsDrive) -> float:
    """Return the time of driving above walking pace, s."""
    return float(np.sum(np.diff(drive.time_s)[drive.moving[:-1] & drive.linked]))


def likely_unit(step_s: float) -> str:
    """Return the largest unit of time of which this many, for seconds, are a step between rows of usual
    recordings; empty where no unit makes it one."""
    units = {"milliseconds": 1e-3, "microseconds": 1e-6, "nanoseconds": 1e-9}
    fits = (unit for unit, size in units.items() if step_s * size <= SETTINGS.gap_s)
    return next(fits, "")


def _reason_to_abstain(drive: DynamicsDrive, moving_s: float) -> str:
    """Return the reason why the drive allows no conclusion; empty if it allows one."""
    if not drive.outputs:
        return "no output of the baseline is recorded (yaw_rate_radps, accel_lat_mps2, velocity_lat_mps)"
    if len(drive.time_s) > 1 and (step_s := float(np.median(np.diff(drive.time_s)))) > SETTINGS.gap_s:
        unit = likely_unit(step_s)
        guess = f"; is time_s in {unit}?" if unit else ""
        return f"the rows are {step_s:g} s apart, at most {SETTINGS.gap_s:g} s is of use{guess}"
    if moving_s < SETTINGS.min_s:
        least = f"{SETTINGS.min_s:g} s are needed"
        return f"{moving_s:.0f} s of driving above {SETTINGS.slowest_mps:g} m/s; {least}"
    if len(drive.starts) < 5:
        return "too few contiguous rows"
    return ""


def _evaluate_stages(
    search: Search,
) -> tuple[tuple[SelectionStep, ...], dict[str, OutputFit], dict[str, Curves]]:
    """Return errors of the outputs after each step and for the whole, and the outputs themselves, parameters
    fitted on the other folds."""
    setup = search.setup
    readings = setup.readings()
    guesses = [heldout(setup, stage) for stage in search.stages]
    steps = [
        SelectionStep(
            tuple(dict.fromkeys(term.name for term in stage.terms)),
            {name: _rms(readings[:, k] - guess[:, k]) for k, name in enumerate(setup.channels)},
            (*search.base, *(term.effect for term in stage.terms)),
        )
        for stage, guess in zip(search.stages, guesses, strict=True)
    ]
    outputs = {
        name: OutputFit(
            UNITS[name],
            steps[0].rms[name],
            steps[-1].rms[name],
            *_ratings(
                setup.drive.time_s,
                readings[:, k],
                before := guesses[0][:, k],
                before if len(guesses) == 1 else guesses[-1][:, k],
            ),
        )
        for k, name in enumerate(setup.channels)
    }
    curves = {
        name: Curves(readings[:, k], guesses[0][:, k], guesses[-1][:, k])
        for k, name in enumerate(setup.channels)
    }
    return tuple(steps), outputs, curves


def _ratings(
    time_s: FloatArray, recorded: FloatArray, before: FloatArray, after: FloatArray
) -> tuple[float, float]:
    """Return the ratings of a curve before and after; one where both are the same."""
    first = curve_rating(time_s, recorded, before)
    return first, first if after is before else curve_rating(time_s, recorded, after)


def heldout(setup: Setup, stage: SelectionState) -> FloatArray:
    """Return the (n, m) outputs predicted from the inputs, each fold with parameters fitted on the others."""
    drive = setup.drive
    out = np.full((len(drive.time_s), len(setup.channels)), np.nan)
    if all(theta == stage.by_fold[0] for theta in stage.by_fold):
        return predicted(setup, stage.by_fold[0], stage.path)
    for blocks, theta in zip(fold_blocks(len(drive.starts)), stage.by_fold, strict=True):
        first, last = int(drive.starts[blocks[0]]), int(drive.ends[blocks[-1]])
        part = Setup(setup.baseline, drive.part(first, last), setup.channels)
        out[first:last] = predicted(part, theta, stage.path[first:last])
    return out


def _rms(values: FloatArray) -> float:
    """Return the root mean square, NaN left out."""
    known = values[np.isfinite(values)]
    return math.sqrt(float(np.mean(known**2))) if len(known) else math.nan


def curve_rating(time_s: FloatArray, recorded: FloatArray, simulated: FloatArray) -> float:
    """Return the ISO/TS 18571 rating of a curve over the drive, thinned out evenly; NaN if it is too
    short."""
    known = np.isfinite(recorded) & np.isfinite(simulated)
    if known.sum() < 20:
        return math.nan
    count = min(int(known.sum()), SETTINGS.rating_samples)
    at = np.linspace(time_s[known][0], time_s[known][-1], count)
    a, b = (np.interp(at, time_s[known], curve[known]) for curve in (recorded, simulated))
    return rating(a, b, float(at[1] - at[0])).overall
