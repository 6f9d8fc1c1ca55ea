// The virtual world above the floor: cones, boxes and cylinders that are only sensed, lights.

import { outline } from "./arena_ground.js";

export function drawCones({ pen, place, store, colours }) {
  for (const cone of store.signals?.cones ?? []) {
    pen.beginPath();
    cone.x_m.forEach((x, corner) => pen.lineTo(place.x(x), place.y(cone.y_m[corner])));
    pen.closePath();
    pen.globalAlpha = 0.26;
    pen.fillStyle = colours.cone;
    pen.fill();
    pen.globalAlpha = 1;
    pen.strokeStyle = colours.cone;
    pen.lineWidth = 2 * place.ratio;
    pen.stroke();
    pen.beginPath();
    pen.arc(place.x(cone.x_m[0]), place.y(cone.y_m[0]), 0.05 * place.zoom, 0, 2 * Math.PI);
    pen.lineWidth = 3 * place.ratio;
    pen.stroke();
  }
}

export function drawVirtual({ pen, place, store, colours }) {
  for (const told of store.world?.entities ?? []) {
    if ((told.kind !== "box" && told.kind !== "cylinder") || told.physical) continue;
    outline(pen, place, told);
    pen.globalAlpha = 0.32;
    pen.fillStyle = colours.virtual;
    pen.fill();
    pen.globalAlpha = 1;
    pen.strokeStyle = colours.virtual;
    pen.lineWidth = 1.5 * place.ratio;
    pen.stroke();
  }
}

export function drawLights({ pen, place, store, colours }) {
  const [halfWidth, halfHeight] = [place.size[0] / 2, place.size[1] / 2];
  const within = (value, centre, half) => Math.min(Math.max(value, centre - half), centre + half);
  for (const told of store.world?.entities ?? []) {
    if (told.kind !== "light") continue;
    // One that hangs outside of the arena is drawn at its edge.
    const x = place.x(within(told.position_m[0], place.centre[0], halfWidth));
    const y = place.y(within(told.position_m[1], place.centre[1], halfHeight));
    const white = told.color.every((part) => part === 255);
    const colour = white ? colours.lamp : `rgb(${told.color.join(" ")})`;
    // The glow ends with the arena.
    pen.save();
    pen.beginPath();
    pen.rect(
      place.x(place.centre[0] - halfWidth), place.y(place.centre[1] + halfHeight),
      2 * halfWidth * place.zoom, 2 * halfHeight * place.zoom,
    );
    pen.clip();
    for (const [radius, share] of [[0.3, 0.12], [0.18, 0.16], [0.09, 0.3]]) glow(pen, x, y, radius * place.zoom, colour, share);
    pen.restore();
    pen.beginPath();
    pen.arc(x, y, 0.035 * place.zoom, 0, 2 * Math.PI);
    pen.fillStyle = colour;
    pen.fill();
    pen.strokeStyle = colours.ink;
    pen.lineWidth = place.ratio;
    pen.stroke();
  }
}

/** Tints a disc. */
export function glow(pen, x, y, radius, colour, share) {
  pen.globalAlpha = share;
  pen.fillStyle = colour;
  pen.beginPath();
  pen.arc(x, y, radius, 0, 2 * Math.PI);
  pen.fill();
  pen.globalAlpha = 1;
}
