"""A wheel's counter adds pulses at a rate."""

from __future__ import annotations

from dataclasses import dataclass, replace

from tpmsd.car.physics.pulse_rate import PulseRate, pulse_rate_parameters


@dataclass(frozen=True)
class CounterExtraPulses(PulseRate):
    """The counter of one wheel adds `rate_per_s` pulses a second, so that it shows more than the wheel turns
    by a share that falls with speed, as one over it.

    Source: counting; a disturbance that goes with time and not with the wheel, such as ignition or a loose
    contact.
    """

    name = "counter_extra_pulses"
    wording = replace(
        PulseRate.wording,
        formula="omega shown = omega + 2 * pi * rate_per_s / teeth on one wheel",
        sentence="a wheel's counter adds pulses",
        noun="added pulses",
        answers=("the counter of {wheel} adds {rate_per_s}",),
    )
    confounding = replace(PulseRate.confounding, mirror_of="counter_missed_pulses")
    parameters = pulse_rate_parameters("pulses added per second")
    more = 1.0
