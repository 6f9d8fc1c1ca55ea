// Corners of the arena, dragged onto cameras' pictures. What they mean is computed by the server.

/** @typedef {{ camera: string, point: string, x: number, y: number }} Click */
/** A camera of the page, its image once that has come, and its button with a small picture.
 * @typedef {{ id: string, width_px: number, height_px: number }} Description
 * @typedef {{ image: HTMLImageElement | null, thumb: HTMLCanvasElement, tab: HTMLButtonElement }} Elements
 * @typedef {Description & Elements} Camera */
/** What the clicks mean: `left` of each, and how the frame moves.
 * @typedef {object} Solution
 * @property {{ point: string, camera: string, off_mm: number[] }[]} clicks
 * @property {{ x_mm: number, y_mm: number, yaw_deg: number }} shift
 * @property {number} rms_mm */
/** What is drawn by camera, as pixels: where points are expected, and the arena's outline.
 * @typedef {{ expected: Record<string, (Point | null)[]>, outline: Record<string, Point[][]>,
 *   found: Solution | null }} Drawing */

/** @template {string} Id @param {Id} id @returns {ElementOf<Id>} */
const byId = (id) => /** @type {any} */ (document.getElementById(id));
/** @param {HTMLCanvasElement} canvas @returns {Pen} */
const penOf = (canvas) => /** @type {any} */ (canvas.getContext("2d"));
const GRAB_PX = 18;
const FAR_MM = 10;
const FINE_PX = 0.2;
const COARSE_PX = 5;
/** @type {Record<string, Point>} */
const STEPS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

const canvas = byId("picture");
const pen = penOf(canvas);
/** @type {Camera[]} */
let cameras = [];
/** Names of the points that can be placed. @type {string[]} */
let points = [];
/** @type {Drawing} */
let drawing = { expected: {}, outline: {}, found: null };
let shown = 0;
/** @type {string | null} */
let chosen = null;
let dragged = false;
// A corner that was chosen in the list is put wherever the picture is pressed next.
let armed = false;
let asked = 0;
let saved = false;
/** By camera and point.
 * @type {Map<string, Click>} */
const clicks = new Map();

/** @param {string} id @param {string} point */
const keyOf = (id, point) => `${id} ${point}`;
const camera = () => cameras[shown];

/** @param {string} text */
function showTrouble(text) {
  byId("trouble").textContent = text;
  byId("trouble").hidden = !text;
}

/** @param {string} path @param {unknown} [body] */
async function ask(path, body) {
  const answer = await fetch(path, body ? { method: "POST", body: JSON.stringify(body) } : {});
  const data = await answer.json();
  if (!answer.ok) throw new Error(data.error ?? answer.statusText);
  return data;
}

/** Where a corner is in a picture: clicked, or else where the calibration has it.
 * @param {string} id @param {number} index @returns {Point | null} */
function placeOf(id, index) {
  const click = clicks.get(keyOf(id, points[index]));
  return click ? [click.x, click.y] : drawing.expected[id]?.[index] ?? null;
}

/** @param {Pen} brush @param {string} id @param {number} zoom @param {number} width */
function drawOutline(brush, id, zoom, width) {
  brush.strokeStyle = "#37d0ff";
  brush.lineWidth = width;
  for (const line of drawing.outline[id] ?? []) {
    brush.beginPath();
    line.forEach(([x, y], at) => (at ? brush.lineTo(x * zoom, y * zoom) : brush.moveTo(x * zoom, y * zoom)));
    brush.stroke();
  }
}

function paint() {
  const { id, image, width_px, height_px } = camera() ?? {};
  if (!image) return;
  const ratio = window.devicePixelRatio || 1;
  canvas.width = Math.round(canvas.clientWidth * ratio);
  canvas.height = Math.round((canvas.width * height_px) / width_px);
  const zoom = canvas.width / width_px;
  pen.drawImage(image, 0, 0, canvas.width, canvas.height);
  drawOutline(pen, id, zoom, 1.5 * ratio);
  pen.font = `600 ${14 * ratio}px system-ui, sans-serif`;
  points.forEach((point, index) => {
    const at = placeOf(id, index);
    if (at) drawPoint(point, at[0] * zoom, at[1] * zoom, ratio);
  });
  cameras.forEach(paintThumb);
}

/** @param {string} point @param {number} x @param {number} y @param {number} ratio */
function drawPoint(point, x, y, ratio) {
  const isSet = clicks.has(keyOf(camera().id, point));
  const size = 11 * ratio;
  pen.strokeStyle = isSet ? "#ffd43b" : "#fffc";
  pen.setLineDash(isSet ? [] : [4 * ratio, 4 * ratio]);
  pen.lineWidth = (point === chosen ? 3 : 2) * ratio;
  pen.beginPath();
  pen.arc(x, y, size, 0, 2 * Math.PI);
  // A cross that leaves the very place open.
  for (const [u, v] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
    pen.moveTo(x + 3 * ratio * u, y + 3 * ratio * v);
    pen.lineTo(x + size * u, y + size * v);
  }
  pen.stroke();
  pen.setLineDash([]);
  pen.lineWidth = 3 * ratio;
  pen.strokeStyle = "#000b";
  pen.strokeText(point, x + 1.3 * size, y - 0.9 * size);
  pen.fillStyle = "#fff";
  pen.fillText(point, x + 1.3 * size, y - 0.9 * size);
}

/** @param {Camera} shownCamera @param {number} index */
function paintThumb({ id, image, thumb, tab, width_px, height_px }, index) {
  if (!image) return;
  thumb.width = Math.round(thumb.clientWidth * (window.devicePixelRatio || 1));
  thumb.height = Math.round((thumb.width * height_px) / width_px);
  const brush = penOf(thumb);
  brush.drawImage(image, 0, 0, thumb.width, thumb.height);
  drawOutline(brush, id, thumb.width / width_px, 2);
  tab.setAttribute("aria-selected", String(index === shown));
}

