// Where a robot was in the last seconds of the run, however fast that goes.

/** Trails are so long [s], and no longer than so many places. */
export const TRAIL_S = 8;
const PLACES_MAX = 200;

/** A robot's way. */
export class Trail {
  /** @type {Vector[]} */
  points = [];
  /** @type {number[]} */
  times_s = [];

  /** @param {number} x_m @param {number} y_m @param {number} time_s */
  add(x_m, y_m, time_s) {
    const { points, times_s } = this;
    while (times_s[0] < time_s - TRAIL_S || points.length > PLACES_MAX) {
      points.shift();
      times_s.shift();
    }
    const last = points.at(-1);
    if (last && last[0] === x_m && last[1] === y_m) return;
    points.push([x_m, y_m, 0]);
    times_s.push(time_s);
  }
}
