// Changing the world while it runs: things are dragged in the arena; below, numbers are set in a row.

import { byId, press, write } from "./dom.js";
import { FromAbove } from "./projections.js";
import { SettingsRow } from "./settings_row.js";

const SAY_EVERY_MS = 100;
const LOST_MS = 3000;
const REACH_PX = 14;
const BUDGE_PX = 4;
/** Radii of things that are drawn as points [m]. */
const SMALL_M = 0.05;

/** Something that can be dragged, round or a rectangle, and how large it is.
 * @typedef {{ name: string, x: number, y: number, yaw: number, radius: number, half: Point,
 *   isSmall: boolean, size: number }} Thing */
/** @typedef {Thing & { dx: number, dy: number, from: Point, hasMoved: boolean }} Drag */

/** What may be dragged, set, put and taken away; whether it may be is the run's to say. */
export class Edit {
  on = false;
  adding = false;
  /** How many answers there are once all changes that were sent are answered. */
  asked = 0;
  /** When a place was sent last [ms]. */
  moved = 0;
  /** Whether the press of the mouse that goes on is no choice of a robot. */
  #hasPress = false;
  /** @type {Drag | null} */
  #drag = null;

  /** @param {Store} store @param {Connection} connection
   * @param {Arena} arena @param {Notify} notify */
  constructor(store, connection, arena, notify) {
    this.store = store;
    this.connection = connection;
    this.arena = arena;
    this.notify = notify;
    this.button = byId("edit");
    this.row = new SettingsRow(store, notify, (change) => this.#change(change));
    this.button.addEventListener("click", () => this.toggle());
    byId("edit_add").addEventListener("click", () => this.#setAdding(!this.adding));
    const { canvas } = arena;
    canvas.addEventListener("pointerdown", (event) => this.on && this.#press(event));
    canvas.addEventListener("pointermove", (event) => this.#move(event));
    canvas.addEventListener("pointerup", (event) => this.#release(event));
    canvas.addEventListener("pointercancel", () => this.#drop());
    arena.attach({
      draw: (scene) => this.#draw(scene),
      takesClicks: () => this.on && (this.adding || this.#hasPress),
    });
  }

  /** Whether this page may change a world, and there is one. */
  get able() {
    const { you, settings, experiment } = this.store;
    return you.control && Boolean(settings) && (experiment?.mode === "live" || experiment?.mode === "sim");
  }

  toggle() {
    let why = "";
    if (!this.able) why = "there is no world to change here";
    else if (this.store.settings?.locked) why = "this run is locked (--locked)";
    if (why && !this.on) this.notify(why, false);
    else this.#show(!this.on);
  }

  /** Renews the row; called a few times per second. */
  render() {
    this.button.hidden = !this.able;
    const locked = Boolean(this.store.settings?.locked);
    write(this.button, locked ? "locked" : "Change");
    if (this.on && (!this.able || locked)) this.#show(false);
    if (this.on) this.row.render();
  }

  /** Waits for no answer any more: it was lost, with the connection or the run. */
  dropPending() {
    this.asked = this.store.settled;
  }

  /** @param {boolean} on */
  #show(on) {
    this.on = on;
    press(this.button, on);
    this.row.show(on);
    this.arena.canvas.classList.toggle("edits", on);
    this.#setAdding(false);
    this.#drop();
  }

  /** @param {boolean} on */
  #setAdding(on) {
    this.adding = on;
    press(byId("edit_add"), on);
    if (on) this.notify("Click where the robot is to stand", true);
  }

  // -- in the arena --------------------------------------------------------------------------

  /** @param {PointerEvent} event */
  #press(event) {
    const at = this.#metres(event);
    this.#hasPress = this.adding;
    this.store.refused = false;
    if (!at) return;
    if (this.adding) {
      this.#change({ kind: "add", x_m: at.x, y_m: at.y });
      return;
    }
    const thing = this.#thingAt(at);
    if (!thing) return;
    this.#hasPress = true;
    this.arena.canvas.setPointerCapture(event.pointerId);
    const from = /** @type {Point} */ ([event.clientX, event.clientY]);
    this.#drag = { ...thing, dx: thing.x - at.x, dy: thing.y - at.y, from, hasMoved: false };
    this.row.choose(thing.name);
  }

  /** @param {PointerEvent} event */
  #move(event) {
    const drag = this.#drag;
    const at = this.#metres(event);
    if (!drag || !at) return;
    drag.hasMoved ||= Math.hypot(event.clientX - drag.from[0], event.clientY - drag.from[1]) > BUDGE_PX;
    if (!drag.hasMoved) return;
    Object.assign(drag, { x: at.x + drag.dx, y: at.y + drag.dy });
    this.arena.key = "";
    const now = performance.now();
    // One at a time is on its way: a slow run gets fewer places, and no queue.
    if (now - this.moved > LOST_MS) this.dropPending();
    if (this.store.settled < this.asked || now - this.moved < SAY_EVERY_MS) return;
    if (this.store.refused) {
      this.#drop();
      return;
    }
    this.moved = now;
    this.#change({ kind: "move", name: drag.name, x_m: drag.x, y_m: drag.y, final: false });
  }

  /** @param {PointerEvent} event */
  #release(event) {
    if (!this.#drag) return;
    this.#move(event);
    const drag = this.#drag;
    if (drag?.hasMoved) this.#change({ kind: "move", name: drag.name, x_m: drag.x, y_m: drag.y });
    this.#drop();
  }

  #drop() {
    this.#drag = null;
    this.store.refused = false;
    this.arena.key = "";
  }

  /** @param {WorldChange} change */
  #change(change) {
    if (!this.connection.say({ change })) {
      this.notify("not sent: there is no connection", false);
      return;
    }
    this.asked = Math.max(this.asked, this.store.settled) + 1;
    if (change.kind === "add") this.#setAdding(false);
  }

  /** Where the mouse is, and how far from it a thing may be [m].
   * @param {PointerEvent} event */
  #metres(event) {
    const { canvas, view } = this.arena;
    if (!view) return null;
    const ratio = canvas.width / canvas.clientWidth;
    return {
      x: (event.offsetX * ratio - view.left) / view.zoom,
      y: (view.top - event.offsetY * ratio) / view.zoom,
      reach: (REACH_PX * ratio) / view.zoom,
    };
  }

