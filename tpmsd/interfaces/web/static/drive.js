// A recorded drive: map, linked plots, wheels and alarms.
import { NAMES, WHEELS, alarmLines, axis, band, byId, clock, css, duration, edge, element, keepFitting, onGround, plain, signed, timeAxis, wheelSeries, whiskers } from "./common.js";

const drive = await (await fetch("api/drive")).json();
const columns = new Map(drive.columns.map((column) => [column.name, column]));
const DEGREES = 180 / Math.PI;
const EVERYDAY = { "m/s": ["km/h", 3.6], rad: ["°", DEGREES], "rad/s": ["°/s", DEGREES] };
const units = byId("units");
try { units.value = localStorage.getItem("drive-units") ?? "everyday"; } catch { /* no storage, no memory */ }
if (!units.value) units.value = "everyday";
const si = () => units.value === "si";
let span = [0, drive.duration_s];
let track = null;

byId("name").textContent = drive.drive;
document.title = `tpmsd: ${drive.drive}`;
if (!drive.diagnosis) byId("diagnosis").remove();
byId("connection").textContent = `${duration(drive.duration_s)}, ${(drive.distance_m / 1000).toFixed(1)} km`;

function table(node, head, rows) {
  const row = (cells, tag) => {
    const line = element("tr", "", { role: "row" });
    cells.forEach((cell, k) => line.append(element(tag, cell, { "data-head": head[k], role: tag === "th" ? "columnheader" : "cell", ...(/^[+−–\d]/.test(cell) ? { class: "number" } : {}) })));
    return line;
  };
  const thead = element("thead", "", { role: "rowgroup" }), tbody = element("tbody", "", { role: "rowgroup" });
  node.setAttribute("role", "table");
  thead.append(row(head, "th"));
  for (const cells of rows) tbody.append(row(cells, "td"));
  node.replaceChildren(thead, tbody);
}

function showWheels() {
  const [unit, scale, digits] = si() ? ["m", 1e-3, 5] : ["mm", 1, 2];
  const length = (value, std) => value === null ? "–" : `${signed(scale * value, digits)} ± ${(scale * (std ?? NaN)).toFixed(digits)}`;
  table(byId("wheels"), ["wheel", "state", `minus nominal (${unit})`, `change (${unit})`],
    Object.entries(drive.wheels).map(([name, wheel]) => [NAMES[name], wheel.state,
      length(wheel.deviation_mm, wheel.std_mm), length(wheel.change_mm, wheel.change_std_mm)]));
}
showWheels();
if (drive.alarms.length)
  table(byId("alarms"), ["time", "alarm", "wheel", "state", "reason"],
    drive.alarms.map((alarm) => [clock(alarm.drive_time_s), plain(alarm.kind), NAMES[alarm.wheel] ?? "the car", alarm.state, (alarm.reason ?? "").replaceAll("+-", "±")]));
else byId("alarms").replaceChildren(element("caption", "No alarms."));
byId("notes").replaceChildren(...drive.notes.map((note) => element("li", note)));

const plots = [];
const wheelOf = (name) => WHEELS.find((wheel) => name.includes(`_${wheel}`));

/** The unit that a column is shown in, and its factor. */
function unitOf(name) {
  const unit = columns.get(name).unit;
  if (si()) return [unit, 1];
  return unit === "m" && wheelOf(name) ? ["mm", 1000] : EVERYDAY[unit] ?? [unit, 1];
}

async function seriesOf(panel) {
  const query = new URLSearchParams({ columns: panel.series.join(","), from: span[0], to: span[1], points: 2 * Math.min(innerWidth, 2000) });
  return (await fetch(`api/series?${query}`)).json();
}

function dataOf(panel, found, scale) {
  const scaled = (values) => values.map((value) => (value === null ? null : scale * value));
  const out = [found.x];
  for (const name of panel.series) {
    out.push(scaled(found[name]));
    if (panel.banded) out.push(scaled(found[`${name}:high`]), scaled(found[`${name}:low`]));
  }
  return out;
}

/** Why a panel has nothing to show, in words: faults that never came, fixes that never stayed away; "" else. */
function nothingIn(panel, found) {
  const most = Math.max(...panel.series.flatMap((name) => found[name].map((value) => Math.abs(value ?? 0))));
  if (most === 0) return `${panel.title}: zero throughout.`;
  return panel.series[0] === "gnss_age_s" && most < 1 ? `${panel.title}: at most ${most.toFixed(1)} s.` : "";
}

/** The y range of a panel with bands: where these are at most twice their median, so that the start-up, in
 * which little is known, does not set the scale; null for the range of all. */
