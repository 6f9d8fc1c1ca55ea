// The buttons: what can be pressed now, and what a press sends.

import { byId, make, mark, press, remember, remembered, write } from "./dom.js";

const TOAST_MS = 4500;
const WAIT_MS = 3000;

/** Start to emergency stop, record, refresh, and what is shown. */
export class Controls {
  constructor(store, connection) {
    this.store = store;
    this.connection = connection;
    this.refresh = true;
    this.view = "both";
    this.suited = false;
    this.buttons = [...document.querySelectorAll("[data-order]")];
    for (const button of this.buttons) {
      button.addEventListener("click", (event) => this.#pressed(button, event));
    }
    // On the way down already: an emergency does not wait for a finger to leave the button.
    byId("emergency").addEventListener("pointerdown", () => this.emergency());
    byId("emergency").addEventListener("click", (event) => event.detail || this.emergency());
    byId("refresh").addEventListener("click", () => this.setRefresh(!this.refresh));
    for (const button of document.querySelectorAll("[data-view]:is(button)")) {
      button.addEventListener("click", () => this.setView(button.dataset.view));
    }
    this.setView(remembered("view", "both"));
  }

  /** Sends an order. */
  order(name, value = 0) {
    if (!this.connection.order(name, value)) this.toast("not sent: there is no connection", false);
  }

  /** Stops everything, now; nothing that the page shows is asked before. */
  emergency() {
    if (document.body.dataset.mode === "replay") return;
    if (document.body.dataset.mode === "sim") return this.#pauseSimulation();
    if (document.body.dataset.mode === "track") {
      this.toast("nothing here moves a robot: stop them where they are driven", false);
      return;
    }
    if (!this.store.you.control) this.order("emergency", 1);
    else if (!this.connection.stopAll()) this.toast("EMERGENCY STOP is not delivered: there is no connection", false);
  }

  // No robot moves there: what can be stopped is the picture.
  #pauseSimulation() {
    if (this.store.run?.can?.includes("pause")) this.order("pause");
    else this.toast("a simulation: no robot moves", false);
  }

  /** What the space bar does in this state. */
  startOrPause() {
    const can = this.store.run?.can ?? [];
    if (can.includes("start")) this.order("start");
    else if (can.includes("pause")) this.order("pause");
    else this.toast("neither start nor pause makes sense now", false);
  }

  toggleRecord() {
    this.order("record", this.store.run?.recording?.on ? 0 : 1);
  }

  setRefresh(on) {
    this.refresh = on;
    press(byId("refresh"), on);
    write(byId("refresh").querySelector("span"), on ? "Refresh" : "Refresh off");
    this.tellServer();
  }

  setView(view, keep = true) {
    this.view = ["both", "arena", "cameras"].includes(view) ? view : "both";
    byId("main").dataset.view = this.view;
    for (const button of document.querySelectorAll("[data-view]:is(button)")) press(button, button.dataset.view === this.view);
    if (keep) remember("view", this.view);
  }

  /** A camera that is only looked through has no arena: it gets all the room, once. */
  #suit(experiment) {
    if (this.suited || !experiment) return;
    this.suited = true;
    if (experiment.command === "sim") this.setView("arena", false);
    if (experiment.mode === "track" && !experiment.robots.length) this.setView("cameras", false);
  }

  /** Whether the page is seen and refreshes: else the server makes next to nothing for it. */
  get lively() {
    return this.refresh && !document.hidden;
  }

  tellServer() {
    this.connection.say({ refresh: this.lively });
  }

  /** Shows what makes sense now. */
  tell() {
    const { run, you } = this.store;
    this.#suit(this.store.experiment);
    const state = run?.state ?? "none";
    const can = run?.can ?? [];
    document.body.dataset.can = can.length ? "some" : "none";
    document.body.dataset.rights = you.control ? "control" : "look";
    byId("looking").hidden = you.control;
    for (const button of this.buttons) {
      const able = this.connection.open && can.includes(button.dataset.order);
      if (button.disabled === able) button.disabled = !able;
      if (button.waits && performance.now() - button.waits > WAIT_MS) this.#waits(button, 0);
    }
    write(byId("start").querySelector("span"), state === "homing paused" || (state === "paused" && run?.timestep >= 0) ? "Resume" : "Start");
    const recording = Boolean(run?.recording?.on);
    press(byId("record"), recording);
    write(byId("record").querySelector("span"), recording ? "Recording" : "Record");
    for (const answer of this.store.answers.splice(0)) {
      // Of a change that was carried out the events tell.
      if (answer.change && answer.ok) continue;
      for (const button of this.buttons) this.#waits(button, 0);
      this.toast(answer.text, answer.ok);
    }
  }

  #pressed(button, event) {
    if (button.id === "record") this.toggleRecord();
    else this.order(button.dataset.order);
    this.#waits(button, performance.now());
    // Whoever uses a mouse goes on with the space bar, which must not press this button again.
    if (event.detail) button.blur();
  }

  #waits(button, since) {
    button.waits = since;
    mark(button, "waits", since);
  }

  /** Says something for a moment. */
  toast(text, ok) {
    const toast = make("p", { className: ok ? "toast" : "toast bad" }, text);
    byId("toasts").append(toast);
    setTimeout(() => toast.remove(), TOAST_MS);
  }
}
