// All cameras in their grid, with what the tracker found in their pictures; and their figures.

import { byId, fit, make, mark, penOf, press, remember, remembered, write } from "./dom.js";
import { rate } from "./format.js";
import { Names } from "./names.js";
import { Overlay } from "./overlay.js";
import { colours } from "./theme.js";

const OLD_S = 1.5;
/** An arena state and a picture are of one time if no more lies between them. */
const SAME_NS = 3e8;
const PAINT_MS = 300;
const CAPTION_PX = 24;
/** @type {Record<string, string>} */
const STATES = { ok: "ok", moved: "has been moved", dark: "is dark", frozen: "is frozen", lost: "is lost" };

/** @param {string} state in a sentence about a camera. */
export const stateWords = (state) => STATES[state] ?? state;

/** The arena state that a picture belongs to; null where none that is known is of its time.
 * @param {Store} store @param {PictureMessage} picture @returns {ArenaMessage | null} */
function arenaOf({ images }, { timestep, capture_ns }) {
  const off = (/** @type {ArenaMessage} */ state) => Math.abs(state.capture_ns - capture_ns);
  const [near = null] = [...images.values()].filter((state) => off(state) < SAME_NS).sort((a, b) => off(a) - off(b));
  return images.get(timestep) ?? near;
}

/** One camera: a canvas, its name, and what is wrong with it. */
class Cell {
  #number = 0;
  #busy = false;
  /** What lay over the picture when it was painted, and when that was [ms]. */
  #overlayKey = "";
  /** @type {number | null} */
  #chosen = null;
  #painted = 0;
  /** Whether nothing is known of the picture's time: then nothing is drawn into it. */
  #alone = false;
  /** @type {ImageBitmap | undefined} */
  bitmap;
  /** The picture that is shown.
   * @type {PictureMessage | undefined} */
  shown;
  /** @type {Overlay | undefined} */
  #overlay;
  names = new Names();

  /** @param {CameraDescription} camera @param {Store} store */
  constructor(camera, store) {
    this.camera = camera;
    this.store = store;
    this.canvas = make("canvas");
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", `Picture of ${camera.id}`);
    this.pen = penOf(this.canvas, { alpha: false });
    this.rate = make("span");
    this.text = make("strong", { hidden: true });
    const tracker = camera.tracker && camera.tracker !== camera.id ? `${camera.tracker}` : "";
    this.element = make(
      "div", { className: "cell" }, this.canvas,
      make("p", {}, make("b", {}, camera.id), make("span", {}, tracker), this.rate), this.text,
    );
    this.element.title = "a click has it fill the panel, or all again";
    this.element.addEventListener("click", () => this.element.classList.toggle("alone"));
    this.element.style.gridRow = String(camera.row + 1);
    this.element.style.gridColumn = String(camera.column + 1);
  }

