// A spare put in for the chosen robot, between runs.

import { byId, make } from "./dom.js";

/** The line below the chosen robot's name. */
export class Replace {
  /** Who is chosen plays this part.
   * @type {string | undefined} */
  #name;

  /** @param {Store} store @param {Connection} connection
   * @param {RobotSelection} selection @param {Notify} notify */
  constructor(store, connection, selection, notify) {
    this.store = store;
    this.connection = connection;
    this.selection = selection;
    this.line = byId("replace");
    this.select = byId("replace_by");
    this.button = byId("replace_do");
    this.line.addEventListener("submit", (event) => {
      event.preventDefault();
      if (selection.tag === null) return;
      const pair = /** @type {Point} */ ([selection.tag, Number(this.select.value)]);
      if (!connection.order("replace", 0, { pair })) notify("not sent: there is no connection", false);
    });
  }

  /** Renews the line; called a few times per second. */
  render() {
    const { run, you, experiment } = this.store;
    this.#follow(experiment);
    const spares = run?.spares ?? [];
    this.line.hidden = this.selection.tag === null || !you.control || !spares.length;
    if (this.line.hidden) return;
    const shown = [...this.select.options].map((option) => Number(option.value));
    if (shown.join() !== spares.join()) {
      this.select.replaceChildren(...spares.map((tag) => make("option", { value: String(tag) }, `robot ${tag}`)));
    }
    const able = this.connection.open && Boolean(run?.can?.includes("replace"));
    if (this.button.disabled === able) this.button.disabled = !able;
    this.button.title = able ? "It has this role from the next run on" : "Between runs only";
  }

  /** Who plays the chosen part now stays chosen.
   * @param {ExperimentMessage | null} experiment */
  #follow(experiment) {
    const robots = experiment?.robots ?? [];
    const chosen = robots.find((robot) => robot.tag === this.selection.tag);
    const heir = robots.find((robot) => robot.name === this.#name);
    if (chosen) this.#name = chosen.name;
    else if (this.selection.tag !== null && heir) this.selection.choose(heir.tag);
    else this.#name = undefined;
  }
}
