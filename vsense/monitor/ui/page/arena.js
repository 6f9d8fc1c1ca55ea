// The arena from above: which layers in which order, what a click chooses.

import { drawGround } from "./arena_ground.js";
import { drawNames, drawRays, drawRobots, drawTrails } from "./arena_robots.js";
import { drawCones, drawLights, drawVirtual } from "./arena_things.js";
import { byId, fit, press, remember, remembered, write } from "./dom.js";
import * as theme from "./theme.js";

const MARGIN = 0.04;
const REACH_PX = 26;
const MARGIN_PX = 10;

/** Turns metres into pixels; +y points up. */
class Place {
  constructor(canvas, size, centre) {
    const ratio = canvas.width / Math.max(canvas.clientWidth, 1);
    const room = (side) => Math.max(side - 2 * MARGIN_PX * ratio, 1);
    this.ratio = ratio;
    this.zoom = Math.min(room(canvas.width) / (size[0] + MARGIN), room(canvas.height) / (size[1] + MARGIN));
    this.left = canvas.width / 2 - centre[0] * this.zoom;
    this.top = canvas.height / 2 + centre[1] * this.zoom;
    this.size = size;
    this.centre = centre;
  }

  x(metres) {
    return this.left + metres * this.zoom;
  }

  y(metres) {
    return this.top - metres * this.zoom;
  }
}

/** The panel. */
export class Arena {
  constructor(store, choice) {
    this.store = store;
    this.choice = choice;
    this.canvas = byId("arena");
    this.pen = this.canvas.getContext("2d", { alpha: false });
    this.ground = document.createElement("canvas");
    this.hint = byId("hint");
    this.note = byId("arena_note");
    /** What was drawn last, for tests and the curious. */
    this.drawn = { count: 0, timestep: -1, robots: [] };
    this.layers = {};
    /** Draws over everything else; whether a click is somebody else's. */
    this.overlay = () => {};
    this.busy = () => false;
    for (const chip of document.querySelectorAll("[data-layer]")) this.#layer(chip);
    this.canvas.addEventListener("click", (event) => this.#click(event));
  }

  #layer(chip) {
    const name = chip.dataset.layer;
    const set = (on) => {
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

  /** Draws where something that it shows is new; called once per frame of the screen. */
  draw() {
    const store = this.store;
    this.#shape(store.experiment?.arena.size_m);
    if (!this.canvas.clientWidth) return;
    const { arena = 0, world = 0, signals = 0, fields = 0, experiment = 0, readings = 0, robots = 0 } = store.changed;
    const resized = fit(this.canvas);
    const key = [arena, world, signals, fields, experiment, readings, robots, theme.version, this.choice.tag].join();
    if (!resized && key === this.key) return;
    this.key = key;
    this.hint.hidden = Boolean(store.experiment);
    this.#paint(world + experiment * 1000);
  }

  // The panel takes the arena's shape; what it leaves is for the measures below.
  #shape(size) {
    const shape = size ? `${(size[0] + MARGIN).toFixed(3)} / ${(size[1] + MARGIN).toFixed(3)}` : "";
    if (shape === this.shape) return;
    this.shape = shape;
    this.canvas.parentElement.style.setProperty("--shape", shape || "5 / 4");
  }

  #paint(worldNumber) {
    const { pen, canvas, store } = this;
    const arena = store.experiment?.arena ?? { size_m: [3, 2.4, 1], centre_m: [0, 0, 0] };
    const place = (this.place = new Place(canvas, arena.size_m, arena.centre_m));
    this.#groundwork(place, worldNumber);
    pen.drawImage(this.ground, 0, 0);
    const scene = { pen, place, store, colours: theme.colours, layers: this.layers, chosen: this.choice.tag };
    pen.lineJoin = pen.lineCap = "round";
    drawCones(scene);
    drawVirtual(scene);
    drawLights(scene);
    if (this.layers.trails) drawTrails(scene);
    if (this.layers.rays) drawRays(scene);
    const robots = drawRobots(scene);
    if (this.layers.names) drawNames(scene, robots);
    this.overlay(scene);
    this.drawn = {
      count: this.drawn.count + 1,
      timestep: store.arena?.timestep ?? -1,
      newest: store.arena?.timestep ?? -1,
      robots,
    };
    const seen = store.arena?.robots.seen.filter(Boolean).length ?? 0;
    write(this.note, store.arena ? `${seen} seen · ${arena.size_m[0]} × ${arena.size_m[1]} m` : "");
  }

  // Floor, grid, walls and fields change rarely: they are kept as one picture.
  #groundwork(place, worldNumber) {
    const { canvas, ground, store } = this;
    const fields = this.layers.fields ? store.changed.fields : "off";
    const key = [worldNumber, fields, theme.version, canvas.width, canvas.height, this.floorLoaded].join();
    if (key === this.groundKey) return;
    this.groundKey = key;
    ground.width = canvas.width;
    ground.height = canvas.height;
    const pen = ground.getContext("2d", { alpha: false });
    drawGround({
      pen, place, store, colours: theme.colours, layers: this.layers, dark: theme.isDark(),
      loaded: () => {
        this.floorLoaded = (this.floorLoaded ?? 0) + 1;
        this.key = "";
      },
    });
  }

  #click(event) {
    if (this.busy()) return;
    const ratio = this.canvas.width / this.canvas.clientWidth;
    const [x, y] = [event.offsetX * ratio, event.offsetY * ratio];
    let best = null;
    let nearest = REACH_PX * ratio;
    for (const robot of this.drawn.robots) {
      const far = Math.hypot(robot.x_px - x, robot.y_px - y);
      if (far < nearest && this.store.rows.has(robot.tag)) [best, nearest] = [robot.tag, far];
    }
    this.choice.choose(best);
  }
}
