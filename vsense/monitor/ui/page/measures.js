// Charts over the run's time: the experiment's measures, and whatever number was clicked.

import { byId, fit, make, write } from "./dom.js";
import { clock, reading } from "./format.js";
import { ofSwarm, Series } from "./series.js";
import * as theme from "./theme.js";

const LINES = ["cone", "lit", "blue", "green", "virtual", "stranger", "ray2", "ray3"];
const OWN = 6;
const MOST = 12;
const GAP_S = 3;

/** The charts below the arena. */
export class Measures {
  constructor(store, toast) {
    this.store = store;
    this.toast = toast;
    this.box = byId("measures");
    /** What was clicked: key -> what; and of everything that is shown its line. */
    this.asked = new Map();
    this.series = new Map();
    this.shown = new Map();
    document.addEventListener("click", (event) => this.#clicked(event));
    document.addEventListener("keydown", (event) => event.key === "Enter" && this.#clicked(event));
  }

  /** Robots whose readings are charted. */
  get tags() {
    return [...new Set([...this.asked.values()].map((what) => what.tag).filter((tag) => tag !== undefined))];
  }

  /** Renews lines and figures; called a few times per second. */
  tell() {
    if (this.store.experiment?.name !== this.name) this.#forget();
    this.#sample();
    const all = this.#all();
    if (all.map(([key]) => key).join("\n") !== [...this.shown.keys()].join("\n")) this.#build(all);
    for (const [key, chart] of this.shown) this.#renew(key, chart);
  }

  toggle(what) {
    if (this.asked.delete(what.key)) this.series.delete(what.key);
    else if (this.asked.size >= MOST) return this.toast(`there are ${MOST} charts already: close one`, false);
    else this.asked.set(what.key, what);
    this.changed?.();
    this.tell();
  }

  #clicked(event) {
    const element = event.target.closest?.(".chartable");
    if (!element?.chart) return;
    event.preventDefault();
    this.toggle(element.chart);
  }

  #forget() {
    this.name = this.store.experiment?.name;
    this.asked.clear();
    this.series.clear();
  }

  #all() {
    const own = [...Object.entries(ofSwarm(this.store)), ...[...this.store.measures.keys()].map((name) => [name])];
    const names = [...new Set(own.map(([name]) => name))].slice(0, OWN);
    return [...names.map((name) => [name, { label: name.replaceAll("_", " ") }]), ...this.asked];
  }

  #sample() {
    const { store } = this;
    const time = store.now.time_s;
    if (!store.run || time === null || store.now.timestep < 0) return;
    for (const [name, value] of Object.entries(ofSwarm(store))) if (!store.measures.has(name)) this.#add(name, time, [value]);
    for (const [key, what] of this.asked) this.#add(key, time, what.now(store));
  }

  #add(key, time, values) {
    if (!this.series.has(key)) this.series.set(key, new Series());
    this.series.get(key).add(time, values, this.store.experiment?.mode === "replay");
  }

  #build(all) {
    this.shown = new Map(all.map(([key, what], index) => [key, this.#chart(key, what, index)]));
    this.box.replaceChildren(...[...this.shown.values()].map(({ element }) => element));
  }

  #chart(key, what, index) {
    const made = { what, index, number: make("b"), canvas: make("canvas"), label: make("span") };
    made.element = make("div", { className: "measure" }, make("p", {}, made.label, made.number), made.canvas);
    made.element.dataset.chart = key;
    if (what.key) {
      const close = make("button", { className: "icon", type: "button", title: "Close this chart" }, "✕");
      close.setAttribute("aria-label", `Close the chart of ${what.label}`);
      close.addEventListener("click", () => this.toggle(what));
      made.element.firstChild.append(close);
    }
    made.canvas.addEventListener("pointermove", (event) => (made.pointed = event.offsetX / Math.max(made.canvas.clientWidth, 1)));
    made.canvas.addEventListener("pointerleave", () => (made.pointed = undefined));
    return made;
  }

  #renew(key, chart) {
    const line = this.series.get(key) ?? this.store.measures.get(key);
    const { what, canvas, pointed } = chart;
    const span = spanOf(line, this.store.now.time_s);
    const at = pointed === undefined ? this.store.now.time_s : span[0] + pointed * (span[1] - span[0]);
    const values = line?.at(at) ?? null;
    const unit = what.unit ? ` ${what.unit}` : "";
    write(chart.number, values ? `${figures(values)}${unit}` : "–");
    write(chart.label, pointed === undefined ? what.label : `${what.label} at ${clock(at)}`);
    chart.label.title = what.label;
    fit(canvas);
    sketch(canvas, line, span, this.store.now.time_s, chart.index);
  }
}

