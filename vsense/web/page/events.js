// What happened, the newest first, and who pressed it.

import { byId, make } from "./dom.js";
import { clock } from "./format.js";

const SHOWN = 60;

/** The list of events. */
export class Events {
  constructor(store) {
    this.store = store;
    this.list = byId("events");
    this.list.append(make("li", { className: "none" }, "nothing yet"));
  }

  /** Adds what is new. */
  tell() {
    if (this.seen === this.store.changed.event) return;
    this.seen = this.store.changed.event;
    this.list.replaceChildren(...this.store.events.slice(-SHOWN).reverse().map(row));
  }
}

function row({ text, level, by, at, run_s }) {
  const when = run_s === null ? at.toLocaleTimeString() : clock(run_s);
  const words = make("span", {}, text);
  if (by) words.append(make("em", {}, ` — ${by}`));
  return make("li", { className: level ?? "info", title: at.toLocaleTimeString() }, make("time", {}, when), words);
}
