// All cameras in their grid, with what the tracker found in their pictures; and their figures.

import { byId, fit, make, mark, press, remember, remembered, write } from "./dom.js";
import { rate } from "./format.js";
import { Overlay } from "./overlay.js";
import { colours } from "./theme.js";

const OLD_NS = 1.5e9;
const PAINT_MS = 300;
const STATES = { ok: "ok", moved: "has been moved", dark: "is dark", frozen: "is frozen", lost: "is lost" };

/** What a camera's state is called in a sentence about it. */
export const stateWords = (state) => STATES[state] ?? state;

/** One camera: a canvas, its name, and what is wrong with it. */
class Cell {
  constructor(camera, store) {
    this.camera = camera;
    this.store = store;
    this.canvas = make("canvas");
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", `Picture of ${camera.id}`);
    this.pen = this.canvas.getContext("2d", { alpha: false });
    this.rate = make("span");
    this.text = make("strong", { hidden: true });
    const tracker = camera.tracker && camera.tracker !== camera.id ? `${camera.tracker}` : "";
    this.element = make(
      "div", { className: "cell" }, this.canvas,
      make("p", {}, make("b", {}, camera.id), make("span", {}, tracker), this.rate), this.text,
    );
    this.element.style.gridRow = camera.row + 1;
    this.element.style.gridColumn = camera.column + 1;
    this.number = 0;
    this.busy = false;
    this.over = "";
    this.chosen = null;
    this.painted = 0;
  }

  /** Decodes and draws the newest picture; those that come meanwhile are passed over.
   *  `over` changes with what lies over it, "" is nothing; `chosen` is a robot's tag or null. */
  async draw(over, chosen) {
    const picture = this.store.pictures.get(this.camera.id);
    const asked = Boolean(over) !== Boolean(this.over) || chosen !== this.chosen;
    // A world that changes in every timestep waits for the next picture, if there is one soon.
    const moved = over !== this.over && performance.now() - this.painted > PAINT_MS;
    const resized = fit(this.canvas);
    if ((resized || asked || moved) && this.bitmap) {
      [this.over, this.chosen] = [over, chosen];
      this.#paint();
    }
    if (!picture || picture.number === this.number || this.busy) return;
    this.number = picture.number;
    this.busy = true;
    [this.over, this.chosen] = [over, chosen];
    try {
      const bitmap = await createImageBitmap(new Blob([picture.blob], { type: `image/${picture.about.format}` }));
      this.bitmap?.close();
      this.bitmap = bitmap;
      this.shown = picture.about;
      this.#paint();
    } catch {
      write(this.text, "a picture could not be read");
      this.text.hidden = false;
    } finally {
      this.busy = false;
    }
  }

  #paint() {
    const { canvas, pen, store, bitmap, camera } = this;
    const zoom = Math.min(canvas.width / bitmap.width, canvas.height / bitmap.height);
    const [width, height] = [bitmap.width * zoom, bitmap.height * zoom];
    const [left, top] = [(canvas.width - width) / 2, (canvas.height - height) / 2];
    this.painted = performance.now();
    pen.fillStyle = "#20262d";
    pen.fillRect(0, 0, canvas.width, canvas.height);
    pen.drawImage(bitmap, left, top, width, height);
    // Found in this very picture where that is still known, else in the newest.
    const arena = store.images.get(this.shown.timestep) ?? store.arena;
    pen.save();
    pen.beginPath();
    pen.rect(left, top, width, height);
    pen.clip();
    pen.translate(left, top);
    if (camera.mask_px) this.#mask(camera.mask_px, width / camera.width_px);
    if (this.over && camera.model?.rotation) this.#world(arena, width / camera.width_px);
    if (arena?.images) this.#found(arena, width / camera.width_px);
    pen.restore();
  }

  // Nothing is looked for where the picture is veiled.
  #mask(polygons, zoom) {
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

  #world(arena, zoom) {
    const { canvas, pen, store, camera } = this;
    this.overlay ??= new Overlay(camera, store, () => this.bitmap && this.#paint());
    this.overlay.draw(pen, zoom, canvas.width / Math.max(canvas.clientWidth, 1), arena, this.chosen);
  }

  #found(arena, zoom) {
    const { pen, canvas, camera, store } = this;
    const { tag, camera: which, x_px, y_px, yaw_px_rad } = arena.images;
    const index = arena.cameras.indexOf(camera.id);
    const ratio = canvas.width / Math.max(canvas.clientWidth, 1);
    const size = this.#radius(zoom);
    const thin = Math.max(1.5 * ratio, size * 0.16);
    const letters = Math.min(Math.max(9, canvas.clientWidth / 24), 13) * ratio;
    pen.font = `600 ${letters}px system-ui, sans-serif`;
    pen.lineJoin = "round";
    for (let row = 0; row < tag.length; row += 1) {
      if (which[row] !== index) continue;
      const [x, y] = [x_px[row] * zoom, y_px[row] * zoom];
      pen.strokeStyle = store.objects?.has(tag[row]) ? colours.cone : "#37d0ff";
      pen.lineWidth = thin;
      pen.beginPath();
      pen.arc(x, y, size, 0, 2 * Math.PI);
      pen.moveTo(x, y);
      // The heading counts counter-clockwise while rows count downwards.
      pen.lineTo(x + 1.9 * size * Math.cos(yaw_px_rad[row]), y - 1.9 * size * Math.sin(yaw_px_rad[row]));
      pen.stroke();
      pen.strokeStyle = "#000b";
      pen.lineWidth = 2.5 * ratio;
      pen.strokeText(String(tag[row]), x + 1.2 * size, y - 0.9 * size);
      pen.fillStyle = "#fff";
      pen.fillText(String(tag[row]), x + 1.2 * size, y - 0.9 * size);
    }
  }

  // How large a robot is in the picture, about: as a share of the arena that a camera sees.
  #radius(zoom) {
    const { arena, cameras, body_radius_m: body = 0.035 } = this.store.experiment;
    const columns = Math.max(...cameras.map((camera) => camera.column)) + 1;
    return Math.max(5, (1.25 * body * this.camera.width_px * zoom * columns) / arena.size_m[0]);
  }

  /** Says how the camera is. */
  tell(told) {
    const { store, shown } = this;
    write(this.rate, told ? rate(told.rate_hz) : "");
    const old = shown && store.arena && store.arena.capture_ns - shown.capture_ns > OLD_NS;
    const bad = told && told.state !== "ok";
    mark(this.element, "bad", bad);
    const words = bad ? `${stateWords(told.state)}${told.text ? `: ${told.text}` : ""}` : old ? "the picture is old" : "";
    write(this.text, words);
    this.text.hidden = !words;
  }
}

