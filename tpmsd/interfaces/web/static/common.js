// What both pages share: wheels, colours that follow the theme, numbers with units, plots.
export const WHEELS = ["fl", "fr", "rl", "rr"];
export const NAMES = { fl: "front left", fr: "front right", rl: "rear left", rr: "rear right" };
const DASHES = { fl: [], fr: [8, 3], rl: [2, 2], rr: [8, 3, 2, 3] }; // told apart in grey, too

export const byId = (id) => document.getElementById(id);
export const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

/** An element with text and attributes; text never becomes markup. */
export function element(tag, text = "", attributes = {}) {
  const node = document.createElement(tag);
  if (text !== "") node.textContent = text;
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
  return node;
}

export function duration(seconds) {
  if (!Number.isFinite(seconds)) return "";
  if (seconds < 90) return `${Math.round(seconds)} s`;
  const minutes = Math.round(seconds / 60);
  return minutes < 90 ? `${minutes} min` : `${Math.floor(minutes / 60)} h ${String(minutes % 60).padStart(2, "0")} min`;
}

export function signed(value, digits) {
  return value === null || value === undefined ? "–" : `${value >= 0 ? "+" : "−"}${Math.abs(value).toFixed(digits)}`;
}

/** Seconds as m:ss, from one hour on h:mm:ss. */
export function clock(seconds) {
  if (seconds === null || !Number.isFinite(seconds)) return "";
  const whole = Math.round(seconds), hours = Math.floor(whole / 3600), two = (value) => String(value).padStart(2, "0");
  return `${hours ? `${hours}:${two(Math.floor((whole % 3600) / 60))}` : Math.floor(whole / 60)}:${two(whole % 60)}`;
}

/**
 * The timeline's row of a status document, as `history_row` of the server makes it: per wheel its change since
 * learned with the standard deviation, null where it is not known; the deviation from nominal is another quantity.
 */
export function changeRow(document_) {
  const row = { time: document_.time };
  for (const wheel of WHEELS) {
    const one = document_.wheels?.[wheel], change = one?.change_mm ?? null;
    row[wheel] = change === null ? null : [change, one.change_std_mm ?? null];
  }
  return row;
}

/** `radius_deviation` as words. */
export const plain = (identifier) => identifier.replaceAll("_", " ");

/** The axis of a drive's time; without a label its marks alone, for all but the last of stacked charts. */
export function timeAxis(label) {
  const seconds = [1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14400, 43200];
  const values = label ? (_, ticks) => ticks.map(clock) : (_, ticks) => ticks.map(() => "");
  return axis(label, { values, incrs: seconds, space: 62, ...(label ? {} : { size: 8 }) });
}

/** The series of one wheel with its band, for uPlot. */
export function wheelSeries(wheel, label) {
  return { label, stroke: () => css(wheel), width: 2, dash: DASHES[wheel], spanGaps: false, points: { show: false } };
}

export const edge = () => ({ show: true, width: 0, points: { show: false }, label: "" });

export function axis(label, extra = {}) {
  return { label, stroke: () => css("text"), grid: { stroke: () => css("line"), width: 1 }, ticks: { stroke: () => css("line") }, ...extra };
}

export function band(wheel, high, low) {
  return { series: [high, low], fill: () => `color-mix(in srgb, ${css(wheel)} 8%, transparent)` };
}

const BAR_SPACING = 96; // CSS pixels between the bars of one wheel

/**
 * Bars from `low` to `high` of each wheel, every wheel at places of its own: bands of wheels that agree lie upon each
 * other and cannot be told apart, bars stand beside each other. `bars`: wheel, series of its upper and lower edge.
 */
export function whiskers(bars) {
  const draw = (plot) => {
    const { ctx, bbox } = plot, step = BAR_SPACING * devicePixelRatio, cap = 4 * devicePixelRatio;
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    ctx.lineWidth = 1.5 * devicePixelRatio;
    bars.forEach(([wheel, high, low], k) => {
      ctx.strokeStyle = css(wheel);
      ctx.beginPath();
      for (let x = bbox.left + ((k + 0.5) / bars.length) * step; x < bbox.left + bbox.width; x += step) {
        const row = plot.valToIdx(plot.posToVal(x, "x", true));
        const [top, bottom] = [plot.data[high][row], plot.data[low][row]];
        if (top === null || bottom === null || top === undefined || bottom === undefined) continue;
        const from = plot.valToPos(top, "y", true), to = plot.valToPos(bottom, "y", true);
        ctx.moveTo(x - cap, from);
        ctx.lineTo(x + cap, from);
        ctx.moveTo(x, from);
        ctx.lineTo(x, to);
        ctx.moveTo(x - cap, to);
        ctx.lineTo(x + cap, to);
      }
      ctx.stroke();
    });
    ctx.restore();
  };
  return { hooks: { draw: [draw] } };
}

/** A word in the colour that is set, on a ground that keeps it readable over curves. */
export function onGround(ctx, text, left, baseline) {
  const colour = ctx.fillStyle;
  ctx.globalAlpha = 0.8;
  ctx.fillStyle = css("card");
  ctx.fillRect(left - devicePixelRatio, baseline - 11 * devicePixelRatio, ctx.measureText(text).width + 2 * devicePixelRatio, 14 * devicePixelRatio);
  ctx.globalAlpha = 1;
  ctx.fillStyle = colour;
  ctx.fillText(text, left, baseline);
}

/** Vertical lines at alarms, drawn over a plot. */
export function alarmLines(alarms, time) {
  return {
    hooks: {
      draw: [
        (plot) => {
          const { ctx, bbox } = plot;
          ctx.save();
          ctx.lineWidth = Math.max(1, devicePixelRatio);
          ctx.textAlign = "left";
          ctx.font = `${12 * devicePixelRatio}px system-ui, sans-serif`;
          const free = [-Infinity, -Infinity, -Infinity];
          for (const alarm of alarms()) {
            const x = plot.valToPos(time(alarm), "x", true);
            if (!(x >= bbox.left && x <= bbox.left + bbox.width)) continue;
            ctx.strokeStyle = ctx.fillStyle = css(alarm.state === "raised" ? "bad" : "soft");
            ctx.setLineDash([4 * devicePixelRatio, 4 * devicePixelRatio]);
            ctx.beginPath();
            ctx.moveTo(x, bbox.top);
            ctx.lineTo(x, bbox.top + bbox.height);
            ctx.stroke();
            const text = `${plain(alarm.kind)} ${(alarm.wheel ?? "").toUpperCase()}`, width = ctx.measureText(text).width + 8;
            const left = x + width > bbox.left + bbox.width ? x - width : x + 3;
            const row = free.findIndex((edge) => left >= edge);
            if (row < 0) continue; // its line is there, its name has no room
            free[row] = left + width;
            onGround(ctx, text, left, bbox.top + (12 + 14 * row) * devicePixelRatio);
          }
          ctx.restore();
        },
      ],
    },
  };
}

/** Plots follow the width of their box and the theme. */
export function keepFitting(plots) {
  const fit = () => {
    for (const [box, plot] of plots()) plot.setSize({ width: Math.max(box.clientWidth, 200), height: plot.height });
  };
  addEventListener("resize", fit);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
    for (const [, plot] of plots()) {
      plot.redraw(false);
      for (const entry of plot.root.querySelectorAll(".u-series")) {
        const series = plot.series.find((one) => one.label && one.label === entry.querySelector(".u-label")?.textContent);
        const marker = entry.querySelector(".u-marker");
        if (series && marker) marker.style.borderColor = series.stroke(plot);
      }
    }
  });
}
