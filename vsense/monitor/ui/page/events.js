// What happened, the newest first, and who pressed it.

import { byId, make } from "./dom.js";
import { clock } from "./format.js";

const SHOWN = 60;

/** The list of events. */
export class Events {
  #key = "";

  /** @param {Store} store */
  constructor(store) {
    this.store = store;
    this.list = byId("events");
    this.list.append(make("li", { className: "none" }, "nothing yet"));
  }

  /** Adds what is new. */
  render() {
    const { store } = this;
    const key = `${store.changed.event} ${store.run === null}`;
    if (this.#key === key || !store.events.length) return;
    this.#key = key;
    this.list.replaceChildren(...store.events.slice(-SHOWN).reverse().map((event) => row(event, store)));
  }
}

/** @param {import("./store.js").StoredEvent} event @param {Store} store */
function row({ text, level, by, timeNs, run_s }, store) {
  // Times are those of the run, here and in a replay; the day's stands in the title, where it is known.
  const live = store.experiment?.mode !== "replay";
  const at = live ? new Date(store.wall(timeNs)).toLocaleTimeString([], { hourCycle: "h23" }) : "";
  const when = run_s === null ? "before" : clock(run_s);
  const words = make("span", {}, text);
  if (by) words.append(make("em", {}, ` — ${by}`));
  return make("li", { className: level ?? "info", title: at }, make("time", {}, when), words);
}