/** The panel, and the table of figures. */
export class Cameras {
  constructor(store, choice) {
    this.store = store;
    this.choice = choice;
    this.cells = new Map();
    this.box = byId("cameras");
    this.note = byId("cameras_note");
    this.rows = byId("watch").tBodies[0];
    this.panel = this.box.parentElement;
    this.chip = byId("overlay");
    this.chip.addEventListener("click", () => this.setOverlay(!this.overlay));
    this.setOverlay(remembered("overlay", "true") === "true");
  }

  /** The virtual world over the pictures, on or off. */
  setOverlay(on) {
    this.overlay = on;
    press(this.chip, on);
    remember("overlay", on);
  }

  /** The cameras whose pictures the page shows now. */
  get shown() {
    return this.panel.clientWidth ? [...this.cells.keys()] : [];
  }

  /** Draws what is new; called once per frame of the screen. */
  draw() {
    const { changed, experiment } = this.store;
    if (this.seen !== changed.experiment && experiment) {
      this.seen = changed.experiment;
      this.#build(experiment.cameras ?? []);
    }
    if (!this.panel.clientWidth) return;
    // What changes with time is drawn with the next picture.
    const over = this.overlay ? `world ${this.store.changed.world}` : "";
    for (const cell of this.cells.values()) cell.draw(over, this.overlay ? this.choice.tag : null);
  }

  /** Renews words and figures; called a few times per second. */
  tell() {
    const told = new Map((this.store.cameras?.cameras ?? []).map((camera) => [camera.id, camera]));
    for (const [id, cell] of this.cells) cell.tell(told.get(id));
    const bad = [...told.values()].filter((camera) => camera.state !== "ok").length;
    const all = this.cells.size;
    write(this.note, all ? (bad ? `${bad} of ${all} in trouble` : `${all}`) : "none: another tracker sends poses");
    [...told.values()].forEach((camera, row) => this.#row(row, camera));
    while (this.rows.rows.length > told.size) this.rows.deleteRow(-1);
  }

  #row(index, camera) {
    const row = this.rows.rows[index] ?? this.rows.insertRow();
    while (row.cells.length < 4) row.insertCell();
    const words = camera.text ? `${camera.state}: ${camera.text}` : camera.state;
    [camera.id, rate(camera.rate_hz), String(camera.dropped), words].forEach((text, at) => write(row.cells[at], text));
    mark(row.cells[3], "bad", camera.state !== "ok");
    mark(row.cells[3], "ok", camera.state === "ok");
  }

  #build(cameras) {
    const key = JSON.stringify(cameras.map((camera) => [camera.id, camera.row, camera.column, camera.tracker, camera.model]));
    if (key === this.key) return;
    this.key = key;
    this.cells = new Map(cameras.map((camera) => [camera.id, new Cell(camera, this.store)]));
    this.box.replaceChildren(...[...this.cells.values()].map((cell) => cell.element));
    const rows = Math.max(1, ...cameras.map((camera) => camera.row + 1));
    const columns = Math.max(1, ...cameras.map((camera) => camera.column + 1));
    const { width_px: width = 4, height_px: height = 3 } = cameras[0] ?? {};
    this.box.style.gridTemplate = `repeat(${rows}, minmax(0, 1fr)) / repeat(${columns}, minmax(0, 1fr))`;
    this.box.style.setProperty("--shape", `${(columns * width) / (rows * height)}`);
    this.panel.hidden = !cameras.length;
    byId("watch").parentElement.hidden = !cameras.length;
  }
}
