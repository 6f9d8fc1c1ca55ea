// Robots: rings with a line where they head to, their LEDs, trails, names, and what one senses.
// Through a lens rings and names are the tracker's, see cameras.js: only what nobody sees is drawn.

import { reading } from "./format.js";
import { FromAbove, ThroughLens, rim } from "./projections.js";
import { STYLES, drawEdges, drawLabel, outlineOf, rgb } from "./scene.js";

/** @typedef {import("./names.js").Names} Names */
/** @typedef {{ tag: number, x_px: number, y_px: number, x_m: number, y_m: number }} DrawnRobot */

const HEADING = 2.1;
const RAY_M = 0.3;
const RING_LEDS = 8;
const RING = 0xff;
const BODY_LED = 1 << 8;
const FRONT_LED = 1 << 9;
const BODY_LED_COLOUR = "rgb(40 200 80)";
const MANY = 40;
/** Trails of many robots are so long [s of the run]. */
const SHORT_TRAIL_S = 2.5;
const FADE_NS = 2e9;
const OLD_NS = 5e8;
const WORDS = 4;

/** Virtual robots.
 * @param {Scene} scene */
export function drawStrangers({ brush, view, store, style, body, height }) {
  for (const robot of store.world?.entities ?? []) {
    if (robot.kind !== "robot") continue;
    // Recordings of 1.2 and before have no bodies: theirs were e-pucks.
    const { radius_m: radius = body, height_m: top = height } = robot;
    const shape = { centre: /** @type {Point} */ ([robot.x_m, robot.y_m]), radius };
    brush.fill(shape, 0, style.stranger, 0.35);
    if (view.flat) {
      drawBody(brush, [robot.x_m, robot.y_m, 0], robot.yaw_rad, radius, style.stranger, false);
      continue;
    }
    brush.fill(shape, top, style.stranger, 0.35);
    drawEdges(brush, shape, 0, top, style.stranger, 1.3);
    drawHeading(brush, [robot.x_m, robot.y_m, top], robot.yaw_rad, radius, style.stranger, 2);
  }
}

/** Draws all robots; gives where they are. Through a lens rings and names are the tracker's, see cameras.js:
 * here is what nobody sees of them.
 * @param {Scene} scene */
export function drawRobots(scene) {
  const { store, view, pen, arena, signals, height } = scene;
  /** @type {DrawnRobot[]} */
  const drawn = [];
  if (!arena) return drawn;
  const virtual = new Map((signals?.leds.tag ?? []).map((tag, row) => [tag, signals?.leds.color[row]]));
  const { tag, x_m, y_m, yaw_rad, age_ns, seen } = arena.robots;
  for (let row = 0; row < tag.length; row += 1) {
    const isObject = store.objects.has(tag[row]);
    if (x_m[row] === null || (isObject && !view.flat)) continue;
    const top = /** @type {Vector} */ ([x_m[row], y_m[row], store.heights.get(tag[row]) ?? height]);
    const spot = view.spot(top);
    if (!spot) continue;
    const robot = { tag: tag[row], x_px: spot[0], y_px: spot[1], x_m: x_m[row], y_m: y_m[row] };
    drawn.push(robot);
    // What has not been seen for a while fades, but never quite: it is somewhere.
    if (view.flat) pen.globalAlpha = seen[row] ? 1 : Math.max(0.35, 1 - age_ns[row] / FADE_NS);
    const sized = { ...scene, body: store.radii.get(tag[row]) ?? scene.body };
    if (isObject) drawObject(sized, spot);
    else drawRobot(sized, robot.tag, top, yaw_rad[row], seen[row], virtual.get(robot.tag));
    pen.globalAlpha = 1;
  }
  return drawn;
}

/** @param {Scene} scene @param {number} tag */
function ledsOf({ store }, tag) {
  const row = store.rows.get(tag);
  return row === undefined ? 0 : store.robots?.leds[row] ?? 0;
}

/** @param {Scene} scene @param {number} tag */
function inTrouble({ store }, tag) {
  const row = store.rows.get(tag);
  return row !== undefined && Boolean(store.robots?.trouble[row]);
}

/** The light of a robot's LEDs: those in its ring, and its body's.
 * @param {Brush} brush @param {Vector} top @param {number} body @param {number} leds @param {string} colour */
export function drawLedGlow(brush, top, body, leds, colour) {
  if (leds & RING) brush.halo(top, 2.6 * body, colour);
  if (leds & BODY_LED) brush.halo(top, 1.6 * body, BODY_LED_COLOUR);
}

/** @param {Scene} scene @param {Spot} spot */
function drawObject({ pen, view, colours, body }, [x, y, zoom]) {
  pen.strokeStyle = colours.cone;
  pen.lineWidth = 3 * view.ratio;
  pen.strokeRect(x - 0.5 * body * zoom, y - 0.5 * body * zoom, body * zoom, body * zoom);
}

