"""A replayed drive in plain sentences: the verdict first, then what it rests on.

In: a `ReplayResult`. Out: a text of a few paragraphs, without a final newline. Times are given as drive time
and as time of the drive's host clock.
"""

from __future__ import annotations

import math

from tpmsd.foundation.english import listed
from tpmsd.foundation.wheels import WHEELS
from tpmsd.offline.report.replay_result import GNSS_GAP_S, ReplayResult, WheelOutcome
from tpmsd.offline.report.wording import drive_time, signed_mm, unsigned_mm, verdict_on, wheel_name
from tpmsd.onboard.monitor.records import AlarmEvent, AlarmKind, WheelState

_SEVERITY = {
    AlarmKind.DEFLATION: 0,
    AlarmKind.RADIUS_DEVIATION: 1,
    AlarmKind.SLOW_LEAK: 2,
    AlarmKind.MALFUNCTION: 3,
}


def replay_summary(result: ReplayResult) -> str:
    """Return the summary that `tpmsd replay` prints."""
    paragraphs = [
        verdict(result),
        _alarm_list(result),
        _wheel_table(result),
        _unmonitored_sentence(result),
        f"{_drive_sentence(result)}\n{_input_lines(result)}",
        "" if result.vehicle_state is None else result.vehicle_state.sentence(),
    ]
    return "\n\n".join(paragraph for paragraph in paragraphs if paragraph)


def verdict(result: ReplayResult) -> str:
    """Return one sentence per raised alarm, the gravest first; without alarms, how long wheels were
    monitored."""
    raised = [alarm for alarm in result.alarms if alarm.state == "raised"]
    if raised:
        heads: dict[tuple[AlarmKind, str | None], AlarmEvent] = {}
        for alarm in raised:  # an alarm that came back is one finding: its first time counts
            heads.setdefault((alarm.kind, alarm.wheel), alarm)
        ordered = sorted(heads.values(), key=lambda alarm: (_SEVERITY[alarm.kind], alarm.time_s))
        return "\n".join(_alarm_sentence(alarm, result) for alarm in ordered)
    watched = [outcome for outcome in result.wheels if outcome.monitored_s > 0]
    if not watched:
        return "No alarm, but no wheel was monitored either."
    shortest = min(outcome.monitored_s for outcome in watched)
    wheels = _wheel_list([outcome.wheel for outcome in watched]).capitalize()
    verb = "was" if len(watched) == 1 else "were"
    return f"No alarm. {wheels} {verb} monitored, for {drive_time(shortest)} or more."


def _alarm_sentence(alarm: AlarmEvent, result: ReplayResult) -> str:
    """Return `Rear left tyre is losing air: ... Announced at ...`, and whether it was cleared before the
    end."""
    still_active = any((other.kind, other.wheel) == (alarm.kind, alarm.wheel) for other in result.active)
    how = alarm.reason.strip().rstrip(".")
    detail = f": {how}." if how else "."
    end = "" if still_active else " It was cleared before the end of the drive."
    return f"{verdict_on(alarm)}{detail} Announced at {_time_text(alarm.time_s, result)}.{end}"


def _time_text(time_s: float, result: ReplayResult) -> str:
    return f"{drive_time(time_s - result.start_s)} (host time {time_s:.3f})"


def _alarm_list(result: ReplayResult) -> str:
    """Return a line per alarm raised or cleared; empty where the verdict names all of them."""
    if all(alarm.state == "raised" for alarm in result.alarms) and len(result.alarms) <= 1:
        return ""
    lines = ["Alarms:"]
    for alarm in result.alarms:
        what = f"{alarm.kind} {alarm.wheel.upper()}" if alarm.wheel else str(alarm.kind)
        numbers = ""
        if math.isfinite(alarm.deviation_m):
            numbers = f"  deviation {signed_mm(alarm.deviation_m)} mm +- {unsigned_mm(alarm.std_m)}"
        when = f"{drive_time(alarm.time_s - result.start_s):>8}  {alarm.time_s:.3f}"
        lines.append(f"  {when}  {alarm.state:<7}  {what:<19}{numbers}".rstrip())
    return "\n".join(lines)


def _wheel_table(result: ReplayResult) -> str:
    """Return the table of radius, deviation and change of each wheel that was on the bus."""
    rows = [("wheel", "state", "radius mm", "deviation mm", "change mm", "monitored", "P(deflation)")]
    for outcome in result.wheels:
        if outcome.seen_s <= 0:
            continue
        nominal = float(result.nominal_m[WHEELS.index(outcome.wheel)])
        probability = outcome.deflation_probability
        rows.append(
            (
                wheel_name(outcome.wheel),
                str(outcome.state),
                unsigned_mm(nominal + outcome.deviation_m),
                _mm_with_std(outcome.deviation_m, outcome.std_m),
                _mm_with_std(outcome.change_m, outcome.change_std_m),
                drive_time(outcome.monitored_s) if outcome.monitored_s > 0 else "-",
                f"{probability:.3f}" if math.isfinite(probability) else "-",
            )
        )
    if len(rows) == 1:
        return ""
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    lines = []
    for row in rows:
        cells = [
            cell.ljust(width) if column < 2 else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        ]
        lines.append("  ".join(cells).rstrip())
    note = (
        "deviation: radius minus nominal; change: radius minus learned baseline; +- is one standard deviation"
    )
    return "\n".join([*lines, note])


