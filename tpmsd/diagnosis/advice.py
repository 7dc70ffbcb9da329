"""Which drive would tell effects apart.

In: the effect named and its rivals. Out: one sentence for the driver.
"""

from __future__ import annotations

DRIVES: dict[str, str] = {
    "radius_change": "repeat the drive: a tyre that lost air stays small, warm-up starts anew",
    "centrifugal_growth": "hold 30 m/s for two minutes, then coast to 15 m/s, twice",
    "thermal_growth": "after half an hour, hold the speed of the first minutes once more",
    "load_transfer_longitudinal": "brake and accelerate firmly on a straight, ten times",
    "load_transfer_lateral": "drive the same bend slowly and fast, to both sides",
    "longitudinal_slip": "accelerate firmly and coast at the same speeds on a straight, ten times",
    "lateral_slip": "drive the same bend slowly and fast: slip grows with speed, a lever arm does not",
    "road_grade": "drive up and down a long slope of 5 % or more at constant speed",
    "gnss_latency": "accelerate and brake firmly on a straight, ten times",
    "antenna_lever_arm": "drive full circles at walking pace, to both sides, then bends at speed",
    "track_width_error": "drive full circles slowly, to both sides: load transfer is small there",
    "tone_ring_error": "roll at walking pace on a smooth straight for a minute",
    "yaw_rate_bias": "stand still for a minute with the ignition on",
    "yaw_rate_scale": "drive ten full circles to each side",
}


def advice(effect: str, rivals: tuple[str, ...]) -> str:
    """The drive that would separate an effect from the first of its rivals; empty without rivals."""
    if not rivals:
        return ""
    order = [DRIVES[name] for name in (effect, rivals[0]) if name in DRIVES]
    return f"to tell {effect} from {rivals[0]}: " + "; and ".join(dict.fromkeys(order))