/**
 * @param {Scene} scene @param {number} tag @param {Vector} top @param {number} yaw @param {boolean} seen
 * @param {Colour | undefined} virtual */
function drawRobot(scene, tag, top, yaw, seen, virtual) {
  const { view, brush, colours, style, body } = scene;
  const leds = ledsOf(scene, tag);
  /** @type {Point} */
  const centre = [top[0], top[1]];
  const around = (/** @type {number} */ radii) => ({ centre, radius: radii * body });
  if (virtual) brush.halo(top, 2.6 * body, rgb(virtual));
  drawLedGlow(brush, top, body, view.flat ? leds : leds & RING, style.led);
  if (tag === scene.chosen) brush.outline(around(2.6), top[2], view.flat ? colours.ink : "#fff", view.flat ? 2 : 1.8);
  if (!view.flat) {
    if (tag === scene.chosen && isInPicture(view, top)) drawSenses(scene, top, yaw);
    return;
  }
  if (inTrouble(scene, tag)) brush.outline(around(2.2), 0, colours.amber, 2);
  drawBody(brush, top, yaw, body, colours.robot, !seen);
  drawLeds(brush, top, yaw, body, leds, colours.led);
}

/** Whether a camera sees a place: of what its neighbour sees, nothing is written into its picture.
 * @param {View} view @param {Vector} place */
function isInPicture(view, place) {
  const [x, y] = view.spot(place) ?? [-1, -1];
  const { width_px, height_px } = view instanceof ThroughLens ? view.lens.model : { width_px: 0, height_px: 0 };
  const zoom = view instanceof ThroughLens ? view.zoom : 0;
  return x >= 0 && y >= 0 && x <= width_px * zoom && y <= height_px * zoom;
}

/** A ring with a line where it heads to.
 * @param {Brush} brush @param {Vector} top @param {number} yaw @param {number} body @param {string} colour
 * @param {boolean} dashed */
export function drawBody(brush, top, yaw, body, colour, dashed) {
  const { pen, view } = brush;
  const radius = (body * (view.spot(top)?.[2] ?? 0)) / view.ratio;
  if (dashed) pen.setLineDash([3 * view.ratio, 3 * view.ratio]);
  brush.outline({ centre: [top[0], top[1]], radius: body }, top[2], colour, Math.max(0.26 * radius, 1.5));
  pen.setLineDash([]);
  drawHeading(brush, top, yaw, body, colour, Math.max(0.2 * radius, 1.2));
}

/**
 * @param {Brush} brush @param {Vector} top @param {number} yaw @param {number} body @param {string} colour
 * @param {number} width */
export function drawHeading(brush, [x, y, z], yaw, body, colour, width) {
  const reach = HEADING * body;
  brush.lines([[[x, y, z], [x + reach * Math.cos(yaw), y + reach * Math.sin(yaw), z]]], colour, width);
}

/** The e-puck's ring: LED 0 in front, the others clockwise; and the one in front of it.
 * @param {Brush} brush @param {number[]} place @param {number} yaw @param {number} body @param {number} leds
 * @param {string} colour */
export function drawLeds({ pen, view }, [x, y], yaw, body, leds, colour) {
  if (!leds) return;
  pen.fillStyle = colour;
  pen.beginPath();
  const dot = (/** @type {number} */ angle, /** @type {number} */ far, /** @type {number} */ radius) => {
    const centre = /** @type {Point} */ ([x + far * Math.cos(angle), y + far * Math.sin(angle)]);
    const spot = view.spot([centre[0], centre[1], 0]);
    if (!spot) return;
    pen.moveTo(spot[0], spot[1]);
    view.area(pen, { centre, radius }, 0);
  };
  for (let led = 0; led < RING_LEDS; led += 1) {
    if (leds & (1 << led)) dot(yaw - (led * 2 * Math.PI) / RING_LEDS, body, 0.26 * body);
  }
  if (leds & FRONT_LED) dot(yaw, 1.35 * body, 0.36 * body);
  pen.fill();
}

// -- what one senses -----------------------------------------------------------------------

/** The chosen robot's rays, from above.
 * @param {Scene} scene */
export function drawChosenRays(scene) {
  const { arena, chosen, body } = scene;
  const row = arena && chosen !== null ? arena.robots.tag.indexOf(chosen) : -1;
  if (!arena || row < 0) return;
  const { x_m, y_m, yaw_rad } = arena.robots;
  drawRays(scene, [x_m[row], y_m[row], 0], yaw_rad[row], body, RAY_M, 2.5);
}

/** Rays from the chosen robot's rim; the longest is as long as the sensor's largest number so far.
 * @param {Scene} scene @param {Vector} top @param {number} yaw @param {number} from
 * @param {number} length both from the middle @param {number} width */
