// Draws shapes of the arena through a view of it.

import { rim } from "./projections.js";

const DASH_M = 0.04;
/** Discs that make a light: shares of its radius, and how strong each is. */
const HALO = [[1, 0.1], [0.82, 0.13], [0.64, 0.18], [0.46, 0.3]];

/** A pen that is told places [m] instead of pixels. Widths are pixels of the screen. */
export class Brush {
  /** @param {Pen} pen @param {View} view */
  constructor(pen, view) {
    this.pen = pen;
    this.view = view;
  }

  /** Tints an area.
   * @param {Shape} shape @param {number} z @param {string} colour @param {number} share */
  fill(shape, z, colour, share) {
    const { pen, view } = this;
    pen.beginPath();
    view.area(pen, shape, z);
    pen.globalAlpha = share;
    pen.fillStyle = colour;
    pen.fill();
    pen.globalAlpha = 1;
  }

  /** @param {Shape} shape @param {number} z @param {string} colour @param {number} width */
  outline(shape, z, colour, width) {
    this.#stroke(colour, width, () => this.view.outline(this.pen, shape, z));
  }

  /** Every other piece of an outline on the floor.
   * @param {Shape} shape @param {string} colour @param {number} width */
  dashes(shape, colour, width) {
    const { pen, view } = this;
    if (view.flat) {
      pen.setLineDash([5 * view.ratio, 4 * view.ratio]);
      this.outline(shape, 0, colour, width);
      pen.setLineDash([]);
    } else {
      // A lens bends dashes, too.
      this.#stroke(colour, width, () => dashesOf(rim(shape)).forEach((dash) => view.line(pen, dash)));
    }
  }

  /** Lines, in one stroke: a hundred cost little more than one.
   * @param {Vector[][]} lines @param {string} colour @param {number} width */
  lines(lines, colour, width) {
    this.#stroke(colour, width, () => lines.forEach((points) => this.view.line(this.pen, points)));
  }

  /** Light around a place, which fades to nothing.
   * @param {Vector} point @param {number} radius @param {string} colour */
  halo(point, radius, colour) {
    for (const [part, share] of HALO) this.glow(point, part * radius, colour, share);
  }

  /** Tints a disc, which is as round as the picture.
   * @param {Vector} point @param {number} radius @param {string} colour @param {number} share */
  glow(point, radius, colour, share) {
    const spot = this.view.spot(point);
    if (!spot) return;
    const { pen } = this;
    pen.globalAlpha = share;
    pen.fillStyle = colour;
    pen.beginPath();
    pen.arc(spot[0], spot[1], radius * spot[2], 0, 2 * Math.PI);
    pen.fill();
    pen.globalAlpha = 1;
  }

  /** @param {string} colour @param {number} width @param {() => void} path */
  #stroke(colour, width, path) {
    const { pen, view } = this;
    pen.beginPath();
    path();
    pen.strokeStyle = colour;
    pen.lineWidth = width * view.ratio;
    pen.stroke();
  }
}

/** @param {Point[]} corners @returns {Vector[][]} */
function dashesOf(corners) {
  /** @type {Vector[][]} */
  const dashes = [];
  corners.forEach((start, index) => {
    const end = corners[(index + 1) % corners.length];
    const count = 2 * Math.max(Math.round(Math.hypot(end[0] - start[0], end[1] - start[1]) / (2 * DASH_M)), 1);
    const point = (/** @type {number} */ step) => /** @type {Vector} */ ([
      start[0] + (step / count) * (end[0] - start[0]), start[1] + (step / count) * (end[1] - start[1]), 0,
    ]);
    for (let step = 0; step < count; step += 2) dashes.push([point(step), point(step + 1)]);
  });
  return dashes;
}
