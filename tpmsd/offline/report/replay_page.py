"""A replayed drive as one HTML page.

In: a `ReplayResult`, its tick track where it was kept, where it comes from. Out: HTML (template
`replay.html`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from tpmsd.foundation.wheels import WHEELS
from tpmsd.offline.report.figures import Track
from tpmsd.offline.report.page import Cell, HtmlTable, Origin, RenderedFigure, Tile, render, render_figure
from tpmsd.offline.report.replay_charts import replay_charts
from tpmsd.offline.report.replay_result import GNSS_GAP_S, ReplayResult, WheelOutcome
from tpmsd.offline.report.replay_summary import verdict
from tpmsd.offline.report.wording import drive_time, plain_name, signed_mm, unsigned_mm, utc_text, wheel_name
from tpmsd.onboard.monitor.records import AlarmEvent

_HELP = {
    "Radius minus learned baseline": "What the alarms are raised from: the lines are their thresholds, the"
    " bands two standard deviations. A soft tyre falls; the others stay.",
    "Radius minus nominal": "The same against the configured radius, before any baseline. A constant offset"
    " is calibration and no fault.",
    "Probability of a deflation": "Of each wheel, by the monitor; near 1 for long enough, it raises"
    " the alarm.",
    "Speed": "Grey: driving from which no radius is learned (slow, braking, in a bend). Yellow: more than"
    f" {GNSS_GAP_S:.0f} s without a fix.",
    "Side slip": "Of the centre of gravity, by the filter of --vehicle-state; the band is two standard"
    " deviations.",
    "Lateral speed": "Of the centre of gravity, to the left, with two standard deviations.",
    "Faults of the inputs so far": "Each step is something wrong with the bus or the receiver.",
    "Track": "In the plane of the first fix. Diamonds: alarms. The ring follows the pointer in the plots"
    " above.",
}


def replay_page(
    result: ReplayResult,
    origin: Origin,
    track: Track | None = None,
    notes: Sequence[str] = (),
    standalone: bool = True,
) -> str:
    """Return the page; ConfigError where Jinja2 or matplotlib is missing."""
    figures = [_render_chart(chart.title, k, chart) for k, chart in enumerate(replay_charts(result))]
    return render(
        "replay.html",
        origin,
        standalone,
        drive=result.drive,
        verdict=verdict(result).splitlines(),
        head=_summary_tiles(result),
        wheels=_wheel_table(result),
        alarms=_alarm_table(result),
        figures=figures,
        track=None if track is None else render_figure(track, "track", _HELP["Track"]),
        faults=_fault_table(result),
        notes=list(notes),
    )


def _render_chart(title: str, number: int, chart: object) -> RenderedFigure:
    return render_figure(chart, f"plot-{number}", _HELP[title.split(" (")[0]])  # type: ignore[arg-type]


def _summary_tiles(result: ReplayResult) -> list[Tile]:
    raised = sum(alarm.state == "raised" for alarm in result.alarms)
    gnss = result.gnss
    longest = f", longest {gnss.longest_outage_s:.0f} s" if gnss.outages else ""
    return [
        Tile(
            drive_time(result.duration_s), "Duration", f"From {utc_text(result.start_s)} by the host's clock."
        ),
        Tile(f"{result.distance_m / 1e3:.2f} km", "Distance", f"{drive_time(result.moving_s)} of it moving."),
        Tile(str(raised), "Alarms raised", f"{len(result.active)} of them stand at the end of the drive."),
        Tile(
            f"{math.floor(100.0 * result.learning_fraction)} %",
            "Baseline learned",
            f"After {drive_time(result.learn_s)} of informative driving (gentle, above a speed limit)"
            f" a wheel is monitored; this drive had {drive_time(result.informative_s)}.",
        ),
        Tile(
            str(gnss.fixes),
            "GNSS fixes",
            f"{gnss.outages} outage{'s' * (gnss.outages != 1)} of more than {GNSS_GAP_S:.0f} s{longest}.",
        ),
    ]


def _wheel_table(result: ReplayResult) -> HtmlTable:
    heads = ("wheel", "state", "radius (mm)", "deviation (mm)", "change (mm)", "monitored", "P(deflation)")
    rows = []
    for outcome in result.wheels:
        if outcome.seen_s > 0:
            rows.append(_wheel_row(outcome, float(result.nominal_m[WHEELS.index(outcome.wheel)])))
    return HtmlTable(heads, tuple(rows))


def _wheel_row(outcome: WheelOutcome, nominal_m: float) -> tuple[Cell, ...]:
    probability = outcome.deflation_probability
    return (
        Cell(wheel_name(outcome.wheel)),
        Cell(str(outcome.state)),
        Cell(unsigned_mm(nominal_m + outcome.deviation_m), number=True),
        Cell(_mm_with_std(outcome.deviation_m, outcome.std_m), number=True),
        Cell(_mm_with_std(outcome.change_m, outcome.change_std_m), number=True),
        Cell(drive_time(outcome.monitored_s) if outcome.monitored_s > 0 else "–", number=True),
        Cell(f"{probability:.3f}" if math.isfinite(probability) else "–", number=True),
    )


def _mm_with_std(value_m: float, std_m: float) -> str:
    return f"{signed_mm(value_m)} ± {unsigned_mm(std_m)}" if math.isfinite(value_m) else "–"


def _alarm_table(result: ReplayResult) -> HtmlTable:
    rows = tuple(_alarm_row(alarm, result.start_s) for alarm in result.alarms)
    return HtmlTable(("time", "alarm", "wheel", "state", "deviation (mm)", "reason"), rows)


def _alarm_row(alarm: AlarmEvent, start_s: float) -> tuple[Cell, ...]:
    return (
        Cell(drive_time(alarm.time_s - start_s)),
        Cell(plain_name(str(alarm.kind))),
        Cell(wheel_name(alarm.wheel)),
        Cell(alarm.state),
        Cell(_mm_with_std(alarm.deviation_m, alarm.std_m), number=True),
        Cell(alarm.reason),
    )


def _fault_table(result: ReplayResult) -> HtmlTable:
    ordered = sorted(result.fault_counts.items(), key=lambda item: (-item[1], item[0]))
    rows = tuple((Cell(_fault_name(key)), Cell(str(count), number=True)) for key, count in ordered)
    return HtmlTable(("fault", "how often"), rows)


def _fault_name(key: str) -> str:
    source, _, what = key.partition(" ")
    return f"{source.upper() if source in ('can', 'gnss') else source}: {what.replace('_', ' ')}"
