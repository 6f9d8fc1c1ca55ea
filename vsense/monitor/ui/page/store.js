// What the page knows: the newest message of every topic, and a little of what was before.

import { Series } from "./series.js";
import { TRAIL_S, Trail } from "./trail.js";

const MOST_STEPS = 24;
const MOST_EVENTS = 200;
/** @type {Record<string, string>} */
const SIMULATED = { running: "run", paused: "pause", ended: "stop" };
const OLD_MS = 2000;
const PLAIN = new Set(["you", "run", "arena", "world", "signals", "fields", "robots", "cameras", "parts", "settings"]);

/** @typedef {EventMessage & { timeNs: number, run_s: number | null }} StoredEvent */

/** What is known of one experiment's runs. */
class RunNews {
  experiment = /** @type {ExperimentMessage | null} */ (null);
  run = /** @type {RunMessage | null} */ (null);
  arena = /** @type {ArenaMessage | null} */ (null);
  world = /** @type {WorldMessage | null} */ (null);
  signals = /** @type {SignalsMessage | null} */ (null);
  fields = /** @type {FieldsMessage | null} */ (null);
  robots = /** @type {RobotsMessage | null} */ (null);
  cameras = /** @type {CamerasMessage | null} */ (null);
  settings = /** @type {SettingsMessage | null} */ (null);
  parts = /** @type {PartsMessage | null} */ (null);
  /** By tag.
   * @type {Map<number, ReadingsMessage>} */
  readings = new Map();
  /** Tags of tagged objects.
   * @type {Set<number>} */
  objects = new Set();
  /** What people call a tag.
   * @type {Map<number, string>} */
  names = new Map();
  heights = /** @type {Map<number, number>} */ (new Map());
  radii = /** @type {Map<number, number>} */ (new Map());
  /** By tag, in `/robots`.
   * @type {Map<number, number>} */
  rows = new Map();
  /** Where the run is, by whatever said it last. */
  now = { timestep: -1, time_s: /** @type {number | null} */ (0) };
  /** The newest picture of each camera.
   * @type {Map<string, { about: PictureMessage, blob: Uint8Array, number: number }>} */
  pictures = new Map();
  /** Earlier places by tag.
   * @type {Map<number, Trail>} */
  trails = new Map();
  /** The last arena states by their timestep.
   * @type {Map<number, ArenaMessage>} */
  images = new Map();
  /** The last signals by their timestep.
   * @type {Map<number, SignalsMessage>} */
  shows = new Map();
  /** The experiment's own numbers over time.
   * @type {Map<string, Series>} */
  measures = new Map();
  /** The largest size of each sensor's numbers.
   * @type {Map<string, number>} */
  peaks = new Map();
}

/** Holds everything; `changed` grows per topic, so that panels see what is new to them. */
export class Store extends RunNews {
  /** @type {ViewerMessage} */
  you = { viewer: "", control: true, viewers: 0 };
  /** @type {StoredEvent[]} */
  events = [];
  /** Those that are not shown yet.
   * @type {AnswerMessage[]} */
  answers = [];
  /** Answers to changes of the world, and whether the newest was a no. */
  settled = 0;
  refused = false;
  /** @type {Record<string, number>} */
  changed = {};
  /** When the run's state was last heard of [ms]. */
  runHeard = Infinity;
  #ahead_ms = Infinity;
  #timestep = -1;
  /** Of the run.
   * @type {number | null} */
  #number = null;
  #state = "";
  /** Who brought the run into its state.
   * @type {string | null} */
  pressed = null;

  /** Drops one experiment's news, as when another comes. */
  clear() {
    Object.assign(this, new RunNews());
  }

  /** What the wall's clock showed [ms] at a time of the host's: no message comes before it is made.
   * @param {number} timeNs */
  wall(timeNs) {
    return timeNs / 1e6 + this.#ahead_ms;
  }

