// The arena from above: which layers in which order, what a click chooses.

import { Brush } from "./brush.js";
import { byId, elements, fit, penOf, press, remember, remembered, write } from "./dom.js";
import { count } from "./format.js";
import { Ground, pictureOf } from "./ground.js";
import { Names } from "./names.js";
import { FromAbove, SCALE_BAR_M, aspectOf } from "./projections.js";
import {
  drawCones, drawFence, drawLights, drawPhysicalSolids,
  drawVirtualSolids, drawZones, rgb, sceneOf,
} from "./scene.js";
import { drawChosenRays, drawNames, drawRobots, drawStrangers, drawTrails } from "./scene_robots.js";
import * as theme from "./theme.js";

const REACH_PX = 26;
const GRID_M = 0.5;

/** @typedef {import("./scene_robots.js").DrawnRobot} DrawnRobot */

/** What others add to the panel.
 * @typedef {{ draw(scene: Scene): void, takesClicks(): boolean }} Overlay */

/** The panel. */
export class Arena {
  /** What was drawn last, for tests and the curious. */
  drawn = { count: 0, timestep: -1, robots: /** @type {DrawnRobot[]} */ ([]) };
  /** @type {Record<string, boolean>} */
  layers = {};
  /** @type {FromAbove | undefined} */
  view;
  /** @type {Overlay | null} */
  #overlay = null;
  /** The world is drawn again where this is no longer what it shows. */
  key = "";
  #aspect = "";
  #groundKey = "";
  #floorLoaded = 0;
  names = new Names();
  /** The robot or thing under the mouse.
   * @type {number | null} */
  hovered = null;

  /** @param {Store} store @param {RobotSelection} selection */
  constructor(store, selection) {
    this.store = store;
    this.selection = selection;
    this.canvas = byId("arena");
    this.pen = penOf(this.canvas, { alpha: false });
    this.groundCanvas = document.createElement("canvas");
    this.ground = new Ground(null, () => this.#floorArrived());
    this.hint = byId("hint");
    this.note = byId("arena_note");
    for (const chip of elements("[data-layer]")) this.#bindLayer(chip);
    this.canvas.addEventListener("click", (event) => this.#click(event));
    this.canvas.addEventListener("pointermove", (event) => this.#hover(this.#nearest(event)));
    this.canvas.addEventListener("pointerleave", () => this.#hover(null));
  }

  /** Lets somebody draw over everything else, and take clicks.
   * @param {Overlay} overlay */
  attach(overlay) {
    this.#overlay = overlay;
  }

  /** @param {HTMLElement} chip */
  #bindLayer(chip) {
    const name = chip.dataset.layer ?? "";
    const set = (/** @type {boolean} */ on) => {
      this.layers[name] = on;
      press(chip, on);
    };
    set(remembered(`layer.${name}`, "true") === "true");
    chip.addEventListener("click", () => {
      set(!this.layers[name]);
      remember(`layer.${name}`, this.layers[name]);
      this.key = "";
    });
  }

  #floorArrived() {
    this.#floorLoaded += 1;
    this.key = "";
  }

  /** Draws where something that it shows is new, or its size is; called once per frame of the screen.
   * @param {boolean} refresh false: what is new is left alone */
  draw(refresh = true) {
    const store = this.store;
    this.#takeShape(store.experiment?.arena.size_m);
    if (!this.canvas.clientWidth) return;
    const { arena = 0, world = 0, signals = 0, fields = 0, experiment = 0, readings = 0, robots = 0 } = store.changed;
    const resized = fit(this.canvas);
    const key = [arena, world, signals, fields, experiment, readings, robots, theme.version, this.selection.tag].join();
    if (!resized && (!refresh || key === this.key)) return;
    this.key = key;
    this.hint.hidden = Boolean(store.experiment);
    this.#paint(`${world} ${experiment}`);
  }

  /** The panel takes the arena's shape; what it leaves is for the measures below.
   * @param {number[] | undefined} size */
  #takeShape(size) {
    const aspect = size ? aspectOf(size) : "5 / 4";
    if (aspect === this.#aspect) return;
    this.#aspect = aspect;
    this.canvas.parentElement?.style.setProperty("--shape", aspect);
  }

  /** @param {string} worldKey */
  #paint(worldKey) {
    const { pen, canvas, store } = this;
    const { size_m, centre_m } = store.experiment?.arena ?? { size_m: [3, 2.4, 1], centre_m: [0, 0, 0] };
    this.view = FromAbove.of(canvas, size_m, centre_m);
    this.#paintGround(this.view, worldKey);
    pen.drawImage(this.groundCanvas, 0, 0);
    const scene = this.#scene(pen, this.view);
    pen.lineJoin = pen.lineCap = "round";
    drawCones(scene);
    drawVirtualSolids(scene);
    drawLights(scene);
    if (this.layers.trails) drawTrails(scene);
    if (this.layers.rays) drawChosenRays(scene);
    drawFence(scene);
    drawStrangers(scene);
    const robots = drawRobots(scene);
    if (this.layers.names) drawNames(scene, robots, this.names, this.hovered);
    this.#overlay?.draw(scene);
    this.drawn = { count: this.drawn.count + 1, timestep: store.arena?.timestep ?? -1, robots };
    const { tag, seen } = store.arena?.robots ?? { tag: [], seen: [] };
    const inView = seen.filter((isSeen, row) => isSeen && !store.objects.has(tag[row])).length;
    write(this.note, store.arena ? `${count(inView, "robot")} seen · ${size_m[0]} × ${size_m[1]} m` : "");
  }

  /** @param {Pen} pen @param {FromAbove} view */
  #scene(pen, view) {
    const { store } = this;
    return sceneOf(new Brush(pen, view), store, theme.colours, this.selection.tag, store.arena, store.signals);
  }

