"""Which drive would tell effects apart.

In: the effect named and its rivals. Out: one sentence for the driver.
"""

from __future__ import annotations

from tpmsd.car.physics.catalogue import EFFECTS

DRIVES: dict[str, str] = {
    name: effect.telling_drive for name, effect in EFFECTS.items() if effect.telling_drive
}


def advice(effect: str, rivals: tuple[str, ...]) -> str:
    """The drive that would separate an effect from the first of its rivals; empty without rivals."""
    if not rivals:
        return ""
    order = [DRIVES[name] for name in (effect, rivals[0]) if name in DRIVES]
    return f"to tell {effect} from {rivals[0]}: " + "; and ".join(dict.fromkeys(order))
