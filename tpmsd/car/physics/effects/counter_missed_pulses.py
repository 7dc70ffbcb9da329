"""A wheel's counter loses pulses at a rate."""

from __future__ import annotations

from dataclasses import dataclass, replace

from tpmsd.car.physics.pulse_rate import PulseRate, pulse_rate_parameters


@dataclass(frozen=True)
class CounterMissedPulses(PulseRate):
    """The counter of one wheel loses `rate_per_s` pulses a second, so that it shows less than the wheel turns
    by a share that falls with speed, as one over it.

    At one speed that is a larger radius; what tells the two apart is the ring's own ripple, which a wheel
    that loses pulses shows after fewer of them. Source: counting; a disturbance that goes with time and not
    with the wheel, such as a bus that drops frames.
    """

    name = "counter_missed_pulses"
    wording = replace(
        PulseRate.wording,
        formula="omega shown = omega - 2 * pi * rate_per_s / teeth on one wheel",
        sentence="a wheel's counter loses pulses",
        noun="lost pulses",
        answers=("the counter of {wheel} loses {rate_per_s}",),
    )
    identification = replace(PulseRate.identification, by_ripple=True)
    parameters = pulse_rate_parameters("pulses lost per second")
    more = -1.0
