// One chart: axes from where the data ask, steps as steps, gaps as gaps.

import { penOf } from "./dom.js";
import { clock } from "./format.js";
import * as theme from "./theme.js";

/** @typedef {import("./series.js").Series} Series */
/** Where times and values are in a chart [px].
 * @typedef {{ x(time: number): number, y(value: number): number, ratio: number, now: number | null }} Scale */

const COLOURS = ["series1", "series2", "series3", "series4", "series5", "series6"];
const LETTERS_PX = 12;
const MARKS_PX = 26;
const LEAST_PX = 1e-9;

/** Draws a series from its first time, or the run's, until now.
 * @param {HTMLCanvasElement} canvas @param {Series} series @param {number[]} span @param {number | null} now
 * @param {number} index of the chart, for its colour */
export function drawChart(canvas, series, [from, to], now, index) {
  const pen = penOf(canvas);
  const { width, height } = canvas;
  const ratio = width / Math.max(canvas.clientWidth, 1);
  pen.clearRect(0, 0, width, height);
  const all = [...series.values.flatMap(numbersIn), ...series.spans.flatMap((span) => span ?? [])];
  if (!all.length) return;
  pen.font = `${LETTERS_PX * ratio}px system-ui, sans-serif`;
  const top = LETTERS_PX * ratio * 0.6;
  const bottom = height - LETTERS_PX * ratio * 1.5;
  const marks = marksOf(all, Math.max(2, Math.floor((bottom - top) / (MARKS_PX * ratio))));
  const [low, high] = [marks[0], marks[marks.length - 1]];
  const words = marks.map(short);
  const side = Math.max(...words.map((word) => pen.measureText(word).width)) + 7 * ratio;
  /** @type {Scale} */
  const scale = {
    ratio, now,
    x: (time) => side + ((time - from) / (to - from)) * (width - side - 2 * ratio),
    y: (value) => bottom - ((value - low) / (high - low)) * (bottom - top),
  };
  drawAxes(pen, scale, marks, words, [side, width], [from, to]);
  const count = Math.max(...series.values.map((values) => values?.length ?? 0));
  // An area says how much there is: it stands on the zero, or is none.
  const base = count === 1 && low <= 0 && high >= 0 ? scale.y(0) : null;
  for (let place = 0; place < count; place += 1) {
    pen.strokeStyle = pen.fillStyle = theme.colours[COLOURS[(index + place) % COLOURS.length]];
    drawLine(pen, series, place, scale, base);
  }
  if (typeof now === "number" && now >= from && now < to - 1e-6) {
    pen.fillStyle = theme.colours.muted;
    pen.fillRect(scale.x(now), 0, ratio, bottom);
  }
}

/** @param {ChartValues} values @returns {number[]} */
export const numbersIn = (values) => (values ?? []).flatMap((value) => (typeof value === "number" ? [value] : []));

/** Round numbers that hold all values; whole ones where all values are whole.
 * @param {number[]} all @param {number} most */
export function marksOf(all, most) {
  let [low, high] = [all.reduce((a, b) => Math.min(a, b)), all.reduce((a, b) => Math.max(a, b))];
  // Amounts stand on their zero; what varies a little around much is shown as it varies.
  if (low > 0 && (low < 0.6 * high || low === high)) low = 0;
  if (high < 0 && low === high) high = 0;
  if (high - low < LEAST_PX) high = low + 1;
  const step = stepOf((high - low) / most, all.every(Number.isInteger));
  const [first, last] = [Math.floor(low / step + 1e-9), Math.ceil(high / step - 1e-9)];
  return Array.from({ length: last - first + 1 }, (_, at) => Number(((first + at) * step).toPrecision(12)));
}

/** The next of 1, 2, 5, 10, ...
 * @param {number} least @param {boolean} isWhole */
function stepOf(least, isWhole) {
  const ten = 10 ** Math.floor(Math.log10(least));
  const step = [1, 2, 5, 10].map((n) => n * ten).find((n) => n >= least * (1 - 1e-9)) ?? least;
  return isWhole ? Math.max(1, Math.ceil(step - 1e-9)) : step;
}

/** @param {Pen} pen @param {Scale} scale @param {number[]} marks @param {string[]} values
 * @param {number[]} sides of the lines [px] @param {number[]} times */
function drawAxes(pen, { x, y, ratio }, marks, values, [left, right], [from, to]) {
  pen.fillStyle = theme.colours.muted;
  pen.strokeStyle = theme.colours.grid;
  pen.lineWidth = ratio;
  pen.textAlign = "right";
  pen.beginPath();
  marks.forEach((mark, at) => {
    pen.fillText(values[at], left - 6 * ratio, y(mark) + 4 * ratio);
    pen.moveTo(left, y(mark));
    pen.lineTo(right, y(mark));
  });
  pen.stroke();
  pen.textAlign = "center";
  const step = timeStep(to - from, (right - left) / (64 * ratio));
  for (let time = Math.ceil(from / step) * step; time <= to; time += step) {
    const words = clock(time, step < 1 ? 1 : 0);
    const half = pen.measureText(words).width / 2;
    if (x(time) + half > right) break;
    pen.fillText(words, Math.max(x(time), half), y(marks[0]) + 15 * ratio);
  }
}

/** @param {number} span_s @param {number} most */
const timeStep = (span_s, most) =>
  [0.2, 0.5, 1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1200, 1800, 3600].find((step) => span_s / step <= most) ?? 7200;

/** @param {number} value */
function short(value) {
  const isPlain = value === 0 || (Math.abs(value) >= 1e-3 && Math.abs(value) < 1e5);
  return isPlain ? String(Number(value.toPrecision(6))) : value.toExponential(1);
}

/** A value holds until the next: a step. What was not heard of is a gap. What lies between `base` [px] and the
 * line is tinted.
 * @param {Pen} pen @param {Series} series @param {number} place among the values of a time
 * @param {Scale} scale @param {number | null} base */
function drawLine(pen, { times, values, spans, gap_s }, place, { x, y, ratio, now }, base) {
  pen.lineWidth = 1.8 * ratio;
  pen.lineJoin = "round";
  /** @type {Point[]} */
  let piece = [];
  const end = () => {
    pen.beginPath();
    for (const [px, py] of piece) pen.lineTo(px, py);
    pen.stroke();
    if (base !== null && piece.length > 1) {
      pen.lineTo(piece[piece.length - 1][0], base);
      pen.lineTo(piece[0][0], base);
      pen.globalAlpha = 0.14;
      pen.fill();
      pen.globalAlpha = 1;
    }
    piece = [];
  };
  times.forEach((time, at) => {
    const value = values[at]?.[place];
    if (typeof value !== "number" || (piece.length && time - times[at - 1] > gap_s)) end();
    if (typeof value !== "number") return;
    const before = piece.at(-1);
    if (before) piece.push([x(time), before[1]]);
    for (const edge of spans[at] ?? []) piece.push([x(time), y(edge)]);
    piece.push([x(time), y(value)]);
  });
  const last = piece.at(-1);
  const isNow = now !== null && now - (times.at(-1) ?? now) <= gap_s;
  if (last && isNow) piece.push([Math.max(x(now), last[0]), last[1]]);
  end();
}
