// Trouble in words, large enough for the other end of the room.

import { byId, make, write } from "./dom.js";
import { bytes, capital, count } from "./format.js";
import { stateWords } from "./cameras.js";

const SILENT_S = 1;
const SILENT_RUN_MS = 4000;
const UNANSWERED_MS = 700;
const DISK_LOW = 2e9;
const LISTED = 3;
const OWN = 3;

/** What is wrong, the worst first: [{level, text, more}]. */
export function troubles(store, connection) {
  const found = [];
  const { run, robots, cameras, experiment } = store;
  if (!connection.open) return [lost(connection)];
  if (connection.emergency !== null && performance.now() - connection.emergency > UNANSWERED_MS) {
    found.push({ level: "trouble", text: "EMERGENCY STOP NOT CONFIRMED", more: "vsense has not answered yet" });
  }
  if (run?.state === "emergency") {
    found.push({ level: "trouble", text: "EMERGENCY STOP", more: [run.by && `pressed by ${run.by}`, run.text].filter(Boolean).join(" · ") });
  }
  for (const alarm of run?.alarms ?? []) found.push({ level: "trouble", text: capital(alarm.text), more: alarm.cause, own: true });
  if (experiment && performance.now() - store.runHeard > SILENT_RUN_MS) {
    found.push({ level: "trouble", text: "No news from the run", more: "vsense is there, but tells nothing of the experiment" });
  }
  if (run?.silent_s >= SILENT_S) {
    found.push({ level: "trouble", text: `Nothing seen for ${run.silent_s.toFixed(0)} s`, more: "no camera gives an arena state" });
  }
  found.push(...ofRobots(robots), ...ofCameras(cameras), ...ofDisk(run));
  if (run?.doubts?.length) {
    found.push({ level: "warning", text: "Not authenticated", more: run.doubts.join(" · ") });
  }
  if (run?.state === "waiting" || run?.state.startsWith("homing")) found.push({ level: "warning", text: capital(run.text), more: "" });
  return found;
}

function lost(connection) {
  const seconds = Math.round((performance.now() - connection.since) / 1000);
  const text = connection.emergency !== null ? "EMERGENCY STOP NOT DELIVERED" : "Connection lost";
  return { level: "lost", text, more: `trying again since ${seconds} s; the run goes on without this page, what is shown is old` };
}

function ofRobots(robots) {
  const bad = (robots?.trouble ?? []).map((text, row) => [robots.name[row] ?? robots.tag[row], text]).filter(([, text]) => text);
  if (!bad.length) return [];
  const words = bad.slice(0, LISTED).map(([name, text]) => `${name}: ${text}`);
  if (bad.length > LISTED) words.push(`and ${bad.length - LISTED} more`);
  if (bad.length === 1) return [{ level: "trouble", text: words[0], more: "" }];
  return [{ level: "trouble", text: `${count(bad.length, "robot")} in trouble`, more: words.join(" · ") }];
}

function ofCameras(cameras) {
  return (cameras?.cameras ?? [])
    .filter((camera) => camera.state !== "ok")
    .map((camera) => ({ level: "trouble", text: `Camera ${camera.id} ${stateWords(camera.state)}`, more: camera.text ?? "" }));
}

function ofDisk(run) {
  const found = [];
  if (run?.recording?.trouble) found.push({ level: "trouble", text: "Recording in trouble", more: run.recording.trouble });
  const free = run?.disk_free_bytes;
  if (typeof free === "number" && free < DISK_LOW) {
    found.push({ level: "warning", text: `Disk nearly full: ${bytes(free)} left`, more: "" });
  }
  return found;
}

/** The banners: one for what has its own, and one for all the rest. */
export function showBanner(found) {
  const own = found.filter((one) => one.own);
  const [first, ...others] = found.filter((one) => !one.own);
  const box = byId("alarms");
  while (box.childElementCount > Math.min(own.length, OWN)) box.lastChild.remove();
  own.slice(0, OWN).forEach((alarm, at) => {
    const banner = box.children[at] ?? box.appendChild(make("section", { className: "banner" }, make("strong"), make("span")));
    const more = at === OWN - 1 && own.length > OWN ? ` · and ${own.length - OWN} more` : "";
    fill(banner, alarm.level, alarm.text, alarm.more + more);
  });
  const banner = byId("banner");
  banner.hidden = !first;
  if (first) fill(banner, first.level, first.text, [first.more, ...others.map((one) => one.text)].filter(Boolean).join(" · "));
}

function fill(banner, level, text, more) {
  banner.dataset.level = level;
  write(banner.querySelector("strong"), text);
  write(banner.querySelector("span"), more);
}
