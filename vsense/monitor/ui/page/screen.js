// The page without controls: the arena as large as it can be, measures, clock; and for a projector the
// virtual world alone, drawn so that it falls onto the real floor.

import { Arena } from "./arena.js";
import { Connection } from "./connection.js";
import { byId, make, remember, remembered, write } from "./dom.js";
import { capital, clock, reading } from "./format.js";
import { homography, matrix3d } from "./homography.js";
import { ofSwarm } from "./series.js";
import { Store } from "./store.js";
import * as theme from "./theme.js";

const TELL_EVERY_MS = 250;
const STILL_MS = 3000;
const FIGURES = 5;
const WORDS = { none: "waiting for news", emergency: "EMERGENCY STOP" };

if (location.search) history.replaceState(null, "", location.pathname);

const store = new Store();
const connection = new Connection((...message) => store.take(...message), () => [{ refresh: !document.hidden }]);
const arena = new Arena(store, { tag: null, choose: () => {} });
const root = document.documentElement;
const canvas = arena.canvas;
let corners = readCorners();
let setting = false;
let moved = performance.now();

/** The corners where the arena is to be, in shares of the window: [[x, y] * 4], or null. */
function readCorners() {
  try {
    const read = JSON.parse(remembered("screen.corners", "null"));
    const right = Array.isArray(read) && read.length === 4 && read.flat().length === 8 && read.flat().every(Number.isFinite);
    return right ? read : null;
  } catch {
    return null;
  }
}

function keep(found) {
  corners = found;
  remember("screen.corners", JSON.stringify(found));
  arrange();
}

/** Where the arena's corners are drawn in the canvas [px of the page]. */
function drawn() {
  const { place } = arena;
  if (!place) return null;
  const [left, right] = [-1, 1].map((side) => place.x(place.centre[0] + (side * place.size[0]) / 2) / place.ratio);
  const [far, near] = [1, -1].map((side) => place.y(place.centre[1] + (side * place.size[1]) / 2) / place.ratio);
  return [[left, far], [right, far], [right, near], [left, near]];
}

function arrange() {
  const source = drawn();
  const shown = corners && source && projects();
  canvas.style.transform = "";
  const matrix = shown ? homography(source, corners.map(([x, y]) => [x * innerWidth, y * innerHeight])) : null;
  if (matrix) canvas.style.transform = matrix3d(matrix);
  byId("corners").hidden = !setting;
  const at = shown ? corners.map(([x, y]) => [x * innerWidth, y * innerHeight]) : source ?? [];
  at.forEach(([x, y], corner) => Object.assign(byId("corners").children[corner].style, { left: `${x}px`, top: `${y}px` }));
}

const projects = () => root.dataset.projector === "true";

function project(on) {
  root.dataset.projector = String(on);
  remember("screen.projector", on);
  setting &&= on;
  theme.refresh();
  arena.layers = { trails: !on, names: !on, fields: true, rays: false };
  arena.key = "";
}

function setCorners(on) {
  if (on && !projects()) project(true);
  setting = on;
  arena.key = "";
  // Without the words below there is more room.
  arena.draw();
  if (on && !corners) keep((drawn() ?? []).map(([x, y]) => [x / innerWidth, y / innerHeight]));
  arrange();
}

for (const handle of byId("corners").children) {
  const corner = Number(handle.dataset.corner);
  handle.addEventListener("pointerdown", (event) => handle.setPointerCapture(event.pointerId));
  handle.addEventListener("pointermove", (event) => {
    if (!handle.hasPointerCapture(event.pointerId)) return;
    keep(corners.map((now, at) => (at === corner ? [event.clientX / innerWidth, event.clientY / innerHeight] : now)));
  });
  handle.addEventListener("keydown", (event) => {
    const by = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    if (!by) return;
    event.preventDefault();
    keep(corners.map((now, at) => (at === corner ? [now[0] + by[0] / innerWidth, now[1] + by[1] / innerHeight] : now)));
  });
}

const KEYS = {
  p: () => project(!projects()),
  c: () => setCorners(!setting),
  r: () => keep(null),
  f: () => (document.fullscreenElement ? document.exitFullscreen() : root.requestFullscreen().catch(() => {})),
  t: theme.toggle,
};
window.addEventListener("keydown", (event) => {
  if (!event.ctrlKey && !event.metaKey && !event.altKey) KEYS[event.key.toLowerCase()]?.();
});
for (const name of ["pointermove", "pointerdown", "keydown"]) window.addEventListener(name, () => (moved = performance.now()));

function tell() {
  const { run, now, experiment } = store;
  const state = run?.replay ? "replay" : run?.state ?? "none";
  document.body.dataset.state = state;
  document.body.dataset.link = connection.open ? "open" : "lost";
  document.body.dataset.still = String(performance.now() - moved > STILL_MS && !setting);
  write(byId("name"), experiment?.name ?? "vsense");
  write(byId("state"), connection.open ? capital(WORDS[state] ?? state) : "No connection");
  write(byId("time"), run ? clock(now.time_s) : "–");
  write(byId("length"), run?.length_s ? ` / ${clock(run.length_s, 0)}` : "");
  const found = { ...ofSwarm(store) };
  for (const [name, line] of store.measures) found[name] = line.last?.[0] ?? null;
  const all = Object.entries(found).slice(0, FIGURES);
  const box = byId("figures");
  while (box.childElementCount > all.length) box.lastChild.remove();
  all.forEach(([name, value], at) => {
    const row = box.children[at] ?? box.appendChild(make("span", {}, make("i"), make("b")));
    write(row.children[0], name.replaceAll("_", " "));
    write(row.children[1], reading(value));
  });
}

let told = 0;
function frame() {
  requestAnimationFrame(frame);
  try {
    const before = arena.drawn.count;
    arena.draw();
    if (arena.drawn.count !== before) arrange();
    if (performance.now() - told < TELL_EVERY_MS) return;
    told = performance.now();
    tell();
  } catch (error) {
    console.error(error);
  }
}

// Its edge is laid onto the real one's.
arena.overlay = ({ pen, place }) => {
  if (!setting) return;
  const [width, height] = place.size;
  pen.strokeStyle = theme.colours.lamp;
  pen.lineWidth = 2 * place.ratio;
  pen.strokeRect(place.x(place.centre[0] - width / 2), place.y(place.centre[1] + height / 2), width * place.zoom, height * place.zoom);
};
project(remembered("screen.projector", "false") === "true");
window.addEventListener("resize", arrange);
document.addEventListener("visibilitychange", () => connection.say({ refresh: !document.hidden }));
// For tests, and for whoever wants to look behind the page: changes nothing.
window.vsense = { store, connection, arena, drawn };
requestAnimationFrame(frame);
