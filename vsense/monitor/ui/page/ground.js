// The painted floor and the fields, as a picture of the arena from above or as a camera sees them:
// looked up pixel by pixel through its lens.

import { penOf } from "./dom.js";

const FLOOR_PX = 360;
const FIELD_PX = 200;
const FIELD_COLOURS = {
  above: [[60, 160, 60], [170, 60, 190], [0, 150, 200]],
  lens: [[60, 200, 60], [210, 80, 230], [0, 180, 240]],
};
const FLOOR_ALPHA = 140;
const FIELD_ALPHA = 190;
const WHITE = 765;

/** The pixels of a floor's picture in base64, once it has arrived; all that are `waiting` are called then. */
class FloorPicture {
  /** White is a floor without paint: it is transparent.
   * @type {ImageData | null} */
  pixels = null;
  canvas = document.createElement("canvas");
  /** @type {Set<() => void>} */
  waiting = new Set();

  /** @param {string} png */
  constructor(png) {
    this.png = png;
    const image = new Image();
    image.onload = () => {
      this.#take(image);
      for (const loaded of this.waiting) loaded();
      this.waiting.clear();
    };
    image.src = `data:image/png;base64,${png}`;
  }

  /** @param {HTMLImageElement} image */
  #take(image) {
    this.canvas.width = image.width;
    this.canvas.height = image.height;
    const pen = penOf(this.canvas, { willReadFrequently: true });
    pen.drawImage(image, 0, 0);
    const pixels = pen.getImageData(0, 0, image.width, image.height);
    const { data } = pixels;
    for (let at = 0; at < data.length; at += 4) {
      if (data[at] + data[at + 1] + data[at + 2] === WHITE) data[at + 3] = 0;
    }
    pen.putImageData(pixels, 0, 0);
    this.pixels = pixels;
  }
}

/** All views show the same floor.
 * @type {FloorPicture | null} */
let floorPicture = null;

/** The floor's picture, or null where it has none or has not arrived: then `loaded` is called once it has.
 * @param {Floor} floor @param {() => void} loaded */
export function pictureOf(floor, loaded) {
  if (!floor.png) return null;
  if (floorPicture?.png !== floor.png) floorPicture = new FloorPicture(floor.png);
  if (floorPicture.pixels) return floorPicture;
  floorPicture.waiting.add(loaded);
  return null;
}

/** An image that is painted pixel by pixel. */
class Raster {
  /** @param {number} width @param {number} height */
  constructor(width, height) {
    this.width = width;
    this.height = height;
    this.canvas = Object.assign(document.createElement("canvas"), { width, height });
    this.pen = penOf(this.canvas);
    this.image = this.pen.createImageData(width, height);
    this.words = new Uint32Array(this.image.data.buffer);
  }

  show() {
    this.pen.putImageData(this.image, 0, 0);
    return this.canvas;
  }
}

/** A raster over a camera's whole picture, with the floor's place in each of its pixels. */
class LensRaster extends Raster {
  /** @param {Lens} lens @param {number} most width of it. */
  constructor(lens, most) {
    const { width_px, height_px } = lens.model;
    const width = Math.min(most, width_px);
    super(width, Math.max(Math.round((width * height_px) / width_px), 1));
    /** x and y [m] of each pixel, NaN where no floor is seen. */
    this.places = new Float32Array(2 * this.words.length).fill(Number.NaN);
    const zoom = width_px / this.width;
    for (let row = 0; row < this.height; row += 1) {
      for (let column = 0; column < this.width; column += 1) {
        const place = lens.floor((column + 0.5) * zoom - 0.5, (row + 0.5) * zoom - 0.5);
        if (place) this.places.set(place, 2 * (row * this.width + column));
      }
    }
  }

  /** The cell of a field in each pixel, or -1.
   * @param {Field} field */
  cellsOf({ corner_m, cell_m, columns, rows }) {
    const cells = new Int32Array(this.words.length).fill(-1);
    for (let at = 0; at < cells.length; at += 1) {
      const column = Math.floor((this.places[2 * at] - corner_m[0]) / cell_m);
      const row = Math.floor((this.places[2 * at + 1] - corner_m[1]) / cell_m);
      if (column >= 0 && row >= 0 && column < columns && row < rows) cells[at] = row * columns + column;
    }
    return cells;
  }

