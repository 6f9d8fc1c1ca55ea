// The virtual world: one drawing for the arena from above and for cameras' pictures.
// As vsense/monitor/pictures/_scene.py draws them for videos; where things are is the view's matter.

import { FromAbove, ThroughLens, rim } from "./projections.js";

const LAMP_M = 0.035;
const CONE_SOURCE_M = 0.05;
const GLOW = [[0.3, 0.12], [0.18, 0.16], [0.09, 0.3]];

/** Colours and strengths upon the panel's ground and upon a camera's picture. */
export const STYLES = {
  above: (/** @type {Record<string, string>} */ colours) => ({
    zone: colours.muted, fence: colours.red, virtual: colours.virtual, stranger: colours.stranger, led: colours.led,
    rays: [colours.ray, colours.ray2, colours.ray3],
    coneFill: 0.26, coneSource: 3, solidFill: 0.32, rayAlpha: 0.85,
  }),
  lens: () => ({
    zone: "#c8ced6", fence: "#ff6b66", virtual: "#b984e0", stranger: "#3cc4ae", led: "#ff8a5c",
    rays: ["#4fd0e0", "#e48ad2", "#e0c24a"],
    coneFill: 0.28, coneSource: 2.5, solidFill: 0.35, rayAlpha: 0.9,
  }),
};

/** @typedef {ReturnType<typeof sceneOf>} Scene */

/** What is drawn: newest or of the moment of a picture.
 * @param {Brush} brush @param {Store} store
 * @param {Record<string, string>} colours @param {number | null} chosen
 * @param {ArenaMessage | null} arena @param {SignalsMessage | null} signals */
export function sceneOf(brush, store, colours, chosen, arena, signals) {
  const style = brush.view.flat ? STYLES.above(colours) : STYLES.lens();
  const { body_radius_m: body = 0, body_height_m: height = 0 } = store.experiment ?? {};
  return { brush, pen: brush.pen, view: brush.view, store, colours, chosen, arena, signals, style, body, height };
}

/** @param {(number | null)[]} colour */
export const rgb = (colour) => `rgb(${colour.join(" ")})`;

/** The outline of a thing on the floor.
 * @param {Box | Cylinder | Zone} thing @returns {Shape} */
export function outlineOf(thing) {
  const [x, y] = thing.kind === "zone" ? [thing.x_m, thing.y_m] : thing.position_m;
  if (thing.kind === "cylinder" || (thing.kind === "zone" && thing.shape === "circle")) {
    return { centre: [x, y], radius: thing.radius_m };
  }
  const [cosine, sine] = [Math.cos(thing.yaw_rad), Math.sin(thing.yaw_rad)];
  const corners = [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([along, across]) => {
    const [u, v] = [(along * thing.size_m[0]) / 2, (across * thing.size_m[1]) / 2];
    return /** @type {Point} */ ([x + u * cosine - v * sine, y + u * sine + v * cosine]);
  });
  return { corners };
}

// -- things --------------------------------------------------------------------------------

/** @param {Scene} scene */
export function drawZones(scene) {
  const { brush, store, style } = scene;
  for (const zone of store.world?.entities ?? []) {
    if (zone.kind !== "zone") continue;
    const colour = zone.color ? rgb(zone.color) : style.zone;
    if (zone.color) brush.fill(outlineOf(zone), 0, colour, 0.28);
    brush.dashes(outlineOf(zone), colour, 1.3);
    drawLabel(scene, zone.id, [zone.x_m, zone.y_m, 0]);
  }
}

/** Where no robot may be: beyond the border, in forbidden zones, and around what they keep off.
 * @param {Scene} scene */
export function drawFence({ brush, store, arena, style }) {
  const fence = store.experiment?.arena.fence;
  if (!fence) return;
  brush.outline({ corners: fence.boundary }, 0, style.fence, 2);
  for (const corners of fence.forbidden) {
    brush.fill({ corners }, 0, style.fence, 0.14);
    brush.outline({ corners }, 0, style.fence, 1.5);
  }
  for (const { tag, distance_m } of fence.keep_off) {
    const row = arena?.robots.tag.indexOf(tag) ?? -1;
    const [x, y] = [arena?.robots.x_m[row], arena?.robots.y_m[row]];
    if (typeof x !== "number" || typeof y !== "number") continue;
    brush.dashes({ centre: [x, y], radius: distance_m }, style.fence, 1.5);
  }
}

/** @param {Scene} scene */
export function drawCones({ brush, signals, colours, style }) {
  for (const { x_m, y_m } of signals?.cones ?? []) {
    const corners = x_m.map((x, corner) => /** @type {Point} */ ([x, y_m[corner]]));
    brush.fill({ corners }, 0, colours.cone, style.coneFill);
    brush.outline({ corners }, 0, colours.cone, 2);
    brush.outline({ centre: corners[0], radius: CONE_SOURCE_M }, 0, colours.cone, style.coneSource);
  }
}