function settledRange(panel, found, scale) {
  if (!panel.banded) return null;
  const widths = panel.series.flatMap((name) => found[`${name}:high`].map((high, k) => (high === null ? null : high - found[`${name}:low`][k]))).filter((width) => width !== null).sort((a, b) => a - b);
  const limit = 2 * (widths[Math.floor(widths.length / 2)] ?? 0);
  let low = Infinity, high = -Infinity;
  for (const name of panel.series)
    found[`${name}:high`].forEach((top, k) => {
      const bottom = found[`${name}:low`][k];
      if (top !== null && top - bottom <= limit) [low, high] = [Math.min(low, bottom), Math.max(high, top)];
    });
  const margin = 0.06 * (high - low);
  return low < high ? [scale * (low - margin), scale * (high + margin)] : null;
}

function makePlot(panel, found, last) {
  const [shown, scale] = unitOf(panel.series[0]);
  panel.banded = panel.series.every((name) => `${name}:low` in found);
  panel.settled = settledRange(panel, found, scale);
  const series = [{ label: "time", value: (_, value) => clock(value) }], bands = [], bars = [];
  const other = ["fl", "fr", "rl", "rr"];
  for (const [k, name] of panel.series.entries()) {
    const wheel = wheelOf(name) ?? other[k % 4];
    const at = series.length;
    series.push(wheelSeries(wheel, wheelOf(name) ? NAMES[wheelOf(name)] : columns.get(name).meaning.split(",")[0]));
    if (panel.banded) {
      series.push(edge(), edge());
      bands.push(band(wheel, at + 1, at + 2));
      bars.push([wheel, at + 1, at + 2]);
    }
  }
  const box = element("div", "", { class: "plot", role: "img", "aria-label": `${panel.title} over time` });
  byId("plots").append(box);
  const plot = new uPlot({
    title: panel.title, width: Math.max(box.clientWidth, 200), height: 200, series, bands,
    scales: { x: { time: false }, y: { range: (_, low, high) => panel.settled ?? uPlot.rangeNum(low, high, 0.1, true) } },
    axes: [timeAxis(last ? "time since the start (h:min:s)" : ""), axis(shown === "1" || shown === "" ? "" : `(${shown})`, { size: 60 })],
    cursor: { sync: { key: "drive" }, drag: { x: true, y: false, setScale: false } },
    legend: { show: true, live: false },
    plugins: [whiskers(bars), alarmLines(() => drive.alarms, (alarm) => alarm.drive_time_s)],
    hooks: { setSelect: [(one) => { if (one.select.width > 4) zoom(one.posToVal(one.select.left, "x"), one.posToVal(one.select.left + one.select.width, "x")); }] },
  }, dataOf(panel, found, scale), box);
  if (panel.banded) for (const [k, entry] of [...box.querySelectorAll(".u-series")].entries()) if (k % 3) entry.remove(); // the edges of a band have no entry
  plots.push([box, plot, panel, scale]);
}

async function zoom(from, to) {
  span = [Math.max(0, from), Math.min(drive.duration_s, to)];
  if (!(span[1] - span[0] > 0.5)) return;
  await Promise.all(plots.map(async ([, plot, panel, scale]) => {
    const found = await seriesOf(panel);
    panel.settled = settledRange(panel, found, scale);
    plot.setData(dataOf(panel, found, scale), false);
    plot.setScale("x", { min: span[0], max: span[1] });
    plot.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
  }));
  drawMap();
}

// Lightness rises with the value (viridis at five stops), so that the map reads in grey, too.
const STOPS = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];
function colourAt(share) {
  const at = Math.min(Math.max(share, 0), 1) * (STOPS.length - 1);
  const k = Math.min(Math.floor(at), STOPS.length - 2), rest = at - k;
  return `rgb(${STOPS[k].map((value, c) => Math.round(value + rest * (STOPS[k + 1][c] - value))).join(" ")})`;
}

