"""What is mutated and which tests have to notice: rooms for the sampled run, and mutations by name.

A mutation by name is one that tests once missed. It stays here with the tests that kill it now.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

REPO = Path(__file__).resolve().parents[2]


@dataclass(frozen=True, slots=True)
class Room:
    """Modules, and the tests that judge their mutants."""

    modules: tuple[str, ...]
    tests: tuple[str, ...]
    left_out: str = ""
    """Tests that take longer than all others together, for pytest's -k."""


@dataclass(frozen=True, slots=True)
class Named:
    """One change of the text of a module; `old` occurs there once."""

    module: str
    old: str
    new: str
    tests: tuple[str, ...]


def _modules(folder: str, *left_out: str) -> tuple[str, ...]:
    """The modules of a room and of the rooms in it, without those that hold numbers alone."""
    skipped = {"__init__", *left_out}
    found = sorted(path for path in (REPO / folder).rglob("*.py") if path.stem not in skipped)
    return tuple(str(path.relative_to(REPO)) for path in found)


def _daemon_tests() -> tuple[str, ...]:
    """The tests of the daemon that run it in their own process."""
    names = (
        *("can_errors", "health", "inputs", "link_ends", "links", "loop", "notify", "obd"),
        *("record", "recorder", "reset", "state_keeper", "state_lock", "time"),
    )
    own = tuple(f"tests/onboard/daemon/test_{name}.py" for name in names)
    return (*own, "tests/car/config/test_signal_table.py")


ROOMS = {
    "monitor": Room(
        _modules("tpmsd/onboard/monitor", "settings", "drive_settings", "encoder_settings"),
        ("tests/onboard/monitor",),
        "TestLife or slow_leak or no_history_of_radii_flaps or reset_away_minute",
    ),
    "timeline": Room(
        _modules("tpmsd/onboard/timeline"),
        (
            "tests/onboard/timeline",
            "tests/onboard/gnss/test_utc_offset.py",
            "tests/onboard/gnss/test_local_plane.py",
        ),
        "test_any_stamps or test_faulty_lines or test_faulty_buses",
    ),
    "daemon": Room(_modules("tpmsd/onboard/daemon"), _daemon_tests()),
    "wheel_counter": Room(
        ("tpmsd/onboard/sources/wheel_counter.py",),
        tuple(
            f"tests/onboard/sources_can/test_{name}.py"
            for name in ("wheel_reach", "wheel_counter", "can_decoder", "regular_readings")
        ),
    ),
    "epochs": Room(
        ("tpmsd/onboard/sources/gnss/nmea_epoch.py", "tpmsd/onboard/sources/gnss/nmea_checks.py"),
        ("tests/onboard/gnss/test_nmea_epoch.py", "tests/onboard/gnss/test_nmea_checks.py"),
    ),
    "state_file": Room(
        (
            "tpmsd/onboard/sinks/state_file.py",
            "tpmsd/onboard/daemon/state_keeper.py",
            "tpmsd/onboard/daemon/state_writer.py",
        ),
        ("tests/onboard/sinks/test_state_file.py", "tests/onboard/daemon/test_state_keeper.py"),
    ),
    "health": Room(
        ("tpmsd/onboard/daemon/health.py",),
        ("tests/onboard/daemon/test_health.py", "tests/onboard/daemon/test_loop.py"),
    ),
    "links": Room(
        tuple(f"tpmsd/onboard/daemon/{name}.py" for name in ("link", "bus_link", "receiver_link")),
        ("tests/onboard/daemon/test_links.py", "tests/onboard/daemon/test_link_ends.py"),
    ),
}