  /** The smallest thing there: what lies in a zone is taken before the zone.
   * @param {{ x: number, y: number, reach: number }} at */
  #thingAt({ x, y, reach }) {
    const size = (/** @type {Thing} */ thing) => thing.size + (thing.isSmall ? reach : 0);
    const near = this.#things().filter((thing) => isInside(thing, x, y, reach));
    return near.reduce((best, thing) => (best && size(best) <= size(thing) ? best : thing), near[0]);
  }

  /** @returns {Thing[]} */
  #things() {
    const { world, arena, objects, names } = this.store;
    const { view } = this.arena;
    const things = view ? (world?.entities ?? []).map((entity) => thingOf(entity, view)) : [];
    const robots = arena?.robots;
    for (const tag of objects) {
      const row = robots?.tag.indexOf(tag) ?? -1;
      if (robots && row >= 0) things.push(small(names.get(tag) ?? String(tag), robots.x_m[row], robots.y_m[row]));
    }
    return things;
  }

  /** Where a dragged thing is wanted, and what can be dragged.
   * @param {Scene} scene */
  #draw({ pen, brush, view, colours }) {
    if (!this.on || !(view instanceof FromAbove)) return;
    const ring = (/** @type {Thing} */ { x, y, radius, size }, /** @type {number} */ width) => {
      const shown = (radius || Math.min(size, 0.1)) + (4 * view.ratio) / view.zoom;
      brush.outline({ centre: [x, y], radius: shown }, 0, colours.blue, width);
    };
    pen.setLineDash([4 * view.ratio, 3 * view.ratio]);
    for (const thing of this.#things()) if (thing.isSmall) ring(thing, 1.5);
    pen.setLineDash([]);
    const drag = this.#drag;
    if (!drag?.hasMoved) return;
    ring(drag, 3);
    pen.fillStyle = colours.ink;
    pen.textAlign = "left";
    const [x, y] = [view.x(drag.x) + 14 * view.ratio, view.y(drag.y) - 14 * view.ratio];
    pen.fillText(`${drag.x.toFixed(2)}, ${drag.y.toFixed(2)} m`, x, y);
  }
}

/** @param {Entity} entity @param {FromAbove} view @returns {Thing} */
function thingOf(entity, view) {
  // As it is drawn: a lamp that hangs outside of the arena is at its edge.
  if (entity.kind === "light") return small(entity.id, ...view.within(entity.position_m));
  if (entity.kind === "robot") return small(entity.id, entity.x_m, entity.y_m);
  const [x, y] = entity.kind === "zone" ? [entity.x_m, entity.y_m] : entity.position_m;
  const place = { name: entity.id, x, y, isSmall: false };
  if (entity.kind === "cylinder" || (entity.kind === "zone" && entity.shape === "circle")) {
    return { ...place, yaw: 0, radius: entity.radius_m, half: [0, 0], size: entity.radius_m };
  }
  /** @type {Point} */
  const half = [entity.size_m[0] / 2, entity.size_m[1] / 2];
  return { ...place, yaw: entity.yaw_rad, radius: 0, half, size: Math.hypot(half[0], half[1]) };
}

/** @param {string} name @param {number} x @param {number} y @returns {Thing} */
function small(name, x, y) {
  return { name, x, y, yaw: 0, radius: SMALL_M, half: [0, 0], isSmall: true, size: SMALL_M };
}

/** @param {Thing} thing @param {number} px @param {number} py @param {number} reach */
function isInside({ x, y, yaw, radius, half }, px, py, reach) {
  const [dx, dy] = [px - x, py - y];
  if (radius) return Math.hypot(dx, dy) < Math.max(radius, reach);
  const [cosine, sine] = [Math.cos(yaw), Math.sin(yaw)];
  const [along, across] = [dx * cosine + dy * sine, dy * cosine - dx * sine];
  return Math.abs(along) < Math.max(half[0], reach / 2) && Math.abs(across) < Math.max(half[1], reach / 2);
}
