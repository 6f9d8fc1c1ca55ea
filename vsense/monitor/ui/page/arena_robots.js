// Robots as rings with a line where they head to, their LEDs, trails, names, and what one senses.

import { glow } from "./arena_things.js";

export const RING_LEDS = 8;
export const BODY_LED = 1 << 8;
export const FRONT_LED = 1 << 9;
const MANY = 40;
const SHORT_TRAIL = 25;
const FADE_NS = 2e9;
const RAY_M = 0.3;
const RAY_COLOURS = ["ray", "ray2", "ray3"];

/** All trails in one stroke: a hundred robots cost little more than one. */
export function drawTrails({ pen, place, store, colours, chosen }) {
  pen.strokeStyle = colours.trail;
  pen.lineWidth = 1.2 * place.ratio;
  pen.globalAlpha = 0.6;
  pen.beginPath();
  const many = store.trails.size > MANY;
  for (const [tag, trail] of store.trails) {
    if (tag !== chosen) path(pen, place, many ? trail.slice(-SHORT_TRAIL) : trail);
  }
  pen.stroke();
  pen.globalAlpha = 1;
  if (!store.trails.has(chosen)) return;
  pen.lineWidth = 2.4 * place.ratio;
  pen.beginPath();
  path(pen, place, store.trails.get(chosen));
  pen.stroke();
}

function path(pen, place, trail) {
  trail.forEach(([x, y], index) => (index ? pen.lineTo(place.x(x), place.y(y)) : pen.moveTo(place.x(x), place.y(y))));
}

/** Draws all robots; gives where: [{tag, x_px, y_px, x_m, y_m}]. */
export function drawRobots(scene) {
  const { store, place, pen, colours } = scene;
  const radius = (store.experiment?.body_radius_m ?? 0.035) * place.zoom;
  const virtual = new Map();
  (store.signals?.leds.tag ?? []).forEach((tag, row) => virtual.set(tag, store.signals.leds.color[row]));
  const made = [];
  for (const told of store.world?.entities ?? []) {
    if (told.kind !== "robot") continue;
    const [x, y] = [place.x(told.x_m), place.y(told.y_m)];
    glow(pen, x, y, radius, colours.stranger, 0.35);
    body(scene, x, y, told.yaw_rad, radius, colours.stranger, false);
  }
  if (!store.arena) return made;
  const { tag, x_m, y_m, yaw_rad, age_ns, seen } = store.arena.robots;
  for (let row = 0; row < tag.length; row += 1) {
    const robot = { tag: tag[row], x_px: place.x(x_m[row]), y_px: place.y(y_m[row]), x_m: x_m[row], y_m: y_m[row] };
    // What has not been seen for a while fades, but never quite: it is somewhere.
    pen.globalAlpha = seen[row] ? 1 : Math.max(0.35, 1 - age_ns[row] / FADE_NS);
    if (store.objects.has(robot.tag)) object(scene, robot, radius);
    else one(scene, robot, yaw_rad[row], radius, seen[row], virtual.get(robot.tag));
    pen.globalAlpha = 1;
    made.push(robot);
  }
  return made;
}

function object({ pen, colours, place }, { x_px, y_px }, radius) {
  pen.strokeStyle = colours.cone;
  pen.lineWidth = 3 * place.ratio;
  pen.strokeRect(x_px - 0.5 * radius, y_px - 0.5 * radius, radius, radius);
}

function one(scene, robot, yaw, radius, seen, virtual) {
  const { pen, store, colours, place, chosen } = scene;
  const { x_px: x, y_px: y, tag } = robot;
  const row = store.rows.get(tag);
  const leds = row === undefined ? 0 : store.robots.leds[row] ?? 0;
  const trouble = row !== undefined && store.robots.trouble[row];
  if (virtual) glow(pen, x, y, 1.5 * radius, `rgb(${virtual.join(" ")})`, 0.6);
  if (leds & 0xff) glow(pen, x, y, 1.9 * radius, colours.lit, 0.28);
  if (leds & BODY_LED) glow(pen, x, y, 0.8 * radius, "rgb(40 200 80)", 0.7);
  if (tag === chosen) halo(scene, x, y, 2.6 * radius, colours.ink, []);
  if (trouble) halo(scene, x, y, 2.2 * radius, colours.red, [4 * place.ratio, 4 * place.ratio]);
  body(scene, x, y, yaw, radius, leds & 0xff ? colours.lit : colours.robot, !seen);
  if (leds) ringLeds(pen, x, y, yaw, radius, leds, colours.lit);
}

function halo({ pen, place }, x, y, radius, colour, dash) {
  pen.setLineDash(dash);
  pen.strokeStyle = colour;
  pen.lineWidth = 2 * place.ratio;
  pen.beginPath();
  pen.arc(x, y, radius, 0, 2 * Math.PI);
  pen.stroke();
  pen.setLineDash([]);
}

function body({ pen, place }, x, y, yaw, radius, colour, dashed) {
  pen.strokeStyle = colour;
  if (dashed) pen.setLineDash([3 * place.ratio, 3 * place.ratio]);
  pen.lineWidth = Math.max(0.26 * radius, 1.5 * place.ratio);
  pen.beginPath();
  pen.arc(x, y, radius, 0, 2 * Math.PI);
  pen.stroke();
  pen.setLineDash([]);
  pen.lineWidth = Math.max(0.2 * radius, 1.2 * place.ratio);
  pen.beginPath();
  pen.moveTo(x, y);
  pen.lineTo(x + 2.1 * radius * Math.cos(yaw), y - 2.1 * radius * Math.sin(yaw));
  pen.stroke();
}

