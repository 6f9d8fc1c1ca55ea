// How fast a simulation goes: wanted, and reached.

import { byId, make, write } from "./dom.js";
import { times } from "./format.js";

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 5, 10, 50, 100];
/** The order's value for "as fast as it goes". */
const FASTEST = 0;
const SLOW = 0.9;

/** The speed's list, and what became of it. */
export class Simulation {
  /** @param {Store} store @param {Controls} controls */
  constructor(store, controls) {
    this.store = store;
    this.select = byId("sim_speed");
    for (const speed of SPEEDS) this.#add(speed);
    this.#add(FASTEST);
    this.select.addEventListener("change", () => {
      controls.order("speed", Number(this.select.value));
      // The space bar is for start and pause again.
      this.select.blur();
    });
  }

  /** @param {number} speed */
  #add(speed) {
    const words = speed === FASTEST ? "as fast as it goes" : `${times(speed)} ×`;
    const option = make("option", { value: String(speed) }, words);
    const orders = [...this.select.options].map((other) => Number(other.value));
    const at = speed === FASTEST ? -1 : orders.findIndex((order) => order > speed || order === FASTEST);
    const after = this.select.options[at];
    this.select.insertBefore(option, after ?? null);
  }

  /** Shows the speed. */
  render() {
    const { run } = this.store;
    if (!run?.sim) return;
    const speed = run.sim.speed ?? FASTEST;
    if (![...this.select.options].some((option) => Number(option.value) === speed)) this.#add(speed);
    if (document.activeElement !== this.select) this.select.value = String(speed);
    const slower = speed === FASTEST || run.sim.reached < SLOW * speed;
    const isShown = run.state === "running" && slower && run.sim.reached > 0;
    write(byId("sim_reached"), isShown ? `${times(run.sim.reached)} × reached` : "");
  }
}