function list() {
  const set = new Set([...clicks.values()].map((click) => click.point));
  const unset = points.filter((point) => !set.has(point)).map((point) => ({ point, camera: "" }));
  byId("points").tBodies[0].replaceChildren(...[...clicks.values(), ...unset].map(rowOf));
  const { found } = drawing;
  byId("found").textContent = found
    ? `The frame moves by ${found.shift.x_mm.toFixed(1)} mm along x, ${found.shift.y_mm.toFixed(1)} mm along y, `
      + `and turns by ${found.shift.yaw_deg.toFixed(3)}°; ${found.rms_mm.toFixed(1)} mm rms are left.`
    : "Two corners say where it is, four say whether that is true.";
  byId("save").disabled = saved || !found;
}

/** @param {{ point: string, camera: string }} click */
function rowOf(click) {
  const error = drawing.found?.clicks.find(({ point, camera: id }) => point === click.point && id === click.camera);
  const mm = error ? Math.hypot(...error.off_mm) : null;
  const row = document.createElement("tr");
  for (const text of [click.point, click.camera || "not set", mm === null ? "–" : `${mm.toFixed(1)} mm`]) {
    row.append(Object.assign(document.createElement("td"), { textContent: text }));
  }
  row.className = [mm !== null && mm > FAR_MM ? "far" : "", click.point === chosen ? "chosen" : ""].join(" ");
  row.addEventListener("click", () => {
    armed = !click.camera;
    show(armed ? shown : cameras.findIndex(({ id }) => id === click.camera), click.point);
  });
  return row;
}

/** @param {number} index */
function show(index, point = chosen) {
  shown = index;
  chosen = point;
  paint();
  list();
}

/** Asks what the clicks mean; an answer that a newer question has overtaken is dropped. */
async function solve() {
  const mine = (asked += 1);
  try {
    const answer = await ask("solve", [...clicks.values()]);
    if (mine !== asked) return;
    drawing = answer;
    showTrouble("");
  } catch (error) {
    if (mine === asked) showTrouble(error.message);
  }
  paint();
  list();
}

/** @param {string} point @param {number} x @param {number} y */
function put(point, x, y) {
  const { id, width_px, height_px } = camera();
  const within = (/** @type {number} */ value, /** @type {number} */ size) => Math.min(Math.max(value, 0), size - 1);
  clicks.set(keyOf(id, point), { camera: id, point, x: within(x, width_px), y: within(y, height_px) });
  solve();
}

/** @param {PointerEvent} event */
function pixel(event) {
  const box = canvas.getBoundingClientRect();
  const zoom = camera().width_px / box.width;
  return [(event.clientX - box.left) * zoom, (event.clientY - box.top) * zoom, zoom];
}

canvas.addEventListener("pointerdown", (event) => {
  const [x, y, zoom] = pixel(event);
  const away = points.map((_, index) => {
    const at = placeOf(camera().id, index);
    return at ? Math.hypot(at[0] - x, at[1] - y) : Infinity;
  });
  const near = away.indexOf(Math.min(...away));
  const isNear = away[near] < GRAB_PX * zoom;
  if (!isNear && armed && chosen !== null) put(chosen, x, y);
  else chosen = isNear ? points[near] : null;
  armed = false;
  dragged = chosen !== null;
  if (dragged) canvas.setPointerCapture(event.pointerId);
  paint();
  list();
});

canvas.addEventListener("pointermove", (event) => {
  if (!dragged || chosen === null) return;
  const [x, y] = pixel(event);
  put(chosen, x, y);
});

for (const end of ["pointerup", "pointercancel"]) {
  canvas.addEventListener(end, () => {
    dragged = false;
  });
}

canvas.addEventListener("keydown", (event) => {
  const index = chosen === null ? -1 : points.indexOf(chosen);
  if (chosen === null || index < 0) return;
  if (event.key === "Delete" || event.key === "Backspace") {
    clicks.delete(keyOf(camera().id, chosen));
    solve();
  } else if (event.key in STEPS) {
    const [u, v] = STEPS[event.key].map((step) => step * (event.shiftKey ? COARSE_PX : FINE_PX));
    const at = placeOf(camera().id, index);
    if (at) put(chosen, at[0] + u, at[1] + v);
  } else {
    return;
  }
  event.preventDefault();
});

byId("save").addEventListener("click", async () => {
  byId("save").disabled = true;
  try {
    await ask("save", [...clicks.values()]);
    saved = true;
    showTrouble("");
    byId("found").textContent = "Done: the camera files are moved. This page can be closed.";
  } catch (error) {
    showTrouble(error.message);
    list();
  }
});

window.addEventListener("resize", paint);

/** @param {Description} description @param {number} index @returns {Camera} */
function cameraOf(description, index) {
  const [thumb, tab] = [document.createElement("canvas"), document.createElement("button")];
  tab.setAttribute("role", "tab");
  tab.append(thumb, description.id);
  tab.addEventListener("click", () => show(index));
  byId("cameras").append(tab);
  return { ...description, image: null, thumb, tab };
}

/** @param {Camera} loading @param {number} index */
async function load(loading, index) {
  const image = new Image();
  image.src = `picture/${index}`;
  await image.decode();
  loading.image = image;
  paint();
}

try {
  const start = await ask("start.json");
  points = start.points;
  drawing = { ...start, found: null };
  cameras = start.cameras.map(cameraOf);
  await Promise.all(cameras.map(load));
  list();
} catch (error) {
  showTrouble(`This page has lost vsense camera arena align: ${error.message}`);
}