  /** Takes one message.
   * @param {string} topic @param {number} timeNs @param {any} data @param {Uint8Array | null} blob */
  take(topic, timeNs, data, blob) {
    if (timeNs > 0) this.#ahead_ms = Math.min(this.#ahead_ms, Date.now() - timeNs / 1e6);
    const [, name, rest] = topic.split("/");
    if (blob) this.pictures.set(rest, { about: data, blob, number: (this.pictures.get(rest)?.number ?? 0) + 1 });
    else if (name === "event") this.#event(timeNs, data);
    else if (name === "answer") this.#answer(data);
    else if (name === "experiment") this.#experiment(data);
    else if (name === "readings") this.#readings(data);
    else if (name === "history") this.#history(data);
    else if (PLAIN.has(name)) Object.assign(this, { [name]: data });
    if (name === "run") this.#run(data);
    if (name === "arena") this.#arena(data);
    if (name === "robots") this.#robots(data);
    if (name === "signals") this.#signals(data);
    this.changed[name] = (this.changed[name] ?? 0) + 1;
  }

  /** Which part a robot plays, and its uid; nothing where nobody has said it.
   * @param {number} tag @returns {{ part?: number, uid?: string | null }} */
  part(tag) {
    const row = this.parts?.tag?.indexOf(tag) ?? -1;
    return !this.parts || row < 0 ? {} : { part: this.parts.part[row], uid: this.parts.uid[row] };
  }

