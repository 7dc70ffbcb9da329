// The running daemon: server-sent events in, the car, its alarms and the last hours out.
import { NAMES, WHEELS, alarmLines, axis, band, byId, changeRow, duration, edge, element, keepFitting, signed, wheelSeries, whiskers } from "./common.js";

const MM_PER_INCH = 25.4;
const units = byId("units"), range = byId("range");
try { units.value = localStorage.getItem("units") ?? "metric"; } catch { /* no storage, no memory */ }
try { range.value = localStorage.getItem("range") ?? "21600"; } catch { range.value = "21600"; }
let newest = null;
let alarms = [];
const rows = [];

function length(mm, std) {
  if (mm === null || mm === undefined) return "not known yet";
  const imperial = units.value === "imperial";
  const [value, spread, unit, digits] = imperial ? [1000 * mm / MM_PER_INCH, 1000 * std / MM_PER_INCH, "thou", 0] : [mm, std, "mm", 2];
  return `${signed(value, digits)} ± ${spread.toFixed(digits)} ${unit}`;
}

function verdict(name, wheel, standing) {
  const kinds = new Set(standing.filter((alarm) => alarm.wheel === name).map((alarm) => alarm.kind));
  if (kinds.has("deflation")) return ["soft", "SOFT"];
  if (kinds.has("radius_deviation")) return ["changed", "CHANGED"];
  if (kinds.has("slow_leak")) return ["suspect", "slow leak"];
  if (!wheel || wheel.state === "unavailable") return ["off", "not watched"];
  if (wheel.state === "learning") return ["", "learning"];
  if (wheel.state === "alarm") return ["soft", "ALARM"];
  return (wheel.deflation_probability ?? 0) >= 0.5 ? ["suspect", "soft?"] : ["ok", "OK"];
}

/** One sentence on all tyres, and its style: the worst that stands, else what is not known yet. */
function sentence(document_) {
  const found = WHEELS.filter((name) => document_.wheels?.[name]).map((name) => [NAMES[name], ...verdict(name, document_.wheels[name], document_.alarms ?? [])]);
  const of = (...styles) => found.filter(([, style]) => styles.includes(style)).map(([name]) => name);
  const listed = (names) => names.length > 1 ? `${names.slice(0, -1).join(", ")} and ${names.at(-1)}` : names[0];
  const capital = (text) => text[0].toUpperCase() + text.slice(1);
  const tyres = (names, one, many) => `${capital(listed(names))} tyre${names.length > 1 ? "s" : ""} ${names.length > 1 ? many : one}`;
  const soft = of("soft"), changed = of("changed"), suspect = of("suspect"), off = of("off"), ok = of("ok");
  if (soft.length) return ["soft", `${tyres(soft, "is", "are")} losing air: check the pressure.`];
  if (changed.length) return ["changed", `${tyres(changed, "has", "have")} another radius than learned.`];
  if (suspect.length) return ["suspect", `${tyres(suspect, "may be", "may be")} losing air slowly.`];
  if (ok.length === 4) return ["ok", "All four tyres are fine."];
  const learning = found.length - ok.length - off.length;
  if (learning) return ["", `No alarm; ${learning === 4 ? "all four tyres are" : `${learning} of 4 tyres are`} being learned.`];
  if (ok.length) return ["suspect", `${tyres(ok, "is", "are")} fine; the others are not watched.`];
  return ["off", "No tyre is watched."];
}

function showVerdict(document_) {
  const [style, text] = sentence(document_);
  const node = byId("verdict");
  if (node.textContent !== text) node.textContent = text;
  node.className = style;
  const times = (document_.alarms ?? []).map((alarm) => alarm.time).filter(Number.isFinite);
  const said = times.length ? `Since ${timeOfDay(Math.min(...times))}.` : `No alarm is active; tpmsd has watched for ${duration(document_.uptime_s)}.`;
  if (byId("since").textContent !== said) byId("since").textContent = said;
  const name = document_.vehicle?.name ?? "Tyres";
  byId("name").textContent = name;
  document.title = `tpmsd: ${name}`;
}

