// A camera's lens model: where places of the arena are in its picture, and what of them it can show.
// As vsense/vision/cameras/camera.py, image_plane.py and vsense/monitor/pictures/_projections.py, which say why.

const NEAR_M = 0.02;
const DIRECTIONS = 48;
const REACH = 6;
const REACH_STEP = 0.01;
const MARGIN = 0.05;
const BEND_PX = 6;
const MOST_STEPS = 400;
const BESIDE_M = 0.01;
const UNDISTORT_STEPS = 12;
const UNDISTORT_ENOUGH = 1e-10;

/** One camera; points are [x, y, z] in m in the arena frame, pixels those of the whole picture. */
export class Lens {
  /** @param {CameraModel} model */
  constructor(model) {
    this.model = model;
    this.radius = this.#windowRadius();
    this.normals = Array.from({ length: DIRECTIONS }, (_, side) => {
      const turn = ((side + 0.5) * 2 * Math.PI) / DIRECTIONS;
      return [Math.cos(turn), Math.sin(turn)];
    });
  }

  /** A point in the camera's frame: z along its axis.
   * @param {number[]} point @returns {Vector} */
  seen([x, y, z]) {
    const { rotation: r, position_m: c } = this.model;
    const [u, v, w] = [x - c[0], y - c[1], z - c[2]];
    return [r[0] * u + r[1] * v + r[2] * w, r[3] * u + r[4] * v + r[5] * w, r[6] * u + r[7] * v + r[8] * w];
  }

