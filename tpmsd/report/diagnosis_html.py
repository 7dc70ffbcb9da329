"""The diagnosis as one page that stands alone.

In: `Diagnosis`. Out: HTML with inline pictures, no scripts and nothing loaded from elsewhere.
"""

from __future__ import annotations

from html import escape

from tpmsd.diagnosis.result import INSUFFICIENT, Diagnosis, Finding
from tpmsd.report.diagnosis_summary import SENTENCES, UNITS, diagnosis_summary, place, quantity_text
from tpmsd.report.svg import bars, lines, track

_STYLE = """
body { font-family: sans-serif; max-width: 62em; margin: 2em auto; padding: 0 1em; }
body { color: #222; line-height: 1.45; }
table { border-collapse: collapse; margin: 0.6em 0; }
td, th { padding: 0.25em 0.8em; border-bottom: 1px solid #ddd; text-align: left; }
pre { background: #f6f6f6; padding: 0.8em; white-space: pre-wrap; } h2 { margin-top: 1.6em; }
"""


def diagnosis_page(diagnosis: Diagnosis, names: list[str]) -> str:
    """The page; `names` are those of the drives."""
    title = f"Diagnosis of {', '.join(names)}"
    parts = [f"<h1>{escape(title)}</h1>", f"<pre>{escape(diagnosis_summary(diagnosis, None))}</pre>"]
    if diagnosis.verdict != INSUFFICIENT:
        parts += _channels(diagnosis)
        for finding in diagnosis.findings:
            parts += _finding(diagnosis, finding)
        parts += _ground(diagnosis)
        parts.append("<h2>Evidence for each effect alone</h2>")
        parts.append(
            "<p>Log-likelihood that each effect would bring to the rolling model by itself. Effects that"
            " resemble the true one bring something too; what counts is what comes beside the findings.</p>"
        )
        shown = [(name, value) for name, value in diagnosis.evidence if value > 0.0][:18]
        parts.append(bars(shown, "nats"))
    body = "\n".join(parts)
    return (
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        f"<style>{_STYLE}</style></head><body>\n{body}\n</body></html>\n"
    )


def _channels(diagnosis: Diagnosis) -> list[str]:
    assert diagnosis.inner is not None
    rows = "".join(
        f"<tr><td>{escape(name)}</td><td>{before:.3f}</td><td>{after:.3f}</td></tr>"
        for name, (before, after) in diagnosis.inner.rms_by_channel.items()
    )
    return [
        "<h2>Residuals</h2>",
        "<p>Root mean square of recording minus model, over what the noise lets expect.</p>",
        f"<table><tr><th>channel</th><th>rolling model</th><th>extended model</th></tr>{rows}</table>",
    ]


def _finding(diagnosis: Diagnosis, finding: Finding) -> list[str]:
    assert diagnosis.inner is not None
    out = [f"<h2>{escape(finding.effect)}</h2>", f"<p>{escape(SENTENCES[finding.effect])}. Seen in "]
    out[-1] += f"{escape(place(finding.where))}. Confidence {finding.confidence:.3f}.</p>"
    rows = "".join(
        f"<tr><td>{escape(name)}</td><td>{escape(quantity_text(quantity))}</td></tr>"
        for name, quantity in finding.parameters.items()
    )
    gain = f"{finding.gain:.1f} nats ({finding.loglik_gain_per_s:.4g} per second)"
    rows += f"<tr><td>held-out gain</td><td>{gain}</td></tr>"
    rows += f"<tr><td>held-out residual</td><td>{finding.rms_before:.4f} to {finding.rms_after:.4f}</td></tr>"
    out.append(f"<table>{rows}</table>")
    if finding.indistinguishable_from:
        rivals = ", ".join(finding.indistinguishable_from)
        out.append(f"<p>This drive cannot tell it from {escape(rivals)}. {escape(finding.advice)}.</p>")
    if finding.shape:
        x = [at for at, _, _ in finding.shape]
        label = f"{finding.where.covariate or 'time'}"
        out.append(lines(x, [("fitted shape", [v for _, v, _ in finding.shape])], label, "m, m/s or rad"))
    for trace in diagnosis.inner.traces:
        if trace.effect == finding.effect and trace.covariate == (finding.where.covariate or "time"):
            out.append(
                lines(
                    trace.middle.tolist(),
                    [("without this effect", trace.before.tolist()), ("with it", trace.after.tolist())],
                    f"{trace.covariate} ({UNITS.get(trace.covariate, '')})",
                    "mismatch per bin, in standard deviations",
                    (-2.0, 2.0),
                )
            )
            break
    return out


def _ground(diagnosis: Diagnosis) -> list[str]:
    assert diagnosis.inner is not None
    ground = diagnosis.inner.ground
    if ground is None or not diagnosis.findings:
        return []
    picture = track(
        ground.east_m.tolist(),
        ground.north_m.tolist(),
        ground.mismatch.tolist(),
        "nats per second that the rolling model loses against the extended one",
    )
    return ["<h2>Where on the way</h2>", picture]
