"""The fleet's report as one page that opens offline.

In: the report's document and the tables. Out: HTML with the tables for manager and engineer, each to be
sorted by a click on its heads, and for every car its drives with the radii of each. Without JavaScript all
is shown as it is, unsorted.
"""

from __future__ import annotations

import html
from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import Any

from tpmsd.fleet.report import utc

Row = dict[str, Any]
MAX_DRIVES = 2_000
"""Of which the page shows details, the newest of each car first: the page stays under some megabytes."""

_STYLE = """
:root{color-scheme:light dark}
body{font:15px/1.45 system-ui,sans-serif;max-width:75rem;margin:0 auto;padding:1rem}
h1{font-size:1.5rem}h2{font-size:1.2rem;margin-top:2.2rem}h3{font-size:1rem}
table{border-collapse:collapse;width:100%;font-variant-numeric:tabular-nums}
div.wide{overflow-x:auto}
th,td{text-align:left;padding:.3rem .6rem;border-bottom:1px solid #8886;vertical-align:top}
th button{all:unset;cursor:pointer;font-weight:600}th button:focus-visible{outline:2px solid}
th[aria-sort=ascending] button::after{content:" \\25B2"}
th[aria-sort=descending] button::after{content:" \\25BC"}
td.n{text-align:right;white-space:nowrap}.now{font-weight:700}.now::before{content:"\\25CF ";color:#d00}
.soon::before{content:"\\25CF ";color:#e69f00}.look::before{content:"\\25CF ";color:#888}
summary{cursor:pointer;padding:.2rem 0}svg{max-width:100%;height:auto}
@media print{details{display:block}th button::after{content:""!important}}
"""
_SCRIPT = """
const show=()=>{const part=document.getElementById(location.hash.slice(1));if(part)part.open=true};
addEventListener('hashchange',show);show();
for(const table of document.querySelectorAll('table.sort')){
 table.querySelectorAll('th').forEach((head,k)=>{
  const button=document.createElement('button');button.textContent=head.textContent;
  head.replaceChildren(button);
  button.addEventListener('click',()=>{
   const up=head.getAttribute('aria-sort')!=='ascending';
   table.querySelectorAll('th').forEach(h=>h.removeAttribute('aria-sort'));
   head.setAttribute('aria-sort',up?'ascending':'descending');
   const key=r=>r.cells[k].dataset.v??r.cells[k].textContent;
   const rows=[...table.tBodies[0].rows].sort((a,b)=>{
    const x=key(a),y=key(b),n=x-y;
    const order=x!==''&&y!==''&&!isNaN(n)?n:x.localeCompare(y);return up?order:-order});
   table.tBodies[0].append(...rows)})})}
"""


def report_page(document: Row, tables: dict[str, list[Row]]) -> str:
    """The page."""
    head = (
        f"{document['drives']} drives of {document['cars']} cars, "
        f"{document['distance_km']:.0f} km, {document['duration_h']:.1f} h"
    )
    parts = [
        "<!doctype html><html lang=en><meta charset=utf-8>",
        '<meta name=viewport content="width=device-width,initial-scale=1">',
        f"<title>Fleet report</title><style>{_STYLE}</style>",
        f"<h1>Fleet report</h1><p>{html.escape(head)}</p>",
        "<h2>Vehicles that need attention</h2>",
        _attention(document["attention"]),
        "<h2>Findings by model</h2>",
        *(_model(model) for model in document["models"]),
        "<h2>Vehicles and drives</h2>",
        *_cars(tables),
        f"<script>{_SCRIPT}</script></html>",
    ]
    return "\n".join(parts)


def _attention(rows: Sequence[Row]) -> str:
    if not rows:
        return "<p>None.</p>"
    order = {"now": 0, "soon": 1, "look": 2}
    body = [
        f"<tr><td class={row['urgency']} data-v={order[row['urgency']]}>{row['urgency']}</td>"
        f'<td><a href="#{_anchor(row["car"])}">{_text(row["car"])}</a></td><td>{_text(row["why"])}</td>'
        f"<td>{_text(row['since'] or '')}</td><td>{_text(row['what_to_do'])}</td></tr>"
        for row in rows
    ]
    return _table(("urgency", "vehicle", "why", "since (UTC)", "what to do"), body)


