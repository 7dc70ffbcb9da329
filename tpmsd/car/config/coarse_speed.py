"""Wheel speeds in coarse steps: how far the radii may be off by them.

In: the step of a speed signal and the wheel's radius. Out: one sentence, or nothing where the step is fine.
"""

from __future__ import annotations

from collections.abc import Mapping

from tpmsd.car.config.model import Config
from tpmsd.foundation.wheels import WHEELS

SPEED_MPS = 20.0
"""The speed for which the bias is stated."""
COARSE_SHARE = 1e-3
"""Relative bias from which a step is coarse: two fifths of the default threshold of a deflation, 0.25 %."""


def truncation_bias(step_mps: float, speed_mps: float = SPEED_MPS) -> float:
    """Return the relative bias of a radius (1) where speeds are truncated to steps: they read low by half a
    step."""
    return 0.5 * step_mps / speed_mps


def coarse_step_warning(step_mps: float, radius_m: float) -> str | None:
    """Return the bias of a radius (m) by speed steps of `step_mps` (m/s) as a sentence; None where it is
    small."""
    bias = truncation_bias(step_mps)
    if bias < COARSE_SHARE:
        return None
    return (
        f"speeds in steps of {3.6 * step_mps:.2g} km/h: a sender that truncates makes every radius look "
        f"{1000 * radius_m * bias:.1f} mm larger at {SPEED_MPS:g} m/s (more when slower), one that "
        "rounds makes it drift while the speed is steady;"
        " 'tpmsd diagnose' estimates it"
    )


def coarse_step_warnings(config: Config, steps: Mapping[str, float]) -> list[str]:
    """Return the sentence on the coarsest wheel speed of a bus, or none; `steps`: role -> resolution
    (rad/s)."""
    found = {
        role: (steps[role] * radius_m, radius_m)
        for wheel, radius_m in zip(WHEELS, config.vehicle.wheel_radius_m, strict=True)
        if (role := f"wheel_speed_{wheel}") in steps
    }
    if not found:
        return []
    role, (step_mps, radius_m) = max(found.items(), key=lambda item: item[1][0])
    text = coarse_step_warning(step_mps, radius_m)
    return [] if text is None else [f"{config.can.signals[role]}: {text}"]
