// The run in figures, and the page's head.

import { byId, make, mark, write } from "./dom.js";
import { bytes, capital, clock, rate, times } from "./format.js";
import { chartable } from "./series.js";

const DISK_LOW = 2e9;

/** Which run of a series by plan it is, or null. */
const planned = (experiment) => experiment?.made?.series ?? null;

// After a reset there may be more runs than were asked for; a plan knows its own.
function ofRuns({ run, runs }, experiment) {
  const series = planned(experiment);
  if (series) return `${series.number} of ${series.of}`;
  return runs && run <= runs ? `${run} of ${runs}` : `${run}`;
}

/** What a plan says of a run, in words. */
function ofPlan({ name, condition, start, repetition, attempt }) {
  const again = attempt > 1 ? `, attempt ${attempt}` : "";
  return `series ${name}: ${condition}, start ${start}, repetition ${repetition}${again}`;
}

// A simulation has no latencies.
const measured = (experiment) => experiment?.command !== "sim";

/** [name, what it shows: [figure, small print, "bad" | "warn" | ""], of which experiments] */
const TILES = [
  ["run", ({ run, experiment }) => [ofRuns(run, experiment), run.by ? `last: ${run.by}` : (planned(experiment)?.name ?? "")]],
  ["timestep", ({ now, experiment }) => [now.timestep < 0 ? "–" : String(now.timestep), experiment?.timestep_s ? `${Math.round(1000 * experiment.timestep_s)} ms each` : ""]],
  ["time", ({ run, now }) => [clock(now.time_s), run.length_s ? `of ${clock(run.length_s, 0)}` : "without end"]],
  ["rate", ({ run, experiment }) => {
    if (run.sim) return [run.state === "running" ? `${times(run.sim.reached)} ×` : "–", "of real time"];
    if (!measured(experiment)) return [rate(run.rate_hz), ""];
    // Who only tracks takes pictures as they come.
    const wanted = experiment?.timestep_s ? 1 / experiment.timestep_s : 0;
    const slow = run.state === "running" && run.rate_hz !== null && run.rate_hz < 0.9 * wanted;
    return [rate(run.rate_hz), run.late === null ? "" : `${run.late} late`, slow ? "warn" : ""];
  }],
  ["latency p50", ({ run }) => (run.latency_ms ? [`${run.latency_ms.p50.toFixed(0)} ms`, "median"] : ["–", "not measured"]), measured],
  ["latency p99", ({ run }) => {
    if (!run.latency_ms) return ["–", ""];
    return [`${run.latency_ms.p99.toFixed(0)} ms`, "worst 1 %", run.latency_ms.p99 > 100 ? "warn" : ""];
  }, measured],
  ["recording", ({ run }) => {
    const { on, file, bytes: size, lost_messages: gone, trouble } = run.recording ?? {};
    const small = trouble ?? [file, gone ? `${gone} lost` : ""].filter(Boolean).join(" · ");
    return [on ? bytes(size) : "off", small, trouble ? "bad" : gone ? "warn" : ""];
  }],
  ["disk left", ({ run }) => [bytes(run.disk_free_bytes), "", run.disk_free_bytes !== null && run.disk_free_bytes < DISK_LOW ? "warn" : ""]],
];
/** Tiles whose number can be shown over time. */
const CHARTS = {
  rate: ["Hz", (run) => run.rate_hz],
  "latency p50": ["ms", (run) => run.latency_ms?.p50],
  "latency p99": ["ms", (run) => run.latency_ms?.p99],
  recording: ["MB", (run) => (run.recording?.on ? run.recording.bytes / 1e6 : null)],
  "disk left": ["GB", (run) => (typeof run.disk_free_bytes === "number" ? run.disk_free_bytes / 1e9 : null)],
};
const WORDS = { none: "waiting for news", ended: "ended", emergency: "EMERGENCY STOP" };

/** Header and tiles. */
export class Tiles {
  constructor(store, connection) {
    this.store = store;
    this.connection = connection;
    this.tiles = TILES.map(([name]) => {
      const parts = [make("span", {}, name), make("b", {}, "–"), make("small")];
      const element = make("div", { className: "tile" }, ...parts);
      const [unit, now] = CHARTS[name] ?? [];
      if (now) chartable(element, { key: `run/${name}`, label: name, unit, now: (from) => (from.run ? [now(from.run)] : null) });
      return { parts, element };
    });
    byId("tiles").append(...this.tiles.map((tile) => tile.element));
  }

  /** Renews the figures; called a few times per second. */
  tell() {
    this.#head();
    if (!this.store.run) return;
    TILES.forEach(([, show, has], index) => {
      const { parts, element } = this.tiles[index];
      element.hidden = has ? !has(this.store.experiment) : false;
      const [figure, small, level = ""] = show(this.store);
      write(parts[1], figure);
      write(parts[2], small);
      if (parts[2].title !== small) parts[2].title = small;
      mark(element, "bad", level === "bad");
      mark(element, "warn", level === "warn");
    });
  }

  #head() {
    const { run, now, experiment, you } = this.store;
    const replay = experiment?.mode === "replay";
    const state = replay && run?.replay ? (run.replay.playing ? "running" : "paused") : run?.state ?? "none";
    const { dataset } = document.body;
    dataset.state = state;
    dataset.mode = experiment?.mode ?? "none";
    dataset.command = experiment?.command ?? "none";
    dataset.link = this.connection.open ? "open" : "lost";
    const shown = replay ? (run?.replay?.playing ? "replay" : "replay, paused") : WORDS[state] ?? state;
    write(byId("state"), this.connection.open ? capital(shown) : "No connection");
    byId("no_pictures").hidden = !(replay && run?.replay?.pictures === false);
    write(byId("name"), experiment ? experiment.name : "no run yet");
    document.title = experiment ? `${experiment.name}: ${state} – vsense` : "vsense";
    write(byId("what"), experiment ? this.#what(experiment, run) : "");
    write(byId("time"), run ? clock(now.time_s) : "–");
    write(byId("length"), run?.length_s ? ` / ${clock(run.length_s, 0)}` : "");
    const share = run?.length_s ? Math.min(now.time_s / run.length_s, 1) : 0;
    document.querySelector("#progress i").style.transform = `scaleX(${share.toFixed(4)})`;
    write(byId("viewers"), you.viewer ? `${you.viewer.split(" (")[0]} of ${you.viewers} watching` : "");
    byId("viewers").title = you.viewer;
  }

  #what(experiment, run) {
    const parts = [];
    const series = planned(experiment);
    if (run) parts.push(`run ${ofRuns(run, experiment)}`);
    if (series) parts.push(ofPlan(series));
    parts.push(`${experiment.robots.length} robots`);
    if (experiment.seed !== null) parts.push(`seed ${experiment.seed}`);
    if (experiment.blind) parts.push("blind");
    if (experiment.user) parts.push(`${experiment.user}’s`);
    return parts.join(" · ");
  }
}
