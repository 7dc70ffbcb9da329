"""Which estimator a configuration asks for.

In: a `Config` and a random generator. Out: an `Estimator`. The table below is where a new method is added.
"""

from __future__ import annotations

import numpy as np

from tpmsd.config.model import Config
from tpmsd.errors import ConfigError
from tpmsd.estimators.aug_kf import AugEkf, AugUkf
from tpmsd.estimators.aug_pf import AugPf
from tpmsd.estimators.base import Estimator
from tpmsd.estimators.mpf_mn import MpfMn
from tpmsd.estimators.mpf_pn import MpfPn
from tpmsd.estimators.mpf_rb import MpfRb
from tpmsd.wheels import FL, FR, RL, RR

METHODS: dict[str, type[MpfRb | MpfPn | AugPf | AugEkf | AugUkf | MpfMn]] = {
    "mpf-rb": MpfRb,
    "mpf-pn": MpfPn,
    "aug-pf": AugPf,
    "aug-ekf": AugEkf,
    "aug-ukf": AugUkf,
    "mpf-mn": MpfMn,
}
"""Method name -> class."""


def monitored_wheels(config: Config) -> tuple[int, ...]:
    """Indices of the wheels whose signals the configuration names: all four, or the rear pair."""
    roles = config.can.signals
    known = {
        i
        for i, w in enumerate(("fl", "fr", "rl", "rr"))
        if f"wheel_count_{w}" in roles or f"wheel_speed_{w}" in roles
    }
    if not {RL, RR} <= known:
        raise ConfigError(
            "the signals of both rear wheels are needed: wheel_count_rl/rr or wheel_speed_rl/rr"
        )
    return (FL, FR, RL, RR) if {FL, FR} <= known else (RL, RR)


def build_estimator(config: Config, rng: np.random.Generator) -> Estimator:
    """The estimator that [filter] method names; ConfigError if there is none of that name."""
    kind = METHODS.get(config.filter.method)
    if kind is None:
        raise ConfigError(f"[filter] method: unknown {config.filter.method!r}; known: {', '.join(METHODS)}")
    return kind(config.vehicle, config.gnss, config.filter, rng, front=len(monitored_wheels(config)) == 4)