/** Boxes and cylinders that are only sensed.
 * @param {Scene} scene */
export function drawVirtualSolids({ brush, view, store, style }) {
  for (const solid of solidsOf(store, false)) {
    const [base, top] = heightsOf(solid);
    brush.fill(outlineOf(solid), base, style.virtual, style.solidFill);
    if (!view.flat) brush.fill(outlineOf(solid), top, style.virtual, 0.3);
    drawEdges(brush, outlineOf(solid), base, top, style.virtual, 1.5);
  }
}

/** What really stands there. A camera sees it: its edges show whether it is where the file says.
 * @param {Scene} scene */
export function drawPhysicalSolids({ brush, view, store, colours }) {
  for (const solid of solidsOf(store, true)) {
    const [base, top] = heightsOf(solid);
    if (view.flat) brush.fill(outlineOf(solid), base, colours.solid, 1);
    drawEdges(brush, outlineOf(solid), base, top, view.flat ? colours["solid-line"] : "#dee2e6", view.flat ? 1 : 0.8);
  }
}

/** @param {Store} store @param {boolean} physical */
function solidsOf({ world }, physical) {
  return (world?.entities ?? []).flatMap((entity) => {
    const isSolid = entity.kind === "box" || entity.kind === "cylinder";
    return isSolid && entity.physical === physical ? [entity] : [];
  });
}

/** @param {Box | Cylinder} solid */
function heightsOf(solid) {
  const base = solid.position_m[2];
  return [base, base + (solid.kind === "cylinder" ? solid.height_m : solid.size_m[2])];
}

/**
 * @param {Brush} brush @param {Shape} shape @param {number} base @param {number} top @param {string} colour
 * @param {number} width */
export function drawEdges(brush, shape, base, top, colour, width) {
  brush.outline(shape, base, colour, width);
  if (brush.view.flat) return;
  brush.outline(shape, top, colour, width);
  const corners = rim(shape);
  const step = corners.length > 8 ? Math.floor(corners.length / 6) : 1;
  const posts = corners.filter((_, corner) => corner % step === 0);
  brush.lines(posts.map(([x, y]) => [[x, y, base], [x, y, top]]), colour, width);
}

/** Lights; from above one that hangs outside of the arena is at its edge, where its glow ends.
 * @param {Scene} scene */
export function drawLights({ brush, pen, view, store, colours }) {
  for (const light of store.world?.entities ?? []) {
    if (light.kind !== "light") continue;
    const [x, y] = view instanceof FromAbove ? view.within(light.position_m) : light.position_m;
    const point = /** @type {Vector} */ ([x, y, light.position_m[2]]);
    const colour = light.color.every((part) => part === 255) ? colours.lamp : rgb(light.color);
    if (!view.flat) brush.lines([[[x, y, 0], point]], colours.lamp, 1);
    pen.save();
    if (view instanceof FromAbove) {
      pen.beginPath();
      pen.rect(...view.edges);
      pen.clip();
    }
    for (const [radius, share] of GLOW) brush.glow(point, radius, colour, share);
    pen.restore();
    brush.glow(point, LAMP_M, colour, 1);
    if (view.flat) brush.outline({ centre: [x, y], radius: LAMP_M }, 0, colours.ink, 1);
  }
}

/** Writes a line at a place, or so many lines below it.
 * @param {Scene} scene @param {string} text @param {Vector} point @param {number} below [m] @param {number} line */
export function drawLabel({ pen, view, colours }, text, point, below = 0, line = 0) {
  const spot = view.spot(point);
  if (!spot) return;
  const [x, y] = [spot[0], spot[1] + below * spot[2] + line * 13 * view.ratio];
  pen.textAlign = "center";
  pen.font = `${view.flat ? "" : "600 "}${12 * view.ratio}px system-ui, sans-serif`;
  if (!(view instanceof ThroughLens)) {
    pen.fillStyle = colours.muted;
    pen.fillText(text, x, y + 4 * view.ratio);
  } else {
    pen.strokeStyle = "#000b";
    pen.lineWidth = 2.5 * view.ratio;
    pen.strokeText(text, x, y);
    pen.fillStyle = "#fff";
    pen.fillText(text, x, y);
    const [half, high, low] = [pen.measureText(text).width / 2, 12 * view.ratio, 3 * view.ratio];
    view.words.push({ left: x - half, top: y - high, right: x + half, bottom: y + low });
  }
  pen.textAlign = "left";
}