  /** Where the lens shows a point of the normalised image plane, on that plane.
   * @param {number} x @param {number} y @returns {Point} */
  distort(x, y) {
    const [k1, k2, p1, p2, k3] = this.model.distortion;
    const r2 = x * x + y * y;
    const radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3));
    const xy = 2 * x * y;
    return [x * radial + p1 * xy + p2 * (r2 + 2 * x * x), y * radial + p1 * (r2 + 2 * y * y) + p2 * xy];
  }

  /** The inverse of `distort`, by Newton's method.
   * @param {number} xSeen @param {number} ySeen @returns {Point} */
  undistort(xSeen, ySeen) {
    const [k1, k2, p1, p2, k3] = this.model.distortion;
    let [x, y] = [xSeen, ySeen];
    for (let step = 0; step < UNDISTORT_STEPS; step += 1) {
      const [xNow, yNow] = this.distort(x, y);
      const [dx, dy] = [xSeen - xNow, ySeen - yNow];
      if (Math.max(Math.abs(dx), Math.abs(dy)) < UNDISTORT_ENOUGH) break;
      const r2 = x * x + y * y;
      const radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3));
      const slope = 2 * (k1 + r2 * (2 * k2 + r2 * 3 * k3));
      const a = radial + slope * x * x + 2 * p1 * y + 6 * p2 * x;
      const b = slope * x * y + 2 * (p1 * x + p2 * y);
      const d = radial + slope * y * y + 6 * p1 * y + 2 * p2 * x;
      const scale = 1 / (a * d - b * b);
      [x, y] = [x + (d * dx - b * dy) * scale, y + (a * dy - b * dx) * scale];
    }
    return [x, y];
  }

  /** The pixel of a point of the normalised image plane.
   * @param {number[]} point @returns {Point} */
  pixel([x, y]) {
    const { fx_px, fy_px, cx_px, cy_px } = this.model;
    const [u, v] = this.distort(x, y);
    return [fx_px * u + cx_px, fy_px * v + cy_px];
  }

  /** The floor's [x, y] in a pixel; null where the camera sees none of it.
   * @param {number} column @param {number} row @returns {Point | null} */
  floor(column, row) {
    const { fx_px, fy_px, cx_px, cy_px, rotation: r, position_m: c } = this.model;
    const [x, y] = this.undistort((column - cx_px) / fx_px, (row - cy_px) / fy_px);
    const reach = -c[2] / (r[2] * x + r[5] * y + r[8]);
    if (!(x * x + y * y <= this.radius * this.radius) || !(reach >= NEAR_M)) return null;
    return [c[0] + reach * (r[0] * x + r[3] * y + r[6]), c[1] + reach * (r[1] * x + r[4] * y + r[7])];
  }

  /** A point's pixel and the pixels of a metre beside it; null: it is not seen.
   * @param {number[]} point @returns {Spot | null} */
  spot([x, y, z]) {
    const beside = [[x, y, z], [x + BESIDE_M, y, z], [x, y + BESIDE_M, z]].map((point) => this.seen(point));
    if (beside.some((point) => point[2] < NEAR_M)) return null;
    const plane = beside.map(([u, v, w]) => [u / w, v / w]);
    if (plane.some(([u, v]) => Math.hypot(u, v) > this.radius)) return null;
    const [here, right, up] = plane.map((point) => this.pixel(point));
    const area = (right[0] - here[0]) * (up[1] - here[1]) - (right[1] - here[1]) * (up[0] - here[0]);
    return [here[0], here[1], Math.sqrt(Math.abs(area)) / BESIDE_M];
  }

  /** The pixels of what is to be seen of an area; empty: nothing.
   * @param {number[][]} points @returns {Point[]} */
  area(points) {
    const front = cut(points.map((point) => this.seen(point)), (point) => point[2] - NEAR_M);
    /** @type {number[][]} */
    let plane = front.map(([x, y, z]) => [x / z, y / z]);
    const reach = this.radius * Math.cos(Math.PI / DIRECTIONS);
    if (plane.some(([x, y]) => Math.hypot(x, y) > reach)) {
      for (const [a, b] of this.normals) plane = cut(plane, ([x, y]) => reach - a * x - b * y);
    }
    return plane.flatMap((start, index) => this.#bend(start, plane[(index + 1) % plane.length]).slice(0, -1));
  }

  /** The pieces, in pixels, of what is to be seen of a line.
   * @param {number[][]} points @returns {Point[][]} */
  line(points, closed = false) {
    const seen = points.map((point) => this.seen(point));
    if (closed) seen.push(seen[0]);
    /** @type {Point[][]} */
    const pieces = [];
    /** @type {Point | null} */
    let last = null;
    for (let index = 1; index < seen.length; index += 1) {
      const ends = this.#visible(seen[index - 1], seen[index]);
      if (!ends) {
        last = null;
        continue;
      }
      const [start, end] = ends;
      const bent = this.#bend(start, end);
      if (last && last[0] === start[0] && last[1] === start[1]) pieces[pieces.length - 1].push(...bent);
      else pieces.push(bent);
      last = end;
    }
    return pieces;
  }

  /** The ends, on the image plane, of what is to be seen of a line; null: nothing.
   * @param {number[]} start @param {number[]} end @returns {[Point, Point] | null} */
  #visible(start, end) {
    if (start[2] < NEAR_M && end[2] < NEAR_M) return null;
    if (start[2] < NEAR_M || end[2] < NEAR_M) {
      const share = (NEAR_M - start[2]) / (end[2] - start[2]);
      const meeting = start.map((value, axis) => value + share * (end[axis] - value));
      [start, end] = start[2] < NEAR_M ? [meeting, end] : [start, meeting];
    }
    const [x, y] = [start[0] / start[2], start[1] / start[2]];
    const [u, v] = [end[0] / end[2] - x, end[1] / end[2] - y];
    const square = u * u + v * v;
    const beyond = x * x + y * y - this.radius * this.radius;
    if (square === 0) return null;
    const middle = -(x * u + y * v) / square;
    const half = middle * middle - beyond / square;
    if (half <= 0) return null;
    const [first, last] = [Math.max(middle - Math.sqrt(half), 0), Math.min(middle + Math.sqrt(half), 1)];
    if (first >= last) return null;
    const far = last === 1 ? [end[0] / end[2], end[1] / end[2]] : [x + last * u, y + last * v];
    return [[x + first * u, y + first * v], [far[0], far[1]]];
  }

  /** Points that are so near to each other that the line bends with the lens.
   * @param {number[]} start @param {number[]} end @returns {Point[]} */
  #bend(start, end) {
    const { fx_px, fy_px } = this.model;
    const length = Math.hypot(end[0] - start[0], end[1] - start[1]) * Math.max(fx_px, fy_px);
    const steps = Math.min(Math.floor(length / BEND_PX) + 1, MOST_STEPS);
    return Array.from({ length: steps + 1 }, (_, step) => {
      const share = step / steps;
      return this.pixel([start[0] * (1 - share) + end[0] * share, start[1] * (1 - share) + end[1] * share]);
    });
  }

  // How far from its axis the lens model is right: a little beyond the picture, or where it folds back.
  #windowRadius() {
    const leaves = Math.max(...scan(REACH, (x, y) => this.#isOutside(this.pixel([x, y])) || this.#folds(x, y)));
    return Math.min(leaves, ...scan(leaves + 2 * REACH_STEP, (x, y) => this.#folds(x, y)));
  }

  /** @param {Point} pixel */
  #isOutside([column, row]) {
    const { width_px, height_px } = this.model;
    const [across, down] = [MARGIN * width_px, MARGIN * height_px];
    return column < -across || column > width_px + across || row < -down || row > height_px + down;
  }

  /** @param {number} x @param {number} y */
  #folds(x, y) {
    const step = 1e-6;
    const [right, left] = [this.distort(x + step, y), this.distort(x - step, y)];
    const [up, low] = [this.distort(x, y + step), this.distort(x, y - step)];
    return (right[0] - left[0]) * (up[1] - low[1]) - (up[0] - low[0]) * (right[1] - left[1]) <= 0;
  }
}

/** How far from the axis, in all directions, a place on the image plane is wanted.
 * @param {number} most @param {(x: number, y: number) => boolean} wanted @returns {number[]} */
function scan(most, wanted) {
  return Array.from({ length: DIRECTIONS }, (_, direction) => {
    const turn = (2 * Math.PI * direction) / DIRECTIONS;
    const [cosine, sine] = [Math.cos(turn), Math.sin(turn)];
    let step = 0;
    while ((step + 1) * REACH_STEP < most && !wanted(step * REACH_STEP * cosine, step * REACH_STEP * sine)) step += 1;
    return step * REACH_STEP;
  });
}

/** The part of an area on one side: where the distance is not negative.
 * @param {number[][]} points @param {(point: number[]) => number} distance @returns {number[][]} */
function cut(points, distance) {
  const far = points.map(distance);
  if (far.every((value) => value >= 0)) return points;
  /** @type {number[][]} */
  const corners = [];
  points.forEach((here, index) => {
    const other = (index + 1) % points.length;
    if (far[index] >= 0) corners.push(here);
    if (far[index] >= 0 !== far[other] >= 0) {
      const share = far[index] / (far[index] - far[other]);
      corners.push(here.map((value, axis) => value + share * (points[other][axis] - value)));
    }
  });
  return corners;
}
