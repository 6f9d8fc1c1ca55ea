// The page without controls: the arena as large as it can be, measures, clock; and for a projector the
// virtual world alone, drawn so that it falls onto the real floor.

import { Arena } from "./arena.js";
import { Connection } from "./connection.js";
import { byId, elements, make, remember, remembered, write } from "./dom.js";
import { capital, clock, labelOf, reading } from "./format.js";
import { homography, matrix3d } from "./homography.js";
import { FromAbove } from "./projections.js";
import { Store } from "./store.js";
import * as theme from "./theme.js";

const RENDER_EVERY_MS = 250;
const STILL_MS = 3000;
const FIGURES = 5;
/** @type {Record<string, Point>} */
const STEPS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
/** @type {Record<string, string>} */
const WORDS = { none: "waiting for news", emergency: "EMERGENCY STOP" };

if (location.search) history.replaceState(null, "", location.pathname);

const store = new Store();
const connection = new Connection(
  (topic, timeNs, data, blob) => store.take(topic, timeNs, data, blob),
  () => [{ refresh: !document.hidden }],
);
const arena = new Arena(store, { tag: null, choose: () => {} });
const root = document.documentElement;
const canvas = arena.canvas;
const handles = elements("[data-corner]");
/** Where the arena's corners are to be, in shares of the window: clockwise from the left, far one. */
let corners = readCorners();
let isSetting = false;
let moved = performance.now();

/** @returns {Point[] | null} */
function readCorners() {
  try {
    const read = JSON.parse(remembered("screen.corners", "null"));
    const isWhole = Array.isArray(read) && read.length === 4 && read.flat().length === 8;
    return isWhole && read.flat().every(Number.isFinite) ? read : null;
  } catch {
    return null;
  }
}

/** @param {Point[] | null} wanted */
function setCorners(wanted) {
  corners = wanted;
  remember("screen.corners", JSON.stringify(wanted));
  arrange();
}

/** Where the arena's corners are drawn in the canvas [px of the page].
 * @returns {Point[] | null} */
function drawnCorners() {
  const { view } = arena;
  if (!view) return null;
  const [left, far, width, height] = view.edges.map((side) => side / view.ratio);
  return [[left, far], [left + width, far], [left + width, far + height], [left, far + height]];
}

function arrange() {
  const source = drawnCorners();
  const target = projects() && corners ? corners.map(([x, y]) => [x * innerWidth, y * innerHeight]) : null;
  const matrix = source && target ? homography(source, target) : null;
  canvas.style.transform = matrix ? matrix3d(matrix) : "";
  byId("corners").hidden = !isSetting;
  const places = source ? target ?? source : [];
  places.forEach(([x, y], corner) => Object.assign(handles[corner].style, { left: `${x}px`, top: `${y}px` }));
}

const projects = () => root.dataset.projector === "true";

/** @param {boolean} on */
function project(on) {
  root.dataset.projector = String(on);
  remember("screen.projector", on);
  isSetting &&= on;
  theme.refresh();
  arena.layers = { trails: !on, names: !on, fields: true, rays: false, scale: !on };
  arena.key = "";
}

/** @param {boolean} on */
function showHandles(on) {
  if (on && !projects()) project(true);
  isSetting = on;
  arena.key = "";
  // Without the words below there is more room.
  arena.draw();
  const drawn = drawnCorners();
  if (on && !corners && drawn) setCorners(drawn.map(([x, y]) => [x / innerWidth, y / innerHeight]));
  arrange();
}

/** @param {number} corner @param {(place: Point) => Point} move */
function moveCorner(corner, move) {
  if (corners) setCorners(corners.map((place, at) => (at === corner ? move(place) : place)));
}

handles.forEach((handle, corner) => {
  handle.addEventListener("pointerdown", (event) => handle.setPointerCapture(event.pointerId));
  handle.addEventListener("pointermove", (event) => {
    if (!handle.hasPointerCapture(event.pointerId)) return;
    moveCorner(corner, () => [event.clientX / innerWidth, event.clientY / innerHeight]);
  });
  handle.addEventListener("keydown", (event) => {
    const step = STEPS[event.key];
    if (!step) return;
    event.preventDefault();
    moveCorner(corner, ([x, y]) => [x + step[0] / innerWidth, y + step[1] / innerHeight]);
  });
});

/** @type {Record<string, () => unknown>} */
const KEYS = {
  p: () => project(!projects()),
  c: () => showHandles(!isSetting),
  r: () => setCorners(null),
  f: () => (document.fullscreenElement ? document.exitFullscreen() : root.requestFullscreen().catch(() => {})),
  t: theme.toggle,
};
window.addEventListener("keydown", (event) => {
  if (!event.ctrlKey && !event.metaKey && !event.altKey) KEYS[event.key.toLowerCase()]?.();
});
for (const name of ["pointermove", "pointerdown", "keydown"]) {
  window.addEventListener(name, () => {
    moved = performance.now();
  });
}

function render() {
  const { run, now, experiment } = store;
  const state = run?.replay ? "replay" : run?.state ?? "none";
  document.body.dataset.state = state;
  document.body.dataset.link = connection.open ? "open" : "lost";
  document.body.dataset.still = String(performance.now() - moved > STILL_MS && !isSetting);
  write(byId("name"), experiment?.name ?? "vsense");
  write(byId("state"), connection.open ? capital(WORDS[state] ?? state) : "No connection");
  write(byId("time"), run ? clock(now.time_s) : "–");
  write(byId("length"), run?.length_s ? ` / ${clock(run.length_s, 0)}` : "");
  renderFigures();
}

function renderFigures() {
  const rows = [...store.measures].slice(0, FIGURES);
  const box = byId("figures");
  while (box.childElementCount > rows.length) box.lastElementChild?.remove();
  rows.forEach(([name, series], at) => {
    const value = series.at(store.now.time_s ?? Infinity)?.[0] ?? null;
    if (at === box.childElementCount) box.append(make("span", {}, make("i"), make("b")));
    const row = box.children[at];
    const { label, unit } = labelOf(name);
    write(row.children[0], label);
    write(row.children[1], unit ? `${reading(value)} ${unit}` : reading(value));
  });
}

let rendered = 0;
function frame() {
  requestAnimationFrame(frame);
  try {
    const before = arena.drawn.count;
    arena.draw();
    if (arena.drawn.count !== before) arrange();
    if (performance.now() - rendered < RENDER_EVERY_MS) return;
    rendered = performance.now();
    render();
  } catch (error) {
    console.error(error);
  }
}

// Its edge is laid onto the real one's.
arena.attach({
  draw: ({ pen, view }) => {
    if (!isSetting || !(view instanceof FromAbove)) return;
    pen.strokeStyle = theme.colours.lamp;
    pen.lineWidth = 2 * view.ratio;
    pen.strokeRect(...view.edges);
  },
  takesClicks: () => false,
});
project(remembered("screen.projector", "false") === "true");
window.addEventListener("resize", arrange);
document.addEventListener("visibilitychange", () => connection.say({ refresh: !document.hidden }));
// For tests, and for whoever wants to look behind the page: changes nothing.
window.vsense = { store, connection, arena, drawnCorners };
requestAnimationFrame(frame);
