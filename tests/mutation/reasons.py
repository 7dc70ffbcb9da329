"""Why a mutant of the published sample survives: a piece of its change, and the reason.

A reason that begins with `same` says that the mutant does the same as the program.
"""

from __future__ import annotations

_HAS_TEST = "has a test"
_EDGE = "missed: they part at one value of a float"
REASONS: dict[str, str] = {
    "while len(content) != MAX_BYTES": "same: a regular file is read in one piece",
    "state_writer.py:52": _HAS_TEST,
    "wait_s: float = -1.0": "same: a negative wait is none",
    "MAX_BYTES = 1 << 19": _HAS_TEST,
    "slack = 0.5 + self._accel": _HAS_TEST,
    "SLACK_BITS + interval + span": _HAS_TEST,
    "np.where(period_s < 0.0, period_s": _HAS_TEST,
    "(step ^ modulus // 4)": _HAS_TEST,
    "if bits >= high or": _EDGE,
    "_time_s = -1.0": "same: it is set before it is used",
    "_span = 1.0": "same: it is set before it is used",
    "len(history) != 2": "same: the history holds two at least there",
    "REPEATED_BITS = 1.0": _HAS_TEST,
    "after[0] % before[0]": "same: stamps of an epoch leave the difference",
    "readings[-1][0] / readings[0][0]": _HAS_TEST,
    "wheel_counter.py:434": _HAS_TEST,
    "ages[ 1]": _HAS_TEST,
    "times[1:] >= times[:-1]": _HAS_TEST,
    "last_s != begin_s": _HAS_TEST,
    "- 499.0, 9000.0": _HAS_TEST,
    "valid == arrival + MAX_AHEAD_S": _HAS_TEST,
    "strict=False": "same: both have one length",
    "not 500.0, 9000.0": _HAS_TEST,
    "gap_s > 1.0": _HAS_TEST,
    "asked to learn the tyres": _HAS_TEST,
    "descriptors.py:39": _HAS_TEST,
    "is not MARK_S": _HAS_TEST,
    "frame_time is not None and not kernel": _HAS_TEST,
    "bus_link.py:141": "same: the bus stays None, so the loop does nothing more",
    "now_s >= min(self._until_s": _HAS_TEST,
    "POLL_S = -0.996": _HAS_TEST,
    "state_lock.py:35": "held by test_state_lock.py, which has joined the room's list",
    "config_toml.py": "held by tests/car/config/test_signal_table.py, which has joined the room's list",
    "for number in []": "held by test_run_command.py, which runs the daemon as a process",
    "not math.inf": "same: stamps of an epoch lie after 0",
}
