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

const RENDER_EVERY_MS = 250;
const SOON_MS = 40;

/** The robot whose senses are shown. */
class Choice {
  /** @type {number | null} */
  tag = null;

  /** @param {number | null} tag */
  choose(tag) {
    this.tag = tag;
    if (tag !== null) store.readings.delete(tag);
    connection.say(this.readings);
    renderSoon();
  }

  /** Whose readings the page wants: the chosen robot's, and those that are charted. */
  get readings() {
    return { look: [...new Set(this.tag === null ? measures.tags : [this.tag, ...measures.tags])] };
  }

  /** Chooses the next robot of the table, or the previous one.
   * @param {number} by 1 or -1 */
  move(by) {
    const { order } = robots;
    if (!order.length) return;
    const at = this.tag === null ? -1 : order.indexOf(this.tag);
    const first = by > 0 ? 0 : order.length - 1;
    this.choose(order[at < 0 ? first : (at + by + order.length) % order.length]);
  }
}

// The token has become a cookie: it shall not stay in the address for others to read.
if (location.search) history.replaceState(null, "", location.pathname);

const store = new Store();
const connection = new Connection(take, greeting);
const controls = new Controls(store, connection);
const choice = new Choice();
const arena = new Arena(store, choice);
const edit = new Edit(store, connection, arena, controls.notify);
const cameras = new Cameras(store, choice);
const robots = new Robots(store, choice);
const measures = new Measures(store, controls.notify, () => connection.say(choice.readings));
const replay = new Replay(store, controls);
const panels = [
  new Tiles(store, connection), controls, cameras, robots, new Robot(store, choice), new Events(store),
  new Replace(store, connection, choice, controls.notify), measures, replay, edit, new Simulation(store, controls),
];
/** When the panels were rendered last [ms]. */
let rendered = 0;
/** The cameras whose pictures were asked for. */
let pictures = "";

function greeting() {
  pictures = "";
  edit.dropPending();
  return [{ refresh: controls.isLive }, choice.readings];
}

/** @param {string} topic @param {number} timeNs @param {any} data @param {Uint8Array | null} blob */
function take(topic, timeNs, data, blob) {
  store.take(topic, timeNs, data, blob);
  // What somebody pressed, and what comes of it, does not wait for the next round.
  if (topic === "/run" || topic === "/answer" || topic === "/you" || topic === "/event") renderSoon();
}

/** Words and figures, a few times per second: nobody reads faster. */
function render() {
  rendered = performance.now();
  safely(() => showBanner(troubles(store, connection)));
  for (const panel of panels) safely(() => panel.render());
  const shown = JSON.stringify(cameras.shown);
  if (shown !== pictures && connection.say({ pictures: cameras.shown })) pictures = shown;
}

function renderSoon() {
  rendered = Math.min(rendered, performance.now() - RENDER_EVERY_MS + SOON_MS);
}

/** Pictures, with every frame of the screen in which something is new. */
function frame() {
  requestAnimationFrame(frame);
  safely(() => arena.draw(controls.refresh));
  safely(() => cameras.draw(controls.refresh));
  if (performance.now() - rendered >= RENDER_EVERY_MS) render();
}

/** A panel that meets something that it does not expect must not take the others along.
 * @param {() => void} act */
function safely(act) {
  try {
    act();
  } catch (error) {
    console.error(error);
  }
}

// A hidden page draws nothing, but its title and its words stay true.
setInterval(() => document.hidden && render(), 1000);
document.addEventListener("visibilitychange", () => controls.sendRefresh());

const toggleHelp = () => (byId("keys").open ? byId("keys").close() : byId("keys").showModal());
byId("help").addEventListener("click", toggleHelp);
byId("theme").addEventListener("click", theme.toggle);

const isReplay = () => document.body.dataset.mode === "replay";
const isSim = () => document.body.dataset.mode === "sim";
const live = (/** @type {() => void} */ act) => () => isReplay() || act();
bindKeys({
  emergency: () => controls.emergency(),
  space: () => (isReplay() ? replay.playOrPause() : controls.startOrPause()),
  step: () => isSim() && controls.order("step", 1),
  stop: live(() => controls.order("stop")),
  reset: live(() => controls.order("reset")),
  record: live(() => controls.toggleRecord()),
  refresh: () => controls.setRefresh(!controls.refresh),
  edit: () => edit.toggle(),
  overlay: () => cameras.setOverlay(!cameras.overlay),
  view: (view) => controls.setView(view),
  select: (by) => choice.move(by),
  none: () => choice.choose(null),
  theme: theme.toggle,
  help: toggleHelp,
});

// For tests, and for whoever wants to look behind the page: changes nothing.
window.vsense = { edit, measures, store, connection, controls, choice, arena, cameras };
requestAnimationFrame(frame);
