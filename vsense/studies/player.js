// A run that plays in a notebook, for anywidget: `render` is called with the run's arrays.

const TRAIL_S = 6;
const SPEEDS = [1, 2, 5, 10, 20];
const ROBOT = "#2f6fb7", HEADING = "#ffffff", LIT = "rgba(215, 48, 39, 0.35)", TRAIL = "rgba(47, 111, 183, 0.35)";
const RING = 0xff;

/** @typedef {object} Run
 * @property {Float32Array} poses x, y [m] and yaw [rad] of every robot in every timestep; NaN: not seen
 * @property {Uint16Array} leds
 * @property {number} robots
 * @property {number} steps
 * @property {number} timestep_s
 * @property {number[]} arena least x, least y, width and depth [m]
 * @property {number[]} radii_m of the robots
 * @property {HTMLImageElement} picture of the arena without robots
 */

/** @param {DataView} view */
const buffer = (view) => view.buffer.slice(view.byteOffset, view.byteOffset + view.byteLength);

/** @param {{get: (name: string) => any}} model @returns {Run} */
function read(model) {
  const picture = new Image();
  picture.src = URL.createObjectURL(new Blob([buffer(model.get("picture"))], { type: "image/png" }));
  const poses = new Float32Array(buffer(model.get("poses")));
  const robots = model.get("robots");
  return {
    poses, robots, picture, leds: new Uint16Array(buffer(model.get("leds"))),
    steps: robots ? poses.length / (3 * robots) : 0,
    timestep_s: model.get("timestep_s"), arena: model.get("arena"), radii_m: model.get("radii_m"),
  };
}

/** Draws one moment. @param {HTMLCanvasElement} canvas @param {Run} run @param {number} step */
function draw(canvas, run, step) {
  const pen = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
  const [left_m, low_m, width_m, depth_m] = run.arena;
  const zoom = canvas.width / width_m;
  const x = (x_m) => (x_m - left_m) * zoom, y = (y_m) => (low_m + depth_m - y_m) * zoom;
  pen.drawImage(run.picture, 0, 0, canvas.width, canvas.height);
  const first = Math.max(0, step - Math.round(TRAIL_S / run.timestep_s));
  for (let robot = 0; robot < run.robots; robot++) {
    const at = (when) => run.poses.subarray(3 * (when * run.robots + robot), 3 * (when * run.robots + robot) + 3);
    pen.beginPath();
    for (let when = first; when <= step; when++) pen.lineTo(x(at(when)[0]), y(at(when)[1]));
    pen.strokeStyle = TRAIL;
    pen.lineWidth = Math.max(1, 0.01 * zoom);
    pen.stroke();
    const [x_m, y_m, yaw] = at(step);
    if (Number.isNaN(x_m)) continue;
    const size = Math.max(3, run.radii_m[robot] * zoom);
    if (run.leds[step * run.robots + robot] & RING) disc(pen, x(x_m), y(y_m), 1.7 * size, LIT);
    disc(pen, x(x_m), y(y_m), size, ROBOT);
    pen.beginPath();
    pen.moveTo(x(x_m), y(y_m));
    pen.lineTo(x(x_m) + size * Math.cos(yaw), y(y_m) - size * Math.sin(yaw));
    pen.strokeStyle = HEADING;
    pen.lineWidth = Math.max(1.5, size / 4);
    pen.stroke();
  }
}

/** @param {CanvasRenderingContext2D} pen */
function disc(pen, x, y, radius, colour) {
  pen.beginPath();
  pen.arc(x, y, radius, 0, 2 * Math.PI);
  pen.fillStyle = colour;
  pen.fill();
}

/** @param {string} kind @param {object} about */
const make = (kind, about = {}) => Object.assign(document.createElement(kind), about);

/** What people use: its elements, in `el`. @param {HTMLElement} el @param {number} steps */
function controls(el, steps) {
  const canvas = /** @type {HTMLCanvasElement} */ (make("canvas"));
  const button = make("button", { textContent: "Play", type: "button" });
  const slider = /** @type {HTMLInputElement} */ (make("input", { type: "range", min: 0, max: steps - 1, value: 0 }));
  const speed = /** @type {HTMLSelectElement} */ (make("select", { title: "speed" }));
  for (const times of SPEEDS) speed.append(make("option", { value: times, textContent: `${times} x` }));
  const clock = make("span");
  slider.setAttribute("aria-label", "time of the run");
  slider.style.flex = "1";
  canvas.style.cssText = "max-width: 100%; display: block; border-radius: 4px";
  clock.style.cssText = "min-width: 5em; text-align: right; font-variant-numeric: tabular-nums";
  const bar = make("div");
  bar.style.cssText = "display: flex; gap: 8px; align-items: center; max-width: 640px; padding: 6px 0;"
    + " font: 14px system-ui, sans-serif";
  bar.append(button, slider, speed, clock);
  el.append(canvas, bar);
  return { canvas, button, slider, speed, clock };
}

/** @param {{model: {get: (name: string) => any}, el: HTMLElement}} given
 * @returns {Promise<() => void>} ends it */
async function render({ model, el }) {
  const run = read(model), last = run.steps - 1;
  const { canvas, button, slider, speed, clock } = controls(el, run.steps);
  let step = 0, plays = false, frame = 0, shown_ms = 0;
  const show = () => {
    draw(canvas, run, Math.floor(step));
    slider.value = String(Math.floor(step));
    clock.textContent = `${(Math.floor(step) * run.timestep_s).toFixed(1)} s`;
    button.textContent = plays ? "Pause" : "Play";
    if (plays) frame = requestAnimationFrame(go);
  };
  const go = (now_ms) => {
    step += Number(speed.value) * Math.max(0, now_ms - shown_ms) / 1000 / run.timestep_s;
    shown_ms = now_ms;
    if (step >= last) [step, plays] = [last, false];
    show();
  };
  button.addEventListener("click", () => {
    cancelAnimationFrame(frame);
    plays = !plays && last > 0;
    if (plays && step >= last) step = 0;
    shown_ms = performance.now();
    show();
  });
  slider.addEventListener("input", () => {
    cancelAnimationFrame(frame);
    step = Number(slider.value);
    shown_ms = performance.now();
    show();
  });
  await run.picture.decode();
  canvas.width = run.picture.width;
  canvas.height = run.picture.height;
  show();
  return () => cancelAnimationFrame(frame);
}

export default { render };
