// Names of robots and things in a picture: those that matter, and as many as touch nothing.

/** Between two names in a line. */
const SPACE_PX = 4;

/** @typedef {{ left: number, top: number, right: number, bottom: number }} Rectangle */
/** Something with a name at a place of the picture; `rank` 0 is always named, others where there is room.
 * @typedef {{ tag: number, text: string, x: number, y: number, rank: number, sign?: boolean }} Named */

/** Where names were written in one canvas: a name stays at its corner, and does not flicker. */
export class Names {
  /** Of what was written last.
   * @type {(Rectangle & { tag: number })[]} */
  boxes = [];
  /** The corner of each tag.
   * @type {Map<number, number>} */
  #corners = new Map();

  /** Writes names; of the four corners around each thing the one that it had, else the first that is free.
   * @param {Pen} pen @param {Named[]} things @param {number} radius of their bodies @param {number} size of letters
   * @param {Rectangle} room names lie inside @param {Rectangle[]} walls what no name may touch
   * @param {{ ink: string, halo: string, sign: string }} colours */
  write(pen, things, radius, size, room, walls, colours) {
    pen.font = `600 ${size}px system-ui, sans-serif`;
    pen.textAlign = "left";
    pen.lineJoin = "round";
    const had = (/** @type {Named} */ { tag }) => (this.#corners.has(tag) ? 0 : 1);
    const sorted = [...things].sort((a, b) => a.rank - b.rank || had(a) - had(b) || a.tag - b.tag);
    const bodies = things.map(({ x, y, tag }) =>
      ({ tag, left: x - radius, top: y - radius, right: x + radius, bottom: y + radius }));
    const corners = new Map();
    this.boxes = [];
    for (const thing of sorted) {
      const text = thing.sign ? `⚠ ${thing.text}` : thing.text;
      const boxes = boxesAround(thing, radius, pen.measureText(text).width, size);
      const taken = [...walls, ...this.boxes, ...bodies.filter(({ tag }) => tag !== thing.tag)];
      const isFree = (/** @type {number} */ at) =>
        within(boxes[at], room) && !taken.some((other) => overlap(boxes[at], other));
      const tries = [this.#corners.get(thing.tag) ?? 0, 0, 1, 2, 3];
      const corner = tries.find(isFree) ?? (thing.rank ? -1 : tries.find((at) => within(boxes[at], room)) ?? 0);
      if (corner < 0) continue;
      corners.set(thing.tag, corner);
      this.boxes.push({ ...boxes[corner], tag: thing.tag });
      pen.strokeStyle = colours.halo;
      pen.lineWidth = size / 4;
      pen.strokeText(text, boxes[corner].left, boxes[corner].bottom - size / 8);
      pen.fillStyle = thing.sign ? colours.sign : colours.ink;
      pen.fillText(text, boxes[corner].left, boxes[corner].bottom - size / 8);
    }
    this.#corners = corners;
  }
}

/** Upper right, upper left, lower right, lower left.
 * @param {Named} thing @param {number} radius @param {number} width @param {number} size @returns {Rectangle[]} */
function boxesAround({ x, y, rank }, radius, width, size) {
  // Around the chosen one there is a ring.
  const [far, near] = rank ? [1.2 * radius, 0.8 * radius] : [1.8 * radius, 1.3 * radius];
  return [[far, -near - size], [-far - width, -near - size], [far, near], [-far - width, near]].map(
    ([across, down]) => ({ left: x + across, top: y + down, right: x + across + width, bottom: y + down + size }),
  );
}

/** @param {Rectangle} box @param {Rectangle} room */
const within = (box, room) =>
  box.left >= room.left && box.top >= room.top && box.right <= room.right && box.bottom <= room.bottom;

/** @param {Rectangle} a @param {Rectangle} b */
function overlap(a, b) {
  return a.left < b.right + SPACE_PX && b.left < a.right + SPACE_PX && a.top < b.bottom && b.top < a.bottom;
}
