// The plane's map that takes four points to four others, as CSS draws it.

/** Nine numbers, row by row, that take each `from` [x, y] to its `to`; null where there is none.
 * @param {number[][]} from @param {number[][]} to @returns {number[] | null} */
export function homography(from, to) {
  const rows = from.flatMap(([x, y], at) => {
    const [u, v] = to[at];
    return [[x, y, 1, 0, 0, 0, -u * x, -u * y, u], [0, 0, 0, x, y, 1, -v * x, -v * y, v]];
  });
  for (let column = 0; column < 8; column += 1) {
    let best = column;
    for (let row = column; row < 8; row += 1) {
      if (Math.abs(rows[row][column]) > Math.abs(rows[best][column])) best = row;
    }
    if (Math.abs(rows[best][column]) < 1e-9) return null;
    [rows[column], rows[best]] = [rows[best], rows[column]];
    for (let row = 0; row < 8; row += 1) {
      if (row === column) continue;
      const share = rows[row][column] / rows[column][column];
      for (let at = column; at < 9; at += 1) rows[row][at] -= share * rows[column][at];
    }
  }
  return [...rows.map((row, at) => row[8] / row[at]), 1];
}

/** The same for `transform`, whose matrices have a depth.
 * @param {number[]} matrix */
export function matrix3d([a, b, c, d, e, f, g, h, i]) {
  return `matrix3d(${[a, d, 0, g, b, e, 0, h, 0, 0, 1, 0, c, f, 0, i].join(", ")})`;
}
