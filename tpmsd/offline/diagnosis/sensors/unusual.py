"""Errors of the sensors that are larger than sensors in order have, as findings.

In: the drives' `SensorError`s. Out: `Finding`s. All errors are fitted, and every sensor has some: what is
reported is an error beyond the usual size that its effect states (`Effect.tolerance_note`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from tpmsd.car.physics.catalogue import EFFECTS, parameters_of
from tpmsd.car.physics.effect import Effect
from tpmsd.offline.diagnosis.assessment.result import Finding, Quantity, Where
from tpmsd.offline.diagnosis.sensors.errors import SensorError, fit_sensor_errors
from tpmsd.offline.diagnosis.settings import SETTINGS
from tpmsd.offline.inference.windows import Reader


def unusual(readers: Sequence[Reader], seconds: float, speeds: bool) -> list[Finding]:
    """Return one finding per effect, by the drive that determines it best; `speeds`: the bus has no
    counts."""
    best: dict[str, tuple[float, Finding]] = {}
    for reader in readers:
        by_effect: dict[str, list[SensorError]] = {}
        for one in fit_sensor_errors(reader):
            by_effect.setdefault(one.probe.effect, []).append(one)
        for name, errors in by_effect.items():
            beyond = [one for one in errors if deviations_beyond(one, speeds) > SETTINGS.sensors.beyond_stds]
            if beyond:
                finding = _sensor_finding(EFFECTS[name], beyond, reader, seconds, speeds)
                if name not in best or finding.gain > best[name][0]:
                    best[name] = finding.gain, finding
    return [finding for _, finding in best.values()]


def deviations_beyond(one: SensorError, speeds: bool) -> float:
    """Return how many standard deviations a value lies beyond its typical value; 0 if within."""
    effect = EFFECTS[one.probe.effect]
    if effect.tolerance_note(one.value, 0.0, speeds):
        return 0.0
    low, high = 0.0, abs(one.value)
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if effect.tolerance_note(one.value, middle, speeds) else (middle, high)
    return 2.0 * low / one.std  # an effect calls unusual what is so by two standard deviations


def _sensor_finding(
    effect: type[Effect], errors: Sequence[SensorError], reader: Reader, seconds: float, speeds: bool
) -> Finding:
    beyond = max(deviations_beyond(one, speeds) for one in errors)
    chance = math.erfc(beyond / math.sqrt(2.0))
    plainest = max(errors, key=lambda one: deviations_beyond(one, speeds))
    shown = {sensor for one in errors for sensor in one.sensors}
    units = parameters_of(effect.name)
    gain = 0.5 * beyond**2
    return Finding(
        effect=effect.name,
        confidence=1.0 - chance,
        parameters={
            one.probe.parameter: Quantity(
                one.value + one.probe.neutral, one.std, units[one.probe.parameter].unit
            )
            for one in errors
        },
        where=_where(effect, plainest.sensors[0], reader),
        rms_before=plainest.rms_before,
        rms_after=plainest.rms_after,
        loglik_gain_per_s=gain / seconds,
        gain=gain,
        indistinguishable_from=tuple(
            name
            for name in effect.confounding.confounded
            if not EFFECTS[name].identification.reads or shown & set(EFFECTS[name].identification.reads)
        ),
        advice=effect.wording.distinguished_by,
        own_chance=chance,
    )


def _where(effect: type[Effect], sensor: str, reader: Reader) -> Where:
    values = reader.windows.covariates.get(effect.identification.shows_in[1])
    if values is None or effect.identification.shows_in[1] == "time":
        end = float(reader.recording.edges_s[-1])
        return Where((), sensor, None, None, ((0.0, end),))
    return Where((), sensor, effect.identification.shows_in[1], (float(values.min()), float(values.max())))
