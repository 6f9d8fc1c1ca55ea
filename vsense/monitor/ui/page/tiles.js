// The run in figures, and the page's head.

import { byId, inside, make, mark, write } from "./dom.js";
import { bytes, capital, clock, count, rate, times } from "./format.js";
import { chartable } from "./series.js";

const DISK_LOW_BYTES = 2e9;
const SLOW = 0.9;
const LATE_MS = 100;
/** @type {Record<string, string>} */
const WORDS = { none: "waiting for news", ended: "ended", emergency: "EMERGENCY STOP" };

/** What a tile shows: figure, small print, and how bad that is.
 * @typedef {[figure: string, small: string, level?: "bad" | "warn" | ""]} Figure */
/**
 * @typedef {object} Tile
 * @property {string} name
 * @property {(run: RunMessage, store: Store) => Figure} show
 * @property {(experiment: ExperimentMessage | null) => boolean} [has] whether it is shown; always, where there is none.
 * @property {string} [unit] of what can be shown over time.
 * @property {(run: RunMessage) => number | null | undefined} [value] what can be shown over time. */

/** Which run of a series by plan it is, or null.
 * @param {ExperimentMessage | null} experiment */
const planned = (experiment) => experiment?.made?.series ?? null;

/** After a reset there may be more runs than were asked for; a plan knows its own.
 * @param {RunMessage} run @param {ExperimentMessage | null} experiment */
function ofRuns({ run, runs }, experiment) {
  const series = planned(experiment);
  if (series) return `${series.number} of ${series.of}`;
  return runs && run <= runs ? `${run} of ${runs}` : `${run}`;
}

/** What a plan says of a run, in words.
 * @param {PlannedRun} run */
function ofPlan({ name, condition, start, repetition, attempt }) {
  const again = attempt > 1 ? `, attempt ${attempt}` : "";
  return `series ${name}: ${condition}, start ${start}, repetition ${repetition}${again}`;
}

/** A simulation has no latencies.
 * @param {ExperimentMessage | null} experiment */
const hasLatency = (experiment) => experiment?.command !== "sim";

/** What is played was written then, and on another disk.
 * @param {ExperimentMessage | null} experiment */
const isLive = (experiment) => experiment?.mode !== "replay";

/** @param {RunMessage} run @param {Store} store @returns {Figure} */
function showRate(run, { experiment }) {
  if (run.sim) return [run.state === "running" ? `${times(run.sim.reached)} ×` : "–", "of real time"];
  if (!hasLatency(experiment)) return [rate(run.rate_hz), ""];
  // Who only tracks takes pictures as they come.
  const wanted = experiment?.timestep_s ? 1 / experiment.timestep_s : 0;
  const isSlow = run.state === "running" && run.rate_hz !== null && run.rate_hz < SLOW * wanted;
  return [rate(run.rate_hz), typeof run.late === "number" ? `${run.late} late` : "", isSlow ? "warn" : ""];
}

/** @param {RunMessage} run @returns {Figure} */
function showRecording({ recording }) {
  if (!recording) return ["off", ""];
  const lost = recording.lost_messages ? `${recording.lost_messages} lost` : "";
  const small = recording.trouble ?? [recording.file, lost].filter(Boolean).join(" · ");
  const level = recording.trouble ? "bad" : lost && "warn";
  return [recording.on ? bytes(recording.bytes) : "off", small, level];
}

/** @type {Tile[]} */
const TILES = [
  { name: "rate", show: showRate, unit: "Hz", value: (run) => run.rate_hz },
  {
    name: "latency p50",
    show: ({ latency_ms: latency }) => (latency ? [`${latency.p50.toFixed(0)} ms`, "median"] : ["–", "not measured"]),
    has: hasLatency, unit: "ms", value: (run) => run.latency_ms?.p50,
  },
  {
    name: "latency p99",
    show: ({ latency_ms: latency }) =>
      latency ? [`${latency.p99.toFixed(0)} ms`, "worst 1 %", latency.p99 > LATE_MS ? "warn" : ""] : ["–", ""],
    has: hasLatency, unit: "ms", value: (run) => run.latency_ms?.p99,
  },
  {
    name: "recording", show: showRecording, has: isLive,
    unit: "MB", value: (run) => (run.recording?.on ? run.recording.bytes / 1e6 : null),
  },
  {
    name: "disk left",
    show: ({ disk_free_bytes: free }) => [bytes(free), "", (free ?? Infinity) < DISK_LOW_BYTES ? "warn" : ""],
    has: isLive, unit: "GB",
    value: (run) => (typeof run.disk_free_bytes === "number" ? run.disk_free_bytes / 1e9 : null),
  },
];