/** Date and time of an instant, without the date where it is today. */
function timeOfDay(seconds) {
  const at = new Date(1000 * seconds), today = at.toDateString() === new Date().toDateString();
  return today ? at.toLocaleTimeString() : at.toLocaleString();
}

function showTyre(name, document_) {
  const wheel = document_.wheels?.[name];
  const standing = document_.alarms ?? [];
  const [style, word] = verdict(name, wheel, standing);
  const box = byId(name);
  box.className = `tyre ${style}`;
  const parts = [element("h3", NAMES[name]), element("strong", word)];
  if (wheel) {
    const learned = wheel.change_mm !== null && wheel.change_mm !== undefined;
    parts.push(element("p", `${learned ? "radius" : "from nominal"} ${length(learned ? wheel.change_mm : wheel.deviation_mm, learned ? wheel.change_std_mm : wheel.std_mm)}`));
    if (wheel.pressure_loss_percent !== null && wheel.pressure_loss_percent > 5 && wheel.pressure_loss_percent > 2 * wheel.pressure_loss_std_percent)
      parts.push(element("p", `pressure about ${wheel.pressure_loss_percent.toFixed(0)} ± ${wheel.pressure_loss_std_percent.toFixed(0)} % low`));
    const since = standing.filter((alarm) => alarm.wheel === name).map((alarm) => document_.time - alarm.time);
    if (since.length) parts.push(element("p", `for ${duration(Math.max(...since))}`));
  }
  box.replaceChildren(...parts);
  byId(`${name}-wheel`).setAttribute("class", style);
}

function showAlarms(standing, now) {
  const key = JSON.stringify(standing.map((alarm) => [alarm.kind, alarm.wheel, alarm.time]));
  const box = byId("alarms");
  if (box.dataset.key === key) return; // a screen reader hears an alarm once
  box.dataset.key = key;
  if (!standing.length) return box.replaceChildren(element("p", "No alarms."));
  box.replaceChildren(...standing.map((alarm) => {
    const node = element("div", "", { class: "alarm" });
    const what = { deflation: "is losing air", radius_deviation: "has another radius than learned", malfunction: "cannot be watched", slow_leak: "leaks slowly" }[alarm.kind] ?? alarm.kind;
    node.append(element("p", `${alarm.wheel ? `${NAMES[alarm.wheel]} tyre` : "The car"} ${what}`), element("p", (alarm.reason ?? "").replaceAll("+-", "±"), { class: "hint" }), element("p", `raised ${new Date(1000 * alarm.time).toLocaleTimeString()}`, { class: "hint" }));
    return node;
  }));
}

function showHealth(document_) {
  const learning = document_.learning_fraction;
  const age = document_.gnss?.age_s;
  const speed = document_.estimator?.speed_mps;
  const imperial = units.value === "imperial";
  const entries = [
    ["learned", learning === null || learning === undefined ? "–" : learning >= 1 ? "all" : `${Math.round(100 * learning)} %; gentle driving above 22 km/h (14 mph) is still missing`],
    ["speed", speed === null || speed === undefined ? "–" : imperial ? `${(2.236936 * speed).toFixed(0)} mph` : `${(3.6 * speed).toFixed(0)} km/h`],
    ["bus", `${document_.can?.channel ?? ""} ${document_.can?.state ?? "unknown"} ${document_.can?.detail ?? ""}`.trim()],
    ["receiver", `${document_.gnss?.state ?? "unknown"} ${document_.gnss?.detail ?? ""}`.trim() + `${age === null || age === undefined ? "" : `, last fix ${age.toFixed(1)} s ago`}`],
    ["tyres", document_.baseline?.tyres ?? "–"],
    ["running for", duration(document_.uptime_s)],
    ["version", document_.tpmsd ?? "–"],
  ];
  byId("health").replaceChildren(...entries.flatMap(([term, text]) => [element("dt", term), element("dd", text)]));
}

const box = byId("timeline");
let plot = null;

/** Times of day as the visitor writes them; seconds where the ticks are closer than a minute. */
function daytimes(_, ticks) {
  const fine = ticks.length > 1 && ticks[1] - ticks[0] < 60 ? { second: "2-digit" } : {};
  return ticks.map((seconds) => new Date(1000 * seconds).toLocaleTimeString([], { hour: "2-digit", minute: "2-digit", ...fine }));
}