export function drawRays({ brush, pen, store, style, chosen }, [x, y, z], yaw, from, length, width) {
  if (chosen === null) return;
  let number = -1;
  for (const { sensor, values, age_ns } of store.sensed(chosen)) {
    const angles = sensor.angles_rad;
    if (!angles?.length) continue;
    number += 1;
    if (age_ns === null) continue;
    const peak = store.peak(sensor.name, values.slice(0, angles.length));
    const lines = angles.map((angle, index) => {
      // Several sensors that look the same way stand side by side.
      const turn = yaw + angle + 0.05 * number;
      const reach = from + (length - from) * Math.min(Math.abs(values[index] ?? 0) / peak, 1);
      const [cosine, sine] = [Math.cos(turn), Math.sin(turn)];
      return [from, reach].map((far) => /** @type {Vector} */ ([x + far * cosine, y + far * sine, z]));
    });
    pen.globalAlpha = age_ns > OLD_NS ? 0.35 : style.rayAlpha;
    brush.lines(lines, style.rays[number % style.rays.length], width);
    pen.globalAlpha = 1;
  }
}

/** The colour of a sensor's rays from above, or null where it has none.
 * @param {Sensor[]} sensors @param {string} name @param {Record<string, string>} colours */
export function rayColour(sensors, name, colours) {
  const looking = sensors.filter((sensor) => sensor.angles_rad?.length).map((sensor) => sensor.name);
  const number = looking.indexOf(name);
  const rays = STYLES.above(colours).rays;
  return number < 0 ? null : rays[number % rays.length];
}

/** Rays, and below the robot in words what looks nowhere.
 * @param {Scene} scene @param {Vector} top @param {number} yaw */
function drawSenses(scene, top, yaw) {
  const { store, chosen, body } = scene;
  if (chosen === null) return;
  drawRays(scene, top, yaw, body, RAY_M, 2.5);
  store.sensed(chosen)
    .filter(({ sensor, values, age_ns }) => age_ns !== null && !sensor.angles_rad?.length && values.length <= 3)
    .slice(0, WORDS)
    .forEach(({ sensor, values }, line) => {
      drawLabel(scene, `${sensor.name} ${values.map(reading).join(", ")}`, top, 2.6 * body, line + 1);
    });
}

// -- trails and names, from above ----------------------------------------------------------

/** @param {Scene} scene */
export function drawTrails({ brush, pen, store, colours, chosen }) {
  const trails = [...store.trails].filter(([tag]) => tag !== chosen).map(([, trail]) => trail);
  const from_s = store.trails.size > MANY ? (store.now.time_s ?? 0) - SHORT_TRAIL_S : -Infinity;
  pen.globalAlpha = 0.6;
  brush.lines(trails.map(({ points, times_s }) => points.filter((_, at) => times_s[at] >= from_s)), colours.trail, 1.2);
  pen.globalAlpha = 1;
  const own = chosen === null ? undefined : store.trails.get(chosen);
  if (own) brush.lines([own.points], colours.trail, 2.4);
}

/** Names beside robots and things, where they touch nothing: neither each other, nor walls, nor the scale bar.
 * @param {Scene} scene @param {DrawnRobot[]} robots @param {Names} names @param {number | null} hovered */
export function drawNames(scene, robots, names, hovered) {
  const { pen, view, store, colours, chosen, body } = scene;
  if (!(view instanceof FromAbove)) return;
  const { ratio, zoom } = view;
  const virtual = (store.world?.entities ?? []).flatMap((thing) => (thing.kind === "robot" ? [thing] : []));
  const visitors = virtual.map(({ tag, id, x_m, y_m }) => ({ tag, text: id, x: view.x(x_m), y: view.y(y_m), rank: 3 }));
  const things = robots.map(({ tag, x_px, y_px }) => {
    const sign = inTrouble(scene, tag);
    const rank = tag === chosen || tag === hovered ? 0 : 2 - Number(sign);
    return { tag, text: store.label(tag), x: x_px, y: y_px, sign, rank };
  });
  const size = Math.max(12, Math.min(15, (0.062 * zoom) / ratio)) * ratio;
  const [left, top, width, height] = view.edges;
  const inner = 5 * ratio;
  const room = { left: left + inner, top: top + inner, right: left + width - inner, bottom: top + height - inner };
  const walls = [view.scaleBar, ...solidBoxes(scene.store, view)];
  const looks = { ink: colours.ink, halo: colours.floor, sign: colours.amber };
  names.write(pen, [...things, ...visitors], 1.2 * body * zoom, size, room, walls, looks);
}

/** What stands in the arena, as boxes of the picture; large ones frame it, and leave no room inside.
 * @param {Store} store @param {FromAbove} view */
function solidBoxes({ world }, view) {
  return (world?.entities ?? []).flatMap((thing) => {
    if (thing.kind !== "box" && thing.kind !== "cylinder") return [];
    const corners = rim(outlineOf(thing));
    const [xs, ys] = [corners.map(([x]) => view.x(x)), corners.map(([, y]) => view.y(y))];
    return [{ left: Math.min(...xs), right: Math.max(...xs), top: Math.min(...ys), bottom: Math.max(...ys) }];
  });
}