/** Header and tiles. */
export class Tiles {
  /** @param {Store} store @param {Connection} connection */
  constructor(store, connection) {
    this.store = store;
    this.connection = connection;
    this.elements = TILES.map(({ name, unit, value }) => {
      const [figure, small] = [make("b", {}, "–"), make("small")];
      const tile = make("div", { className: "tile" }, make("span", {}, name), figure, small);
      if (value) {
        const now = (/** @type {Store} */ { run }) => (run ? [value(run)] : null);
        chartable(tile, { key: `run/${name}`, label: name, unit, now });
      }
      return { tile, figure, small };
    });
    byId("tiles").append(...this.elements.map(({ tile }) => tile));
  }

  /** Renews the figures; called a few times per second. */
  render() {
    this.#renderHead();
    const { run } = this.store;
    if (!run) return;
    TILES.forEach(({ show, has }, index) => {
      const { tile, figure, small } = this.elements[index];
      tile.hidden = has ? !has(this.store.experiment) : false;
      const [text, smallText, level = ""] = show(run, this.store);
      write(figure, text);
      write(small, smallText);
      if (small.title !== smallText) small.title = smallText;
      mark(tile, "bad", level === "bad");
      mark(tile, "warn", level === "warn");
    });
  }

  #renderHead() {
    const { run, now, experiment, you } = this.store;
    const isReplay = experiment?.mode === "replay";
    const replayState = run?.replay?.playing ? "running" : "paused";
    const state = isReplay && run?.replay ? replayState : run?.state ?? "none";
    Object.assign(document.body.dataset, {
      state,
      mode: experiment?.mode ?? "none",
      command: experiment?.command ?? "none",
      link: this.connection.open ? "open" : "lost",
    });
    const replayWords = run?.replay?.playing ? "replay" : "replay, paused";
    const judged = run?.verdict ? `, ${run.why ? "invalid" : run.verdict}` : "";
    const words = (isReplay ? replayWords : WORDS[state] ?? state) + judged;
    write(byId("state"), this.connection.open ? capital(words) : "No connection");
    write(byId("name"), experiment ? experiment.name : "no run yet");
    document.title = experiment ? `${experiment.name}: ${state} – vsense` : "vsense";
    write(byId("what"), experiment ? describe(experiment, run) : "");
    write(byId("time"), run ? clock(now.time_s) : "–");
    write(byId("length"), run?.length_s ? ` / ${clock(run.length_s, 0)}` : "");
    const share = run?.length_s ? Math.min((now.time_s ?? 0) / run.length_s, 1) : 0;
    inside(byId("progress"), "i").style.transform = `scaleX(${share.toFixed(4)})`;
    write(byId("viewers"), you.viewer ? count(you.viewers, "page") + " open" : "");
    byId("viewers").title = `this is ${you.viewer}`;
    byId("time").title = now.timestep < 0 ? "" : `timestep ${now.timestep}`;
  }
}

/** @param {ExperimentMessage} experiment @param {RunMessage | null} run */
function describe(experiment, run) {
  const parts = [];
  const series = planned(experiment);
  if (run) parts.push(`run ${ofRuns(run, experiment)}`);
  if (series) parts.push(ofPlan(series));
  parts.push(`${experiment.robots.length} robots`);
  if (experiment.seed !== null) parts.push(`seed ${experiment.seed}`);
  if (experiment.blind) parts.push("without virtual sensors");
  if (experiment.user) parts.push(`${experiment.user}’s`);
  return parts.join(" · ");
}
