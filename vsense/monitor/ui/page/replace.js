// A spare put in for the chosen robot, between runs.

import { byId, make } from "./dom.js";

/** The line below the chosen robot's name. */
export class Replace {
  constructor(store, connection, choice, toast) {
    this.store = store;
    this.connection = connection;
    this.choice = choice;
    this.line = byId("replace");
    this.select = byId("replace_by");
    this.button = byId("replace_do");
    this.line.addEventListener("submit", (event) => {
      event.preventDefault();
      const pair = [choice.tag, Number(this.select.value)];
      if (!connection.order("replace", 0, { pair })) toast("not sent: there is no connection", false);
    });
  }

  /** Renews the line; called a few times per second. */
  tell() {
    const { run, you, experiment } = this.store;
    this.#follow(experiment);
    const spares = run?.spares ?? [];
    this.line.hidden = this.choice.tag === null || !you.control || !spares.length;
    if (this.line.hidden) return;
    const known = [...this.select.options].map((option) => Number(option.value));
    if (known.join() !== spares.join()) {
      this.select.replaceChildren(...spares.map((tag) => make("option", { value: tag }, `robot ${tag}`)));
    }
    const able = this.connection.open && (run.can ?? []).includes("replace");
    if (this.button.disabled === able) this.button.disabled = !able;
    this.button.title = able ? "It plays this part from the next run on" : "Between runs only";
  }

  // Who plays the chosen part now stays chosen.
  #follow(experiment) {
    const robots = experiment?.robots ?? [];
    const chosen = robots.find((robot) => robot.tag === this.choice.tag);
    const heir = robots.find((robot) => robot.name === this.name);
    if (chosen) this.name = chosen.name;
    else if (this.choice.tag !== null && heir) this.choice.choose(heir.tag);
    else this.name = undefined;
  }
}
