// Changing the world while it runs: things are dragged in the arena, numbers are set in a row below.

import { byId, make, press, write } from "./dom.js";

const SAY_EVERY_MS = 100;
const LOST_MS = 3000;
const REACH_PX = 14;
const BUDGE_PX = 4;
const SIZES = { light: 0.05, robot: 0.05, object: 0.05 };
const UNITS = { evaporation_per_s: "1/s", diffusion_m2_s: "m²/s", drift_per_s: "1/s", latency: "timesteps", update_every: "timesteps", radius_m: "m" };

/** What may be dragged, set, put and taken away; whether it may be is the run's to say. */
export class Edit {
  constructor(store, connection, arena, toast) {
    Object.assign(this, { store, connection, arena, toast });
    this.on = this.adding = this.caught = false;
    this.drag = null;
    this.asked = this.moved = 0;
    this.button = byId("edit");
    this.row = byId("editor");
    [this.target, this.setting, this.value] = ["edit_target", "edit_setting", "edit_value"].map(byId);
    this.button.addEventListener("click", () => this.toggle());
    this.target.addEventListener("change", () => this.#settings());
    this.setting.addEventListener("change", () => this.#value());
    byId("edit_form").addEventListener("submit", (event) => this.#set(event));
    byId("edit_add").addEventListener("click", () => this.#adding(!this.adding));
    byId("edit_remove").addEventListener("click", () => this.#change({ kind: "remove", name: this.#chosen.name }));
    const { canvas } = arena;
    canvas.addEventListener("pointerdown", (event) => this.on && this.#down(event));
    canvas.addEventListener("pointermove", (event) => this.drag && this.#move(event));
    canvas.addEventListener("pointerup", (event) => this.drag && this.#up(event));
    canvas.addEventListener("pointercancel", () => this.#drop());
    arena.overlay = (scene) => this.#draw(scene);
    arena.busy = () => this.on && (this.adding || this.caught);
  }

  /** Whether this page may change a world, and there is one. */
  get able() {
    const { you, settings, experiment } = this.store;
    return you.control && Boolean(settings) && ["live", "sim"].includes(experiment?.mode);
  }

  toggle() {
    const why = !this.able ? "there is no world to change here" : this.store.settings.locked && "this run is locked (--locked)";
    if (why && !this.on) this.toast(why, false);
    else this.#show(!this.on);
  }

  /** Renews the row; called a few times per second. */
  tell() {
    this.button.hidden = !this.able;
    const locked = Boolean(this.store.settings?.locked);
    write(this.button, locked ? "locked" : "change");
    if (this.on && (!this.able || locked)) this.#show(false);
    const key = `${this.store.changed.settings} ${this.store.changed.world}`;
    if (this.on && key !== this.key && !this.row.contains(document.activeElement)) {
      this.key = key;
      this.#targets();
    }
  }

  /** What was asked for is not waited for any more: its answer was lost, with the connection or the run. */
  forget() {
    this.asked = this.store.settled;
  }

  #show(on) {
    this.on = on;
    press(this.button, on);
    this.row.hidden = !on;
    this.arena.canvas.classList.toggle("edits", on);
    this.#adding(false);
    this.#drop();
    if (on) this.#targets();
  }

  #adding(on) {
    this.adding = on;
    press(byId("edit_add"), on);
    if (on) this.toast("click where it shall stand", true);
  }

  // -- a row of settings ---------------------------------------------------------------------

  get #all() {
    const { settings, world } = this.store;
    const sensors = settings.sensors.map((row) => ({ label: `sensor ${row.name} (${row.controller})`, name: row.name, controller: row.controller, now: without(row, "name", "controller") }));
    const fields = settings.fields.map((row) => ({ label: `field ${row.id}`, name: row.id, now: without(row, "id") }));
    const params = Object.keys(settings.params).length ? [{ label: "parameters of the loop functions", name: "", now: settings.params }] : [];
    const things = (world?.entities ?? []).filter((thing) => thing.kind === "robot" || (settings.things[thing.kind] ?? []).length);
    return [...sensors, ...fields, ...params, ...things.map((thing) => ({
      label: `${thing.kind} ${thing.id}`, name: thing.id, robot: thing.kind === "robot",
      now: Object.fromEntries((settings.things[thing.kind] ?? []).filter((name) => name !== "radius_m" || thing.shape !== "rectangle").map((name) => [name, thing[name]])),
    }))];
  }

  get #chosen() {
    return this.list?.[this.target.selectedIndex];
  }

  #targets() {
    const chosen = this.#chosen?.label;
    this.list = this.#all;
    options(this.target, this.list.map((one) => one.label), chosen);
    this.#settings();
  }

  #settings() {
    options(this.setting, Object.keys(this.#chosen?.now ?? {}), this.setting.value);
    byId("edit_remove").hidden = !this.#chosen?.robot;
    this.#value();
  }

  #value() {
    const now = this.#chosen?.now[this.setting.value];
    this.value.value = now ?? "";
    this.value.disabled = now === undefined;
    write(byId("edit_unit"), UNITS[this.setting.value] ?? "");
  }

  #set(event) {
    event.preventDefault();
    const { name, controller, now } = this.#chosen ?? {};
    const setting = this.setting.value;
    if (!now || !setting) return;
    const text = this.value.value.trim();
    const value = typeof now[setting] === "number" ? Number(text) : text;
    if (text === "" || Number.isNaN(value)) return this.toast(`${setting}: ${text || "nothing"} is no number`, false);
    this.value.blur();
    this.#change({ kind: "set", setting, value, name, ...(controller && { controller }) });
  }

  // -- in the arena --------------------------------------------------------------------------

  #down(event) {
    const at = this.#metres(event);
    this.caught = this.adding;
    this.store.refused = false;
    if (this.adding) {
      this.#change({ kind: "add", x_m: at.x, y_m: at.y });
      return;
    }
    const thing = this.#under(at);
    if (!thing) return;
    this.caught = thing;
    this.arena.canvas.setPointerCapture(event.pointerId);
    this.drag = { ...thing, dx: thing.x - at.x, dy: thing.y - at.y, from: [event.clientX, event.clientY], far: false };
    const chosen = this.list.findIndex((one) => one.name === thing.name && !one.controller);
    if (chosen >= 0) {
      this.target.selectedIndex = chosen;
      this.#settings();
    }
  }

  #move(event) {
    const { drag } = this;
    drag.far ||= Math.hypot(event.clientX - drag.from[0], event.clientY - drag.from[1]) > BUDGE_PX;
    if (!drag.far) return;
    const at = this.#metres(event);
    Object.assign(drag, { x: at.x + drag.dx, y: at.y + drag.dy });
    this.arena.key = "";
    const now = performance.now();
    // One at a time is on its way: a slow run gets fewer places, and no queue.
    if (now - this.moved > LOST_MS) this.forget();
    if (this.store.settled < this.asked || now - this.moved < SAY_EVERY_MS) return;
    if (this.store.refused) return this.#drop();
    this.moved = now;
    this.#change({ kind: "move", name: drag.name, x_m: drag.x, y_m: drag.y, final: false });
  }

  #up(event) {
    const { drag } = this;
    this.#move(event);
    if (this.drag && drag.far) this.#change({ kind: "move", name: drag.name, x_m: drag.x, y_m: drag.y });
    this.#drop();
  }

