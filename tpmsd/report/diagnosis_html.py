"""The diagnosis as one page that stands alone.

In: `Diagnosis`, and the replays of its drives where they were made. Out: HTML with inline pictures, no
scripts and nothing loaded from elsewhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from tpmsd.diagnosis.assessment.result import FINDING, INSUFFICIENT, Diagnosis, Finding, Quantity, Trace
from tpmsd.physics.catalogue import sentence_of
from tpmsd.report.alarms_compared import AlarmsCompared
from tpmsd.report.diagnosis_html_alarms import alarms_section
from tpmsd.report.diagnosis_summary import (
    CHANNELS,
    UNITS,
    diagnosis_summary,
    explained,
    place,
    quantity_text,
    reached,
)
from tpmsd.report.simulation_text import baseline_name
from tpmsd.report.svg import AFTER, BEFORE, Series, bars, chart, track

_STYLE = """
body { font-family: sans-serif; max-width: 52em; margin: 2em auto; padding: 0 1.2em; color: #222;
  line-height: 1.5; }
h1 { font-size: 1.6em; margin-bottom: 0.2em; } h2 { margin-top: 2em; border-bottom: 2px solid #ddd; }
h3 { margin: 1.6em 0 0.2em; }
table { border-collapse: collapse; margin: 0.8em 0; font-size: 0.92em; }
td, th { padding: 0.3em 0.8em 0.3em 0; border-bottom: 1px solid #ddd; text-align: left;
  vertical-align: top; }
td.w { white-space: nowrap; }
td.n, th.n { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
pre { background: #f5f5f3; padding: 0.9em; white-space: pre-wrap; font-size: 0.85em; }
svg { display: block; margin: 0.6em 0 1em; max-width: 100%; height: auto; }
.tiles { display: flex; flex-wrap: wrap; gap: 0.8em; margin: 1.2em 0; }
.tile { background: #f5f5f3; padding: 0.6em 1em; min-width: 8em; }
.tile b { display: block; font-size: 1.35em; } .note { color: #555; font-size: 0.92em; }
"""
_VERDICTS = {"consistent": "consistent", "mismatch": "mismatch", INSUFFICIENT: "insufficient data"}
_SHOWN = 14


def diagnosis_page(diagnosis: Diagnosis, names: list[str], alarms: Sequence[AlarmsCompared] = ()) -> str:
    """The page; `names` are those of the drives."""
    title = f"Diagnosis of {', '.join(names)}"
    parts = [f"<h1>{escape(title)}</h1>", _tiles(diagnosis)]
    parts.append(f"<pre>{escape(diagnosis_summary(diagnosis, None))}</pre>")
    parts += [f'<p class="note">{escape(note)}.</p>' for note in diagnosis.notes]
    if diagnosis.verdict != INSUFFICIENT:
        parts += _table(diagnosis)
        traces = list(diagnosis.inner.traces) if diagnosis.inner is not None else []
        for count, finding in enumerate(diagnosis.findings, 1):
            parts += _finding(count, finding, traces)
        for compared in alarms:
            parts += alarms_section(compared)
        parts += _ground(diagnosis)
        parts += _channels(diagnosis)
        parts += _evidence(diagnosis)
    body = "\n".join(part for part in parts if part)
    return (
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        f"<style>{_STYLE}</style></head><body>\n{body}\n</body></html>\n"
    )


def _tiles(diagnosis: Diagnosis) -> str:
    """The answer at a glance."""
    tiles = [("verdict", _VERDICTS[diagnosis.verdict])]
    if diagnosis.verdict != INSUFFICIENT:
        tiles.append(("driving compared", f"{diagnosis.driving_s / 60:.0f} min"))
        tiles.append(("findings", str(len(diagnosis.findings))))
        rms = f"{diagnosis.baseline_rms:.2f} → {diagnosis.model_rms:.2f}"
        tiles.append(("held-out residual (noise: 1)", rms))
        share = None if diagnosis.reach is None else diagnosis.reach.share
        tiles.append(
            ("of the reachable gain", "nothing to gain" if share is None else f"{100 * share:.0f} %")
        )
    cells = "".join(f'<div class="tile"><b>{escape(value)}</b>{escape(name)}</div>' for name, value in tiles)
    return f'<div class="tiles">{cells}</div>'


def _table(diagnosis: Diagnosis) -> list[str]:
    """All findings with their parameters and what they gain."""
    if not diagnosis.findings:
        return []
    rows = ""
    for finding in diagnosis.findings:
        values = "<br>".join(
            f"{escape(name)} = {escape(_readable(q))}" for name, q in finding.parameters.items()
        )
        rows += (
            f"<tr><td>{escape(finding.effect)}{_doubt(finding)}</td>"
            f'<td class="w">{values or "free shape, below"}</td>'
            f'<td class="n">{finding.confidence:.3f}</td><td class="n">{_nats(finding.gain)}</td>'
            f'<td class="n">{finding.rms_before:.3f} → {finding.rms_after:.3f}</td></tr>'
        )
    return [
        "<h2>What was found</h2>",
        "<table><tr><th>effect</th><th>parameters (+- one standard deviation)</th>"
        '<th class="n">confidence</th><th class="n">held-out gain, nats</th>'
        f'<th class="n">held-out residual</th></tr>{rows}</table>',
        '<p class="note">Held-out: each stretch of 30 s is predicted with values fitted elsewhere. The'
        " gain is that of the finding in the presence of the others; e to its power is how much likelier it"
        " makes the held-out data. The residual is in units of the noise.</p>",
    ]


def _doubt(finding: Finding) -> str:
    """What the certificate says of a finding."""
    if finding.p_value is None:
        return ""
    doubt = "a suspicion, " if finding.status != FINDING else ""
    return f"<br>{doubt}p {finding.p_value:.1g}"


def _readable(quantity: Quantity) -> str:
    """As `quantity_text`, small lengths in millimetres."""
    if quantity.unit == "m" and isinstance(quantity.value, float) and abs(quantity.value) < 0.05:
        std = None if quantity.std is None else 1e3 * quantity.std
        return quantity_text(Quantity(1e3 * quantity.value, std, "mm"))
    return quantity_text(quantity)


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _finding(count: int, finding: Finding, traces: list[Trace]) -> list[str]:
    """Its sentence, its shape, and its mismatch before and after; takes its trace out of the list."""
    seen = place(finding.where)
    out = [f"<h3>{count}. {escape(finding.effect)}</h3>"]
    out.append(f"<p>{escape(_capital(sentence_of(finding.effect)))}. Seen in {escape(seen)}.</p>")
    if finding.drives:
        out.append(f"<p>Only in {escape(', '.join(finding.drives))}.</p>")
    if finding.indistinguishable_from:
        rivals = ", ".join(finding.indistinguishable_from)
        out.append(
            f"<p>This drive cannot tell it from {escape(rivals)}. {escape(_capital(finding.advice))}.</p>"
        )
    elif finding.advice:
        out.append(f"<p>{escape(_capital(finding.advice))}.</p>")
    covariate = finding.where.covariate or "time"
    x_label = f"{covariate} ({UNITS.get(covariate, '')})"
    if finding.shape:
        reading = {"gnss_speed": "m/s", "gnss_course": "rad", "yaw_rate": "rad/s"}.get(finding.where.channel)
        scale = 1e3 if reading is None else 1.0
        shape = Series(
            "fitted shape, with its standard deviation",
            [at for at, _, _ in finding.shape],
            [scale * value for _, value, _ in finding.shape],
            AFTER,
            [scale * std for _, _, std in finding.shape],
        )
        label = "change of radius (mm)" if reading is None else f"reading minus truth ({reading})"
        out.append(chart([shape], x_label, label))
    for k, trace in enumerate(traces):
        if (trace.effect, trace.covariate) == (finding.effect, covariate):
            del traces[k]
            pair = [
                Series("without this effect", trace.middle.tolist(), trace.before.tolist(), BEFORE),
                Series("with it", trace.middle.tolist(), trace.after.tolist(), AFTER),
            ]
            y_label = "mismatch (standard deviations)"
            out.append(chart(pair, x_label, y_label, (-2.0, 2.0, "what noise lets expect")))
            break
    return out


def _ground(diagnosis: Diagnosis) -> list[str]:
    ground = diagnosis.inner.ground if diagnosis.inner is not None else None
    if ground is None or not diagnosis.findings:
        return []
    picture = track(
        ground.east_m.tolist(),
        ground.north_m.tolist(),
        ground.mismatch.tolist(),
        f"nats per second that {baseline_name(diagnosis)} loses against the extended one",
    )
    return ["<h2>Where on the way</h2>", picture]


def _channels(diagnosis: Diagnosis) -> list[str]:
    """Residual, gain and what is left, channel by channel."""
    if diagnosis.inner is None:
        return []
    reach = diagnosis.reach
    rows = ""
    for name, (before, after) in diagnosis.inner.rms_by_channel.items():
        rows += f"<tr><td>{escape(CHANNELS[name])}</td>"
        rows += f'<td class="n">{before:.3f}</td><td class="n">{after:.3f}</td>'
        channel = None if reach is None else reach.channels.get(name)
        if channel is not None:
            rows += f'<td class="n">{_nats(channel.found)}</td><td class="n">{_nats(channel.left)}</td>'
            rows += f'<td class="n">{channel.correlation:+.2f}</td>'
        rows += "</tr>"
    head = "".join(
        f'<th class="n">{title}</th>'
        for title in (diagnosis.baseline[0], "extended", "gain, nats", "left, nats", "next second")
    )
    out = [
        "<h2>What was reached, and what is left</h2>",
        f"<table><tr><th>channel</th>{head}</tr>{rows}</table>",
        '<p class="note">Rolling and extended: root mean square of recording minus model over what the noise'
        " lets expect. Gain: held-out log-likelihood that the extended model gains. Left: what a flexible"
        " model (every shape at every place and every effect at once) would gain beyond it. Next second:"
        " correlation of what is left with itself a second later; noise has none.</p>",
    ]
    if reach is not None:
        out.insert(1, f"<p>{escape(reached(reach))}</p>")
    out += [f"<p>{escape(told)}</p>" for told in map(explained, diagnosis.explanatory) if told]
    if diagnosis.unexplained is not None:
        out.append(f"<p>Still unexplained: {escape(place(diagnosis.unexplained))}.</p>")
    return out


def _nats(value: float) -> str:
    return f"{round(value) + 0:,}".replace(",", " ")


def _evidence(diagnosis: Diagnosis) -> list[str]:
    shown = [(name, value) for name, value in diagnosis.evidence if value > 0.0][:_SHOWN]
    found = {
        f"{f.effect} {f.parameters['wheel'].value}" for f in diagnosis.findings if "wheel" in f.parameters
    }
    found |= {finding.effect for finding in diagnosis.findings}
    return [
        "<h2>Evidence for each effect alone</h2>",
        '<p class="note">Log-likelihood that each effect would bring to'
        f" {baseline_name(diagnosis)} by itself, findings"
        " in red. Effects that resemble a true one bring something too; what counts is what an effect brings"
        " beside the others.</p>",
        bars(shown, "nats", frozenset(found)),
    ]
