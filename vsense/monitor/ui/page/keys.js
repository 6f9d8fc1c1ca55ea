// The keyboard. Escape is the emergency stop, whatever has the focus and whatever is open; but for the open list
// of a choice: the browser closes it with the first Escape, of which no page is told.

import { byId, make } from "./dom.js";

/** @typedef {"emergency" | "space" | "step" | "stop" | "reset" | "record" | "refresh" | "edit" | "overlay"
 *   | "none" | "theme" | "help"} Action */
/** @typedef {Record<Action, () => unknown>
 *   & { view(view: string): unknown, select(by: number): unknown }} Actions */

const TEXT_INPUTS = "input, select, textarea, [contenteditable]";

/** Binds the keys.
 * @param {Actions} actions */
export function bindKeys(actions) {
  // key, how it is shown, what it does in words, and in deed; two stand in a row of the help
  /** @type {[string, string, string, () => unknown][]} */
  const table = [
    ["Escape", "Esc", "emergency stop; in a simulation pause", actions.emergency],
    [" ", "Space", "start, pause, resume; in a replay play, pause", actions.space],
    ["S", "⇧ S", "stop the run", actions.stop],
    ["R", "⇧ R", "reset: the next run waits for its start", actions.reset],
    ["n", "N", "in a simulation: one timestep", actions.step],
    ["C", "⇧ C", "recording on, off", actions.record],
    ["j", "J", "next robot", () => actions.select(1)],
    ["k", "K", "previous robot", () => actions.select(-1)],
    ["x", "X", "no robot", actions.none],
    ["e", "E", "change the world: drag things, set numbers", actions.edit],
    ["1", "1", "arena and cameras", () => actions.view("both")],
    ["2", "2", "arena only", () => actions.view("arena")],
    ["3", "3", "cameras only", () => actions.view("cameras")],
    ["v", "V", "virtual world over the cameras' pictures on, off", actions.overlay],
    ["f", "F", "live pictures on, off", actions.refresh],
    ["t", "T", "light, dark", actions.theme],
    ["?", "?", "this help", actions.help],
  ];
  byId("keys_list").replaceChildren(
    ...table.flatMap(([, shown, words]) => [make("dt", {}, make("kbd", {}, shown)), make("dd", {}, words)]),
  );
  const byKey = new Map(table.map(([key, , , act]) => [key, act]));
  // While the event comes down to its target: nobody on the way can keep it.
  window.addEventListener("keydown", (event) => handle(event, byKey), { capture: true });
}

/** @param {KeyboardEvent} event @param {Map<string, () => unknown>} byKey */
function handle(event, byKey) {
  if (event.key === "Escape") {
    if (!event.repeat) byKey.get("Escape")?.();
    return;
  }
  if (event.ctrlKey || event.metaKey || event.altKey || event.repeat) return;
  const target = event.target instanceof Element ? event.target : null;
  if (target?.matches(TEXT_INPUTS) || (event.key === " " && target?.matches("button"))) return;
  if (byId("keys").open && event.key !== "?") return;
  const act = byKey.get(event.key) ?? (event.shiftKey ? undefined : byKey.get(event.key.toLowerCase()));
  if (!act) return;
  event.preventDefault();
  act();
}
