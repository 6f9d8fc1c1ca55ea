// Corners of the arena, dragged onto cameras' pictures. What they mean is computed by the server.

const byId = (id) => document.getElementById(id);
const GRAB_PX = 18;
const FAR_MM = 10;
const FINE_PX = 0.2;
const COARSE_PX = 5;

const canvas = byId("picture");
const pen = canvas.getContext("2d");
let cameras = [];
let points = [];
let told = { expected: {}, outline: {}, found: null };
let shown = 0;
let chosen = null;
let dragged = false;
// A corner that was chosen in the list is put wherever the picture is pressed next.
let armed = false;
let asked = 0;
let saved = false;
/** "camera point" -> {camera, point, x, y} */
const clicks = new Map();

const key = (camera, point) => `${camera} ${point}`;
const camera = () => cameras[shown];

function trouble(text) {
  byId("trouble").textContent = text;
  byId("trouble").hidden = !text;
}

async function ask(path, body) {
  const answer = await fetch(path, body && { method: "POST", body: JSON.stringify(body) });
  const data = await answer.json();
  if (!answer.ok) throw new Error(data.error ?? answer.statusText);
  return data;
}

/** Where a corner is in a picture: clicked, or else where the calibration has it. */
function place(id, index) {
  const click = clicks.get(key(id, points[index]));
  return click ? [click.x, click.y] : told.expected[id]?.[index] ?? null;
}

function outline(brush, id, zoom, width) {
  brush.strokeStyle = "#37d0ff";
  brush.lineWidth = width;
  for (const line of told.outline[id] ?? []) {
    brush.beginPath();
    line.forEach(([x, y], at) => (at ? brush.lineTo(x * zoom, y * zoom) : brush.moveTo(x * zoom, y * zoom)));
    brush.stroke();
  }
}

function paint() {
  const one = camera();
  if (!one?.image) return;
  const ratio = window.devicePixelRatio || 1;
  canvas.width = Math.round(canvas.clientWidth * ratio);
  canvas.height = Math.round((canvas.width * one.height_px) / one.width_px);
  const zoom = canvas.width / one.width_px;
  pen.drawImage(one.image, 0, 0, canvas.width, canvas.height);
  outline(pen, one.id, zoom, 1.5 * ratio);
  pen.font = `600 ${14 * ratio}px system-ui, sans-serif`;
  points.forEach((point, index) => {
    const at = place(one.id, index);
    if (!at) return;
    const [x, y] = [at[0] * zoom, at[1] * zoom];
    const set = clicks.has(key(one.id, point));
    const size = 11 * ratio;
    pen.strokeStyle = set ? "#ffd43b" : "#fffc";
    pen.setLineDash(set ? [] : [4 * ratio, 4 * ratio]);
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
  });
  cameras.forEach(small);
}

function small(one, index) {
  if (!one.image) return;
  const { thumb } = one;
  thumb.width = Math.round(thumb.clientWidth * (window.devicePixelRatio || 1));
  thumb.height = Math.round((thumb.width * one.height_px) / one.width_px);
  const brush = thumb.getContext("2d");
  brush.drawImage(one.image, 0, 0, thumb.width, thumb.height);
  outline(brush, one.id, thumb.width / one.width_px, 2);
  one.tab.setAttribute("aria-selected", String(index === shown));
}

function list() {
  const set = new Set([...clicks.values()].map((click) => click.point));
  const unset = points.filter((point) => !set.has(point)).map((point) => ({ point, camera: "" }));
  const rows = [...clicks.values(), ...unset].map((click) => {
    const left = told.found?.clicks.find((each) => each.point === click.point && each.camera === click.camera);
    const mm = left ? Math.hypot(...left.off_mm) : null;
    const row = document.createElement("tr");
    for (const text of [click.point, click.camera || "not set", mm === null ? "–" : `${mm.toFixed(1)} mm`]) {
      row.append(Object.assign(document.createElement("td"), { textContent: text }));
    }
    row.className = [mm > FAR_MM ? "far" : "", click.point === chosen ? "chosen" : ""].join(" ");
    row.onclick = () => {
      armed = !click.camera;
      show(armed ? shown : cameras.findIndex((each) => each.id === click.camera), click.point);
    };
    return row;
  });
  byId("points").tBodies[0].replaceChildren(...rows);
  const { found } = told;
  byId("found").textContent = found
    ? `The frame moves by ${found.shift.x_mm.toFixed(1)} mm along x, ${found.shift.y_mm.toFixed(1)} mm along y, `
      + `and turns by ${found.shift.yaw_deg.toFixed(3)}°; ${found.rms_mm.toFixed(1)} mm rms are left.`
    : "Two corners say where it is, four say whether that is true.";
  byId("save").disabled = saved || !found;
}

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
    told = answer;
    trouble("");
  } catch (error) {
    if (mine === asked) trouble(error.message);
  }
  paint();
  list();
}

function put(point, x, y) {
  const { id, width_px, height_px } = camera();
  const within = (value, size) => Math.min(Math.max(value, 0), size - 1);
  clicks.set(key(id, point), { camera: id, point, x: within(x, width_px), y: within(y, height_px) });
  solve();
}

function pixel(event) {
  const box = canvas.getBoundingClientRect();
  const zoom = camera().width_px / box.width;
  return [(event.clientX - box.left) * zoom, (event.clientY - box.top) * zoom, zoom];
}

canvas.addEventListener("pointerdown", (event) => {
  const [x, y, zoom] = pixel(event);
  const away = points.map((_, index) => {
    const at = place(camera().id, index);
    return at ? Math.hypot(at[0] - x, at[1] - y) : Infinity;
  });
  const near = away.indexOf(Math.min(...away));
  const isNear = away[near] < GRAB_PX * zoom;
  if (!isNear && armed) put(chosen, x, y);
  else chosen = isNear ? points[near] : null;
  armed = false;
  dragged = chosen !== null;
  if (dragged) canvas.setPointerCapture(event.pointerId);
  paint();
  list();
});

canvas.addEventListener("pointermove", (event) => {
  if (!dragged) return;
  const [x, y] = pixel(event);
  put(chosen, x, y);
});

for (const end of ["pointerup", "pointercancel"]) {
  canvas.addEventListener(end, () => {
    dragged = false;
  });
}

canvas.addEventListener("keydown", (event) => {
  const steps = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
  const index = points.indexOf(chosen);
  if (index < 0) return;
  if (event.key === "Delete" || event.key === "Backspace") {
    clicks.delete(key(camera().id, chosen));
    solve();
  } else if (event.key in steps) {
    const [u, v] = steps[event.key].map((step) => step * (event.shiftKey ? COARSE_PX : FINE_PX));
    const at = place(camera().id, index);
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
    trouble("");
    byId("found").textContent = "Done: the camera files are moved. This page can be closed.";
  } catch (error) {
    trouble(error.message);
    list();
  }
});

window.addEventListener("resize", paint);

async function load(one, index) {
  one.thumb = document.createElement("canvas");
  one.tab = document.createElement("button");
  one.tab.setAttribute("role", "tab");
  one.tab.append(one.thumb, one.id);
  one.tab.onclick = () => show(index);
  byId("cameras").append(one.tab);
  const image = new Image();
  image.src = `picture/${index}`;
  await image.decode();
  one.image = image;
  paint();
}

try {
  const begun = await ask("start.json");
  ({ cameras, points } = begun);
  told = { ...begun, found: null };
  await Promise.all(cameras.map(load));
  list();
} catch (error) {
  trouble(`This page has lost vsense arena align: ${error.message}`);
}
