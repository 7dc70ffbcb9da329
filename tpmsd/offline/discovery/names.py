"""Evidence for a signal's role by its name: one piece of evidence, never the only one.

In: 'Message.Signal', a role. Out: log-likelihood ratio, in nats. Languages and makers' customs are the
table below.
"""

from __future__ import annotations

import re

CLEAR = 3.6
"""Names that say it are right in 97 % of DBC files: nats for all wheels together, or for one other role."""

_WHEEL = {
    "fl": r"FL|LF|VL|FrL|LFt|FrntL|FrontLeft|LeftFront|LFront|FrtLft|LHF|FLH|AVG|Front_?L|FntL",
    "fr": r"FR|RF|VR|FrR|RFt|FrntR|FrontRight|RightFront|RFront|FrtRt|RHF|FRH|AVD|Front_?R|FntR",
    "rl": r"RL|LR|HL|ReL|LRr|RearL|RearLeft|LeftRear|LRear|RrLft|LHR|RLH|ARG|Rear_?L",
    "rr": r"RR|HR|ReR|RRr|RearR|RearRight|RightRear|RRear|RrRt|RHR|RRH|ARD|Rear_?R",
}
_PATTERNS = {
    wheel: re.compile(rf"(?:^|[_\d.]|(?<=[a-z]))(?:{names})(?=$|[_\d]|(?=[A-Z][a-z]))")
    for wheel, names in _WHEEL.items()
}
ROLE_WORDS: dict[str, str] = {
    "yaw_rate": r"yaw|gier",
    "accel_long": r"(acc|accel|beschl).*(long|lgt|laengs|_x|x$)|(long|lgt|laengs|x).*(acc|beschl)|\bax\b",
    "accel_lat": r"(acc|accel|beschl).*(lat|quer|_y|y$)|(lat|quer|y).*(acc|beschl)|\bay\b",
    "steering_wheel_angle": r"steer|str_?w|lenk|lwi|sas|swa",
    "brake_pressure": r"brake|brk|brems",
    "drive_torque": r"torque|trq|moment|mom_",
    "ambient_temp": r"amb|outside|outdoor|extern|aussen|oat|temp_ext|out.*temp",
}


def named_wheel(signal: str) -> str | None:
    """Return the wheel that a name states; None if it states none, or two."""
    name = signal.partition(".")[2] or signal
    found = {wheel for wheel, pattern in _PATTERNS.items() if pattern.search(name)}
    if not found:
        found = {wheel for wheel, pattern in _PATTERNS.items() if pattern.search(name.upper())}
    return found.pop() if len(found) == 1 else None


def role_evidence(signal: str, role: str) -> float:
    """Return the evidence (nats) of a signal's name for a role that is no wheel's."""
    return CLEAR if re.search(ROLE_WORDS[role], signal.partition(".")[2], re.IGNORECASE) else 0.0