function data() {
  const scale = units.value === "imperial" ? 1000 / MM_PER_INCH : 1;
  const first = (rows.at(-1)?.time ?? 0) - Number(range.value);
  const shown = rows.filter((row) => row.time >= first);
  const out = [shown.map((row) => row.time)];
  for (const wheel of WHEELS) {
    const value = shown.map((row) => (row[wheel]?.[0] ?? null) === null ? null : scale * row[wheel][0]);
    const std = shown.map((row) => row[wheel]?.[1] ?? null);
    out.push(value, value.map((one, k) => one === null || std[k] === null ? null : one + 2 * scale * std[k]), value.map((one, k) => one === null || std[k] === null ? null : one - 2 * scale * std[k]));
  }
  return out;
}

function draw() {
  if (plot) plot.destroy();
  const series = [{}], bands = [], bars = [];
  for (const wheel of WHEELS) {
    const at = series.length;
    bars.push([wheel, at + 1, at + 2]);
    series.push(wheelSeries(wheel, NAMES[wheel]), edge(), edge());
    bands.push(band(wheel, at + 1, at + 2));
  }
  plot = new uPlot({
    width: Math.max(box.clientWidth, 200), height: 260, series, bands,
    scales: { x: { time: true } },
    axes: [axis("", { values: daytimes, space: 90 }), axis(units.value === "imperial" ? "change of radius (thou)" : "change of radius (mm)", { size: 60 })],
    legend: { show: true, live: false }, plugins: [whiskers(bars), alarmLines(() => alarms, (alarm) => alarm.time)],
  }, data(), box);
  for (const [k, entry] of [...box.querySelectorAll(".u-series")].entries()) if (k % 3) entry.remove(); // the edges of a band have no entry
}

function show() {
  if (!newest) return;
  showVerdict(newest);
  for (const name of WHEELS) showTyre(name, newest);
  showAlarms(newest.alarms ?? [], newest.time);
  showHealth(newest);
}

function connected(text, down) {
  const node = byId("connection");
  if (node.textContent !== text) node.textContent = text;
  node.className = down ? "down" : "";
  document.body.className = down ? "stale" : "";
}

function follow() {
  const source = new EventSource("api/live");
  source.addEventListener("history", (event) => {
    rows.splice(0, rows.length, ...JSON.parse(event.data));
    draw();
  });
  source.addEventListener("status", (event) => {
    newest = JSON.parse(event.data);
    alarms = newest.alarms ?? [];
    connected(`Live, ${new Date(1000 * newest.time || Date.now()).toLocaleTimeString()}`, false);
    show();
    if (newest.time && (!rows.length || newest.time - rows.at(-1).time >= 1)) {
      rows.push(changeRow(newest));
      if (rows.length > 6000) rows.splice(0, rows.length, ...rows.filter((_, k) => k % 2));
      plot?.setData(data());
    }
  });
  source.addEventListener("down", (event) => connected(`No data: ${JSON.parse(event.data).reason}`, true));
  source.onerror = () => {
    connected("The connection is lost; trying again.", true);
    if (source.readyState === EventSource.CLOSED) setTimeout(follow, 2000);
  };
}

units.addEventListener("change", () => {
  try { localStorage.setItem("units", units.value); } catch { /* not remembered */ }
  show();
  draw();
});
range.addEventListener("change", () => {
  try { localStorage.setItem("range", range.value); } catch { /* not remembered */ }
  draw();
});
byId("reset").addEventListener("click", () => byId("confirm").showModal());
byId("no").addEventListener("click", () => byId("confirm").close());
byId("yes").addEventListener("click", async () => {
  byId("confirm").close();
  const { csrf } = await (await fetch("api/session")).json();
  const answer = await fetch("api/reset", { method: "POST", headers: { "X-CSRF-Token": csrf, "Content-Type": "application/json" }, body: "{}" });
  const said = answer.status === 202 ? "Asked; the health box shows the progress." : (await answer.text()).slice(0, 200);
  byId("answer").textContent = said;
});
keepFitting(() => (plot ? [[box, plot]] : []));
follow();
