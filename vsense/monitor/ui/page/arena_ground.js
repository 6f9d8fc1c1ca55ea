// What lies under everything: floor, grid, fields, walls, zones, scale bar.

const FIELD_COLOURS = [[60, 160, 60], [170, 60, 190], [0, 150, 200]];
const GRID_M = 0.5;

let floor = { png: null, image: null };
const clouds = new Map();

/** Draws the ground; `loaded` is called when a picture in it has arrived. */
export function drawGround({ pen, place, store, colours, layers, dark, loaded }) {
  const [width, height] = place.size;
  const left = place.x(place.centre[0] - width / 2);
  const top = place.y(place.centre[1] + height / 2);
  pen.fillStyle = colours.card;
  pen.fillRect(0, 0, pen.canvas.width, pen.canvas.height);
  pen.fillStyle = colours.floor;
  pen.fillRect(left, top, width * place.zoom, height * place.zoom);
  const world = store.world;
  if (world?.floor) paintFloor(pen, place, world.floor, dark, loaded);
  grid(pen, place, colours, left, top);
  for (const entity of world?.entities ?? []) if (entity.kind === "zone") zone(pen, place, colours, entity);
  if (layers.fields) (store.fields?.fields ?? []).forEach((field, index) => cloud(pen, place, field, index));
  for (const entity of world?.entities ?? []) if (entity.physical) solid(pen, place, colours, entity);
  scaleBar(pen, place, colours, left, top + height * place.zoom);
}

function paintFloor(pen, place, told, dark, loaded) {
  const [r, g, b] = told.color;
  const [width, height] = told.size_m;
  const box = [
    place.x(told.centre_m[0] - width / 2), place.y(told.centre_m[1] + height / 2),
    width * place.zoom, height * place.zoom,
  ];
  // White is what a floor is without paint: in the dark it would only dazzle.
  if (r !== 255 || g !== 255 || b !== 255) {
    pen.globalAlpha = dark ? 0.4 : 0.75;
    pen.fillStyle = `rgb(${r} ${g} ${b})`;
    pen.fillRect(...box);
    pen.globalAlpha = 1;
  }
  if (!told.png) return;
  if (floor.png !== told.png) {
    floor = { png: told.png, image: null };
    const image = new Image();
    image.onload = () => {
      floor.image = withoutWhite(image);
      loaded();
    };
    image.src = `data:image/png;base64,${told.png}`;
  }
  if (floor.image) {
    pen.imageSmoothingEnabled = false;
    pen.globalAlpha = dark ? 0.4 : 0.7;
    pen.drawImage(floor.image, ...box);
    pen.globalAlpha = 1;
    pen.imageSmoothingEnabled = true;
  }
}

function withoutWhite(image) {
  const canvas = new OffscreenCanvas(image.width, image.height);
  const pen = canvas.getContext("2d", { willReadFrequently: true });
  pen.drawImage(image, 0, 0);
  const pixels = pen.getImageData(0, 0, image.width, image.height);
  for (let at = 0; at < pixels.data.length; at += 4) {
    if (pixels.data[at] + pixels.data[at + 1] + pixels.data[at + 2] === 765) pixels.data[at + 3] = 0;
  }
  pen.putImageData(pixels, 0, 0);
  return canvas;
}

function grid(pen, place, colours, left, top) {
  const [width, height] = place.size;
  const [right, bottom] = [left + width * place.zoom, top + height * place.zoom];
  pen.beginPath();
  for (let n = Math.ceil((place.centre[0] - width / 2) / GRID_M); n * GRID_M < place.centre[0] + width / 2; n += 1) {
    pen.moveTo(place.x(n * GRID_M), top);
    pen.lineTo(place.x(n * GRID_M), bottom);
  }
  for (let n = Math.ceil((place.centre[1] - height / 2) / GRID_M); n * GRID_M < place.centre[1] + height / 2; n += 1) {
    pen.moveTo(left, place.y(n * GRID_M));
    pen.lineTo(right, place.y(n * GRID_M));
  }
  pen.strokeStyle = colours.grid;
  pen.lineWidth = place.ratio;
  pen.stroke();
  pen.strokeStyle = colours.solid;
  pen.strokeRect(left, top, right - left, bottom - top);
}

