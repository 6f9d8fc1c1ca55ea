// Charts over the run's time: the experiment's measures, and whatever number was clicked.

import { drawChart, numbersIn } from "./chart.js";
import { byId, fit, make, write } from "./dom.js";
import { clock, labelOf, reading } from "./format.js";
import { Series } from "./series.js";

const OWN = 6;
const MOST = 12;

/** @typedef {ReturnType<typeof chartOf>} Chart */
/** What is charted: the experiment's own measures have only a label.
 * @typedef {{ label: string } & Partial<ChartSource>} Source */

/** The charts below the arena. */
export class Measures {
  /** What was clicked, by key.
   * @type {Map<string, ChartSource>} */
  chosen = new Map();
  /** The lines of what was clicked, by key.
   * @type {Map<string, Series>} */
  series = new Map();
  /** @type {Map<string, Chart>} */
  #charts = new Map();
  /** Of which run these are. */
  #run = "";

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
    this.#follow();
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

  /** Another run begins without the numbers of the one before. */
  #follow() {
    const { experiment, run } = this.store;
    const key = `${experiment?.name} ${run?.run}`;
    if (key === this.#run) return;
    if (!this.#run.startsWith(`${experiment?.name} `)) this.chosen.clear();
    this.series.clear();
    this.#run = key;
  }

  /** The experiment's measures, and what was clicked.
   * @returns {Map<string, Source>} */
  #sources() {
    const names = [...this.store.measures.keys()].slice(0, OWN);
    /** @type {[string, Source][]} */
    const own = names.map((name) => [name, labelOf(name)]);
    return new Map([...own, ...this.chosen]);
  }

  #sample() {
    const { store } = this;
    const time = store.now.time_s;
    if (!store.run || time === null || store.now.timestep < 0) return;
    for (const [key, source] of this.chosen) {
      const series = this.series.get(key) ?? new Series();
      this.series.set(key, series);
      series.add(time, source.now(store));
    }
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
    const span = spanOf(series, now, this.chosen.has(key));
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

/** The first and last time that a chart shows [s]: the run's measures have been there since its beginning.
 * @param {Series | undefined} series @param {number | null} now @param {boolean} isChosen */
function spanOf(series, now, isChosen) {
  const times = series?.times ?? [];
  const from = isChosen ? times[0] ?? 0 : 0;
  return [from, Math.max(times[times.length - 1] ?? 0, now ?? 0, from + 1)];
}
