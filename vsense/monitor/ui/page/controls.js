// The buttons: what can be pressed now, and what a press sends.

import { byId, elements, inside, make, mark, press, remember, remembered, write } from "./dom.js";

const NOTICE_MS = 4500;
const WAIT_MS = 3000;
const VIEWS = ["both", "arena", "cameras"];

/** Start to emergency stop, record, refresh, and what is shown. */
export class Controls {
  refresh = true;
  view = "both";
  #suited = false;
  /** When buttons were pressed whose orders are not answered yet [ms].
   * @type {Map<HTMLElement, number>} */
  #pending = new Map();

  /** @param {Store} store @param {Connection} connection */
  constructor(store, connection) {
    this.store = store;
    this.connection = connection;
    this.buttons = /** @type {HTMLButtonElement[]} */ (elements("[data-order]"));
    this.viewButtons = elements("[data-view]:is(button)");
    for (const button of this.buttons) {
      button.addEventListener("click", (event) => this.#click(button, event));
    }
    // On the way down already: an emergency does not wait for a finger to leave the button.
    byId("emergency").addEventListener("pointerdown", () => this.emergency());
    const emergency = byId("emergency");
    emergency.addEventListener("click", (event) => (event.detail ? emergency.blur() : this.emergency()));
    byId("refresh").addEventListener("click", () => this.setRefresh(!this.refresh));
    for (const button of this.viewButtons) {
      button.addEventListener("click", () => this.setView(button.dataset.view));
    }
    this.setView(remembered("view", "both"));
  }

  /** Sends an order.
   * @param {string} name */
  order(name, value = 0) {
    if (!this.connection.order(name, value)) this.notify("not sent: there is no connection", false);
  }

  /** Stops everything, now; nothing that the page shows is asked before. */
  emergency() {
    const { mode } = document.body.dataset;
    if (mode === "replay") return;
    if (mode === "sim") this.#pauseSimulation();
    else if (mode === "track") this.notify("camera track moves no robot: stop them where they are driven", false);
    else if (!this.store.you.control) this.order("emergency", 1);
    else if (!this.connection.stopAll()) this.notify("EMERGENCY STOP is not delivered: there is no connection", false);
  }

  // No robot moves there: what can be stopped is the picture.
  #pauseSimulation() {
    if (this.store.run?.can?.includes("pause")) this.order("pause");
    else this.notify("Escape pauses a simulation; this one is not running", false);
  }

  /** What the space bar does in this state. */
  startOrPause() {
    const can = this.store.run?.can ?? [];
    if (can.includes("start")) this.order("start");
    else if (can.includes("pause")) this.order("pause");
    else this.notify(whyNot(this.store.run), false);
  }

  toggleRecord() {
    this.order("record", this.store.run?.recording?.on ? 0 : 1);
  }

  /** @param {boolean} on */
  setRefresh(on) {
    this.refresh = on;
    press(byId("refresh"), on);
    write(inside(byId("refresh"), "span"), on ? "Live pictures" : "Pictures frozen");
    this.sendRefresh();
  }

  /** @param {string | undefined} view */
  setView(view, keep = true) {
    this.view = view && VIEWS.includes(view) ? view : "both";
    byId("main").dataset.view = this.view;
    for (const button of this.viewButtons) press(button, button.dataset.view === this.view);
    if (keep) remember("view", this.view);
  }

  /** A camera that is only looked through has no arena: it gets all the room, once.
   * @param {ExperimentMessage | null} experiment */
  #suit(experiment) {
    if (this.#suited || !experiment) return;
    this.#suited = true;
    if (experiment.command === "sim") this.setView("arena", false);
    if (experiment.mode === "track" && !experiment.robots.length) this.setView("cameras", false);
  }

  /** Whether the page is seen and refreshes: else the server makes next to nothing for it. */
  get isLive() {
    return this.refresh && !document.hidden;
  }

  /** Has the server know whether the page refreshes. */
  sendRefresh() {
    this.connection.say({ refresh: this.isLive });
  }

  /** Shows what makes sense now. */
  render() {
    const { run, you } = this.store;
    this.#suit(this.store.experiment);
    const can = run?.can ?? [];
    document.body.dataset.can = can.length ? "some" : "none";
    document.body.dataset.rights = you.control ? "control" : "look";
    byId("looking").hidden = you.control;
    for (const button of this.buttons) {
      const able = this.connection.open && can.includes(button.dataset.order ?? "");
      if (button.disabled === able) button.disabled = !able;
      button.dataset.does ??= button.title || button.innerText.split("\n")[0];
      const why = able ? "" : `: not while the run is ${run?.state ?? "away"}`;
      if (button.title !== button.dataset.does + why) button.title = button.dataset.does + why;
      const since = this.#pending.get(button);
      if (since !== undefined && performance.now() - since > WAIT_MS) this.#settle(button);
    }
    const resumes = run?.state === "homing paused" || (run?.state === "paused" && run.timestep >= 0);
    write(inside(byId("start"), "span"), resumes ? "Resume" : "Start");
    // The button that goes on stands out.
    mark(byId("reset"), "primary", run?.state === "emergency" || (run?.state === "ended" && !can.includes("start")));
    const recording = Boolean(run?.recording?.on);
    press(byId("record"), recording);
    write(inside(byId("record"), "span"), recording ? "Recording" : "Record");
    for (const answer of this.store.answers.splice(0)) this.#showAnswer(answer);
  }

  /** @param {AnswerMessage} answer */
  #showAnswer(answer) {
    // A change that was carried out is among the events.
    if (answer.change && answer.ok) return;
    for (const button of this.buttons) this.#settle(button);
    this.notify(answer.text, answer.ok);
  }

  /** @param {HTMLButtonElement} button @param {MouseEvent} event */
  #click(button, event) {
    if (button.id === "record") this.toggleRecord();
    else this.order(button.dataset.order ?? "");
    this.#pending.set(button, performance.now());
    mark(button, "waits", true);
    // Whoever uses a mouse goes on with the space bar, which must not press this button again.
    if (event.detail) button.blur();
  }

  /** @param {HTMLButtonElement} button */
  #settle(button) {
    this.#pending.delete(button);
    mark(button, "waits", false);
  }

  /** Says something for a moment.
   * @type {Notify} */
  notify = (text, ok) => {
    const notice = make("p", { className: ok ? "toast" : "toast bad" }, text);
    byId("toasts").replaceChildren(notice);
    setTimeout(() => notice.remove(), NOTICE_MS);
  };
}

/** Why the space bar does nothing, and what goes on.
 * @param {RunMessage | null} run */
function whyNot(run) {
  if (run?.state === "emergency") return "Emergency stop: first Reset (Shift+R), then Start";
  if (run?.state === "ended") return "The run has ended: first Reset (Shift+R), then Start";
  return `Nothing to start or pause: the run is ${run?.state ?? "away"}`;
}