function zone(pen, place, colours, told) {
  outline(pen, place, told);
  if (told.color) {
    pen.fillStyle = `rgb(${told.color.join(" ")} / 0.28)`;
    pen.fill();
  }
  pen.setLineDash([5 * place.ratio, 4 * place.ratio]);
  pen.strokeStyle = told.color ? `rgb(${told.color.join(" ")})` : colours.muted;
  pen.lineWidth = 1.3 * place.ratio;
  pen.stroke();
  pen.setLineDash([]);
  pen.fillStyle = colours.muted;
  pen.font = `${11 * place.ratio}px system-ui, sans-serif`;
  pen.textAlign = "center";
  pen.fillText(told.id, place.x(told.x_m), place.y(told.y_m) + 4 * place.ratio);
}

function solid(pen, place, colours, told) {
  outline(pen, place, told);
  pen.fillStyle = colours.solid;
  pen.strokeStyle = colours["solid-line"];
  pen.lineWidth = place.ratio;
  pen.fill();
  pen.stroke();
}

/** The outline of a box, cylinder or zone as the pen's path. */
export function outline(pen, place, told) {
  const [x, y] = told.position_m ?? [told.x_m, told.y_m];
  pen.beginPath();
  if (told.kind === "cylinder" || told.shape === "circle") {
    pen.arc(place.x(x), place.y(y), told.radius_m * place.zoom, 0, 2 * Math.PI);
    return;
  }
  const [cosine, sine] = [Math.cos(told.yaw_rad), Math.sin(told.yaw_rad)];
  for (const [along, across] of [[-1, -1], [1, -1], [1, 1], [-1, 1]]) {
    const [u, v] = [(along * told.size_m[0]) / 2, (across * told.size_m[1]) / 2];
    pen.lineTo(place.x(x + u * cosine - v * sine), place.y(y + u * sine + v * cosine));
  }
  pen.closePath();
}

function cloud(pen, place, field, index) {
  const kept = clouds.get(field.id);
  if (kept?.levels !== field.levels) {
    clouds.set(field.id, { levels: field.levels, canvas: tinted(field, FIELD_COLOURS[index % FIELD_COLOURS.length]) });
  }
  const [x, y] = field.corner_m;
  const [width, height] = [field.columns * field.cell_m, field.rows * field.cell_m];
  pen.drawImage(
    clouds.get(field.id).canvas, place.x(x), place.y(y + height), width * place.zoom, height * place.zoom,
  );
}

function tinted(field, [r, g, b]) {
  const levels = atob(field.levels);
  const canvas = new OffscreenCanvas(field.columns, field.rows);
  const pen = canvas.getContext("2d");
  const pixels = pen.createImageData(field.columns, field.rows);
  for (let row = 0; row < field.rows; row += 1) {
    for (let column = 0; column < field.columns; column += 1) {
      // The first row of the levels lies at the lowest y, that of a picture at the highest.
      const at = 4 * ((field.rows - 1 - row) * field.columns + column);
      const share = Math.sqrt(levels.charCodeAt(row * field.columns + column) / 255);
      pixels.data.set([r, g, b, 190 * share], at);
    }
  }
  pen.putImageData(pixels, 0, 0);
  return canvas;
}

function scaleBar(pen, place, colours, left, bottom) {
  const [x, y] = [left + 14 * place.ratio, bottom - 14 * place.ratio];
  pen.strokeStyle = pen.fillStyle = colours.ink;
  pen.lineWidth = 2 * place.ratio;
  pen.beginPath();
  pen.moveTo(x, y);
  pen.lineTo(x + GRID_M * place.zoom, y);
  pen.stroke();
  pen.font = `600 ${11 * place.ratio}px system-ui, sans-serif`;
  pen.textAlign = "left";
  pen.fillText(`${GRID_M} m`, x, y - 6 * place.ratio);
}