  #drop() {
    this.drag = null;
    this.store.refused = false;
    this.arena.key = "";
  }

  #change(change) {
    if (!this.connection.say({ change })) return this.toast("not sent: there is no connection", false);
    this.asked = Math.max(this.asked, this.store.settled) + 1;
    if (change.kind === "add") this.#adding(false);
  }

  #metres(event) {
    const { canvas, place } = this.arena;
    const ratio = canvas.width / canvas.clientWidth;
    return { x: (event.offsetX * ratio - place.left) / place.zoom, y: (place.top - event.offsetY * ratio) / place.zoom, reach: (REACH_PX * ratio) / place.zoom };
  }

  // The smallest thing there: what lies in a zone is taken before the zone.
  #under({ x, y, reach }) {
    let best = null;
    for (const thing of this.#things()) {
      const size = thing.size + (thing.small ? reach : 0);
      if (inside(thing, x, y, reach) && (!best || size < best.reached)) best = { ...thing, reached: size };
    }
    return best;
  }

  *#things() {
    const { world, arena, objects, names } = this.store;
    const [width, height] = this.arena.place.size;
    const [left, low] = [this.arena.place.centre[0] - width / 2, this.arena.place.centre[1] - height / 2];
    for (const told of world?.entities ?? []) {
      let [x, y] = told.position_m ?? [told.x_m, told.y_m];
      // As it is drawn: a lamp that hangs outside of the arena is at its edge.
      if (told.kind === "light") [x, y] = [Math.min(Math.max(x, left), left + width), Math.min(Math.max(y, low), low + height)];
      const round = SIZES[told.kind] ?? (told.kind === "cylinder" || told.shape === "circle" ? told.radius_m : 0);
      const half = round ? null : [told.size_m[0] / 2, told.size_m[1] / 2];
      yield { name: told.id, x, y, yaw: told.yaw_rad ?? 0, round, half, small: told.kind in SIZES, size: round || Math.hypot(...half) };
    }
    for (const tag of objects) {
      const row = arena?.robots.tag.indexOf(tag) ?? -1;
      if (row >= 0) yield { name: names.get(tag), x: arena.robots.x_m[row], y: arena.robots.y_m[row], yaw: 0, round: SIZES.object, half: null, small: true, size: SIZES.object };
    }
  }

  /** Where a dragged thing is wanted, and what can be dragged. */
  #draw({ pen, place, colours }) {
    if (!this.on) return;
    pen.setLineDash([4 * place.ratio, 3 * place.ratio]);
    pen.strokeStyle = colours.blue;
    pen.lineWidth = 1.5 * place.ratio;
    for (const thing of this.#things()) if (thing.small) ring(pen, place, thing);
    pen.setLineDash([]);
    if (this.drag?.far) {
      pen.lineWidth = 3 * place.ratio;
      ring(pen, place, this.drag);
      pen.fillStyle = colours.ink;
      pen.textAlign = "left";
      pen.fillText(`${this.drag.x.toFixed(2)}, ${this.drag.y.toFixed(2)} m`, place.x(this.drag.x) + 14 * place.ratio, place.y(this.drag.y) - 14 * place.ratio);
    }
  }
}

function ring(pen, place, { x, y, round, size }) {
  pen.beginPath();
  pen.arc(place.x(x), place.y(y), (round || Math.min(size, 0.1)) * place.zoom + 4 * place.ratio, 0, 2 * Math.PI);
  pen.stroke();
}

function inside({ x, y, yaw, round, half }, px, py, reach) {
  const [dx, dy] = [px - x, py - y];
  if (round) return Math.hypot(dx, dy) < Math.max(round, reach);
  const [along, across] = [dx * Math.cos(yaw) + dy * Math.sin(yaw), dy * Math.cos(yaw) - dx * Math.sin(yaw)];
  return Math.abs(along) < Math.max(half[0], reach / 2) && Math.abs(across) < Math.max(half[1], reach / 2);
}

function without(row, ...names) {
  return Object.fromEntries(Object.entries(row).filter(([name]) => !names.includes(name)));
}

function options(select, texts, chosen) {
  const before = [...select.options].map((option) => option.value).join("\n");
  if (before !== texts.join("\n")) select.replaceChildren(...texts.map((text) => make("option", { value: text }, text)));
  if (texts.includes(chosen)) select.value = chosen;
}
