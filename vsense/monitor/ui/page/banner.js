// Trouble in words, large enough for the other end of the room.

import { stateWords } from "./cameras.js";
import { byId, inside, make, write } from "./dom.js";
import { bytes, capital, clock, count } from "./format.js";

const SILENT_S = 1;
const SILENT_RUN_MS = 4000;
const UNANSWERED_MS = 700;
const DISK_LOW_BYTES = 2e9;
const LISTED = 3;
const OWN_BANNERS = 3;

/** `own`: it has a banner of its own.
 * @typedef {{ level: "lost" | "danger" | "trouble" | "warning" | "info", text: string, more: string,
 *   own?: boolean }} Trouble */

/** What is wrong, the worst first.
 * @param {Store} store @param {Connection} connection @returns {Trouble[]} */
export function troubles(store, connection) {
  if (!connection.open) return [ofConnection(connection)];
  return [
    ...ofEmergency(store, connection), ...ofRun(store), ...ofRobots(store.robots), ...ofCameras(store.cameras),
    ...ofDisk(store.run), ...ofAccess(store.run), ...ofNext(store),
  ];
}

/** What red stands for.
 * @param {string} text @param {string} more @returns {Trouble} */
const danger = (text, more) => ({ level: "danger", text, more });
/** @param {string} text @param {string} more @returns {Trouble} */
const trouble = (text, more) => ({ level: "trouble", text, more });
/** @param {string} text @param {string} more @returns {Trouble} */
const warning = (text, more) => ({ level: "warning", text, more });

/** @param {Connection} connection @returns {Trouble} */
function ofConnection(connection) {
  const seconds = Math.round((performance.now() - connection.since) / 1000);
  const text = connection.emergency !== null ? "EMERGENCY STOP NOT DELIVERED" : "Connection lost";
  const more = `trying again since ${seconds} s; the run goes on without this page, what is shown is old`;
  return { level: "lost", text, more };
}

/** Who pressed, when, and the way out.
 * @param {Store} store @param {Connection} connection */
function ofEmergency({ run, pressed }, connection) {
  const rows = [];
  if (connection.emergency !== null && performance.now() - connection.emergency > UNANSWERED_MS) {
    const why = connection.refusal && `refused: ${connection.refusal} · it is sent again every second`;
    rows.push(danger("EMERGENCY STOP NOT CONFIRMED", why || "vsense has not answered yet"));
  }
  if (run?.state === "emergency") {
    const when = run.timestep < 0 ? `before run ${run.run}` : `at ${clock(run.time_s)} of run ${run.run}`;
    const words = `pressed by ${pressed ?? "somebody"} ${when} · all robots must stand · `;
    rows.push(danger("EMERGENCY STOP", `${words}Reset (Shift+R) prepares the next run, which waits for Start`));
  }
  return rows;
}

/** @param {Store} store @returns {Trouble[]} */
function ofRun({ run, experiment, runHeard }) {
  /** @type {Trouble[]} */
  const rows = (run?.alarms ?? []).map(({ kind, text, cause }) =>
    ({ ...(kind === "overload" ? trouble : danger)(capital(text), cause), own: true }));
  if (experiment && performance.now() - runHeard > SILENT_RUN_MS) {
    rows.push(trouble("No news from the run", "vsense is there, but reports nothing of the experiment"));
  }
  // An emergency has a banner of its own, which says what to do.
  if (run?.why && run.state !== "emergency") rows.push(trouble(`Run ${run.run} is invalid`, run.why));
  // Where a recording ends nobody looked any more.
  const looked = run && (!run.replay || run.state === "running");
  if (looked && run.silent_s !== null && run.silent_s >= SILENT_S) {
    rows.push(trouble(`Nothing seen for ${run.silent_s.toFixed(0)} s`, "no camera gives an arena state"));
  }
  return rows;
}

/** @param {RobotsMessage | null} robots */
function ofRobots(robots) {
  if (!robots) return [];
  const rows = robots.trouble.map((text, row) => ({ name: `robot ${robots.tag[row]}`, text }));
  const bad = rows.filter(({ text }) => text).map(({ name, text }) => `${name}: ${text}`);
  if (!bad.length) return [];
  if (bad.length === 1) return [trouble(capital(bad[0]), "")];
  const words = bad.slice(0, LISTED);
  if (bad.length > LISTED) words.push(`and ${bad.length - LISTED} more`);
  return [trouble(`${count(bad.length, "robot")} in trouble`, words.join(" · "))];
}

/** @param {CamerasMessage | null} cameras */
function ofCameras(cameras) {
  const bad = (cameras?.cameras ?? []).filter((camera) => camera.state !== "ok");
  return bad.map((camera) => trouble(`Camera ${camera.id} ${stateWords(camera.state)}`, camera.text ?? ""));
}

/** @param {RunMessage | null} run */
function ofDisk(run) {
  const rows = [];
  if (run?.recording?.trouble) rows.push(trouble("Recording in trouble", run.recording.trouble));
  const free = run?.disk_free_bytes;
  if (typeof free === "number" && free < DISK_LOW_BYTES) {
    rows.push(warning(`Disk nearly full: ${bytes(free)} left`, ""));
  }
  return rows;
}

/** @param {RunMessage | null} run */
function ofAccess(run) {
  const rows = [];
  if (run?.doubts?.length) rows.push(warning("Not authenticated", run.doubts.join(" · ")));
  const isWaiting = run && !run.replay && (run.state === "waiting" || run.state.startsWith("homing"));
  if (isWaiting) rows.push(warning(capital(run.text), ""));
  return rows;
}

/** After a reset: which run waits, and where its robots are.
 * @param {Store} store @returns {Trouble[]} */
function ofNext({ run, experiment }) {
  const isNext = run && run.run > 1 && run.timestep < 0 && !run.replay;
  if (!isNext || !run.can.includes("start") || run.state === "ended") return [];
  const where = experiment?.homes ? "the robots drive to their starts first" : "the robots stay where they stand";
  const more = experiment?.mode === "sim" ? "the robots stand at their starts" : where;
  const text = `Run ${run.run} waits for Start (Space)`;
  return [{ level: "info", text, more: `seed ${experiment?.seed} · ${more}` }];
}

/** The banners: one for what has its own, and one for all the rest.
 * @param {Trouble[]} rows */
export function showBanner(rows) {
  const own = rows.filter((row) => row.own);
  const [first, ...rest] = rows.filter((row) => !row.own);
  const box = byId("alarms");
  while (box.childElementCount > Math.min(own.length, OWN_BANNERS)) box.lastElementChild?.remove();
  own.slice(0, OWN_BANNERS).forEach((alarm, at) => {
    if (at === box.childElementCount) {
      box.append(make("section", { className: "banner" }, make("strong"), make("span")));
    }
    const hidden = at === OWN_BANNERS - 1 ? own.length - OWN_BANNERS : 0;
    fill(box.children[at], alarm.level, alarm.text, alarm.more + (hidden > 0 ? ` · and ${hidden} more` : ""));
  });
  const banner = byId("banner");
  banner.hidden = !first;
  const more = [first?.more, ...rest.map((row) => row.text)].filter(Boolean).join(" · ");
  if (first) fill(banner, first.level, first.text, more);
}

/** @param {Element} banner @param {string} level @param {string} text @param {string} more */
function fill(banner, level, text, more) {
  banner.setAttribute("data-level", level);
  write(inside(banner, "strong"), text);
  write(inside(banner, "span"), more);
}
