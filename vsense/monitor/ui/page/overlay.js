// The virtual world over a camera's picture, through the camera's own lens: everything at its height.

import { Brush } from "./brush.js";
import { Ground } from "./ground.js";
import { Lens } from "./lens.js";
import { ThroughLens } from "./projections.js";
import {
  drawCones, drawFence, drawLights, drawPhysicalSolids,
  drawVirtualSolids, drawZones, sceneOf,
} from "./scene.js";
import { drawRobots, drawStrangers } from "./scene_robots.js";
import { colours } from "./theme.js";

/** One camera's overlay. */
export class Overlay {
  /**
   * @param {CameraModel} model @param {Store} store
   * @param {() => void} loaded is called when a picture of the floor has arrived. */
  constructor(model, store, loaded) {
    this.store = store;
    this.lens = new Lens(model);
    this.ground = new Ground(this.lens, loaded);
  }

  /** Draws what there was at an arena state; gives where words stand.
   * @param {Pen} pen @param {number} zoom pixels of the canvas in one of the camera
   * @param {number} ratio pixels of the canvas in one of the screen @param {ArenaMessage | null} arena
   * @param {number | null} chosen */
  draw(pen, zoom, ratio, arena, chosen) {
    const { store, ground } = this;
    const view = new ThroughLens(this.lens, zoom, ratio);
    const signals = store.signalsAt(arena?.run_timestep);
    const scene = sceneOf(new Brush(pen, view), store, colours, chosen, arena, signals);
    pen.save();
    pen.lineJoin = pen.lineCap = "round";
    this.#lay(pen, zoom, ground.floor(store.world?.floor));
    store.fields?.fields.forEach((field, number) => {
      if (field.peak > 0) this.#lay(pen, zoom, ground.field(field, number));
    });
    drawZones(scene);
    drawCones(scene);
    drawPhysicalSolids(scene);
    drawVirtualSolids(scene);
    drawLights(scene);
    drawFence(scene);
    drawStrangers(scene);
    drawRobots(scene);
    pen.restore();
    return view.words;
  }

  /** @param {Pen} pen @param {number} zoom @param {HTMLCanvasElement | null} canvas */
  #lay(pen, zoom, canvas) {
    const { width_px, height_px } = this.lens.model;
    if (canvas) pen.drawImage(canvas, 0, 0, width_px * zoom, height_px * zoom);
  }
}
