// Puts the page together: messages into the store, the store onto the screen.

import { Arena } from "./arena.js";
import { Edit } from "./arena_edit.js";
import { showBanner, troubles } from "./banner.js";
import { Cameras } from "./cameras.js";
import { Connection } from "./connection.js";
import { Controls } from "./controls.js";
import { byId } from "./dom.js";
import { Events } from "./events.js";
import { bindKeys } from "./keys.js";
import { Measures } from "./measures.js";
import { Replace } from "./replace.js";
import { Replay } from "./replay.js";
import { Robot } from "./robot.js";
import { Robots } from "./robots.js";
import { Simulation } from "./simulation.js";
import { Store } from "./store.js";
import * as theme from "./theme.js";
import { Tiles } from "./tiles.js";

const TELL_EVERY_MS = 250;
const SOON_MS = 40;

/** The robot whose senses are shown. */
class Choice {
  tag = null;

  choose(tag) {
    this.tag = tag;
    store.readings.delete(tag);
    connection.say(this.looks);
    soon();
  }

  /** Whose readings the page wants: the chosen robot's, and those that are charted. */
  get looks() {
    return { look: [...new Set([this.tag, ...measures.tags])].filter((tag) => tag !== null) };
  }

  /** Chooses the next robot of the table, or the one before. */
  step(by) {
    const order = robots.order;
    if (!order.length) return;
    const at = order.indexOf(this.tag);
    this.choose(order[at < 0 ? (by > 0 ? 0 : order.length - 1) : (at + by + order.length) % order.length]);
  }
}

// The token has become a cookie: it shall not stay in the address for others to read.
if (location.search) history.replaceState(null, "", location.pathname);

const store = new Store();
const connection = new Connection(take, greet);
const controls = new Controls(store, connection);
const choice = new Choice();
const arena = new Arena(store, choice);
const edit = new Edit(store, connection, arena, (text, ok) => controls.toast(text, ok));
const cameras = new Cameras(store, choice);
const robots = new Robots(store, choice);
const measures = new Measures(store, (text, ok) => controls.toast(text, ok));
measures.changed = () => connection.say(choice.looks);
const replay = new Replay(store, controls);
const panels = [
  new Tiles(store, connection), controls, cameras, robots, new Robot(store, choice), new Events(store),
  new Replace(store, connection, choice, (text, ok) => controls.toast(text, ok)), measures, replay, edit, new Simulation(store, controls),
];
let telling = 0;
let pictures = "";

function greet() {
  pictures = "";
  edit.forget();
  return [{ refresh: controls.lively }, choice.looks];
}

function take(topic, timeNs, data, blob) {
  store.take(topic, timeNs, data, blob);
  // What somebody pressed, and what comes of it, does not wait for the next round.
  if (topic === "/run" || topic === "/answer" || topic === "/you" || topic === "/event") soon();
}

/** Words and figures, a few times per second: nobody reads faster. */
function tell() {
  telling = performance.now();
  safely(() => showBanner(troubles(store, connection)));
  for (const panel of panels) safely(() => panel.tell());
  const shown = JSON.stringify(cameras.shown);
  if (shown !== pictures && connection.say({ pictures: cameras.shown })) pictures = shown;
}

function soon() {
  telling = Math.min(telling, performance.now() - TELL_EVERY_MS + SOON_MS);
}

/** Pictures, with every frame of the screen in which something is new. */
function frame() {
  requestAnimationFrame(frame);
  if (controls.refresh) {
    safely(() => arena.draw());
    safely(() => cameras.draw());
  }
  if (performance.now() - telling >= TELL_EVERY_MS) tell();
}

/** A panel that meets something that it does not expect must not take the others along. */
function safely(act) {
  try {
    act();
  } catch (error) {
    console.error(error);
  }
}

// A hidden page draws nothing, but its title and its words stay true.
setInterval(() => document.hidden && tell(), 1000);
document.addEventListener("visibilitychange", () => controls.tellServer());

const toggleHelp = () => (byId("keys").open ? byId("keys").close() : byId("keys").showModal());
byId("help").addEventListener("click", toggleHelp);
byId("theme").addEventListener("click", theme.toggle);

const isReplay = () => document.body.dataset.mode === "replay";
const isSim = () => document.body.dataset.mode === "sim";
const live = (act) => () => isReplay() || act();
bindKeys({
  emergency: () => controls.emergency(),
  space: () => (isReplay() ? replay.playOrPause() : controls.startOrPause()),
  one: () => isSim() && controls.order("step", 1),
  stop: live(() => controls.order("stop")),
  reset: live(() => controls.order("reset")),
  record: live(() => controls.toggleRecord()),
  refresh: () => controls.setRefresh(!controls.refresh),
  edit: () => edit.toggle(),
  overlay: () => cameras.setOverlay(!cameras.overlay),
  view: (view) => controls.setView(view),
  step: (by) => choice.step(by),
  none: () => choice.choose(null),
  theme: theme.toggle,
  help: toggleHelp,
});

// For tests, and for whoever wants to look behind the page: changes nothing.
window.vsense = { edit, measures, store, connection, controls, choice, arena, cameras };
requestAnimationFrame(frame);
