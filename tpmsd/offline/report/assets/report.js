// Reports: figures that can be zoomed in place of their pictures, and tables that sort. Everything works without it.
"use strict";
(() => {
  const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
  const faint = (name, percent) => `color-mix(in srgb, ${css(name)} ${percent}%, transparent)`;
  const ratio = () => devicePixelRatio || 1;
  const plots = [], tracks = [];
  let zooming = false;

  function clock(seconds) {
    if (seconds === null || !Number.isFinite(seconds)) return "";
    const whole = Math.round(seconds), h = Math.floor(whole / 3600), m = Math.floor((whole % 3600) / 60);
    const two = (value) => String(value).padStart(2, "0");
    return h ? `${h}:${two(m)}:${two(whole % 60)}` : `${m}:${two(whole % 60)}`;
  }
  const short = (value) => (value === null || value === undefined ? "" : String(Number(value.toPrecision(4))));

  /** Text on the card's colour, so that curves under it do not cross it. */
  function write(ctx, text, x, y) {
    const size = ctx.measureText(text), pad = 2 * ratio(), ink = ctx.fillStyle;
    ctx.fillStyle = faint("card", 80);
    ctx.fillRect(x - pad, y - size.actualBoundingBoxAscent - pad, size.width + 2 * pad, size.actualBoundingBoxAscent + size.actualBoundingBoxDescent + 2 * pad);
    ctx.fillStyle = ink;
    ctx.fillText(text, x, y);
  }

  function drawBehind(plot, data) {
    const { ctx, bbox } = plot;
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    for (const span of data.spans) {
      const from = plot.valToPos(span.from, "x", true), to = plot.valToPos(span.to, "x", true);
      ctx.fillStyle = faint(span.style, 50);
      ctx.fillRect(from, bbox.top, Math.max(to - from, 1), bbox.height);
    }
    if (data.noise) {
      const top = plot.valToPos(data.noise[1], "y", true), bottom = plot.valToPos(data.noise[0], "y", true);
      ctx.fillStyle = faint("line", 45);
      ctx.fillRect(bbox.left, top, bbox.width, bottom - top);
    }
    ctx.restore();
  }

  function drawOver(plot, data) {
    const { ctx, bbox } = plot, one = ratio();
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    ctx.lineWidth = 1.2 * one;
    ctx.font = `${11.5 * one}px system-ui, sans-serif`;
    for (const level of data.levels) {
      const y = plot.valToPos(level.at, "y", true);
      ctx.strokeStyle = ctx.fillStyle = css(level.style);
      ctx.setLineDash(level.style === "bad" ? [] : [5 * one, 4 * one]);
      ctx.beginPath();
      ctx.moveTo(bbox.left, y);
      ctx.lineTo(bbox.left + bbox.width, y);
      ctx.stroke();
      ctx.textAlign = "left";
      write(ctx, level.name, bbox.left + 5 * one, y - 5 * one);
    }
    const free = [-Infinity, -Infinity, -Infinity];
    for (const moment of data.moments) {
      const x = plot.valToPos(moment.at, "x", true);
      if (!(x >= bbox.left && x <= bbox.left + bbox.width)) continue;
      ctx.strokeStyle = ctx.fillStyle = css(moment.style);
      ctx.setLineDash(moment.style === "bad" ? [] : [4 * one, 4 * one]);
      ctx.beginPath();
      ctx.moveTo(x, bbox.top);
      ctx.lineTo(x, bbox.top + bbox.height);
      ctx.stroke();
    }
    for (const moment of data.moments) {
      const x = plot.valToPos(moment.at, "x", true);
      if (!(x >= bbox.left && x <= bbox.left + bbox.width)) continue;
      ctx.fillStyle = css(moment.style);
      const width = ctx.measureText(moment.name).width + 8 * one;
      const left = x + width > bbox.left + bbox.width ? x - width : x;
      const row = free.findIndex((edge) => left >= edge);
      if (row < 0) continue;
      free[row] = left + width;
      ctx.textAlign = "left";
      write(ctx, moment.name, left + 4 * one, bbox.top + (13 + 14 * row) * one);
    }
    ctx.restore();
  }

  function seriesOf(data) {
    const day = (value) => (value === null ? "" : new Date(1e3 * value).toISOString().slice(0, 16).replace("T", " "));
    const series = [{ label: data.time ? "time" : data.xLabel, value: (_, value) => (data.time ? clock(value) : data.date ? day(value) : short(value)) }];
    const columns = [data.x], bands = [];
    for (const curve of data.curves) {
      const at = series.length, colour = () => css(curve.style);
      series.push({ label: curve.name, stroke: colour, width: 1.8, dash: curve.dashes, points: { show: curve.dots, size: 6 }, value: (_, value) => short(value) });
      columns.push(curve.y);
      if (curve.low) {
        for (const edge of [curve.high, curve.low]) {
          series.push({ label: "", width: 0, points: { show: false } });
          columns.push(edge);
        }
        bands.push({ series: [at + 1, at + 2], fill: () => faint(curve.style, 22) });
      }
    }
    return [series, columns, bands];
  }

  function follow(group, source, min, max) {
    if (zooming || !group) return;
    zooming = true;
    for (const [, plot, data] of plots) if (plot !== source && data.group === group) plot.setScale("x", { min, max });
    zooming = false;
  }

  function makeChart(figure, data) {
    const box = document.createElement("div");
    box.className = "plot";
    box.setAttribute("role", "img");
    box.setAttribute("aria-label", figure.querySelector("h3")?.textContent ?? "plot");
    figure.append(box);
    figure.classList.add("live");
    const [series, columns, bands] = seriesOf(data);
    const axis = (label, extra) => ({ label, labelSize: 22, stroke: () => css("text"), grid: { stroke: () => css("line"), width: 0.5 }, ticks: { stroke: () => css("line"), width: 0.5 }, ...extra });
    const seconds = [1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14400, 43200];
    const across = data.time ? { values: (_, values) => values.map(clock), incrs: seconds, space: 62 } : data.date ? { values: (_, values) => values.map(dateOf), space: 84 } : data.counts ? { incrs: [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 10000] } : {};
    const labels = data.moments.length ? 0.14 * (data.yRange[1] - data.yRange[0]) : 0;
    const plot = new uPlot({
      width: Math.max(box.clientWidth, 200), height: 260, series, bands,
      tzDate: (value) => uPlot.tzDate(new Date(1e3 * value), "Etc/UTC"),
      scales: { x: { time: data.date }, y: { range: () => [data.yRange[0], data.yRange[1] + labels] } },
      axes: [axis(data.xLabel, across), axis(data.yLabel, { size: 56 })],
      cursor: { sync: data.group ? { key: data.group } : undefined, drag: { x: true, y: false } },
      legend: { markers: { dash: (_, k) => ["solid", "dashed", "dotted"][dashOf(series[k].dash)] } },
      hooks: {
        drawClear: [(one) => drawBehind(one, data)],
        draw: [(one) => drawOver(one, data)],
        setScale: [(one, key) => { if (key === "x") follow(data.group, one, one.scales.x.min, one.scales.x.max); }],
        setCursor: [(one) => { box.classList.toggle("aimed", one.cursor.left >= 0); if (data.time) showPlace(data.group, one.cursor.left < 0 ? null : one.posToVal(one.cursor.left, "x")); }],
      },
    }, columns, box);
    const entries = [...box.querySelectorAll(".u-series")];
    series.forEach((one, k) => { if (one.label === "") entries[k]?.remove(); }); // the edges of a band have no entry
    for (const name of data.spanNames) {
      const entry = document.createElement("tr"), swatch = document.createElement("span");
      entry.className = "u-series";
      swatch.className = "u-marker";
      swatch.style.background = `color-mix(in srgb, var(--${name.style}) 50%, transparent)`;
      const head = document.createElement("th");
      head.append(swatch, name.name);
      entry.append(head);
      box.querySelector(".u-legend")?.append(entry);
    }
    plots.push([box, plot, data]);
  }

  /** Label of a tick of a date axis, UTC: the date at midnight and at the first tick, else the time. */
  function dateOf(value, k) {
    const [day, time] = new Date(1e3 * value).toISOString().slice(0, 16).split("T");
    return time === "00:00" ? day : k === 0 ? `${time}\n${day}` : time;
  }

  /** 0 solid, 1 dashed, 2 dotted: how the legend shows a line. */
  function dashOf(dashes) {
    return !dashes || dashes.length === 0 ? 0 : dashes.length === 2 && dashes[0] <= 4 ? 2 : 1;
  }

  function makeTrack(figure, data) {
    const svg = figure.querySelector("svg");
    const dot = document.createElementNS("http://www.w3.org/2000/svg", "circle");
    dot.setAttribute("r", "6");
    dot.setAttribute("fill", "none");
    dot.setAttribute("stroke", "var(--bad)");
    dot.setAttribute("stroke-width", "3");
    dot.setAttribute("visibility", "hidden");
    svg.append(dot);
    tracks.push([dot, data]);
  }

  function showPlace(group, time) {
    for (const [dot, data] of tracks) {
      if (data.group !== group) continue;
      if (time === null) { dot.setAttribute("visibility", "hidden"); continue; }
      let low = 0, high = data.time.length - 1;
      while (low < high) {
        const middle = (low + high) >> 1;
        if (data.time[middle] < time) low = middle + 1; else high = middle;
      }
      dot.setAttribute("cx", data.x[low]);
      dot.setAttribute("cy", data.y[low]);
      dot.setAttribute("visibility", "visible");
    }
  }

  /** A narrow screen shows rows as blocks, which would hide from a screen reader that this is a table. */
  function nameRoles(table) {
    for (const [selector, role] of [["thead, tbody", "rowgroup"], ["tr", "row"], ["th", "columnheader"], ["td", "cell"]])
      table.querySelectorAll(selector).forEach((part) => part.setAttribute("role", role));
    table.setAttribute("role", "table");
  }

  function makeSortable(table) {
    table.querySelectorAll("thead th").forEach((head, k) => {
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = head.textContent;
      head.replaceChildren(button);
      button.addEventListener("click", () => {
        const up = head.getAttribute("aria-sort") !== "ascending";
        table.querySelectorAll("th").forEach((other) => other.removeAttribute("aria-sort"));
        head.setAttribute("aria-sort", up ? "ascending" : "descending");
        const key = (row) => row.cells[k].dataset.sort ?? row.cells[k].textContent;
        const rows = [...table.tBodies[0].rows].sort((first, second) => {
          const a = key(first), b = key(second), difference = a - b;
          const order = a !== "" && b !== "" && !Number.isNaN(difference) ? difference : a.localeCompare(b);
          return up ? order : -order;
        });
        table.tBodies[0].append(...rows);
      });
    });
  }

  function start() {
    document.documentElement.classList.add("scripted");
    document.querySelectorAll("table").forEach(nameRoles);
    document.querySelectorAll("table.sort").forEach(makeSortable);
    const kinds = { chart: makeChart, track: makeTrack };
    const make = (figure) => {
      const data = figure.querySelector("script[type='application/json']");
      if (!data || figure.dataset.made) return;
      figure.dataset.made = "1";
      const parsed = JSON.parse(data.textContent);
      kinds[parsed.kind](figure, parsed);
    };
    document.querySelectorAll("figure").forEach((figure) => { if (!figure.closest("details")) make(figure); });
    document.querySelectorAll("details").forEach((part) => part.addEventListener("toggle", () => part.querySelectorAll("figure").forEach(make)));
    const show = () => {
      const part = location.hash.length > 1 ? document.getElementById(decodeURIComponent(location.hash.slice(1))) : null;
      if (part instanceof HTMLDetailsElement) part.open = true;
    };
    addEventListener("hashchange", show);
    show();
    addEventListener("resize", () => plots.forEach(([box, plot]) => plot.setSize({ width: Math.max(box.clientWidth, 200), height: plot.height })));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => plots.forEach(([, plot]) => plot.redraw(false)));
    document.body.dataset.ready = "1";
  }
  if (document.readyState === "loading") addEventListener("DOMContentLoaded", start); else start();
})();
