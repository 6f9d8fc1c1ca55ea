// Charts over the run's time: the experiment's measures, and whatever number was clicked.

import { byId, fit, make, penOf, write } from "./dom.js";
import { clock, reading } from "./format.js";
import { ofSwarm, Series } from "./series.js";
import * as theme from "./theme.js";

const LINES = ["cone", "lit", "blue", "green", "virtual", "stranger", "ray2", "ray3"];
const OWN = 6;
const MOST = 12;
const GAP_S = 3;

/** @typedef {ReturnType<typeof chartOf>} Chart */
/** What is charted: the experiment's own measures have only a label.
 * @typedef {{ label: string } & Partial<ChartSource>} Source */

/** The charts below the arena. */
export class Measures {
  /** What was clicked, by key.
   * @type {Map<string, ChartSource>} */
  chosen = new Map();
  /** The lines of what is charted and of the swarm's counts, by key.
   * @type {Map<string, Series>} */
  series = new Map();
  /** @type {Map<string, Chart>} */
  #charts = new Map();
  /** @type {string | undefined} */
  #experiment;

  /** @param {Store} store @param {Notify} notify @param {() => void} changed is called when others are charted. */
  constructor(store, notify, changed) {
    this.store = store;
    this.notify = notify;
    this.changed = changed;
    this.box = byId("measures");
    document.addEventListener("click", (event) => this.#click(event));
    document.addEventListener("keydown", (event) => event.key === "Enter" && this.#click(event));
  }

  /** Robots whose readings are charted. */
  get tags() {
    return [...this.chosen.values()].flatMap(({ tag }) => (tag === undefined ? [] : [tag]));
  }

  /** Renews lines and figures; called a few times per second. */
  render() {
    if (this.store.experiment?.name !== this.#experiment) this.#clear();
    this.#sample();
    const sources = this.#sources();
    if ([...sources.keys()].join("\n") !== [...this.#charts.keys()].join("\n")) this.#build(sources);
    for (const [key, chart] of this.#charts) this.#renderChart(key, chart);
  }

  /** Opens a chart, or closes it.
   * @param {ChartSource} source */
  toggle(source) {
    if (this.chosen.delete(source.key)) this.series.delete(source.key);
    else if (this.chosen.size >= MOST) return this.notify(`there are ${MOST} charts already: close one`, false);
    else this.chosen.set(source.key, source);
    this.changed();
    this.render();
  }

  /** @param {Event} event */
  #click(event) {
    const element = event.target instanceof Element ? event.target.closest(".chartable") : null;
    if (!(element instanceof HTMLElement) || !element.chart) return;
    event.preventDefault();
    this.toggle(element.chart);
  }

  #clear() {
    this.#experiment = this.store.experiment?.name;
    this.chosen.clear();
    this.series.clear();
  }

  /** The experiment's measures, and what was clicked.
   * @returns {Map<string, Source>} */
  #sources() {
    const names = [...new Set([...Object.keys(ofSwarm(this.store)), ...this.store.measures.keys()])].slice(0, OWN);
    /** @type {[string, Source][]} */
    const own = names.map((name) => [name, { label: name.replaceAll("_", " ") }]);
    return new Map([...own, ...this.chosen]);
  }

  #sample() {
    const { store } = this;
    const time = store.now.time_s;
    if (!store.run || time === null || store.now.timestep < 0) return;
    for (const [name, value] of Object.entries(ofSwarm(store))) {
      if (!store.measures.has(name)) this.#add(name, time, [value]);
    }
    for (const [key, source] of this.chosen) this.#add(key, time, source.now(store));
  }

  /** @param {string} key @param {number | null} time @param {ChartValues} values */
  #add(key, time, values) {
    const series = this.series.get(key) ?? new Series();
    this.series.set(key, series);
    series.add(time, values, this.store.experiment?.mode === "replay");
  }

  /** @param {Map<string, Source>} sources */
  #build(sources) {
    this.#charts = new Map([...sources].map(([key, source], index) => [key, chartOf(key, source, index)]));
    for (const { source, close } of this.#charts.values()) {
      close.addEventListener("click", () => {
        const chosen = this.chosen.get(source.key ?? "");
        if (chosen) this.toggle(chosen);
      });
    }
    this.box.replaceChildren(...[...this.#charts.values()].map(({ element }) => element));
  }

  /** @param {string} key @param {Chart} chart */
  #renderChart(key, chart) {
    const series = this.series.get(key) ?? this.store.measures.get(key);
    const { source, canvas, pointer } = chart;
    const now = this.store.now.time_s;
    const span = spanOf(series, now);
    const at = pointer.share === null ? now : span[0] + pointer.share * (span[1] - span[0]);
    const values = series?.at(at ?? Infinity);
    const unit = source.unit ? ` ${source.unit}` : "";
    write(chart.number, values ? `${figures(values)}${unit}` : "–");
    write(chart.label, pointer.share === null ? source.label : `${source.label} at ${clock(at)}`);
    chart.label.title = source.label;
    fit(canvas);
    drawChart(canvas, series ?? new Series(), span, now, chart.index);
  }
}

/** A chart's elements; `pointer.share` is where the mouse is, as a share of its width.
 * @param {string} key @param {Source} source @param {number} index */
function chartOf(key, source, index) {
  const [number, canvas, label] = [make("b"), make("canvas"), make("span")];
  const close = make("button", { className: "icon", type: "button", title: "Close this chart" }, "✕");
  close.setAttribute("aria-label", `Close the chart of ${source.label}`);
  const head = make("p", {}, label, number);
  if (source.key) head.append(close);
  const element = make("div", { className: "measure" }, head, canvas);
  element.dataset.chart = key;
  const pointer = { share: /** @type {number | null} */ (null) };
  canvas.addEventListener("pointermove", (event) => {
    pointer.share = event.offsetX / Math.max(canvas.clientWidth, 1);
  });
  canvas.addEventListener("pointerleave", () => {
    pointer.share = null;
  });
  return { source, index, number, canvas, label, close, element, pointer };
}

/** Of many numbers the largest says most.
 * @param {(number | null | undefined)[]} values */
function figures(values) {
  if (values.length < 3) return values.map(reading).join(", ");
  const numbers = numbersIn(values);
  return numbers.length ? `up to ${reading(Math.max(...numbers))}` : "–";
}

/** @param {(number | null | undefined)[]} values @returns {number[]} */
const numbersIn = (values) => values.flatMap((value) => (typeof value === "number" ? [value] : []));

/** The first and last time that a chart shows [s].
 * @param {Series | undefined} series @param {number | null} now */
function spanOf(series, now) {
  const times = series?.times ?? [];
  const from = times[0] ?? 0;
  return [from, Math.max(times[times.length - 1] ?? 0, now ?? 0, from + 1e-3)];
}

/**
 * @param {HTMLCanvasElement} canvas @param {Series} series @param {number[]} span @param {number | null} now
 * @param {number} index */
function drawChart(canvas, series, [from, to], now, index) {
  const pen = penOf(canvas);
  const { width, height } = canvas;
  const ratio = width / Math.max(canvas.clientWidth, 1);
  pen.clearRect(0, 0, width, height);
  const all = series.values.flatMap((values) => numbersIn(values ?? []));
  if (!all.length) return;
  let [low, high] = [all.reduce((a, b) => Math.min(a, b)), all.reduce((a, b) => Math.max(a, b))];
  // Small counts stand on their zero; what varies a little around much is shown as it varies.
  if (low > 0 && low < 0.6 * high) low = 0;
  if (high - low < 1e-9) [low, high] = [low - 0.5, high + 0.5];
  const side = 34 * ratio;
  const x = (/** @type {number} */ time) => side + ((time - from) / (to - from)) * (width - side - 3 * ratio);
  const rise = (height - 10 * ratio) / (high - low);
  const y = (/** @type {number} */ value) => height - 4 * ratio - (value - low) * rise;
  drawAxes(pen, { low, high, y, side, width, ratio });
  const count = Math.max(...series.values.map((values) => values?.length ?? 0));
  const base = count === 1 ? y(Math.max(low, 0)) : null;
  for (let place = 0; place < count; place += 1) {
    const colour = theme.colours[LINES[(index + place) % LINES.length]];
    drawLine(pen, series, place, { x, y, ratio, colour, base });
  }
  if (typeof now === "number" && now >= from && now < to - 1e-6) {
    pen.fillStyle = theme.colours.muted;
    pen.fillRect(x(now), 0, ratio, height);
  }
}

/**
 * @param {Pen} pen
 * @param {{ low: number, high: number, y: (value: number) => number, side: number, width: number,
 *   ratio: number }} scale */
function drawAxes(pen, { low, high, y, side, width, ratio }) {
  pen.font = `${10 * ratio}px system-ui, sans-serif`;
  pen.fillStyle = theme.colours.muted;
  pen.strokeStyle = theme.colours.grid;
  pen.lineWidth = ratio;
  pen.textAlign = "right";
  for (const [value, shift] of [[high, 6], [low, 0]]) {
    pen.fillText(short(value), side - 4 * ratio, y(value) + shift * ratio);
    pen.beginPath();
    pen.moveTo(side, y(value));
    pen.lineTo(width, y(value));
    pen.stroke();
  }
}

/** @param {number} value */
function short(value) {
  const isPlain = value === 0 || (Math.abs(value) >= 1e-2 && Math.abs(value) < 1e4);
  return isPlain ? String(Number(value.toPrecision(3))) : value.toExponential(0);
}

/** What was not heard of is a gap, not a line. `base` [px]: what lies between it and the line is tinted.
 * @param {Pen} pen @param {Series} series @param {number} place among the values of a time
 * @param {{ x: (time: number) => number, y: (value: number) => number, ratio: number, colour: string,
 *   base: number | null }} scale */
function drawLine(pen, { times, values }, place, { x, y, ratio, colour, base }) {
  pen.strokeStyle = pen.fillStyle = colour;
  pen.lineWidth = 1.8 * ratio;
  pen.lineJoin = "round";
  /** @type {Point[]} */
  let piece = [];
  const end = () => {
    pen.beginPath();
    for (const [px, py] of piece) pen.lineTo(px, py);
    pen.stroke();
    if (base !== null && piece.length > 1) {
      pen.lineTo(piece[piece.length - 1][0], base);
      pen.lineTo(piece[0][0], base);
      pen.globalAlpha = 0.14;
      pen.fill();
      pen.globalAlpha = 1;
    }
    piece = [];
  };
  times.forEach((time, at) => {
    const value = values[at]?.[place];
    if (typeof value !== "number" || (piece.length && time - times[at - 1] > GAP_S)) end();
    if (typeof value === "number") piece.push([x(time), y(value)]);
  });
  end();
}