def _mm_with_std(value_m: float, std_m: float) -> str:
    return f"{signed_mm(value_m)} +- {unsigned_mm(std_m)}" if math.isfinite(value_m) else "-"


def _unmonitored_sentence(result: ReplayResult) -> str:
    """Return which wheels were not monitored and why; empty if all were."""
    sentences = []
    absent = [outcome.wheel for outcome in result.wheels if outcome.seen_s <= 0]
    if len(absent) == len(WHEELS):
        return "Not monitored: no wheel signal of the configuration was usable on the bus."
    if absent:
        sentences.append(f"{_wheel_list(absent)} (no usable signal on the bus)")
    reasons: dict[str, list[str]] = {}
    for outcome in result.wheels:
        if outcome.seen_s > 0 and outcome.monitored_s <= 0:
            reasons.setdefault(_why_unmonitored(outcome, result), []).append(outcome.wheel)
    sentences.extend(f"{_wheel_list(wheels)} ({reason})" for reason, wheels in reasons.items())
    lost = [
        outcome.wheel
        for outcome in result.wheels
        if outcome.monitored_s > 0 and outcome.state == WheelState.UNAVAILABLE
    ]
    if lost:
        sentences.append(f"{_wheel_list(lost)} at the end of the drive (the signal was lost)")
    return "Not monitored: " + "; ".join(sentences) + "." if sentences else ""


def _why_unmonitored(outcome: WheelOutcome, result: ReplayResult) -> str:
    """Return the reason why a wheel on the bus was never monitored."""
    if result.gnss.fixes == 0:
        return "no GNSS fix in the whole drive"
    if result.moving_s <= 0:
        return "the car never moved"
    if not math.isfinite(outcome.deviation_m):
        return "its radius was never estimated"
    return (
        f"the baseline was still being learned, {math.floor(100 * result.learning_fraction)}% of it after "
        f"{math.floor(result.informative_s)} s of steady driving; {result.learn_s:.0f} s are needed"
    )


def _drive_sentence(result: ReplayResult) -> str:
    factor = result.realtime_factor
    speed = f", replayed at {factor:.{0 if factor >= 10 else 1}f} times real time" if factor > 0 else ""
    gaps = ""
    if result.tick_gaps:
        gaps = f" The recording pauses {_times_word(result.tick_gaps)}, {result.tick_gap_s:.1f} s in all."
    return (
        f"Drive {result.drive}: {drive_time(result.duration_s)}, {result.distance_m / 1e3:.2f} km, "
        f"{drive_time(result.moving_s)} of it moving and {drive_time(result.informative_s)} informative"
        f"{speed}.{gaps}"
    )


def _input_lines(result: ReplayResult) -> str:
    """Return fixes, outages and fault counts of the inputs, one line each."""
    lines = [
        f"GNSS: {'; '.join(filter(None, (_fixes_sentence(result), _fault_counts_text(result, 'gnss'))))}."
    ]
    lines.append(f"CAN: {_fault_counts_text(result, 'can') or 'no faults'}.")
    others = sorted({key.split(" ")[0] for key in result.fault_counts} - {"can", "gnss"})
    lines.extend(f"{source.capitalize()}: {_fault_counts_text(result, source)}." for source in others)
    return "\n".join(lines)


def _fixes_sentence(result: ReplayResult) -> str:
    gnss = result.gnss
    if gnss.fixes == 0:
        return "no fix in the whole drive"
    if gnss.outages == 0:
        return f"{gnss.fixes} fixes, never more than {GNSS_GAP_S:.0f} s without a usable one"
    total = f", {gnss.outage_s:.0f} s in all" if gnss.outages > 1 else ""
    return (
        f"{gnss.fixes} fixes, {_times_word(gnss.outages)} more than {GNSS_GAP_S:.0f} s without a usable "
        f"one{total} (longest {gnss.longest_outage_s:.0f} s)"
    )


def _fault_counts_text(result: ReplayResult, source: str) -> str:
    counts = [
        f"{count} {key.removeprefix(source + ' ').replace('_', ' ')}"
        for key, count in sorted(result.fault_counts.items(), key=lambda item: (-item[1], item[0]))
        if key.startswith(source + " ")
    ]
    return f"rejected before the estimate: {', '.join(counts)}" if counts else ""


def _times_word(count: int) -> str:
    return {1: "once", 2: "twice"}.get(count, f"{count} times")


def _wheel_list(wheels: list[str]) -> str:
    return listed([wheel_name(wheel) for wheel in wheels])