  /** Floor, grid, walls and fields change rarely: they are kept as one picture.
   * @param {FromAbove} view @param {string} worldKey */
  #paintGround(view, worldKey) {
    const { canvas, groundCanvas, store } = this;
    const fields = this.layers.fields ? store.changed.fields : "off";
    const key = [worldKey, fields, theme.version, canvas.width, canvas.height, this.#floorLoaded].join();
    if (key === this.#groundKey) return;
    this.#groundKey = key;
    groundCanvas.width = canvas.width;
    groundCanvas.height = canvas.height;
    const pen = penOf(groundCanvas, { alpha: false });
    const scene = this.#scene(pen, view);
    pen.fillStyle = theme.colours.card;
    pen.fillRect(0, 0, canvas.width, canvas.height);
    pen.fillStyle = theme.colours.floor;
    pen.fillRect(...view.edges);
    if (store.world?.floor) this.#paintFloor(pen, view, store.world.floor);
    drawGrid(pen, view);
    drawZones(scene);
    if (this.layers.fields) store.fields?.fields.forEach((field, number) => this.#drawField(pen, view, field, number));
    drawPhysicalSolids(scene);
    if (this.layers.scale !== false) drawScaleBar(pen, view);
  }

  /** @param {Pen} pen @param {FromAbove} view @param {Floor} floor */
  #paintFloor(pen, view, floor) {
    const box = view.box(floor.centre_m, floor.size_m);
    const dark = theme.isDark();
    // White is what a floor is without paint: in the dark it would only dazzle.
    if (floor.color.some((part) => part !== 255)) {
      pen.globalAlpha = dark ? 0.4 : 0.75;
      pen.fillStyle = rgb(floor.color);
      pen.fillRect(...box);
    }
    const picture = pictureOf(floor, this.ground.loaded);
    if (picture) {
      pen.imageSmoothingEnabled = false;
      pen.globalAlpha = dark ? 0.4 : 0.7;
      pen.drawImage(picture.canvas, ...box);
      pen.imageSmoothingEnabled = true;
    }
    pen.globalAlpha = 1;
  }

  /** @param {Pen} pen @param {FromAbove} view @param {Field} field @param {number} number */
  #drawField(pen, view, field, number) {
    const [x, y] = field.corner_m;
    const [width, height] = [field.columns * field.cell_m, field.rows * field.cell_m];
    pen.drawImage(
      this.ground.field(field, number), view.x(x), view.y(y + height), width * view.zoom, height * view.zoom,
    );
  }

  /** @param {MouseEvent} event */
  #click(event) {
    if (this.#overlay?.takesClicks()) return;
    this.selection.choose(this.#nearest(event));
  }

  /** The robot at the mouse.
   * @param {MouseEvent} event */
  #nearest(event) {
    const ratio = this.canvas.width / this.canvas.clientWidth;
    const [x, y] = [event.offsetX * ratio, event.offsetY * ratio];
    /** @type {number | null} */
    let best = null;
    let nearest = REACH_PX * ratio;
    for (const robot of this.drawn.robots) {
      const far = Math.hypot(robot.x_px - x, robot.y_px - y);
      if (far < nearest && this.store.rows.has(robot.tag)) [best, nearest] = [robot.tag, far];
    }
    return best;
  }

  /** @param {number | null} tag */
  #hover(tag) {
    if (tag !== this.hovered) this.key = "";
    this.hovered = tag;
  }
}

/** @param {Pen} pen @param {FromAbove} view */
function drawGrid(pen, view) {
  const [left, top, width, height] = view.edges;
  pen.beginPath();
  for (const x of gridLines(view.centre[0], view.size[0])) {
    pen.moveTo(view.x(x), top);
    pen.lineTo(view.x(x), top + height);
  }
  for (const y of gridLines(view.centre[1], view.size[1])) {
    pen.moveTo(left, view.y(y));
    pen.lineTo(left + width, view.y(y));
  }
  pen.strokeStyle = theme.colours.grid;
  pen.lineWidth = view.ratio;
  pen.stroke();
  pen.strokeStyle = theme.colours.solid;
  pen.strokeRect(left, top, width, height);
}

/** Multiples of the grid's width inside the arena.
 * @param {number} centre @param {number} size */
function gridLines(centre, size) {
  const lines = [];
  for (let n = Math.ceil((centre - size / 2) / GRID_M); n * GRID_M < centre + size / 2; n += 1) lines.push(n * GRID_M);
  return lines;
}

/** @param {Pen} pen @param {FromAbove} view */
function drawScaleBar(pen, view) {
  const { left: x, right, bottom } = view.scaleBar;
  const y = bottom - 3 * view.ratio;
  pen.strokeStyle = pen.fillStyle = theme.colours.ink;
  pen.lineWidth = 2 * view.ratio;
  pen.beginPath();
  pen.moveTo(x, y);
  pen.lineTo(right, y);
  pen.stroke();
  pen.font = `600 ${12 * view.ratio}px system-ui, sans-serif`;
  pen.textAlign = "left";
  pen.fillText(`${SCALE_BAR_M} m`, x, y - 6 * view.ratio);
}