  /** Paints the floor: white does not hide what the camera sees.
   * @param {Floor} floor @param {ImageData | null} pixels */
  paint({ size_m, centre_m, color }, pixels) {
    const { data } = this.image;
    this.words.fill(0);
    for (let at = 0; at < this.words.length; at += 1) {
      const across = (this.places[2 * at] - centre_m[0]) / size_m[0] + 0.5;
      const down = 0.5 - (this.places[2 * at + 1] - centre_m[1]) / size_m[1];
      if (!(across >= 0 && across < 1 && down >= 0 && down < 1)) continue;
      if (!pixels) {
        data.set([...color, FLOOR_ALPHA], 4 * at);
        continue;
      }
      const from = 4 * (Math.floor(down * pixels.height) * pixels.width + Math.floor(across * pixels.width));
      const [r, g, b, alpha] = pixels.data.subarray(from, from + 4);
      if (alpha) data.set([r, g, b, (FLOOR_ALPHA * alpha) / 255], 4 * at);
    }
    return this.show();
  }
}

/** One view's floor and fields; painted again only where they have changed. */
export class Ground {
  /** @type {LensRaster | null} */
  floorRaster = null;
  /** @type {HTMLCanvasElement | null} */
  floorCanvas = null;
  #floorKey = "";
  /** @type {ImageData | null} */
  #floorPixels = null;
  /** @type {Map<string, { shape: string, levels: string, raster: Raster, cells: Int32Array, colours: Uint32Array }>} */
  #fields = new Map();

  /**
   * @param {Lens | null} lens null: from above.
   * @param {() => void} loaded is called when a picture of the floor has arrived. */
  constructor(lens, loaded) {
    this.lens = lens;
    this.loaded = loaded;
  }

  /** The painted floor as a canvas of a camera's whole picture, or null where there is none.
   * @param {Floor | null | undefined} floor */
  floor(floor) {
    if (!floor || !this.lens) return null;
    const pixels = pictureOf(floor, this.loaded)?.pixels ?? null;
    const plain = !floor.png && floor.color.some((part) => part !== 255);
    if (!pixels && !plain) return null;
    // Every message about the world brings a new object, mostly with the same floor.
    const key = [floor.color, floor.size_m, floor.centre_m].join();
    if (!this.floorCanvas || this.#floorKey !== key || this.#floorPixels !== pixels) {
      [this.#floorKey, this.#floorPixels] = [key, pixels];
      this.floorRaster ??= new LensRaster(this.lens, FLOOR_PX);
      this.floorCanvas = this.floorRaster.paint(floor, pixels);
    }
    return this.floorCanvas;
  }

  /** A field as a canvas: of a camera's whole picture, or of the field from above.
   * @param {Field} field @param {number} number its place among the fields. */
  field(field, number) {
    let layer = this.#fields.get(field.id);
    const shape = [field.corner_m, field.cell_m, field.columns, field.rows].join();
    if (layer?.shape !== shape) {
      const colours = FIELD_COLOURS[this.lens ? "lens" : "above"];
      layer = { shape, levels: "", ...this.#rasterOf(field), colours: shades(colours[number % colours.length]) };
      this.#fields.set(field.id, layer);
    }
    if (layer.levels !== field.levels) {
      layer.levels = field.levels;
      const levels = atob(field.levels);
      const { raster, cells, colours } = layer;
      for (let at = 0; at < cells.length; at += 1) {
        raster.words[at] = cells[at] < 0 ? 0 : colours[levels.charCodeAt(cells[at])];
      }
      raster.show();
    }
    return layer.raster.canvas;
  }

  /** @param {Field} field */
  #rasterOf(field) {
    if (this.lens) {
      const raster = new LensRaster(this.lens, FIELD_PX);
      return { raster, cells: raster.cellsOf(field) };
    }
    const { columns, rows } = field;
    // The first row of the levels lies at the lowest y, that of a picture at the highest.
    const flipped = (/** @type {unknown} */ _, /** @type {number} */ at) =>
      (rows - 1 - Math.floor(at / columns)) * columns + (at % columns);
    return { raster: new Raster(columns, rows), cells: Int32Array.from({ length: columns * rows }, flipped) };
  }
}

/** A field's colour for each level, as the words of an image: red, green, blue, alpha.
 * @param {number[]} colour */
function shades([r, g, b]) {
  const bytes = new Uint8ClampedArray(4 * 256);
  for (let level = 0; level < 256; level += 1) bytes.set([r, g, b, FIELD_ALPHA * Math.sqrt(level / 255)], 4 * level);
  return new Uint32Array(bytes.buffer);
}
