// The row below the arena in which numbers of the world are set.

import { byId, make, write } from "./dom.js";

/** @type {Record<string, string>} */
const UNITS = {
  evaporation_per_s: "1/s", diffusion_m2_s: "m²/s", drift_per_s: "1/s", latency: "timesteps",
  update_every: "timesteps", radius_m: "m",
};

/** What can be set: a sensor, a field, the loop functions' parameters, or a thing.
 * @typedef {{ label: string, name: string, controller?: string, isRobot?: boolean, settings: Settings }} Target */

/** Chooses what is set, which of its numbers, and to what. */
export class SettingsRow {
  /** @type {Target[]} */
  #targets = [];
  #key = "";

  /** @param {Store} store @param {Notify} notify @param {(change: WorldChange) => void} change */
  constructor(store, notify, change) {
    this.store = store;
    this.notify = notify;
    this.change = change;
    this.element = byId("editor");
    this.targetSelect = byId("edit_target");
    this.settingSelect = byId("edit_setting");
    this.valueInput = byId("edit_value");
    this.targetSelect.addEventListener("change", () => this.#renderSettings());
    this.settingSelect.addEventListener("change", () => this.#renderValue());
    byId("edit_form").addEventListener("submit", (event) => this.#submit(event));
    byId("edit_remove").addEventListener("click", () => this.#remove());
  }

  /** @param {boolean} on */
  show(on) {
    this.element.hidden = !on;
    if (on) this.#renderTargets();
  }

  /** Renews what can be set, but not while somebody types. */
  render() {
    const key = `${this.store.changed.settings} ${this.store.changed.world}`;
    if (key === this.#key || this.element.contains(document.activeElement)) return;
    this.#key = key;
    this.#renderTargets();
  }

  /** Chooses a thing, where it has something to set.
   * @param {string} name */
  choose(name) {
    const index = this.#targets.findIndex((target) => target.name === name && !target.controller);
    if (index < 0) return;
    this.targetSelect.selectedIndex = index;
    this.#renderSettings();
  }

  /** @returns {Target[]} */
  #allTargets() {
    const { settings, world } = this.store;
    if (!settings) return [];
    const sensors = settings.sensors.map(({ name, controller, ...own }) => ({
      label: `sensor ${name} (${controller})`, name, controller, settings: own,
    }));
    const fields = settings.fields.map(({ id, ...own }) => ({ label: `field ${id}`, name: id, settings: own }));
    const params = { label: "parameters of the loop functions", name: "", settings: settings.params };
    const things = (world?.entities ?? []).map((thing) => ({
      label: `${thing.kind} ${thing.id}`, name: thing.id, isRobot: thing.kind === "robot",
      settings: settingsOf(thing, settings.things[thing.kind] ?? []),
    }));
    return [
      ...sensors, ...fields, ...(Object.keys(settings.params).length ? [params] : []),
      ...things.filter((thing) => thing.isRobot || Object.keys(thing.settings).length),
    ];
  }

  /** @returns {Target | undefined} */
  get #target() {
    return this.#targets[this.targetSelect.selectedIndex];
  }

  #renderTargets() {
    const chosen = this.#target?.label;
    this.#targets = this.#allTargets();
    setOptions(this.targetSelect, this.#targets.map(({ label }) => label), chosen);
    this.#renderSettings();
  }

  #renderSettings() {
    setOptions(this.settingSelect, Object.keys(this.#target?.settings ?? {}), this.settingSelect.value);
    byId("edit_remove").hidden = !this.#target?.isRobot;
    this.#renderValue();
  }

  #renderValue() {
    const value = this.#target?.settings[this.settingSelect.value];
    this.valueInput.value = String(value ?? "");
    this.valueInput.disabled = value === undefined;
    write(byId("edit_unit"), UNITS[this.settingSelect.value] ?? "");
  }

  /** @param {Event} event */
  #submit(event) {
    event.preventDefault();
    const target = this.#target;
    const setting = this.settingSelect.value;
    if (!target || !setting) return;
    const text = this.valueInput.value.trim();
    const value = typeof target.settings[setting] === "number" ? Number(text) : text;
    if (text === "" || Number.isNaN(value)) {
      this.notify(`${setting}: ${text || "nothing"} is no number`, false);
      return;
    }
    this.valueInput.blur();
    const { name, controller } = target;
    this.change({ kind: "set", setting, value, name, ...(controller && { controller }) });
  }

  #remove() {
    if (this.#target) this.change({ kind: "remove", name: this.#target.name });
  }
}

/** The numbers of a thing that can be set; a rectangle has no radius.
 * @param {Entity} thing @param {string[]} names @returns {Settings} */
function settingsOf(thing, names) {
  const isRectangle = thing.kind === "zone" && thing.shape === "rectangle";
  const own = names.filter((name) => name !== "radius_m" || !isRectangle);
  const values = /** @type {any} */ (thing);
  return Object.fromEntries(own.map((name) => [name, values[name]]));
}

/** @param {HTMLSelectElement} select @param {string[]} texts @param {string | undefined} chosen */
function setOptions(select, texts, chosen) {
  const before = [...select.options].map((option) => option.value).join("\n");
  if (before !== texts.join("\n")) {
    select.replaceChildren(...texts.map((text) => make("option", { value: text }, text)));
  }
  if (chosen !== undefined && texts.includes(chosen)) select.value = chosen;
}