  /** @param {RobotsMessage} data */
  #robots(data) {
    this.rows = new Map(data.tag.map((tag, row) => [tag, row]));
  }

  /** @param {ReadingsMessage} data */
  #readings(data) {
    for (const tag of data.tag ?? []) this.readings.set(tag, data);
  }

  /** @param {AnswerMessage} data */
  #answer(data) {
    if (data.change) {
      this.settled += 1;
      this.refused = !data.ok;
    }
    this.answers.push(data);
  }

  /** @param {RunMessage} data */
  #run(data) {
    // Another run begins without the numbers of the one before.
    if (this.#number !== null && this.#number !== data.run) {
      this.measures.clear();
      this.peaks.clear();
    }
    this.#number = data.run;
    if (data.state !== this.#state) this.pressed = data.by;
    this.#state = data.state;
    this.now = { timestep: data.timestep, time_s: data.time_s };
    this.runHeard = performance.now();
  }

  /** @param {ExperimentMessage} data */
  #experiment(data) {
    const before = this.experiment;
    // What came before the first one is of it, too.
    if (before && (before.name !== data.name || before.mode !== data.mode)) this.clear();
    const { robots = [], objects = [] } = data;
    Object.assign(this, { experiment: data });
    this.objects = new Set(objects.map((object) => object.tag));
    this.heights = new Map(robots.map((robot) => [robot.tag, robot.height_m]));
    this.radii = new Map([...robots, ...objects].map((body) => [body.tag, body.radius_m ?? data.body_radius_m]));
    this.names = new Map([...robots, ...objects].map(({ tag, name }) => [tag, name]));
  }

  /** @param {number} timeNs @param {EventMessage} data */
  #event(timeNs, data) {
    // Whoever comes anew is told the last events again.
    if (this.events.some((event) => event.timeNs === timeNs && event.text === data.text)) return;
    // Older recordings and other programs do not say when in the run it was.
    const fresh = this.experiment?.mode === "replay" || Date.now() - this.wall(timeNs) < OLD_MS;
    const heard = this.run && fresh && this.now.timestep >= 0 ? this.now.time_s : null;
    const run_s = data.time_s ?? (data.time_s === null && this.#state !== "ended" ? null : heard);
    if (this.events.push({ timeNs, run_s, ...data }) > MOST_EVENTS) this.events.shift();
  }

  /** @param {ArenaMessage} data */
  #arena(data) {
    const before = this.#timestep;
    this.now.timestep = data.run_timestep;
    this.#timestep = data.run_timestep;
    // Another run began, or a replay went to another place: the old trails lead nowhere.
    const leap = data.run_timestep - before;
    if (leap < 0 || (before < 0 && leap) || leap * (this.experiment?.timestep_s ?? 0.1) > TRAIL_S) {
      this.trails.clear();
      this.images.clear();
      this.shows.clear();
    }
    const { tag, x_m, y_m } = data.robots;
    const time_s = (data.run_timestep < 0 ? data.timestep : data.run_timestep) * (this.experiment?.timestep_s ?? 0.1);
    for (let row = 0; row < tag.length; row += 1) {
      if (!this.trails.has(tag[row])) this.trails.set(tag[row], new Trail());
      this.trails.get(tag[row])?.add(x_m[row], y_m[row], time_s);
    }
    this.images.set(data.timestep, data);
    dropOldest(this.images);
  }

  /** @param {SignalsMessage} data */
  #signals(data) {
    this.now.time_s = data.time_s;
    this.shows.set(data.timestep, data);
    dropOldest(this.shows);
    for (const [name, value] of Object.entries(data.measures ?? {})) this.addMeasure(name, data.time_s, value);
  }

  /** Adds a value of a measure of the run.
   * @param {string} name @param {number} time_s @param {number} value */
  addMeasure(name, time_s, value) {
    let line = this.measures.get(name);
    if (!line) this.measures.set(name, (line = new Series()));
    line.add(time_s, [value]);
  }

  /** The measures since the run began, as the host has kept them.
   * @param {HistoryMessage} data */
  #history(data) {
    if (this.run && data.run !== this.run.run) return;
    for (const name of Object.keys(data.measures)) {
      const line = this.measures.get(name) ?? new Series();
      line.load(data, name);
      this.measures.set(name, line);
    }
  }

  /** The `/signals` of a timestep, where that is still known, else the newest.
   * @param {number | undefined} timestep */
  signalsAt(timestep) {
    return (timestep === undefined ? undefined : this.shows.get(timestep)) ?? this.signals;
  }

  /** In the experiment's file. @param {number} tag */
  name = (tag) => this.names.get(tag) ?? String(tag);

  /** A robot's tag; a thing's name, to which ARGoS adds tag and number where it distributes it.
   * @param {number} tag */
  label(tag) {
    return this.objects.has(tag) ? this.name(tag).replace(`_${tag}_`, " ").replace(/ \d+$/, "") : String(tag);
  }

  /** A robot's row of `/robots`, or null.
   * @param {number} tag @returns {RobotRow | null} */
  robot(tag) {
    const row = this.rows.get(tag);
    if (row === undefined || !this.robots) return null;
    const values = Object.entries(this.robots).map(([name, column]) => [name, column[row]]);
    const made = Object.fromEntries(values);
    // Simulated robots have no daemons of their own that would report what they do.
    if (this.experiment?.mode === "sim") made.state = SIMULATED[this.run?.state ?? ""] ?? made.state;
    return /** @type {any} */ (made);
  }

  /** What drives a robot: its row of the experiment's controllers, or undefined.
   * @param {number} tag */
  controller(tag) {
    const all = this.experiment?.controllers ?? [];
    return all.find((controller) => controller.tags.includes(tag)) ?? all[0];
  }

  /** The virtual sensors of a robot.
   * @param {number} tag */
  sensors(tag) {
    return this.controller(tag)?.sensors ?? [];
  }

  /** The chosen robot's reading of each sensor; [] before the first.
   * @param {number} tag @returns {SensorReading[]} */
  sensed(tag) {
    const data = this.readings.get(tag);
    const row = data?.tag.indexOf(tag) ?? -1;
    if (!data || row < 0 || !this.experiment) return [];
    return this.sensors(tag).map((sensor, index) => {
      const captured = data.captured_ns[row][index];
      return { sensor, values: data.values[row][index], age_ns: captured < 0 ? null : data.capture_ns - captured };
    });
  }

  /** The largest size of a sensor's numbers so far: what its rays and bars are drawn against.
   * @param {string} name @param {(number | null)[]} values */
  peak(name, values) {
    let peak = this.peaks.get(name) ?? 1e-9;
    for (const value of values) peak = Math.max(peak, Math.abs(value ?? 0));
    this.peaks.set(name, peak);
    return peak;
  }
}

/** @param {Map<number, unknown>} messages by timestep. */
function dropOldest(messages) {
  for (const timestep of messages.keys()) {
    if (messages.size <= MOST_STEPS) return;
    messages.delete(timestep);
  }
}