  /** Decodes and draws the newest picture; those that come meanwhile are passed over.
   *  `overlayKey` changes with what lies over it, "" is nothing.
   * @param {string} overlayKey @param {number | null} chosen @param {boolean} refresh false: only its size */
  async draw(overlayKey, chosen, refresh) {
    const picture = this.store.pictures.get(this.camera.id);
    const switched = Boolean(overlayKey) !== Boolean(this.#overlayKey) || chosen !== this.#chosen;
    // A world that changes in every timestep waits for the next picture, if there is one soon.
    const isDue = overlayKey !== this.#overlayKey && performance.now() - this.#painted > PAINT_MS;
    const resized = fit(this.canvas);
    const isAlone = Boolean(this.shown && !arenaOf(this.store, this.shown));
    if ((resized || (refresh && (switched || isDue || isAlone !== this.#alone))) && this.bitmap) {
      [this.#overlayKey, this.#chosen] = [overlayKey, chosen];
      this.#paint();
    }
    if (!refresh || !picture || picture.number === this.#number || this.#busy) return;
    this.#number = picture.number;
    this.#busy = true;
    [this.#overlayKey, this.#chosen] = [overlayKey, chosen];
    try {
      const blob = new Blob([/** @type {any} */ (picture.blob)], { type: `image/${picture.about.format}` });
      const bitmap = await createImageBitmap(blob);
      this.bitmap?.close();
      this.bitmap = bitmap;
      this.shown = picture.about;
      this.#paint();
    } catch {
      write(this.text, "a picture could not be read");
      this.text.hidden = false;
    } finally {
      this.#busy = false;
    }
  }

  #paint() {
    const { canvas, pen, store, bitmap, shown, camera } = this;
    if (!bitmap || !shown) return;
    const zoom = Math.min(canvas.width / bitmap.width, canvas.height / bitmap.height);
    const [width, height] = [bitmap.width * zoom, bitmap.height * zoom];
    const [left, top] = [(canvas.width - width) / 2, (canvas.height - height) / 2];
    this.#painted = performance.now();
    pen.fillStyle = "#20262d";
    pen.fillRect(0, 0, canvas.width, canvas.height);
    pen.drawImage(bitmap, left, top, width, height);
    // What was found in this very picture: no pose of another time lies over it.
    const arena = arenaOf(store, shown);
    this.#alone = !arena;
    pen.save();
    pen.beginPath();
    pen.rect(left, top, width, height);
    pen.clip();
    pen.translate(left, top);
    const scale = width / camera.width_px;
    if (camera.mask_px) this.#drawMask(camera.mask_px, scale);
    const model = this.#overlayKey && (arena || !store.arena) && camera.model?.rotation ? camera.model : null;
    const words = model ? this.#drawOverlay(model, arena, scale) : [];
    if (arena?.images) this.#drawImages(arena, scale, words);
    pen.restore();
  }

  /** Nothing is looked for where the picture is veiled.
   * @param {Point[][]} polygons @param {number} zoom */
  #drawMask(polygons, zoom) {
    const { pen, camera } = this;
    pen.beginPath();
    pen.rect(0, 0, camera.width_px * zoom, camera.height_px * zoom);
    for (const polygon of polygons) {
      polygon.forEach(([x, y], index) => (index ? pen.lineTo(x * zoom, y * zoom) : pen.moveTo(x * zoom, y * zoom)));
      pen.closePath();
    }
    pen.fillStyle = "#20262da8";
    pen.fill("evenodd");
  }

  /** @param {CameraModel} model @param {ArenaMessage | null} arena @param {number} zoom */
  #drawOverlay(model, arena, zoom) {
    const { canvas, pen, store } = this;
    this.#overlay ??= new Overlay(model, store, () => this.#paint());
    return this.#overlay.draw(pen, zoom, canvas.width / Math.max(canvas.clientWidth, 1), arena, this.#chosen);
  }

  /** What the tracker found in the picture.
   * @param {ArenaMessage} arena @param {number} zoom @param {import("./names.js").Rectangle[]} words to keep off */
  #drawImages(arena, zoom, words) {
    const { pen, canvas, camera, store } = this;
    const { tag, camera: which, x_px, y_px, yaw_px_rad } = arena.images;
    const index = arena.cameras.indexOf(camera.id);
    const ratio = canvas.width / Math.max(canvas.clientWidth, 1);
    const near = this.#radius(zoom, store.experiment?.body_radius_m);
    /** @type {import("./names.js").Named[]} */
    const things = [];
    for (let row = 0; row < tag.length; row += 1) {
      if (which[row] !== index) continue;
      const [x, y] = [x_px[row] * zoom, y_px[row] * zoom];
      const size = this.#radius(zoom, store.radii.get(tag[row]) ?? store.experiment?.body_radius_m);
      pen.strokeStyle = store.objects.has(tag[row]) ? colours.cone : "#37d0ff";
      pen.lineWidth = Math.max(1.5 * ratio, near * 0.16);
      pen.beginPath();
      pen.arc(x, y, size, 0, 2 * Math.PI);
      pen.moveTo(x, y);
      // The heading counts counter-clockwise while rows count downwards.
      pen.lineTo(x + 1.9 * size * Math.cos(yaw_px_rad[row]), y - 1.9 * size * Math.sin(yaw_px_rad[row]));
      pen.stroke();
      const rank = tag[row] === this.#chosen ? 0 : 1;
      things.push({ tag: tag[row], text: store.label(tag[row]), x, y, rank });
    }
    // The camera's own name stands above.
    const room = { left: 0, top: CAPTION_PX * ratio, right: camera.width_px * zoom, bottom: camera.height_px * zoom };
    const letters = Math.min(Math.max(12, canvas.clientWidth / 24), 14) * ratio;
    this.names.write(pen, things, near, letters, room, words, { ink: "#fff", halo: "#000c", sign: "#fff" });
  }

  /** How large a body is in the picture; a lens that is not known is taken to see its share of the arena.
   * @param {number} zoom @param {number} [body] its radius [m] */
  #radius(zoom, body = 0) {
    const { camera, store } = this;
    const { arena, cameras } = store.experiment ?? {};
    const columns = Math.max(...(cameras ?? [camera]).map(({ column }) => column)) + 1;
    const lens = camera.model?.rotation && camera.model.fx_px / Math.abs(camera.model.position_m[2]);
    return Math.max(5, 1.25 * body * zoom * (lens || (camera.width_px * columns) / (arena?.size_m[0] ?? 1)));
  }

  /** Says how the camera is.
   * @param {CameraState | undefined} state */
  render(state) {
    const { store, shown } = this;
    write(this.rate, state ? rate(state.rate_hz) : "");
    const age_s = shown && store.arena ? (store.arena.capture_ns - shown.capture_ns) / 1e9 : 0;
    const bad = state && state.state !== "ok";
    mark(this.element, "bad", bad);
    let words = "";
    // A fast replay shows fewer of the pictures.
    if (age_s > OLD_S * Math.max(1, store.run?.replay?.speed ?? 1)) words = `the picture is ${age_s.toFixed(1)} s old`;
    if (age_s < -OLD_S) words = `the picture is of ${(-age_s).toFixed(1)} s later`;
    if (!this.bitmap) words = store.run?.replay ? "no picture is recorded here" : "no picture yet";
    mark(this.canvas, "old", Boolean(words));
    if (bad) words = `${stateWords(state.state)}${state.text ? `: ${state.text}` : ""}`;
    write(this.text, words);
    this.text.hidden = !words;
  }
}

/** The panel, and the table of figures. */
export class Cameras {
  /** By the camera's id.
   * @type {Map<string, Cell>} */
  cells = new Map();
  /** Whether the virtual world lies over the pictures. */
  overlay = true;
  #experiment = 0;
  #layoutKey = "";

  /** @param {Store} store @param {RobotSelection} selection */
  constructor(store, selection) {
    this.store = store;
    this.selection = selection;
    this.box = byId("cameras");
    this.note = byId("cameras_note");
    this.rows = byId("watch").tBodies[0];
    this.panel = byId("cameras_panel");
    this.chip = byId("overlay");
    this.chip.addEventListener("click", () => this.setOverlay(!this.overlay));
    this.setOverlay(remembered("overlay", "true") === "true");
  }

  /** @param {boolean} on */
  setOverlay(on) {
    this.overlay = on;
    press(this.chip, on);
    remember("overlay", on);
  }

  /** The cameras whose pictures the page shows now. */
  get shown() {
    return this.panel.clientWidth ? [...this.cells.keys()] : [];
  }

  /** For each frame of the screen. @param {boolean} refresh false: only what has a new size is drawn */
  draw(refresh) {
    const { changed, experiment } = this.store;
    if (this.#experiment !== changed.experiment && experiment) {
      this.#experiment = changed.experiment;
      this.#build(experiment.cameras ?? []);
    }
    if (!this.panel.clientWidth) return;
    // What changes with time is drawn with the next picture.
    const overlayKey = this.overlay ? `world ${changed.world}` : "";
    for (const cell of this.cells.values()) cell.draw(overlayKey, this.overlay ? this.selection.tag : null, refresh);
  }

  /** Renews words and figures; called a few times per second. */
  render() {
    const states = this.store.cameras?.cameras ?? [];
    for (const [id, cell] of this.cells) cell.render(states.find((state) => state.id === id));
    const bad = states.filter(({ state }) => state !== "ok").length;
    const all = this.cells.size;
    const isBare = this.store.run?.replay?.pictures === false;
    byId("no_pictures").hidden = !isBare;
    this.panel.hidden = !all || isBare;
    const note = bad ? `${bad} of ${all} in trouble` : `${all}`;
    write(this.note, all ? note : "none: another tracker sends poses");
    states.forEach((state, row) => this.#renderRow(row, state));
    while (this.rows.rows.length > states.length) this.rows.deleteRow(-1);
  }

  /** @param {number} index @param {CameraState} camera */
  #renderRow(index, camera) {
    const row = this.rows.rows[index] ?? this.rows.insertRow();
    while (row.cells.length < 4) row.insertCell();
    // A recording can have the health of a camera and lack its pictures.
    const isShown = this.store.run?.replay && this.panel.clientWidth && camera.state === "ok";
    const lacks = (isShown && this.cells.get(camera.id)?.text.textContent) || "";
    const words = camera.text ? `${camera.state}: ${camera.text}` : lacks || camera.state;
    [camera.id, rate(camera.rate_hz), String(camera.dropped), words].forEach((text, at) => write(row.cells[at], text));
    mark(row.cells[3], "bad", camera.state !== "ok");
    mark(row.cells[3], "ok", camera.state === "ok" && !lacks);
  }

  /** @param {CameraDescription[]} cameras */
  #build(cameras) {
    const key = JSON.stringify(cameras.map(({ id, row, column, tracker, model }) => [id, row, column, tracker, model]));
    if (key === this.#layoutKey) return;
    this.#layoutKey = key;
    this.cells = new Map(cameras.map((camera) => [camera.id, new Cell(camera, this.store)]));
    this.box.replaceChildren(...[...this.cells.values()].map((cell) => cell.element));
    const rows = Math.max(1, ...cameras.map((camera) => camera.row + 1));
    const columns = Math.max(1, ...cameras.map((camera) => camera.column + 1));
    const { width_px: width = 4, height_px: height = 3 } = cameras[0] ?? {};
    this.box.style.gridTemplate = `repeat(${rows}, minmax(0, 1fr)) / repeat(${columns}, minmax(0, 1fr))`;
    this.box.style.setProperty("--shape", `${(columns * width) / (rows * height)}`);
    byId("watch_panel").hidden = !cameras.length;
  }
}