function drawMap() {
  const canvas = byId("map"), ctx = canvas.getContext("2d");
  const width = (canvas.width = canvas.clientWidth * devicePixelRatio), height = (canvas.height = canvas.clientHeight * devicePixelRatio);
  const seen = track.east_m.map((east, k) => [east, track.north_m[k], track.value[k], track.time_s[k]]).filter(([east, north]) => east !== null && north !== null);
  if (seen.length < 2) {
    ctx.fillStyle = css("text");
    ctx.font = `${14 * devicePixelRatio}px system-ui, sans-serif`;
    return ctx.fillText("No positions.", 20, 40);
  }
  const range = (values) => values.reduce(([low, high], value) => [Math.min(low, value), Math.max(high, value)], [Infinity, -Infinity]);
  const [left, right] = range(seen.map((point) => point[0])), [bottom, top] = range(seen.map((point) => point[1]));
  const values = seen.map((point) => point[2]).filter((value) => value !== null).sort((a, b) => a - b);
  const low = values[Math.floor(0.02 * values.length)] ?? 0, high = values[Math.floor(0.98 * (values.length - 1))] ?? 1;
  const margin = 30 * devicePixelRatio;
  const scale = Math.min((width - 2 * margin) / Math.max(right - left, 1), (height - 2 * margin) / Math.max(top - bottom, 1));
  const x = (east) => width / 2 + scale * (east - (left + right) / 2), y = (north) => height / 2 - scale * (north - (bottom + top) / 2);
  ctx.lineCap = "round";
  for (let k = 1; k < seen.length; k++) {
    const [east, north, value, time] = seen[k];
    const inside = time >= span[0] && time <= span[1];
    ctx.strokeStyle = !inside || value === null ? css("line") : colourAt((value - low) / Math.max(high - low, 1e-12));
    ctx.lineWidth = (inside ? 4 : 2) * devicePixelRatio;
    ctx.beginPath();
    ctx.moveTo(x(seen[k - 1][0]), y(seen[k - 1][1]));
    ctx.lineTo(x(east), y(north));
    ctx.stroke();
  }
  ctx.fillStyle = ctx.strokeStyle = css("text");
  ctx.font = `${12 * devicePixelRatio}px system-ui, sans-serif`;
  for (const [k, word] of [[0, "start"], [seen.length - 1, "end"]]) {
    ctx.beginPath();
    ctx.arc(x(seen[k][0]), y(seen[k][1]), 5 * devicePixelRatio, 0, 7);
    ctx.fill();
    ctx.fillText(word, x(seen[k][0]) + 8 * devicePixelRatio, y(seen[k][1]) - 6 * devicePixelRatio);
  }
  const taken = [];
  for (const alarm of drive.alarms.filter((one) => one.state === "raised")) {
    const point = seen.find((one) => one[3] >= alarm.drive_time_s);
    if (!point) continue;
    const left = x(point[0]), line = 15 * devicePixelRatio;
    let top = y(point[1]);
    ctx.fillStyle = css("bad");
    ctx.fillRect(left - 5 * devicePixelRatio, top - 5 * devicePixelRatio, 10 * devicePixelRatio, 10 * devicePixelRatio);
    while (taken.some(([otherLeft, otherTop]) => Math.abs(otherLeft - left) < 10 * line && Math.abs(otherTop - top) < line)) top += line;
    if (top > height - line) continue; // no room left below
    taken.push([left, top]);
    onGround(ctx, `${plain(alarm.kind)} ${(alarm.wheel ?? "").toUpperCase()}`, left + 9 * devicePixelRatio, top + 4 * devicePixelRatio);
  }
  const metres = 10 ** Math.floor(Math.log10((0.3 * width) / scale));
  ctx.fillStyle = css("text");
  ctx.lineWidth = 2 * devicePixelRatio;
  ctx.beginPath();
  ctx.moveTo(margin, height - margin / 2);
  ctx.lineTo(margin + metres * scale, height - margin / 2);
  ctx.stroke();
  ctx.fillText(metres >= 1000 ? `${metres / 1000} km` : `${metres} m`, margin, height - margin / 2 - 6 * devicePixelRatio);
  ctx.fillText("N ↑", width - margin, margin / 2 + 6 * devicePixelRatio);
  const column = columns.get(byId("colour").value);
  const bar = element("span", "", { class: "bar" });
  bar.style.background = `linear-gradient(to right, ${STOPS.map((stop) => `rgb(${stop.join(" ")})`).join(", ")})`;
  const [unit, factor] = unitOf(column.name);
  byId("legend").replaceChildren((factor * low).toPrecision(3), bar, `${(factor * high).toPrecision(3)} ${unit === "1" ? "" : unit}`.trim());
}

const select = byId("colour");
for (const column of drive.columns) select.append(element("option", column.meaning, { value: column.name }));
select.value = columns.has("speed_mps") ? "speed_mps" : drive.columns[0].name;
async function recolour() {
  track = await (await fetch(`api/track?${new URLSearchParams({ colour: select.value, points: 4000 })}`)).json();
  drawMap();
}
select.addEventListener("change", recolour);
byId("all").addEventListener("click", () => zoom(0, drive.duration_s));
addEventListener("resize", drawMap);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", drawMap);
keepFitting(() => plots);
await recolour();
async function drawPanels() {
  const found = await Promise.all(drive.panels.map(seriesOf));
  const panels = drive.panels.map((panel, k) => [panel, found[k], nothingIn(panel, found[k])]);
  for (const [, plot] of plots.splice(0)) plot.destroy();
  byId("plots").replaceChildren();
  const full = panels.filter(([, , why]) => !why);
  full.forEach(([panel, values], k) => makePlot(panel, values, k === full.length - 1));
  for (const [, plot] of plots) plot.setScale("x", { min: span[0], max: span[1] });
  for (const [, , why] of panels) if (why) byId("plots").append(element("p", why, { class: "hint" }));
}
units.addEventListener("change", async () => {
  try { localStorage.setItem("drive-units", units.value); } catch { /* not remembered */ }
  showWheels();
  drawMap();
  await drawPanels();
});
await drawPanels();
document.body.dataset.ready = "1";
