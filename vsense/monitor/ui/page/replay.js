// A recording's time line.

import { byId, write } from "./dom.js";
import { clock } from "./format.js";

const SEEK_EVERY_MS = 80;

/** Play, pause, speed, and the slider. */
export class Replay {
  constructor(store, controls) {
    this.store = store;
    this.controls = controls;
    this.slider = byId("seek");
    this.held = false;
    this.sought = 0;
    this.slider.addEventListener("input", () => this.#seek(false));
    this.slider.addEventListener("change", () => this.#seek(true));
    byId("play").addEventListener("click", (event) => {
      this.playOrPause();
      if (event.detail) event.currentTarget.blur();
    });
    byId("speed").addEventListener("change", (event) => controls.order("speed", Number(event.target.value)));
  }

  playOrPause() {
    this.controls.order("play", this.store.run?.replay?.playing ? 0 : 1);
  }

  #seek(final) {
    const now = performance.now();
    this.held = !final;
    write(byId("position"), clock(Number(this.slider.value)));
    if (!final && now - this.sought < SEEK_EVERY_MS) return;
    this.sought = now;
    this.controls.order("seek", Number(this.slider.value));
  }

  /** Shows where the replay is. */
  tell() {
    const replay = this.store.run?.replay;
    if (!replay) return;
    if (Number(this.slider.max) !== replay.duration_s) this.slider.max = replay.duration_s;
    if (!this.held && performance.now() - this.sought > 4 * SEEK_EVERY_MS) {
      const at = this.#position(replay);
      this.slider.value = at;
      write(byId("position"), clock(at));
    }
    write(byId("duration"), clock(replay.duration_s, 0));
    write(byId("play").querySelector("span"), replay.playing ? "Pause" : "Play");
    byId("play").querySelector("i").className = replay.playing ? "sign pause" : "sign play";
    const speed = byId("speed");
    if (document.activeElement !== speed) speed.value = String(replay.speed);
  }

  // The run tells its place once per second; between, the slider goes on by itself.
  #position(replay) {
    if (this.told !== this.store.changed.run) {
      this.told = this.store.changed.run;
      this.toldAt = performance.now();
    }
    const since = replay.playing ? ((performance.now() - this.toldAt) / 1000) * replay.speed : 0;
    return Math.min(replay.position_s + Math.min(since, 1.2 * replay.speed), replay.duration_s);
  }
}
