// The painted floor and the fields as a camera sees them: looked up pixel by pixel through its lens.

const FLOOR_PX = 360;
const FIELD_PX = 200;
const FIELD_COLOURS = [[60, 200, 60], [210, 80, 230], [0, 180, 240]];
const FLOOR_ALPHA = 140;
const FIELD_ALPHA = 190;
const WHITE = 765;

let floorPicture = null;

/** The pixels of a floor's picture in base64, once it has arrived; all that are `waiting` are called then. */
class FloorPicture {
  constructor(png) {
    this.png = png;
    this.waiting = new Set();
    const image = new Image();
    image.onload = () => {
      const canvas = new OffscreenCanvas(image.width, image.height);
      const pen = canvas.getContext("2d", { willReadFrequently: true });
      pen.drawImage(image, 0, 0);
      this.pixels = pen.getImageData(0, 0, image.width, image.height);
      for (const loaded of this.waiting) loaded();
      this.waiting.clear();
    };
    image.src = `data:image/png;base64,${png}`;
  }
}

/** A raster over a camera's whole picture, with the floor's place in each of its pixels. */
class Raster {
  constructor(lens, width) {
    const { width_px, height_px } = lens.model;
    this.width = Math.min(width, width_px);
    this.height = Math.max(Math.round((this.width * height_px) / width_px), 1);
    this.canvas = new OffscreenCanvas(this.width, this.height);
    this.pen = this.canvas.getContext("2d");
    this.made = this.pen.createImageData(this.width, this.height);
    this.words = new Uint32Array(this.made.data.buffer);
    /** x and y [m] of each pixel, NaN where no floor is seen. */
    this.places = new Float32Array(2 * this.words.length).fill(Number.NaN);
    const zoom = width_px / this.width;
    for (let row = 0; row < this.height; row += 1) {
      for (let column = 0; column < this.width; column += 1) {
        const found = lens.floor((column + 0.5) * zoom - 0.5, (row + 0.5) * zoom - 0.5);
        if (found) this.places.set(found, 2 * (row * this.width + column));
      }
    }
  }

  show() {
    this.pen.putImageData(this.made, 0, 0);
    return this.canvas;
  }
}

/** One camera's ground; made again only where floor or fields have changed. */
export class Ground {
  constructor(lens, loaded) {
    this.lens = lens;
    this.loaded = loaded;
    this.fields = new Map();
  }

  /** The painted floor as a canvas of the whole picture, or null where there is none. */
  floor(told) {
    if (!told) return null;
    if (told.png && floorPicture?.png !== told.png) floorPicture = new FloorPicture(told.png);
    const pixels = told.png ? floorPicture.pixels : null;
    if (told.png && !pixels) floorPicture.waiting.add(this.loaded);
    const plain = !told.png && told.color.some((part) => part !== 255);
    if (!pixels && !plain) return null;
    // Every message about the world brings a new object, mostly with the same floor.
    const paint = [told.color, told.size_m, told.centre_m].join();
    if (this.floorPaint !== paint || this.floorPixels !== pixels) {
      [this.floorPaint, this.floorPixels] = [paint, pixels];
      this.floorRaster ??= new Raster(this.lens, FLOOR_PX);
      paintFloor(this.floorRaster, told, pixels);
    }
    return this.floorRaster.canvas;
  }

  /** A field as a canvas of the whole picture; `number` is its place among the fields. */
  field(told, number) {
    let kept = this.fields.get(told.id);
    const shape = [told.corner_m, told.cell_m, told.columns, told.rows].join();
    if (kept?.shape !== shape) {
      const raster = new Raster(this.lens, FIELD_PX);
      kept = { shape, raster, cells: cellsOf(raster, told), colours: shades(FIELD_COLOURS[number % FIELD_COLOURS.length]) };
      this.fields.set(told.id, kept);
    }
    if (kept.levels !== told.levels) {
      kept.levels = told.levels;
      const levels = atob(told.levels);
      const { raster, cells, colours } = kept;
      for (let at = 0; at < cells.length; at += 1) {
        raster.words[at] = cells[at] < 0 ? 0 : colours[levels.charCodeAt(cells[at])];
      }
      raster.show();
    }
    return kept.raster.canvas;
  }
}

// The cell of a field in each pixel, or -1.
function cellsOf({ places, words }, { corner_m, cell_m, columns, rows }) {
  const cells = new Int32Array(words.length).fill(-1);
  for (let at = 0; at < cells.length; at += 1) {
    const column = Math.floor((places[2 * at] - corner_m[0]) / cell_m);
    const row = Math.floor((places[2 * at + 1] - corner_m[1]) / cell_m);
    if (column >= 0 && row >= 0 && column < columns && row < rows) cells[at] = row * columns + column;
  }
  return cells;
}

// A field's colour for each level, as the words of an image: red, green, blue, alpha.
function shades([r, g, b]) {
  const bytes = new Uint8ClampedArray(4 * 256);
  for (let level = 0; level < 256; level += 1) bytes.set([r, g, b, FIELD_ALPHA * Math.sqrt(level / 255)], 4 * level);
  return new Uint32Array(bytes.buffer);
}

// White is a floor without paint, which does not hide what the camera sees.
function paintFloor(raster, { size_m, centre_m, color }, pixels) {
  const { data } = raster.made;
  raster.words.fill(0);
  for (let at = 0; at < raster.words.length; at += 1) {
    const across = (raster.places[2 * at] - centre_m[0]) / size_m[0] + 0.5;
    const down = 0.5 - (raster.places[2 * at + 1] - centre_m[1]) / size_m[1];
    if (!(across >= 0 && across < 1 && down >= 0 && down < 1)) continue;
    if (!pixels) {
      data.set([...color, FLOOR_ALPHA], 4 * at);
      continue;
    }
    const from = 4 * (Math.floor(down * pixels.height) * pixels.width + Math.floor(across * pixels.width));
    const [r, g, b, alpha] = pixels.data.subarray(from, from + 4);
    if (r + g + b !== WHITE) data.set([r, g, b, (FLOOR_ALPHA * alpha) / 255], 4 * at);
  }
  raster.show();
}
