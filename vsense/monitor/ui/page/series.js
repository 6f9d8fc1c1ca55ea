// Numbers over time: of the run, of a robot, of a sensor. A replay may be sought: places stay where they are.

const KEPT = 2400;

/** One or several numbers over the run's time [s]; `values` of one time are a list. */
export class Series {
  constructor() {
    this.times = [];
    this.values = [];
  }

  /** Adds what is so at a time; what is told again replaces what was there. */
  add(time, values, replay) {
    const { times } = this;
    if (time === null || time === undefined) return;
    // Another run begins; a replay only goes to another place.
    if (!replay && times.length && time < times.at(-1)) this.clear();
    let at = times.length;
    while (at > 0 && times[at - 1] >= time) at -= 1;
    const same = times[at] === time ? 1 : 0;
    times.splice(at, same, time);
    this.values.splice(at, same, values);
    if (times.length > KEPT) this.#thin();
  }

  clear() {
    this.times.length = this.values.length = 0;
  }

  get last() {
    return this.values.at(-1) ?? null;
  }

  /** What was so at a time, or just before. */
  at(time) {
    let at = this.times.length - 1;
    while (at > 0 && this.times[at] > time) at -= 1;
    return this.values[at] ?? null;
  }

  // A long run keeps its whole line, with every other of its points.
  #thin() {
    const keep = (_, index) => index % 2 === 0;
    this.times = this.times.filter(keep);
    this.values = this.values.filter(keep);
  }
}

/** The robots in the polluted cone, and those that are lit; null where there can be none. */
export function ofSwarm(store) {
  const { signals, arena, robots } = store;
  const found = {};
  const cones = signals?.cones ?? [];
  if (cones.length || store.hadCone) {
    store.hadCone = true;
    const { tag = [], x_m: x, y_m: y } = arena?.robots ?? {};
    found["in the cone"] = tag.filter((one, row) => store.rows.has(one) && cones.some((cone) => within(cone, x[row], y[row]))).length;
  }
  const lit = (robots?.leds ?? []).filter(Boolean).length;
  if (lit || store.hadLight) {
    store.hadLight = true;
    found.lit = lit;
  }
  return found;
}

function within({ x_m: x, y_m: y }, px, py) {
  let side = 0;
  for (let at = 0; at < x.length; at += 1) {
    const next = (at + 1) % x.length;
    const turn = Math.sign((x[next] - x[at]) * (py - y[at]) - (y[next] - y[at]) * (px - x[at]));
    if (turn && side && turn !== side) return false;
    side ||= turn;
  }
  return true;
}

/** Makes an element one that opens a chart; `what` is {key, label, unit, tag, now(store)}, null: none. */
export function chartable(element, what) {
  element.chart = what;
  const on = Boolean(what);
  if (element.classList.contains("chartable") === on) return;
  element.classList.toggle("chartable", on);
  if (on) Object.assign(element, { tabIndex: 0, title: "a click shows it over time" });
  else element.removeAttribute("tabindex");
}