def _model(model: Row) -> str:
    parts = [f"<h3>{_text(model['model'])}: {model['drives']} drives of {model['cars']} cars</h3>"]
    found = [
        f"<tr><td>{_text(row['effect'])}</td><td>{_text(row['parameter'])}</td>{_numbers(row)}"
        f"<td>{_text(row['unit'])}</td><td class=n data-v={row['p_value']}>{row['p_value']:.1g}</td></tr>"
        for row in model["findings"]
    ]
    if found:
        heads = ("effect of the model", "parameter", "value", "95 % interval", "unit", "p")
        parts.append(_table(heads, found))
    else:
        parts.append("<p>No effect of all its cars together.</p>")
    differing = [
        f'<tr><td><a href="#{_anchor(row["car"])}">{_text(row["car"])}</a></td><td>{_text(row["kind"])}</td>'
        f"<td>{_text(row['effect'])} {_text(row['parameter'])}</td>{_numbers(row)}"
        f"<td>{_text(row['unit'])}</td><td class=n data-v={row['p_value']}>{row['p_value']:.1g}</td></tr>"
        for row in model["differing"]
    ]
    if differing:
        titles = ("vehicle", "what", "parameter", "difference or slope", "95 % interval", "unit", "p")
        parts.append(_table(titles, differing))
    named = [
        f"<tr><td>{_text(row['effect'])}</td>"
        f"<td class=n>{row['drives']}</td><td class=n>{row['cars']}</td></tr>"
        for row in model["named_in_drives"]
    ]
    if named:
        parts.append(_table(("named by the diagnosis of single drives", "drives", "cars"), named))
    rows = [
        f"<tr><td>{_text(row['parameter'])}</td>{_numbers(row)}<td class=n>{_g(row['spread_cars'])}</td>"
        f"<td class=n>{_g(row['spread_drives'])}</td><td>{_text(row['unit'])}</td></tr>"
        for row in model["parameters"]
    ]
    if rows:
        names = ("parameter", "mean", "95 % interval", "from car to car", "from drive to drive", "unit")
        inner = _table(names, rows)
        parts.append(f"<details><summary>all parameters of the model</summary>{inner}</details>")
    return "\n".join(parts)


