"""A calibration in words and as JSON.

In: `FittedGeometry`. Out: the summary for a reader, the document for a program.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

from tpmsd.car.physics.catalogue import EFFECTS
from tpmsd.foundation.plain import with_unit
from tpmsd.offline.calibration.result import FittedGeometry

_NAMES = {"fl": "front left", "fr": "front right", "rl": "rear left", "rr": "rear right"}


def summary(found: FittedGeometry, bus_radii_m: Mapping[str, float] = MappingProxyType({})) -> str:
    """Return the text that the command prints; `bus_radii_m` as `Config.bus_radii_m`."""
    kmh = found.reference_speed_mps * 3.6
    lines = [f"Calibration by the {found.method} method from {', '.join(found.drives)}", ""]
    lines.append("wheel            circumference            radius")
    for wheel, result in found.wheels.items():
        round_m, round_std_m = result.circumference_m, result.circumference_std_m
        lines.append(
            f"{_NAMES[wheel]:<15}  {round_m * 1e3:7.1f} +- {round_std_m * 1e3:4.2f} mm"
            f"   {result.radius_m * 1e3:7.2f} +- {result.radius_std_m * 1e3:4.2f} mm"
        )
    rear = found.wheels["rr"].radius_m - found.wheels["rl"].radius_m
    lines.append(
        f"rear right minus left: {rear * 1e3:+.3f} +- {found.difference_std_m * 1e3:.3f} mm of radius"
    )
    lines.append(f"The radii are those at {kmh:.0f} km/h.")
    if bus_radii_m:
        stated = ", ".join(f"bus_radius_{wheel}_m = {radius:g}" for wheel, radius in bus_radii_m.items())
        lines.append(f"Of speeds over the road they hold with these in [calibration]: {stated}")
    if math.isfinite(found.track_rear_std_m):
        lines.append(f"track rear:  {found.track_rear_m:.3f} +- {found.track_rear_std_m:.3f} m")
    else:
        lines.append(f"track rear:  {found.track_rear_m:.3f} m, as configured")
    if math.isfinite(found.track_front_m):
        lines.append(f"track front: {found.track_front_m:.3f} +- {found.track_front_std_m:.3f} m")
    if found.effects:
        lines += ["", "also estimated:"]
        names = {name: _effect_label(name, found.drives) for name in found.effects}
        width = max(map(len, names.values()))
        lines += [
            f"  {names[name]:<{width}}  " + with_unit(f"{effect.value:+.3g} +- {effect.std:.2g}", effect.unit)
            for name, effect in found.effects.items()
        ]
    lines += [
        "",
        f"{found.iterations} iterations; stopped because {found.stopped_because}",
        f"pose error of un-fused odometry: {found.pose_error_before_m:.2f} m before, "
        f"{found.pose_error_after_m:.2f} m after",
    ]
    return "\n".join(lines)


def _effect_label(name: str, drives: Sequence[str]) -> str:
    """Return the label of a column such as `latency@0`: effect and parameter as in `tpmsd effects`, drive."""
    base, _, drive = name.partition("@")
    known = {
        row[0]: f"{effect.name}, {row[1]}" for effect in EFFECTS.values() for row in effect.in_calibration
    }
    of_drive = f" of {drives[int(drive)]}" if drive and len(drives) > 1 else ""
    return known.get(base, base) + of_drive


def document(
    found: FittedGeometry, bus_radii_m: Mapping[str, float] = MappingProxyType({})
) -> dict[str, Any]:
    """Return the document that `--json` writes; `bus_radii_m` as `Config.bus_radii_m`."""
    return {
        "method": found.method,
        "drives": list(found.drives),
        "wheels": {
            wheel: {
                "radius_m": result.radius_m,
                "radius_std_m": result.radius_std_m,
                "circumference_m": result.circumference_m,
                "circumference_std_m": result.circumference_std_m,
                **({"bus_radius_m": bus_radii_m[wheel]} if wheel in bus_radii_m else {}),
            }
            for wheel, result in found.wheels.items()
        },
        "rear_difference_std_m": found.difference_std_m,
        "track_rear_m": found.track_rear_m,
        "track_rear_std_m": found.track_rear_std_m,
        "track_front_m": found.track_front_m,
        "track_front_std_m": found.track_front_std_m,
        "reference_speed_mps": found.reference_speed_mps,
        "iterations": found.iterations,
        "stopped_because": found.stopped_because,
        "pose_error_m": {"before": found.pose_error_before_m, "after": found.pose_error_after_m},
        "effects": {
            name: {"value": effect.value, "std": effect.std, "unit": effect.unit}
            for name, effect in found.effects.items()
        },
        "history": found.history_m,
    }