// Of many numbers the largest says most.
function figures(values) {
  if (values.length < 3) return values.map(reading).join(", ");
  const known = values.filter((value) => typeof value === "number");
  return known.length ? `up to ${reading(Math.max(...known))}` : "–";
}

function spanOf(line, now) {
  const from = line?.times[0] ?? 0;
  return [from, Math.max(line?.times.at(-1) ?? 0, now ?? 0, from + 1e-3)];
}

function sketch(canvas, line, [from, to], now, index) {
  const pen = canvas.getContext("2d");
  const { width, height } = canvas;
  const ratio = width / Math.max(canvas.clientWidth, 1);
  pen.clearRect(0, 0, width, height);
  const all = (line?.values ?? []).flat().filter((value) => typeof value === "number");
  if (!all.length) return;
  let [low, high] = [all.reduce((a, b) => Math.min(a, b)), all.reduce((a, b) => Math.max(a, b))];
  // Small counts stand on their zero; what varies a little around much is shown as it varies.
  if (low > 0 && low < 0.6 * high) low = 0;
  if (high - low < 1e-9) [low, high] = [low - 0.5, high + 0.5];
  const side = 34 * ratio;
  const x = (time) => side + ((time - from) / (to - from)) * (width - side - 3 * ratio);
  const y = (value) => height - 4 * ratio - ((value - low) / (high - low)) * (height - 10 * ratio);
  axes(pen, { low, high, y, side, width, ratio });
  const count = Math.max(...line.values.map((values) => values?.length ?? 0));
  for (let one = 0; one < count; one += 1) {
    trace(pen, line, one, { x, y, ratio, colour: theme.colours[LINES[(index + one) % LINES.length]], base: count === 1 ? y(Math.max(low, 0)) : null });
  }
  if (typeof now === "number" && now >= from && now < to - 1e-6) {
    pen.fillStyle = theme.colours.muted;
    pen.fillRect(x(now), 0, ratio, height);
  }
}

function axes(pen, { low, high, y, side, width, ratio }) {
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

const short = (value) => (Math.abs(value) >= 1e4 || (value && Math.abs(value) < 1e-2) ? value.toExponential(0) : String(Number(value.toPrecision(3))));

// What was not heard of is a gap, not a line.
function trace(pen, { times, values }, one, { x, y, ratio, colour, base }) {
  pen.strokeStyle = pen.fillStyle = colour;
  pen.lineWidth = 1.8 * ratio;
  pen.lineJoin = "round";
  let run = [];
  const end = () => {
    pen.beginPath();
    for (const [px, py] of run) pen.lineTo(px, py);
    pen.stroke();
    if (base !== null && run.length > 1) {
      pen.lineTo(run.at(-1)[0], base);
      pen.lineTo(run[0][0], base);
      pen.globalAlpha = 0.14;
      pen.fill();
      pen.globalAlpha = 1;
    }
    run = [];
  };
  times.forEach((time, at) => {
    const value = values[at]?.[one];
    if (typeof value !== "number" || (run.length && time - times[at - 1] > GAP_S)) end();
    if (typeof value === "number") run.push([x(time), y(value)]);
  });
  end();
}
