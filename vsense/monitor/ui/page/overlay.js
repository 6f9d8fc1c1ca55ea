// The virtual world over a camera's picture, through the camera's own lens: everything at its height.
// As vsense/monitor/pictures/scene.py draws it for videos and for the picture of a run.

import { reading } from "./format.js";
import { Lens } from "./lens.js";
import { Ground } from "./overlay_ground.js";
import { colours } from "./theme.js";

const BODY_HEIGHT_M = 0.076;
const RAY_M = 0.3;
const DASH_M = 0.04;
const GLOW = [[0.3, 0.12], [0.18, 0.16], [0.09, 0.3]];
const RAYS = ["#4fd0e0", "#e48ad2", "#e0c24a"];
const VIRTUAL = "#b984e0";
const STRANGER = "#3cc4ae";
const WALL = "#dee2e6";
const LIT = "#ff4d48";
const WORDS = 4;
const OLD_NS = 5e8;
const RIM = Array.from({ length: 36 }, (_, at) => [Math.cos((at * Math.PI) / 18), Math.sin((at * Math.PI) / 18)]);

/** One camera's overlay. */
export class Overlay {
  /** `loaded` is called when a picture of the floor has arrived. */
  constructor(camera, store, loaded) {
    this.store = store;
    this.lens = new Lens(camera.model);
    this.ground = new Ground(this.lens, loaded);
  }

  /** Draws what there was at an arena state; the pen's unit is a pixel of the screen, `zoom` of them one of the camera. */
  draw(pen, zoom, ratio, arena, chosen) {
    const { store } = this;
    Object.assign(this, { pen, zoom, ratio });
    pen.save();
    pen.lineJoin = pen.lineCap = "round";
    // The middle of a pixel is a whole number.
    pen.translate(zoom / 2, zoom / 2);
    this.#ground();
    const signals = store.signalsAt(arena?.run_timestep);
    const entities = store.world?.entities ?? [];
    const all = (kind, draw) => entities.forEach((told) => told.kind === kind && draw(told));
    all("zone", (told) => this.#zone(told));
    for (const cone of signals?.cones ?? []) this.#cone(cone);
    for (const told of entities) if (told.kind === "box" || told.kind === "cylinder") this.#solid(told);
    all("light", (told) => this.#light(told));
    all("robot", (told) => this.#stranger(told));
    if (arena) this.#robots(arena, signals, chosen);
    pen.restore();
  }

  #ground() {
    const { store, ground } = this;
    this.#layer(ground.floor(store.world?.floor));
    (store.fields?.fields ?? []).forEach((field, number) => field.peak > 0 && this.#layer(ground.field(field, number)));
  }

  #layer(canvas) {
    const { pen, zoom, lens } = this;
    const { width_px, height_px } = lens.model;
    if (canvas) pen.drawImage(canvas, -zoom / 2, -zoom / 2, width_px * zoom, height_px * zoom);
  }

  #zone(told) {
    const edge = outline(told);
    const colour = told.color ? `rgb(${told.color.join(" ")})` : "#c8ced6";
    if (told.color) this.#fill(at(edge, 0), colour, 0.28);
    for (const dash of dashes(edge)) this.#stroke(at(dash, 0), colour, 1.3, false);
    this.#label(told.id, [told.x_m, told.y_m, 0], 0);
  }

  #cone({ x_m, y_m }) {
    const corners = x_m.map((x, corner) => [x, y_m[corner]]);
    this.#fill(at(corners, 0), colours.cone, 0.28);
    this.#stroke(at(corners, 0), colours.cone, 2);
    this.#stroke(at(circle(corners[0], 0.05), 0), colours.cone, 2.5);
  }