_KEEPER, _HEALTH = "tests/onboard/daemon/test_state_keeper.py", "tests/onboard/daemon/test_health.py"
_EPOCH, _COUNTER = "tests/onboard/gnss/test_nmea_epoch.py", "tests/onboard/sources_can/test_wheel_counter.py"
_SIGNALS, _LEARNS = (
    "tests/onboard/monitor/test_signal_watch.py",
    "tests/onboard/monitor/test_learns_in_order.py",
)
_OFFSET, _OFFSET_TEST = "tpmsd/onboard/timeline/utc_offset.py", "tests/onboard/gnss/test_utc_offset.py"
_LOOP, _RESET = "tpmsd/onboard/daemon/loop.py", "tests/onboard/daemon/test_reset.py"
_QUEUE, _INPUTS = "tpmsd/onboard/daemon/input_queue.py", "tests/onboard/daemon/test_inputs.py"
_STEPPED = "heapq.heapify(self._heap)\n        self._released_until_s = -math.inf"
_SETTINGS = "tpmsd/onboard/monitor/settings.py"
_LATE, _BACK = "time_s > self.deadline_s", "time_s < burst.last_s - self._interval.gap_s"
_BURST_ENDS = f"({_LATE} or {_BACK})"

NAMED = (
    # A link or a FIFO in place of the temporary file is not written through.
    Named(
        "tpmsd/onboard/sinks/state_file.py",
        "os.O_WRONLY | os.O_CREAT | os.O_EXCL |",
        "os.O_WRONLY | os.O_CREAT |",
        ("tests/onboard/sinks/test_state_file.py",),
    ),
    Named(
        "tpmsd/onboard/sinks/state_file.py",
        "        files.unlink(name)\n    flags",
        "        pass\n    flags",
        ("tests/onboard/sinks/test_state_file.py",),
    ),
    # What restoring may raise is set aside, and nothing of it is taken up.
    *(
        Named(
            "tpmsd/onboard/daemon/state_keeper.py",
            "except (ValueError, LookupError, TypeError, AttributeError, ArithmeticError) as error:",
            f"except ({', '.join(rest)}) as error:",
            (_KEEPER,),
        )
        for kinds in [("ValueError", "LookupError", "TypeError", "AttributeError", "ArithmeticError")]
        for rest in ([k for k in kinds if k != gone] for gone in kinds)
    ),
    Named(
        "tpmsd/onboard/daemon/state_keeper.py",
        "            return make()  # the other",
        "            return pipeline  # the other",
        (_KEEPER,),
    ),
    # A disk that fails a second time is told a second time.
    Named(
        "tpmsd/onboard/daemon/state_keeper.py",
        "        self._complained = False\n        self._saved = self._writing",
        "        self._saved = self._writing",
        (_KEEPER,),
    ),
    # An alarm that the disk refused stays urgent.
    Named(
        "tpmsd/onboard/daemon/state_keeper.py",
        "self._urgent |= self._was_urgent",
        "self._urgent &= self._was_urgent",
        (_KEEPER,),
    ),
    # Warm-up and greatest drift of the receiver's clock; a reading of the same instant.
    Named(_OFFSET, "_WARM_FIXES = 10", "_WARM_FIXES = 9", (_OFFSET_TEST,)),
    Named(_OFFSET, "QUANTILE = 0.15", "QUANTILE = 0.2", (_OFFSET_TEST,)),
    Named(_OFFSET, "MAX_DRIFT = 2e-3", "MAX_DRIFT = 4e-3", (_OFFSET_TEST,)),
    Named("tpmsd/onboard/sources/wheel_counter.py", "if interval <= 0.0:", "if interval < 0.0:", (_COUNTER,)),
    Named("tpmsd/onboard/sources/wheel_counter.py", "0 < sum(bits) <= limit and", "", (_COUNTER,)),
    Named(_OFFSET, "STEP_FIXES = 4", "STEP_FIXES = 3", (_OFFSET_TEST,)),
    # A receiver's reset sentence is none; a reset over the socket waits five seconds for the next.
    Named(_LOOP, "if not line.startswith(PREFIX):", "if True:", (_RESET,)),
    Named(_LOOP, "RESET_PAUSE_S = 5.0", "RESET_PAUSE_S = 4.0", (_RESET,)),
    Named(
        "tpmsd/onboard/daemon/recorder.py",
        "            os.ftruncate(self._descriptor, self._size)",
        "            pass",
        ("tests/onboard/daemon/test_recorder.py",),
    ),
    Named(_QUEUE, "STRANGE_S = 60.0", "STRANGE_S = 61.0", (_INPUTS,)),
    Named(_QUEUE, _STEPPED, "heapq.heapify(self._heap)", (_INPUTS,)),
    Named(_QUEUE, "(stamp_s, kind, self._number, item)", "(stamp_s, kind, -self._number, item)", (_INPUTS,)),
    Named(
        "tpmsd/onboard/daemon/notify.py",
        "self._begun_s = math.inf  # killed",
        "pass  # killed",
        ("tests/onboard/daemon/test_notify.py",),
    ),
    Named(
        "tpmsd/onboard/monitor/alarms/alarm_state.py",
        "max(self.raise_hold_s, least_hold_s)",
        "min(self.raise_hold_s, least_hold_s)",
        ("tests/onboard/monitor/test_alarm_state.py",),
    ),
    Named("tpmsd/onboard/daemon/health.py", "BUS_SILENT_S = 2.0", "BUS_SILENT_S = 3.0", (_HEALTH,)),
    Named("tpmsd/onboard/daemon/health.py", "RECEIVER_SILENT_S = 3.0", "RECEIVER_SILENT_S = 2.0", (_HEALTH,)),
    Named("tpmsd/onboard/daemon/health.py", 'counts["late"],\n', 'counts["lost"],\n', (_HEALTH,)),
    Named("tpmsd/onboard/daemon/health.py", "too_late=self._queue", "late=self._queue", (_HEALTH,)),
    # A burst ends after its silence, and when the host's clock steps back.
    Named("tpmsd/onboard/sources/gnss/nmea_epoch.py", _BURST_ENDS, _LATE, (_EPOCH,)),
    Named("tpmsd/onboard/sources/gnss/nmea_epoch.py", _BURST_ENDS, _BACK, (_EPOCH,)),
    Named(
        "tpmsd/onboard/sources/gnss/nmea_epoch.py",
        _BURST_ENDS,
        _BURST_ENDS.replace("s > self", "s >= self"),
        (_EPOCH,),
    ),
    # A counter that fell to near zero was reset, one that leapt elsewhere jumped.
    Named("tpmsd/onboard/sources/wheel_counter.py", "min(way, self._modulus / 4)", "way", (_COUNTER,)),
    Named(
        "tpmsd/onboard/sources/wheel_counter.py",
        "min(way, self._modulus / 4)",
        "self._modulus / 4",
        (_COUNTER,),
    ),
    Named("tpmsd/onboard/sources/wheel_counter.py", "min(way, self._modulus / 4)", "0", (_COUNTER,)),
    Named(_SETTINGS, "gnss_fresh_s: float = 10.0", "gnss_fresh_s: float = 5.0", (_SIGNALS,)),
    Named(_SETTINGS, "gnss_fresh_s: float = 10.0", "gnss_fresh_s: float = 20.0", (_SIGNALS,)),
    Named(_SETTINGS, "disagree_mps: float = 3.0", "disagree_mps: float = 6.0", (_SIGNALS,)),
    Named(_SETTINGS, "disagree_mps: float = 3.0", "disagree_mps: float = 1.5", (_SIGNALS,)),
    Named(_SETTINGS, "disagree_share: float = 0.2", "disagree_share: float = 0.4", (_SIGNALS,)),
    Named(_SETTINGS, "disagree_share: float = 0.2", "disagree_share: float = 0.1", (_SIGNALS,)),
    Named("tpmsd/onboard/monitor/health/signal_watch.py", "fix.quality == _ESTIMATED", "False", (_SIGNALS,)),
    # A baseline does not learn while an alarm stands, or while a loss is likelier than none.
    Named(
        "tpmsd/onboard/monitor/monitor.py",
        "judging.settled) and not self._standing",
        "judging.settled)",
        (_LEARNS,),
    ),
    Named(_SETTINGS, "suspicious: float = 0.5", "suspicious: float = 50.0", (_LEARNS,)),
    Named(_SETTINGS, "suspicious: float = 0.5", "suspicious: float = -50.0", (_LEARNS,)),
)
