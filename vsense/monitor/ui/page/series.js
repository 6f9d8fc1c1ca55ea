// Numbers over time: of the run, of a robot, of a sensor. A replay may be sought: places stay where they are.

const MOST_SAMPLES = 2400;
/** Times that are farther apart have a gap between them [s]. */
const GAP_S = 3;

/** One or several numbers over the run's time [s]; `values` of one time are a list. */
export class Series {
  /** @type {number[]} */
  times = [];
  /** @type {ChartValues[]} */
  values = [];
  /** The smallest and the largest value from each time to the next, where some were thinned out.
   * @type {([number, number] | undefined)[]} */
  spans = [];
  /** What is farther apart has a gap between [s]. */
  gap_s = GAP_S;

  /** Adds the values of a time; in place of those that it had.
   * @param {number | null} time @param {ChartValues} values */
  add(time, values) {
    const { times } = this;
    if (time === null) return;
    let at = times.length;
    while (at > 0 && times[at - 1] >= time) at -= 1;
    const same = times[at] === time ? 1 : 0;
    times.splice(at, same, time);
    this.values.splice(at, same, values);
    this.spans.splice(at, same, same ? this.spans[at] : undefined);
    if (times.length > MOST_SAMPLES) this.#thin();
  }

  /** Takes what the host has kept, in place of what was heard until then.
   * @param {HistoryMessage} history @param {string} name */
  load({ time_s, bucket_s, measures }, name) {
    const { low, high, last } = measures[name];
    const end_s = (time_s.at(-1) ?? -1) + bucket_s;
    const from = this.times.findIndex((time) => time >= end_s - 1e-6);
    const rest = from < 0 ? this.times.length : from;
    this.times = [...time_s, ...this.times.slice(rest)];
    this.values = [...last.map((value) => [value]), ...this.values.slice(rest)];
    this.spans = [...low.map((value, at) => spanOf(value, high[at])), ...this.spans.slice(rest)];
    this.gap_s = Math.max(GAP_S, 2.5 * bucket_s);
  }

  get last() {
    return this.values.at(-1) ?? null;
  }

  /** What was so at a time, or just before.
   * @param {number} time */
  at(time) {
    let at = this.times.length - 1;
    while (at > 0 && this.times[at] > time) at -= 1;
    return this.values[at] ?? null;
  }

  // A long run keeps its whole line, with every other of its points.
  #thin() {
    const keep = (/** @type {unknown} */ _, /** @type {number} */ index) => index % 2 === 0;
    this.times = this.times.filter(keep);
    this.values = this.values.filter(keep);
    this.spans = this.spans.filter(keep);
  }
}

/** @param {number | null} low @param {number | null} high @returns {[number, number] | undefined} */
const spanOf = (low, high) => (low === null || high === null || low === high ? undefined : [low, high]);

/** Makes an element one that opens a chart; null: none.
 * @param {HTMLElement} element @param {ChartSource | null} source */
export function chartable(element, source) {
  element.chart = source;
  const on = Boolean(source);
  if (element.classList.contains("chartable") === on) return;
  element.classList.toggle("chartable", on);
  if (on) Object.assign(element, { tabIndex: 0, title: "a click shows it over time" });
  else element.removeAttribute("tabindex");
}
