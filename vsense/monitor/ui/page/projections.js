// Where places of the arena are in a picture: from above, or through a camera's lens.
// As vsense/monitor/pictures/_projections.py; see `View` in types.d.ts.

const MARGIN_M = 0.04;
const MARGIN_PX = 10;
/** Length of the bar that says how large things are. */
export const SCALE_BAR_M = 0.5;
const RIM = Array.from({ length: 36 }, (_, at) => [Math.cos((at * Math.PI) / 18), Math.sin((at * Math.PI) / 18)]);

/** The shape that the arena's panel takes, as CSS has it.
 * @param {number[]} size */
export const aspectOf = ([width, height]) => `${(width + MARGIN_M).toFixed(3)} / ${(height + MARGIN_M).toFixed(3)}`;

/** The whole arena in a canvas; +y points up.
 * @implements {View} */
export class FromAbove {
  flat = true;

  /**
   * @param {HTMLCanvasElement} canvas
   * @param {number[]} size width and height [m].
   * @param {number[]} centre of the arena.
   */
  static of(canvas, size, centre) {
    const ratio = canvas.width / Math.max(canvas.clientWidth, 1);
    const room = (/** @type {number} */ side) => Math.max(side - 2 * MARGIN_PX * ratio, 1);
    const zoom = Math.min(room(canvas.width) / (size[0] + MARGIN_M), room(canvas.height) / (size[1] + MARGIN_M));
    const left = canvas.width / 2 - centre[0] * zoom;
    return new FromAbove(left, canvas.height / 2 + centre[1] * zoom, zoom, ratio, size, centre);
  }

  /** `left` and `top` are the pixel of the origin, `zoom` the pixels of a metre. */
  constructor(left = 0, top = 0, zoom = 1, ratio = 1, size = [0, 0], centre = [0, 0]) {
    this.left = left;
    this.top = top;
    this.zoom = zoom;
    this.ratio = ratio;
    this.size = size;
    this.centre = centre;
  }

  /** @param {number} metres */
  x(metres) {
    return this.left + metres * this.zoom;
  }

  /** @param {number} metres */
  y(metres) {
    return this.top - metres * this.zoom;
  }

  /** The arena's edges: left, top, width, height [px].
   * @returns {[number, number, number, number]} */
  get edges() {
    return this.box(this.centre, this.size);
  }

  /** Where the scale bar is, with its words. */
  get scaleBar() {
    const [left, top, , height] = this.edges;
    const [x, y] = [left + 14 * this.ratio, top + height - 14 * this.ratio];
    return { left: x, top: y - 20 * this.ratio, right: x + SCALE_BAR_M * this.zoom, bottom: y + 3 * this.ratio };
  }

  /** Left, top, width and height of a rectangle around a place.
   * @param {number[]} centre @param {number[]} size @returns {[number, number, number, number]} */
  box([x, y], [width, height]) {
    return [this.x(x - width / 2), this.y(y + height / 2), width * this.zoom, height * this.zoom];
  }

  /** The nearest place inside the arena.
   * @param {number[]} place @returns {Point} */
  within([x, y]) {
    const [across, along] = [this.size[0] / 2, this.size[1] / 2];
    return [
      Math.min(Math.max(x, this.centre[0] - across), this.centre[0] + across),
      Math.min(Math.max(y, this.centre[1] - along), this.centre[1] + along),
    ];
  }

  /** @param {number[]} point @returns {Spot} */
  spot([x, y]) {
    return [this.x(x), this.y(y), this.zoom];
  }

  /** @param {Pen} pen @param {Shape} shape */
  area(pen, shape) {
    this.outline(pen, shape);
  }

  /** @param {Pen} pen @param {Shape} shape */
  outline(pen, shape) {
    if ("radius" in shape) {
      pen.arc(this.x(shape.centre[0]), this.y(shape.centre[1]), shape.radius * this.zoom, 0, 2 * Math.PI);
      return;
    }
    trace(pen, shape.corners.map(([x, y]) => [this.x(x), this.y(y)]));
    pen.closePath();
  }

  /** @param {Pen} pen @param {number[][]} points */
  line(pen, points) {
    trace(pen, points.map(([x, y]) => [this.x(x), this.y(y)]));
  }
}

/** A camera's whole picture.
 * @implements {View} */
export class ThroughLens {
  flat = false;
  /** Where words were written.
   * @type {import("./names.js").Rectangle[]} */
  words = [];

  /**
   * @param {Lens} lens
   * @param {number} zoom pixels of the canvas in one of the camera.
   * @param {number} ratio pixels of the canvas in one of the screen.
   */
  constructor(lens, zoom, ratio) {
    this.lens = lens;
    this.zoom = zoom;
    this.ratio = ratio;
  }

  /** @param {Vector} point @returns {Spot | null} */
  spot(point) {
    const spot = this.lens.spot(point);
    if (!spot) return null;
    const [x, y] = this.#pixel(spot);
    return [x, y, spot[2] * this.zoom];
  }

  /** @param {Pen} pen @param {Shape} shape @param {number} z */
  area(pen, shape, z) {
    const seen = this.lens.area(at(rim(shape), z));
    if (seen.length > 2) trace(pen, seen.map((pixel) => this.#pixel(pixel)));
  }

  /** @param {Pen} pen @param {Shape} shape @param {number} z */
  outline(pen, shape, z) {
    this.line(pen, at(rim(shape), z), true);
  }

  /** @param {Pen} pen @param {Vector[]} points */
  line(pen, points, closed = false) {
    for (const piece of this.lens.line(points, closed)) trace(pen, piece.map((pixel) => this.#pixel(pixel)));
  }

  /** The middle of a pixel is a whole number.
   * @param {number[]} pixel @returns {Point} */
  #pixel([x, y]) {
    return [(x + 0.5) * this.zoom, (y + 0.5) * this.zoom];
  }
}

/** A line through pixels.
 * @param {Pen} pen @param {number[][]} pixels */
function trace(pen, pixels) {
  pixels.forEach(([x, y], index) => (index ? pen.lineTo(x, y) : pen.moveTo(x, y)));
}

/** Corners of an outline; a circle's are many.
 * @param {Shape} shape @returns {Point[]} */
export function rim(shape) {
  if ("corners" in shape) return shape.corners;
  const { centre: [x, y], radius } = shape;
  return RIM.map(([u, v]) => [x + radius * u, y + radius * v]);
}

/** @param {Point[]} outline @param {number} z @returns {Vector[]} */
const at = (outline, z) => outline.map(([x, y]) => [x, y, z]);
