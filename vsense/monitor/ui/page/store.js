// What the page knows: the newest message of every topic, and a little of what was before.

import { Series } from "./series.js";

const TRAIL = 80;
const STEPS_KEPT = 24;
const EVENTS_KEPT = 200;
const OLD_MS = 2000;
const PLAIN = new Set(["you", "run", "arena", "world", "signals", "fields", "robots", "cameras", "parts", "settings"]);

/** Holds everything; `changed` grows per topic, so that panels see what is new to them. */
export class Store {
  constructor() {
    this.clear();
    this.you = { viewer: "", control: true, viewers: 0 };
    this.events = [];
    this.answers = [];
    /** Answers to changes of the world, and whether the newest was a no. */
    this.settled = 0;
    this.refused = false;
    this.changed = {};
    this.runHeard = Infinity;
    this.ahead = Infinity;
  }

  /** Forgets one run's news, as when another experiment comes. */
  clear() {
    this.experiment = null;
    this.objects = new Set();
    this.names = new Map();
    this.heights = new Map();
    this.run = null;
    this.arena = null;
    this.world = null;
    this.signals = null;
    this.fields = null;
    this.robots = null;
    this.cameras = null;
    this.readings = new Map();
    this.hadCone = this.hadLight = false;
    this.settings = this.parts = null;
    /** Where the run is, by whatever told it last. */
    this.now = { timestep: -1, time_s: 0 };
    this.pictures = new Map();
    this.trails = new Map();
    this.images = new Map();
    this.shows = new Map();
    this.measures = new Map();
    this.rows = new Map();
    this.peaks = new Map();
  }

  /** What the wall's clock showed [ms] at a time of the host's: no message comes before it is made. */
  wall(timeNs) {
    return timeNs / 1e6 + this.ahead;
  }

  /** Takes one message. */
  take(topic, timeNs, data, blob) {
    if (timeNs > 0) this.ahead = Math.min(this.ahead, Date.now() - timeNs / 1e6);
    const [, name, rest] = topic.split("/");
    if (blob) this.pictures.set(rest, { about: data, blob, number: (this.pictures.get(rest)?.number ?? 0) + 1 });
    else if (name === "event") this.#event(timeNs, data);
    else if (name === "answer") this.#answer(data);
    else if (name === "experiment") this.#experiment(data);
    else if (name === "readings") for (const tag of data.tag ?? []) this.readings.set(tag, data);
    else if (PLAIN.has(name)) this[name] = data;
    if (name === "run") this.#run(data);
    if (name === "arena") this.#arena(data);
    if (name === "robots") this.rows = new Map(data.tag.map((tag, row) => [tag, row]));
    if (name === "signals") this.#signals(data);
    this.changed[name] = (this.changed[name] ?? 0) + 1;
  }

  /** Which part a robot plays, and its uid; nothing where nobody has told it. */
  part(tag) {
    const row = this.parts?.tag?.indexOf(tag) ?? -1;
    return row < 0 ? {} : { part: this.parts.part[row], uid: this.parts.uid[row] };
  }

  #answer(data) {
    if (data.change) {
      this.settled += 1;
      this.refused = !data.ok;
    }
    this.answers.push(data);
  }

  #run(data) {
    this.now = { timestep: data.timestep, time_s: data.time_s };
    this.runHeard = performance.now();
  }

  #experiment(data) {
    const same = this.experiment && this.experiment.name === data.name && this.experiment.mode === data.mode;
    if (!same) this.clear();
    this.experiment = data;
    this.objects = new Set((data.objects ?? []).map((object) => object.tag));
    this.heights = new Map((data.robots ?? []).map((robot) => [robot.tag, robot.height_m]));
    this.names = new Map([...(data.robots ?? []), ...(data.objects ?? [])].map((one) => [one.tag, one.name]));
  }

  #event(timeNs, data) {
    // Whoever comes anew is told the last events again.
    if (this.events.some((event) => event.timeNs === timeNs && event.text === data.text)) return;
    // Older recordings and other programs do not say when in the run it was.
    const fresh = this.experiment?.mode === "replay" || Date.now() - this.wall(timeNs) < OLD_MS;
    const heard = this.run && fresh && this.now.timestep >= 0 ? this.now.time_s : null;
    this.events.push({ timeNs, run_s: data.time_s === undefined ? heard : data.time_s, ...data });
    if (this.events.length > EVENTS_KEPT) this.events.shift();
  }

  #arena(data) {
    const before = this.step ?? -1;
    this.now.timestep = data.run_timestep;
    this.step = data.run_timestep;
    // Another run began, or a replay went to another place: the old trails lead nowhere.
    if (data.run_timestep < before || data.run_timestep > before + 50) {
      this.trails.clear();
      this.images.clear();
      this.shows.clear();
    }
    const { tag, x_m, y_m } = data.robots;
    for (let row = 0; row < tag.length; row += 1) {
      let trail = this.trails.get(tag[row]);
      if (!trail) this.trails.set(tag[row], (trail = []));
      const last = trail.at(-1);
      if (last && last[0] === x_m[row] && last[1] === y_m[row]) continue;
      trail.push([x_m[row], y_m[row]]);
      if (trail.length > TRAIL) trail.shift();
    }
    this.images.set(data.timestep, data);
    if (this.images.size > STEPS_KEPT) this.images.delete(this.images.keys().next().value);
  }

  #signals(data) {
    this.now.time_s = data.time_s;
    this.shows.set(data.timestep, data);
    if (this.shows.size > STEPS_KEPT) this.shows.delete(this.shows.keys().next().value);
    for (const [name, value] of Object.entries(data.measures ?? {})) {
      let line = this.measures.get(name);
      if (!line) this.measures.set(name, (line = new Series()));
      line.add(data.time_s, [value], this.experiment?.mode === "replay");
    }
  }

  /** The `/signals` of a timestep of the run, where that is still known, else the newest. */
  signalsAt(timestep) {
    return this.shows.get(timestep) ?? this.signals;
  }

  /** What people call a tag. */
  name(tag) {
    return this.names.get(tag) ?? String(tag);
  }

  /** The chosen robot's row of `/robots`, or null. */
  robot(tag) {
    const row = this.rows.get(tag);
    if (row === undefined) return null;
    return Object.fromEntries(Object.entries(this.robots).map(([name, column]) => [name, column[row]]));
  }

  /** What drives a robot: its row of the experiment's controllers, or undefined. */
  controller(tag) {
    const all = this.experiment?.controllers ?? [];
    return all.find((each) => each.tags.includes(tag)) ?? all[0];
  }

  /** The virtual sensors of a robot. */
  sensors(tag) {
    return this.controller(tag)?.sensors ?? [];
  }

  /** The chosen robot's reading of each sensor: [{sensor, values, age_ns}]; [] before the first. */
  sensed(tag) {
    const data = this.readings.get(tag);
    const row = data?.tag.indexOf(tag) ?? -1;
    if (row < 0 || !this.experiment) return [];
    return this.sensors(tag).map((sensor, index) => {
      const captured = data.captured_ns[row][index];
      return { sensor, values: data.values[row][index], age_ns: captured < 0 ? null : data.capture_ns - captured };
    });
  }

  /** The largest size of a sensor's numbers so far: what its rays and bars are drawn against. */
  peak(name, values) {
    let peak = this.peaks.get(name) ?? 1e-9;
    for (const value of values) peak = Math.max(peak, Math.abs(value ?? 0));
    this.peaks.set(name, peak);
    return peak;
  }
}
