"""What is mutated and which tests have to notice: packages for the sampled run, and mutations by name.

A mutation by name is one that tests once missed. It stays here with the tests that kill it now.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

REPO = Path(__file__).resolve().parents[2]


@dataclass(frozen=True, slots=True)
class Package:
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
    """The modules of a package and of the packages in it, without those that hold numbers alone."""
    skipped = {"__init__", *left_out}
    found = sorted(path for path in (REPO / folder).rglob("*.py") if path.stem not in skipped)
    return tuple(str(path.relative_to(REPO)) for path in found)


def _daemon_tests() -> tuple[str, ...]:
    """The tests of the daemon that run it in their own process."""
    names = (
        *("can_errors", "descriptors", "feeder", "health", "inputs", "journal", "link_ends", "links", "loop"),
        *("loop_log", "notify", "obd", "own_frames", "record", "recorder", "reset", "service_manager"),
        *("signals", "state_keeper", "state_lock", "time"),
    )
    own = tuple(f"tests/onboard/daemon/test_{name}.py" for name in names)
    return (*own, "tests/car/config/test_signal_table.py")


PACKAGES = {
    "monitor": Package(
        _modules("tpmsd/onboard/monitor", "settings", "drive_settings", "encoder_settings"),
        ("tests/onboard/monitor",),
        "TestLife or a_leak_is_noticed_over_restarts or what_a_drive_taught_counts or a_leak_of_half_an_hour"
        " or no_history_of_radii_flaps or reset_away_minute",
    ),
    "timeline": Package(
        _modules("tpmsd/onboard/timeline"),
        (
            "tests/onboard/timeline",
            "tests/onboard/gnss/test_utc_offset.py",
            "tests/onboard/gnss/test_local_plane.py",
            "tests/onboard/gnss/test_gnss_on_can.py",
        ),
        "test_any_stamps or test_faulty_lines or test_faulty_buses",
    ),
    "daemon": Package(_modules("tpmsd/onboard/daemon"), _daemon_tests()),
    "wheel_counter": Package(
        ("tpmsd/onboard/sources/wheel_counter.py",),
        tuple(
            f"tests/onboard/sources_can/test_{name}.py"
            for name in ("wheel_reach", "wheel_counter", "can_decoder", "regular_readings")
        ),
    ),
    "epochs": Package(
        ("tpmsd/onboard/sources/gnss/nmea_epoch.py", "tpmsd/onboard/sources/gnss/nmea_checks.py"),
        ("tests/onboard/gnss/test_nmea_epoch.py", "tests/onboard/gnss/test_nmea_checks.py"),
    ),
    "state_file": Package(
        (
            "tpmsd/onboard/sinks/state_file.py",
            "tpmsd/onboard/daemon/state_keeper.py",
            "tpmsd/onboard/daemon/state_writer.py",
        ),
        ("tests/onboard/sinks/test_state_file.py", "tests/onboard/daemon/test_state_keeper.py"),
    ),
    "health": Package(
        ("tpmsd/onboard/daemon/health.py",),
        ("tests/onboard/daemon/test_health.py", "tests/onboard/daemon/test_loop.py"),
    ),
    "links": Package(
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
_TREND = "test_a_lone_early_fix_is_enough_for_the_trend"
_LOOPS = "tests/onboard/daemon/test_loop.py"
_LOOP, _RESET = "tpmsd/onboard/daemon/loop.py", "tests/onboard/daemon/test_reset.py"
_QUEUE, _INPUTS = "tpmsd/onboard/daemon/input_queue.py", "tests/onboard/daemon/test_inputs.py"
_WHEEL_COUNTER = "tpmsd/onboard/sources/wheel_counter.py"
_AHEAD = (
    "tests/onboard/sources_can/test_wheel_reach.py::test_a_reading_ahead_is_regular_up_to_the_last_bit",
)
_STEADY = ("tests/onboard/sources_can/test_regular_readings.py::test_a_steady_drive_is_regular",)
_SLACK = "slack = 0.5 * self._accel * interval * (span + interval) + SLACK_BITS + interval / span"
_POLLED = "test_a_bus_without_a_descriptor_is_polled_every_few_milliseconds"
_ADAPTER = "test_stamps_of_an_adapters_own_clock_are_brought_onto_the_hosts"
_STEPPED = "heapq.heapify(self._heap)\n        self._released_until_s = -math.inf"
_SETTINGS = "tpmsd/onboard/monitor/settings.py"
_LATE, _BACK = "time_s > self.deadline_s", "time_s < burst.last_s - self._interval.gap_s"
_BURST_ENDS = f"({_LATE} or {_BACK})"

_STATES, _RECORD = "tests/onboard/sinks/test_state_file.py", "tests/onboard/daemon/test_record.py"
_REGULAR = ("tests/onboard/sources_can/test_regular_readings.py",)
_TIMELINE, _PLANS = "tpmsd/onboard/timeline/timeline.py", "tests/onboard/timeline/test_tick_plan.py"
_PLANE = "tests/onboard/gnss/test_local_plane.py"
_TRACK, _ASKER = "tpmsd/onboard/timeline/rotation_track.py", "tpmsd/onboard/daemon/obd_asker.py"

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
        "max(self.raise_hold_s, min_hold_s)",
        "min(self.raise_hold_s, min_hold_s)",
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
    Named(
        "tpmsd/onboard/sources/wheel_counter.py", "min(distance, self._modulus / 4)", "distance", (_COUNTER,)
    ),
    Named(
        "tpmsd/onboard/sources/wheel_counter.py",
        "min(distance, self._modulus / 4)",
        "self._modulus / 4",
        (_COUNTER,),
    ),
    Named("tpmsd/onboard/sources/wheel_counter.py", "min(distance, self._modulus / 4)", "0", (_COUNTER,)),
    Named(_SETTINGS, "gnss_fresh_s: float = 10.0", "gnss_fresh_s: float = 5.0", (_SIGNALS,)),
    Named(_SETTINGS, "gnss_fresh_s: float = 10.0", "gnss_fresh_s: float = 20.0", (_SIGNALS,)),
    Named(_SETTINGS, "disagree_mps: float = 3.0", "disagree_mps: float = 6.0", (_SIGNALS,)),
    Named(_SETTINGS, "disagree_mps: float = 3.0", "disagree_mps: float = 1.5", (_SIGNALS,)),
    Named(_SETTINGS, "disagree_share: float = 0.2", "disagree_share: float = 0.4", (_SIGNALS,)),
    Named(_SETTINGS, "disagree_share: float = 0.2", "disagree_share: float = 0.1", (_SIGNALS,)),
    Named("tpmsd/onboard/monitor/health/signal_watch.py", "fix.quality == _ESTIMATED", "False", (_SIGNALS,)),
    # Readings taken at once keep to the bounds of readings one by one, and a steady drive is regular.
    Named(_WHEEL_COUNTER, _SLACK, _SLACK.replace("0.5 *", "0.5 +"), _AHEAD),
    Named(_WHEEL_COUNTER, _SLACK, _SLACK.replace("interval /", "interval +"), _AHEAD),
    Named(_WHEEL_COUNTER, "np.where(period_s > 0.0, period_s", "np.where(period_s < 0.0, period_s", _AHEAD),
    Named(_WHEEL_COUNTER, "(step + modulus // 4)", "(step ^ modulus // 4)", _STEADY),
    # Trend of the offset, heights of roads, a gap, a block without a tick.
    Named(_OFFSET, "times_s[0] > _TREND", "times_s[1] > _TREND", (f"{_OFFSET_TEST}::{_TREND}",)),
    Named(
        "tpmsd/onboard/timeline/local_plane.py",
        "= -500.0, 9000.0",
        "= -499.0, 9000.0",
        ("tests/onboard/gnss/test_local_plane.py::test_heights_of_no_road_leave_the_scale",),
    ),
    Named(
        "tpmsd/onboard/timeline/compensation.py",
        "if tick.gap_s > 0.0:",
        "if tick.gap_s > 1.0:",
        ("tests/onboard/timeline/test_compensation.py::test_a_grade_is_forgotten_in_a_gap",),
    ),
    Named(
        "tpmsd/onboard/timeline/timeline.py",
        "if last_s > begin_s else 0",
        "if last_s != begin_s else 0",
        ("tests/onboard/timeline/test_tick_plan.py::test_a_block_without_a_wheel_is_no_plan",),
    ),
    # Descriptors, the recording's marks, an adapter's stamps, polling, the car that is asked, the log.
    Named(
        "tpmsd/onboard/daemon/descriptors.py",
        "if watched is not None:",
        "if watched is None:",
        ("tests/onboard/daemon/test_descriptors.py",),
    ),
    Named(
        "tpmsd/onboard/daemon/feeder.py",
        "until_s - self._written_s < MARK_S",
        "until_s - self._written_s is not MARK_S",
        ("tests/onboard/daemon/test_feeder.py",),
    ),
    Named(
        _LOOP,
        "if frame_time is None and not",
        "if frame_time is not None and not",
        (f"{_LOOPS}::{_ADAPTER}",),
    ),
    Named(_LOOP, "POLL_S = 0.004", "POLL_S = -0.996", (f"{_LOOPS}::{_POLLED}",)),
    Named(_LOOP, '"" if tyres is None else', '"" if tyres is not None else', (_RESET,)),
    Named(
        "tpmsd/onboard/daemon/obd_asker.py",
        "or now_s > min(self._until_s",
        "or now_s >= min(self._until_s",
        ("tests/onboard/daemon/test_obd.py::test_the_minute_ends_with_its_last_instant",),
    ),
    # A baseline does not learn while an alarm is active, or while a loss is likelier than none.
    Named(
        "tpmsd/onboard/monitor/monitor.py",
        "judging.settled) and not self._active",
        "judging.settled)",
        (_LEARNS,),
    ),
    Named(_SETTINGS, "suspicious: float = 0.5", "suspicious: float = 50.0", (_LEARNS,)),
    Named(_SETTINGS, "suspicious: float = 0.5", "suspicious: float = -50.0", (_LEARNS,)),
    # Bounds of counters and of the state's file, the plane's axes, ticks that wait, links and requests.
    Named(
        "tpmsd/onboard/sinks/state_file.py",
        "MAX_BYTES = 1 << 20",
        "MAX_BYTES = 2 << 20",
        ("tests/onboard/sinks/test_state_file.py::test_a_state_may_have_a_megabyte_and_no_byte_more",),
    ),
    Named(
        "tpmsd/onboard/sources/wheel_counter.py",
        "or math.isnan(self._speed)\n",
        "and math.isnan(self._speed)\n",
        (
            "tests/onboard/sources_can/test_regular_readings.py::test_nothing_is_regular_while_no_speed_is_known",
        ),
    ),
    Named(
        "tpmsd/onboard/sources/wheel_counter.py",
        "wide = span >= 0.8 * SPEED_WINDOW_S",
        "wide = span >= 0.0 * SPEED_WINDOW_S",
        (
            "tests/onboard/sources_can/test_regular_readings.py::test_a_new_segment_keeps_the_speed_of_before_for_80_ms",
        ),
    ),
    Named(
        "tpmsd/onboard/sources/wheel_counter.py",
        "suspect[0], kind, self.wheel",
        "suspect[-1], kind, self.wheel",
        (
            "tests/onboard/sources_can/test_wheel_reach.py::test_a_fault_bears_the_time_of_the_reading_that_was_doubted",
        ),
    ),
    Named(
        "tpmsd/onboard/sources/wheel_counter.py",
        "        if speed >= 0.0:\n",
        "        if speed >= -1.0:\n",
        ("tests/onboard/sources_can/test_wheel_reach.py::test_the_slowest_wheel_has_a_direction",),
    ),
    Named(
        "tpmsd/onboard/sources/wheel_counter.py",
        "self._accel * run * (width + run)",
        "self._accel * run // (width + run)",
        (
            "tests/onboard/sources_can/test_regular_readings.py::test_a_value_that_was_not_renewed_ends_what_is_regular",
        ),
    ),
    Named(
        "tpmsd/onboard/timeline/local_plane.py",
        "vector[2] + once[2] + twice[2] / (1.0 + cos)",
        "vector[2] + once[2] + twice[2] / (2.0 + cos)",
        (
            "tests/onboard/gnss/test_local_plane.py::test_axes_are_carried_by_the_rotation_that_takes_one_vertical_to_the_other",
        ),
    ),
    Named(
        "tpmsd/onboard/timeline/tick_source.py",
        "advance(time_s)):\n                break",
        "advance(time_s)):\n                continue",
        (
            "tests/onboard/timeline/test_tick_source_pace.py::test_frames_behind_one_that_meets_something_due_are_not_passed_by",
        ),
    ),
    Named(
        "tpmsd/onboard/timeline/compensation.py",
        "and tick.gap_s == 0.0:",
        "and tick.gap_s == -1.0:",
        (
            "tests/onboard/timeline/test_compensation.py::test_the_rate_of_steering_is_that_of_the_last_ticks_without_a_gap",
        ),
    ),
    Named(
        "tpmsd/onboard/timeline/timeline.py",
        "self._due_s = self._tick_end_s(self._index + 1) + needed",
        "self._due_s = self._tick_end_s(self._index + 2) + needed",
        (
            "tests/onboard/timeline/test_slow_receiver.py::test_the_tick_that_waits_is_due_when_the_longer_holdback_is_over",
        ),
    ),
    Named(
        "tpmsd/onboard/daemon/feeder.py",
        "CLOCK_STEP_S = 0.25",
        "CLOCK_STEP_S = 1.25",
        ("tests/onboard/daemon/test_feeder.py::test_a_quarter_of_a_second_is_a_step_of_the_clock",),
    ),
    Named(
        "tpmsd/onboard/daemon/obd_asker.py",
        "        if self._in_vain >= UNANSWERED:",
        "        if not self._in_vain >= UNANSWERED:",
        ("tests/onboard/daemon/test_obd.py::test_the_speed_is_known_until_ten_requests_were_in_vain",),
    ),
    Named(
        "tpmsd/onboard/daemon/obd_asker.py",
        "ASLEEP_S = 60.0",
        "ASLEEP_S = 61.0",
        ("tests/onboard/daemon/test_obd.py::test_a_bus_that_was_silent_for_a_minute_has_slept",),
    ),
    Named(
        "tpmsd/onboard/daemon/link.py",
        "self._opened_s = now_s\n        self.generation += 1",
        "self._opened_s = now_s\n        self.generation += 0",
        ("tests/onboard/daemon/test_link_ends.py::test_each_opening_and_each_failure_is_a_generation",),
    ),
    Named(
        "tpmsd/onboard/daemon/notify.py",
        "{self._config.command[0]} cannot be run",
        "{self._config.command[-1]} cannot be run",
        ("tests/onboard/daemon/test_notify.py::test_a_program_that_is_not_there_is_said_once",),
    ),
    Named(
        "tpmsd/onboard/daemon/drive_recording.py",
        "self._max_bytes >> 20} MB",
        "self._max_bytes >> 21} MB",
        ("tests/onboard/daemon/test_record.py::test_a_recording_ends_at_its_limit_and_says_which",),
    ),
    Named(
        "tpmsd/onboard/daemon/state_lock.py",
        "parents=True",
        "parents=False",
        ("tests/onboard/daemon/test_state_lock.py::test_folders_of_the_state_are_made",),
    ),
    Named(
        "tpmsd/onboard/daemon/service_manager.py",
        "self._fed_ticks = 0\n",
        "self._fed_ticks = 1\n",
        (
            "tests/onboard/daemon/test_service_manager.py::test_the_first_tick_makes_it_ready_and_feeds_the_watchdog",
        ),
    ),
    Named(
        "tpmsd/onboard/daemon/bus_link.py",
        "self._malformed_before + (",
        "self._malformed_before ^ (",
        ("tests/onboard/daemon/test_links.py::test_malformed_datagrams_add_up_over_openings",),
    ),
    Named(
        "tpmsd/onboard/timeline/reading_track.py",
        "in zip(times_s, values, strict=True):",
        "in []:",
        (
            "tests/onboard/timeline/test_tick_plan.py::test_readings_of_before_a_step_of_the_clock_are_put_in_order",
        ),
    ),
    Named(
        "tpmsd/onboard/timeline/compensation.py",
        "start = self._start_s if self._start_s is not None",
        "start = self._start_s if not self._start_s is not None",
        (
            "tests/onboard/timeline/test_compensation.py::test_time_counts_from_the_beginning_of_the_first_tick",
        ),
    ),
    # The sample of seed 5757: each survivor that acts otherwise, but one, with the test that kills it.
    Named("tpmsd/onboard/daemon/state_writer.py", "daemon=True", "daemon=False", (_KEEPER,)),
    Named("tpmsd/onboard/sinks/state_file.py", "sort_keys=True", "sort_keys=False", (_STATES,)),
    Named("tpmsd/onboard/sinks/state_file.py", "parents=True", "parents=False", (_STATES,)),
    Named(_WHEEL_COUNTER, "np.append(self._span, spans)[:-1]", "np.append(self._span, spans)[:+1]", _REGULAR),
    Named(_WHEEL_COUNTER, "0.0 < after[0] - before[0]", "0.0 <= after[0] - before[0]", (_COUNTER,)),
    Named(_WHEEL_COUNTER, "np.abs(speed[begin]) * run - 0.5", "np.abs(speed[begin]) * run + 0.5", _REGULAR),
    Named(_WHEEL_COUNTER, "(bits + modulus <= high)", "(bits + modulus is high)", _REGULAR),
    Named(_TIMELINE, '"off_utc": 0', '"off_utc": -1', ("tests/onboard/timeline/test_timeline.py",)),
    Named(_TIMELINE, "max((float(group.time_s[-1])", "max((float(group.time_s[-2])", (_PLANS,)),
    Named(
        "tpmsd/onboard/timeline/rotation_track.py",
        "return not self._times\n",
        "return self._times\n",
        (_PLANS,),
    ),
    Named("tpmsd/onboard/timeline/local_plane.py", "RADIUS_M = 2000.0", "RADIUS_M = 2001.0", (_PLANE,)),
    Named(
        "tpmsd/onboard/daemon/obd_asker.py",
        "if kmh > 0:",
        "if kmh > 1:",
        ("tests/onboard/daemon/test_obd.py",),
    ),
    *(
        Named("tpmsd/onboard/daemon/drive_recording.py", old, new, (_RECORD,))
        for old, new in (
            ("frames_before = 0\n", "frames_before = 1\n"),
            ("            self._flush_files(sync=True)", "            self._flush_files(sync=False)"),
            ("self.seen.frames - frames_before", "self.seen.frames >> frames_before"),
            ("sync=monotonic_s - synced_s >= SYNC_S", "sync=monotonic_s - synced_s < SYNC_S"),
        )
    ),
    # The samples of seeds 6011, 6012, 6021: survivors that act otherwise, with the test that kills each.
    *(
        Named(f"tpmsd/onboard/{module}", old, new, (f"tests/onboard/{test}.py",))
        for module, old, new, test in (
            (
                "monitor/slow_leaks/history.py",
                "[-self._settings.clear_days :]",
                "[~self._settings.clear_days :]",
                "monitor/test_slow_leak",
            ),
            (
                "monitor/baseline/baseline.py",
                "_learned_s = 0.0\n        self._since_s = 0.0",
                "_learned_s = 0.0\n        self._since_s = 1.0",
                "monitor/test_grip",
            ),
            (
                "monitor/evidence/detectable.py",
                "np.array(smallest) * radius_m",
                "np.array(smallest) + radius_m",
                "monitor/test_detectable",
            ),
            ("daemon/state_keeper.py", "split()) or type", "split()) and type", "daemon/test_state_keeper"),
            ("daemon/state_keeper.py", 'int") != self', 'int") > self', "daemon/test_state_keeper"),
            ("daemon/state_keeper.py", "FINISH_S = 5.0", "FINISH_S = 4.0", "daemon/test_state_keeper"),
            (
                "sources/wheel_counter.py",
                "or self._suspect is not None",
                "and self._suspect is not None",
                "sources_can/test_regular_readings",
            ),
            (
                "sources/wheel_counter.py",
                "if raw == self._raw else self._time_s",
                "if raw != self._raw else self._time_s",
                "sources_can/test_wheel_counter",
            ),
            ("timeline/utc_offset.py", "_FIXES = 4096", "_FIXES = 4097", "gnss/test_utc_offset"),
            ("timeline/utc_offset.py", "maxlen=64", "maxlen=65", "gnss/test_utc_offset"),
            (
                "timeline/compensation.py",
                "tick.dt_s / RATE_SMOOTHING_S",
                "tick.dt_s ** RATE_SMOOTHING_S",
                "timeline/test_compensation",
            ),
            (
                "timeline/compensation.py",
                "speed > 1.0 else",
                "speed != 1.0 else",
                "timeline/test_compensation",
            ),
            (
                "timeline/block_source.py",
                "if tick is None:\n",
                "if not tick is None:\n",
                "timeline/test_block_source",
            ),
            (
                "timeline/block_source.py",
                "(latest_s + self._shift_s)",
                "(latest_s ** self._shift_s)",
                "timeline/test_block_source",
            ),
            ("timeline/local_plane.py", "cos < -0.999999", "cos == -0.999999", "gnss/test_local_plane"),
            ("timeline/timeline.py", "[at_s + shift_s", "[at_s ^ shift_s", "timeline/test_timeline"),
            ("timeline/speed_accuracy.py", "_since += 1", "_since += 0", "timeline/test_speed_accuracy"),
            ("daemon/journal.py", ") and not stream", ") or not stream", "daemon/test_journal"),
            ("daemon/signals.py", "in STOP_SIGNALS:", "in []:", "daemon/test_signals"),
            ("daemon/signals.py", "in self._handlers.items():", "in []:", "daemon/test_signals"),
            (
                "daemon/loop.py",
                "if self._manager.is_ready and",
                "if not self._manager.is_ready and",
                "daemon/test_loop_log",
            ),
            (
                "daemon/loop.py",
                "if frames := bus.read(monotonic_s):",
                "if not (frames := bus.read(monotonic_s)):",
                "daemon/test_loop_log",
            ),
            (
                "daemon/link.py",
                "self._until_data = False\n        self._delay_s",
                "self._until_data = True\n        self._delay_s",
                "daemon/test_link_ends",
            ),
            ("daemon/feeder.py", "monotonic_s + HOLD_S", "monotonic_s // HOLD_S", "daemon/test_feeder"),
            ("daemon/clock.py", "INSTANT_S = 1e-3", "INSTANT_S = 1.001", "daemon/test_time"),
            (
                "daemon/loop.py",
                "in self._receiver.read(monotonic_s, now_s):",
                "in []:",
                "daemon/test_loop_log",
            ),
            (
                "daemon/loop.py",
                "enumerate(config.can.buses.values(), 1)}",
                "enumerate(config.can.buses.values(), 0)}",
                "daemon/test_loop_log",
            ),
            ("daemon/drive_recording.py", "exist_ok=True", "exist_ok=False", "daemon/test_record"),
            ("timeline/timeline.py", "MAX_AHEAD_S = 1.0", "MAX_AHEAD_S = 2.0", "timeline/test_timeline"),
            (
                "timeline/timeline.py",
                "for track in self._tracks:\n                track.forget",
                "for track in []:\n                track.forget",
                "timeline/test_block_source",
            ),
            (
                "timeline/utc_offset.py",
                "if half >= _WARM_FIXES",
                "if half > _WARM_FIXES",
                "gnss/test_utc_offset",
            ),
            ("daemon/notify.py", "MAX_WAITING = 32", "MAX_WAITING = 33", "daemon/test_notify"),
            ("daemon/obd_asker.py", "if not self:", "if not not self:", "daemon/test_obd"),
            ("daemon/input_queue.py", "if entry[0] > now_s", "if entry[0] >= now_s", "daemon/test_inputs"),
            ("daemon/frame_stamps.py", "if not 0.0 <=", "if not -1.0 <=", "daemon/test_inputs"),
            ("daemon/frame_stamps.py", "WINDOW_S = 10.0", "WINDOW_S = 11.0", "daemon/test_inputs"),
            ("daemon/drive_recording.py", "200 << 20", "201 << 20", "daemon/test_record"),
            (
                "daemon/drive_recording.py",
                "if len(seen.identifiers) < 4096",
                "if not len(seen.identifiers) < 4096",
                "daemon/test_record",
            ),
        )
    ),
)