  // What really stands there is seen already: its edges show whether it is where the file says.
  #solid(told) {
    const edge = outline(told);
    const base = told.position_m[2];
    const top = base + (told.kind === "cylinder" ? told.height_m : told.size_m[2]);
    if (!told.physical) {
      this.#fill(at(edge, base), VIRTUAL, 0.35);
      this.#fill(at(edge, top), VIRTUAL, 0.3);
    }
    this.#edges(edge, base, top, told.physical ? WALL : VIRTUAL, told.physical ? 0.8 : 1.5);
  }

  #edges(edge, base, top, colour, width) {
    this.#stroke(at(edge, base), colour, width);
    this.#stroke(at(edge, top), colour, width);
    const step = edge.length > 8 ? Math.floor(edge.length / 6) : 1;
    for (let corner = 0; corner < edge.length; corner += step) {
      const [x, y] = edge[corner];
      this.#stroke([[x, y, base], [x, y, top]], colour, width, false);
    }
  }

  #light({ position_m, color }) {
    const [x, y, z] = position_m;
    this.#stroke([[x, y, 0], [x, y, z]], colours.lamp, 1, false);
    const colour = color.every((part) => part === 255) ? colours.lamp : `rgb(${color.join(" ")})`;
    for (const [radius, share] of GLOW) this.#glow([x, y, z], radius, colour, share);
    this.#glow([x, y, z], 0.035, colour, 1);
  }

  #stranger({ x_m, y_m, yaw_rad }) {
    const edge = circle([x_m, y_m], this.store.experiment?.body_radius_m ?? 0.035);
    this.#fill(at(edge, 0), STRANGER, 0.35);
    this.#fill(at(edge, BODY_HEIGHT_M), STRANGER, 0.35);
    this.#edges(edge, 0, BODY_HEIGHT_M, STRANGER, 1.3);
    const reach = 0.0735;
    const tip = [x_m + reach * Math.cos(yaw_rad), y_m + reach * Math.sin(yaw_rad), BODY_HEIGHT_M];
    this.#stroke([[x_m, y_m, BODY_HEIGHT_M], tip], STRANGER, 2, false);
  }

  // Rings and names are the tracker's, see cameras.js; here is what nobody sees of them.
  #robots(arena, signals, chosen) {
    const { store } = this;
    const { tag, x_m, y_m, yaw_rad } = arena.robots;
    const body = store.experiment?.body_radius_m ?? 0.035;
    const leds = new Map((signals?.leds.tag ?? []).map((each, row) => [each, signals.leds.color[row]]));
    for (let row = 0; row < tag.length; row += 1) {
      if (store.objects.has(tag[row]) || x_m[row] === null) continue;
      const top = [x_m[row], y_m[row], store.heights.get(tag[row]) ?? BODY_HEIGHT_M];
      const known = store.rows.get(tag[row]);
      const ring = known === undefined ? 0 : (store.robots.leds[known] ?? 0) & 0xff;
      if (leds.has(tag[row])) this.#glow(top, 1.5 * body, `rgb(${leds.get(tag[row]).join(" ")})`, 0.6);
      if (ring) this.#glow(top, 1.9 * body, LIT, 0.3);
      if (tag[row] === chosen) this.#senses(top, yaw_rad[row], body, chosen);
    }
  }

  #senses(top, yaw, body, chosen) {
    const [x, y, z] = top;
    this.#stroke(at(circle(top, 2.6 * body), z), "#fff", 1.8);
    const words = [];
    let number = 0;
    for (const { sensor, values, age_ns } of this.store.sensed(chosen)) {
      const angles = sensor.angles_rad;
      if (age_ns === null) continue;
      if (!angles?.length) {
        if (values.length <= 3) words.push(`${sensor.name} ${values.map(reading).join(", ")}`);
        continue;
      }
      const peak = this.store.peak(sensor.name, values.slice(0, angles.length));
      this.pen.globalAlpha = age_ns > OLD_NS ? 0.35 : 0.9;
      angles.forEach((angle, index) => {
        const turn = yaw + angle + 0.05 * number;
        const far = body + (RAY_M - body) * Math.min(Math.abs(values[index] ?? 0) / peak, 1);
        const end = (reach) => [x + reach * Math.cos(turn), y + reach * Math.sin(turn), z];
        this.#stroke([end(body), end(far)], RAYS[number % RAYS.length], 2.5, false);
      });
      this.pen.globalAlpha = 1;
      number += 1;
    }
    words.slice(0, WORDS).forEach((word, line) => this.#label(word, top, 2.6 * body, line + 1));
  }

  #fill(points, colour, share) {
    const { pen } = this;
    const pixels = this.lens.area(points);
    if (pixels.length < 3) return;
    this.#path([pixels]);
    pen.globalAlpha = share;
    pen.fillStyle = colour;
    pen.fill();
    pen.globalAlpha = 1;
  }

  #stroke(points, colour, width, closed = true) {
    this.#path(this.lens.line(points, closed));
    this.pen.strokeStyle = colour;
    this.pen.lineWidth = width * this.ratio;
    this.pen.stroke();
  }

  #path(pieces) {
    const { pen, zoom } = this;
    pen.beginPath();
    for (const piece of pieces) {
      piece.forEach(([x, y], index) => (index ? pen.lineTo(x * zoom, y * zoom) : pen.moveTo(x * zoom, y * zoom)));
    }
  }

  #glow(point, radius, colour, share) {
    const { pen, zoom } = this;
    const spot = this.lens.spot(point);
    if (!spot) return;
    pen.globalAlpha = share;
    pen.fillStyle = colour;
    pen.beginPath();
    pen.arc(spot[0] * zoom, spot[1] * zoom, radius * spot[2] * zoom, 0, 2 * Math.PI);
    pen.fill();
    pen.globalAlpha = 1;
  }

  #label(text, point, below, line = 0) {
    const { pen, zoom, ratio } = this;
    const spot = this.lens.spot(point);
    if (!spot) return;
    const [x, y] = [spot[0] * zoom, (spot[1] + below * spot[2]) * zoom + line * 13 * ratio];
    pen.font = `600 ${11 * ratio}px system-ui, sans-serif`;
    pen.textAlign = "center";
    pen.strokeStyle = "#000b";
    pen.lineWidth = 2.5 * ratio;
    pen.strokeText(text, x, y);
    pen.fillStyle = "#fff";
    pen.fillText(text, x, y);
    pen.textAlign = "left";
  }
}

const at = (outline, z) => outline.map(([x, y]) => [x, y, z]);
const circle = ([x, y], radius) => RIM.map(([u, v]) => [x + radius * u, y + radius * v]);

/** The outline of a box, cylinder or zone on the floor. */
function outline(told) {
  const [x, y] = told.position_m ?? [told.x_m, told.y_m];
  if (told.kind === "cylinder" || told.shape === "circle") return circle([x, y], told.radius_m);
  const [cosine, sine] = [Math.cos(told.yaw_rad), Math.sin(told.yaw_rad)];
  return [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([along, across]) => {
    const [u, v] = [(along * told.size_m[0]) / 2, (across * told.size_m[1]) / 2];
    return [x + u * cosine - v * sine, y + u * sine + v * cosine];
  });
}

// Every other piece of an outline; a lens bends dashes, too.
function dashes(edge) {
  const found = [];
  edge.forEach((start, index) => {
    const end = edge[(index + 1) % edge.length];
    const count = 2 * Math.max(Math.round(Math.hypot(end[0] - start[0], end[1] - start[1]) / (2 * DASH_M)), 1);
    const point = (step) => [0, 1].map((axis) => start[axis] + (step / count) * (end[axis] - start[axis]));
    for (let step = 0; step < count; step += 2) found.push([point(step), point(step + 1)]);
  });
  return found;
}