/** The e-puck's ring: LED 0 in front, the others clockwise. */
export function ringLeds(pen, x, y, yaw, radius, leds, colour) {
  pen.fillStyle = colour;
  pen.beginPath();
  for (let led = 0; led < RING_LEDS; led += 1) {
    if (!(leds & (1 << led))) continue;
    const angle = yaw - (led * 2 * Math.PI) / RING_LEDS;
    const [u, v] = [x + radius * Math.cos(angle), y - radius * Math.sin(angle)];
    pen.moveTo(u, v);
    pen.arc(u, v, 0.26 * radius, 0, 2 * Math.PI);
  }
  if (leds & FRONT_LED) {
    const [u, v] = [x + 1.35 * radius * Math.cos(yaw), y - 1.35 * radius * Math.sin(yaw)];
    pen.moveTo(u, v);
    pen.arc(u, v, 0.36 * radius, 0, 2 * Math.PI);
  }
  pen.fill();
}

// Where a name goes: of the four corners around a robot the first that is in the picture and on no
// other name, else the first in the picture. `placed` are [left, top, right, bottom] of the others.
function corner({ canvas }, width, size, robot, radius, placed) {
  const [far, near] = [1.25 * radius, 0.95 * radius];
  const corners = [[far, -near], [-far - width, -near], [far, near + size], [-far - width, near + size]];
  const boxes = corners.map(([x, y]) => [robot.x_px + x, robot.y_px + y - size, robot.x_px + x + width, robot.y_px + y]);
  const inside = boxes.filter(([left, top, right, bottom]) => left >= 0 && top >= 0 && right <= canvas.width && bottom <= canvas.height);
  const free = inside.find((box) => !placed.some((other) => box[0] < other[2] && other[0] < box[2] && box[1] < other[3] && other[1] < box[3]));
  return free ?? inside[0] ?? boxes[0];
}

/** Numbers beside the robots; where many are, only those that matter. */
export function drawNames({ pen, place, store, colours, chosen }, robots) {
  const radius = (store.experiment?.body_radius_m ?? 0.035) * place.zoom;
  const size = Math.max(10, Math.min(14, 0.062 * place.zoom / place.ratio)) * place.ratio;
  pen.textAlign = "left";
  pen.font = `600 ${size}px system-ui, sans-serif`;
  pen.strokeStyle = colours.floor;
  pen.lineWidth = 3 * place.ratio;
  const placed = [];
  for (const robot of robots) {
    const { tag } = robot;
    const row = store.rows.get(tag);
    const matters = tag === chosen || (row !== undefined && store.robots.trouble[row]);
    if (robots.length > MANY && !matters) continue;
    const text = store.objects.has(tag) ? store.name(tag) : String(tag);
    const box = corner(pen, pen.measureText(text).width, size, robot, radius, placed);
    placed.push(box);
    const [x, , , y] = box;
    pen.strokeText(text, x, y);
    pen.fillStyle = matters && tag !== chosen ? colours.red : colours.ink;
    pen.fillText(text, x, y);
  }
}

/** What the chosen robot senses, as rays of the sensors that look somewhere. */
export function drawRays({ pen, place, store, colours, chosen }) {
  if (chosen === null || !store.arena) return;
  const row = store.arena.robots.tag.indexOf(chosen);
  if (row < 0) return;
  const { x_m, y_m, yaw_rad } = store.arena.robots;
  const from = (store.experiment?.body_radius_m ?? 0.035) * place.zoom;
  const at = [place.x(x_m[row]), place.y(y_m[row]), yaw_rad[row]];
  rays(pen, at, from, RAY_M * place.zoom, store, chosen, colours, 2.5 * place.ratio);
}

/** Draws rays from a body's rim; the longest is as long as the sensor's largest number so far. */
export function rays(pen, [x, y, yaw], from, length, store, tag, colours, width) {
  let number = -1;
  for (const { sensor, values, age_ns } of store.sensed(tag)) {
    const angles = sensor.angles_rad;
    if (!angles?.length) continue;
    number += 1;
    if (age_ns === null) continue;
    const peak = store.peak(sensor.name, values.slice(0, angles.length));
    pen.strokeStyle = colours[RAY_COLOURS[number % RAY_COLOURS.length]];
    pen.lineWidth = width;
    pen.globalAlpha = age_ns > 5e8 ? 0.35 : 0.85;
    pen.beginPath();
    angles.forEach((angle, index) => {
      // Several sensors that look the same way stand side by side.
      const turn = yaw + angle + 0.05 * number;
      const reach = from + (length - from) * Math.min(Math.abs(values[index] ?? 0) / peak, 1);
      pen.moveTo(x + from * Math.cos(turn), y - from * Math.sin(turn));
      pen.lineTo(x + reach * Math.cos(turn), y - reach * Math.sin(turn));
    });
    pen.stroke();
    pen.globalAlpha = 1;
  }
}

/** The colour of a sensor's rays, or null where it has none. */
export function rayColour(sensors, name, colours) {
  const looking = sensors.filter((sensor) => sensor.angles_rad?.length).map((sensor) => sensor.name);
  const number = looking.indexOf(name);
  return number < 0 ? null : colours[RAY_COLOURS[number % RAY_COLOURS.length]];
}