def _cars(tables: dict[str, list[Row]]) -> Iterable[str]:
    wheels: dict[str, dict[str, Row]] = defaultdict(dict)
    for row in tables["wheels"]:
        wheels[row["key"]][row["wheel"]] = row
    alarms: dict[str, list[Row]] = defaultdict(list)
    for row in tables["alarms"]:
        alarms[row["key"]].append(row)
    cars: dict[str, list[Row]] = defaultdict(list)
    for row in tables["drives"]:
        cars[row["car"]].append(row)
    each = max(1, MAX_DRIVES // max(len(cars), 1))
    for car, drives in sorted(cars.items()):
        drives.sort(key=lambda row: (row["start"] or 0.0, row["key"]))
        shown = drives[-each:]
        rows = [_drive(row, wheels[row["key"]], alarms[row["key"]]) for row in shown]
        heads = ("drive", "start (UTC)", "km", "status", "fl", "fr", "rl", "rr", "alarms")
        left = f"<p>The newest {len(shown)} of {len(drives)} drives.</p>" if len(shown) < len(drives) else ""
        plot = _plot([(row, wheels[row["key"]]) for row in shown])
        yield (
            f'<details id="{_anchor(car)}"><summary>{_text(car)} ({_text(drives[0]["model"])}), '
            f"{len(drives)} drives</summary>{left}{plot}<p>Radius minus nominal in mm.</p>"
            f"{_table(heads, rows)}</details>"
        )


def _drive(row: Row, wheels: dict[str, Row], alarms: Sequence[Row]) -> str:
    cells = []
    for wheel in ("fl", "fr", "rl", "rr"):
        one = wheels.get(wheel)
        if one is None or one["deviation_mm"] is None:
            cells.append("<td class=n></td>")
        else:
            std = "" if one["std_mm"] is None else f" ± {one['std_mm']:.2f}"
            cells.append(f"<td class=n data-v={one['deviation_mm']}>{one['deviation_mm']:+.2f}{std}</td>")
    told = ", ".join(f"{one['kind']} {one['wheel'] or ''} {one['state']}" for one in alarms)
    status = row["status"] + (f": {row['reason']}" if row["reason"] else "")
    return (
        f"<tr><td>{_text(row['path'])}</td><td>{_text(utc(row['start']) or '')}</td>"
        f"<td class=n>{_g((row['distance_m'] or 0.0) / 1e3)}</td><td>{_text(status)}</td>"
        f"{''.join(cells)}<td>{_text(told)}</td></tr>"
    )


_COLORS = {
    "fl": ("#0072B2", ""),
    "fr": ("#D55E00", "6 3"),
    "rl": ("#009E73", "2 3"),
    "rr": ("#CC79A7", "8 3 2 3"),
}


def _plot(drives: Sequence[tuple[Row, dict[str, Row]]]) -> str:
    """Radius minus nominal of each wheel, drive by drive, with bars of two standard deviations."""
    series: dict[str, list[tuple[int, float, float]]] = {wheel: [] for wheel in _COLORS}
    for k, (_, wheels) in enumerate(drives):
        for wheel, one in wheels.items():
            if wheel in series and one["deviation_mm"] is not None:
                series[wheel].append((k, one["deviation_mm"], 2.0 * (one["std_mm"] or 0.0)))
    values = [
        value + sign * bar for points in series.values() for _, value, bar in points for sign in (-1, 1)
    ]
    if len(drives) < 2 or not values:
        return ""
    low, high = min(*values, -0.5), max(*values, 0.5)
    width, height, left, bottom = 720, 200, 48, 24

    def x(k: int) -> float:
        return left + (width - left - 90) * k / (len(drives) - 1)

    def y(value: float) -> float:
        return 8 + (height - bottom - 8) * (high - value) / (high - low)

    lines = [f'<svg viewBox="0 0 {width} {height}" role=img aria-label="radii drive by drive">']
    for value in (low, 0.0, high):
        lines.append(_line(left, y(value), width - 90, y(value), "currentColor", "stroke-opacity=.25"))
        lines.append(_label(left - 4, y(value) + 4, f"{value:+.1f}", "text-anchor=end"))
    for k, (wheel, points) in enumerate(series.items()):
        color, dash = _COLORS[wheel]
        style = f'stroke-width=1.6 stroke-dasharray="{dash}"'
        path = " ".join(f"{x(at):.1f},{y(value):.1f}" for at, value, _ in points)
        lines.append(f'<polyline points="{path}" fill=none stroke="{color}" {style} />')
        for at, value, bar in points:
            lines.append(_line(x(at), y(value - bar), x(at), y(value + bar), color, "stroke-opacity=.5"))
        lines.append(_line(width - 80, 20 + 18 * k, width - 50, 20 + 18 * k, color, style))
        lines.append(_label(width - 44, 24 + 18 * k, wheel))
    lines += [_label(left, height - 6, "mm, drive by drive"), "</svg>"]
    return "".join(lines)


def _line(x1: float, y1: float, x2: float, y2: float, color: str, style: str) -> str:
    return f'<line x1={x1:.1f} y1={y1:.1f} x2={x2:.1f} y2={y2:.1f} stroke="{color}" {style} />'


def _label(x: float, y: float, text: str, style: str = "") -> str:
    return f"<text x={x:.1f} y={y:.1f} font-size=12 fill=currentColor {style}>{_text(text)}</text>"


def _numbers(row: Row) -> str:
    value, std = row["value"], row["std"]
    if std is None:
        return f"<td class=n data-v={value}>{_g(value)}</td><td></td>"
    low, high = value - 1.96 * std, value + 1.96 * std
    return f"<td class=n data-v={value}>{_g(value)}</td><td class=n data-v={std}>{_g(low)} to {_g(high)}</td>"


def _table(heads: Sequence[str], rows: Iterable[str]) -> str:
    titles = "".join(f"<th scope=col>{_text(name)}</th>" for name in heads)
    body = "".join(rows)
    head = f"<thead><tr>{titles}</tr></thead>"
    return f"<div class=wide><table class=sort>{head}<tbody>{body}</tbody></table></div>"


def _g(value: float | None) -> str:
    return "" if value is None else f"{value:.4g}"


def _text(value: object) -> str:
    return html.escape(str(value))


def _anchor(car: str) -> str:
    return "car-" + "".join(c if c.isascii() and c.isalnum() else f"_{ord(c):x}_" for c in car)
