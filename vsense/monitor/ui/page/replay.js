// A recording's time line.

import { byId, inside, write } from "./dom.js";
import { clock } from "./format.js";

const SEEK_EVERY_MS = 80;

/** Play, pause, speed, and the slider. */
export class Replay {
  /** The newest `/run`, by its number, and when it came [ms]. */
  #news = { number: -1, heard: 0 };
  /** How long before the run the recording begins [s]. */
  #ahead_s = 0;

  /** @param {Store} store @param {Controls} controls */
  constructor(store, controls) {
    this.store = store;
    this.controls = controls;
    this.slider = byId("seek");
    this.held = false;
    this.sought = 0;
    this.slider.addEventListener("input", () => this.#seek(false));
    this.slider.addEventListener("change", () => this.#seek(true));
    this.button = byId("play");
    this.speed = byId("speed");
    this.button.addEventListener("click", (event) => {
      this.playOrPause();
      if (event.detail) this.button.blur();
    });
    this.speed.addEventListener("change", () => controls.order("speed", Number(this.speed.value)));
  }

  playOrPause() {
    this.controls.order("play", this.store.run?.replay?.playing ? 0 : 1);
  }

  /** @param {boolean} final */
  #seek(final) {
    const now = performance.now();
    this.held = !final;
    this.#writeClock(Number(this.slider.value));
    if (!final && now - this.sought < SEEK_EVERY_MS) return;
    this.sought = now;
    this.controls.order("seek", Number(this.slider.value));
  }

  /** Shows where the replay is. */
  render() {
    const replay = this.store.run?.replay;
    if (!replay) return;
    if (Number(this.slider.max) !== replay.duration_s) this.slider.max = String(replay.duration_s);
    this.slider.min = String(replay.begin_s ?? 0);
    if (!this.held && performance.now() - this.sought > 4 * SEEK_EVERY_MS) {
      const at = this.#position(replay);
      this.slider.value = String(at);
      this.#writeClock(at);
    }
    write(inside(this.button, "span"), replay.playing ? "Pause" : "Play");
    inside(this.button, "i").className = replay.playing ? "sign pause" : "sign play";
    if (document.activeElement !== this.speed) this.speed.value = String(replay.speed);
  }

  /** One clock, the run's: a recording may begin before it.
   * @param {number} at_s of the recording */
  #writeClock(at_s) {
    const { run, now } = this.store;
    if (!this.held) this.#ahead_s = (run?.replay?.position_s ?? 0) - (now.time_s ?? 0);
    const before = at_s < this.#ahead_s - 0.5 || (!this.held && now.timestep < 0);
    write(byId("position"), before ? "before" : clock(this.held ? at_s - this.#ahead_s : now.time_s));
    write(byId("duration"), clock(run?.length_s ?? (run?.replay?.duration_s ?? 0) - this.#ahead_s, 0));
  }

  /** The run says its place once per second; between, the slider goes on by itself.
   * @param {ReplayState} replay */
  #position(replay) {
    const number = this.store.changed.run;
    if (this.#news.number !== number) this.#news = { number, heard: performance.now() };
    const since = replay.playing ? ((performance.now() - this.#news.heard) / 1000) * replay.speed : 0;
    return Math.min(replay.position_s + Math.min(since, 1.2 * replay.speed), replay.duration_s);
  }
}
