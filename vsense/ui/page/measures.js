// The experiment's measures: the newest number of each and its line since the run began.

import { byId, fit, make, write } from "./dom.js";
import { reading } from "./format.js";
import * as theme from "./theme.js";

const LINES = ["cone", "lit", "blue", "green", "virtual", "stranger"];
const SHOWN = 6;

/** The strip below the arena. */
export class Measures {
  constructor(store) {
    this.store = store;
    this.box = byId("measures");
    this.shown = new Map();
  }

  /** Renews numbers and lines; called a few times per second. */
  tell() {
    const names = [...this.store.measures.keys()].slice(0, SHOWN);
    if (names.join("\n") !== [...this.shown.keys()].join("\n")) this.#build(names);
    for (const [name, { number, canvas, label, colour }] of this.shown) {
      const line = this.store.measures.get(name);
      write(number, reading(line.at(-1)?.[1] ?? null));
      write(label, `${name} · at most ${reading(Math.max(...line.map(([, value]) => value ?? 0)))}`);
      fit(canvas);
      sketch(canvas, line, theme.colours[colour]);
    }
  }

  #build(names) {
    this.shown = new Map(
      names.map((name, index) => [name, { number: make("b"), canvas: make("canvas"), label: make("span"), colour: LINES[index % LINES.length] }]),
    );
    this.box.replaceChildren(
      ...[...this.shown.values()].map(({ number, canvas, label }) =>
        make("div", { className: "measure" }, number, canvas, label),
      ),
    );
  }
}

function sketch(canvas, line, colour) {
  const pen = canvas.getContext("2d");
  const { width, height } = canvas;
  pen.clearRect(0, 0, width, height);
  if (line.length < 2) return;
  const values = line.map(([, value]) => value ?? 0);
  const [low, high] = [Math.min(0, ...values), Math.max(1e-9, ...values)];
  const [from, to] = [line[0][0], line.at(-1)[0]];
  const x = (time) => ((time - from) / Math.max(to - from, 1e-9)) * (width - 4) + 2;
  const y = (value) => height - 3 - ((value - low) / (high - low)) * (height - 6);
  pen.beginPath();
  line.forEach(([time], index) => pen.lineTo(x(time), y(values[index])));
  pen.strokeStyle = colour;
  pen.lineWidth = (2 * width) / Math.max(canvas.clientWidth, 1);
  pen.lineJoin = "round";
  pen.stroke();
  pen.lineTo(x(to), y(low));
  pen.lineTo(x(from), y(low));
  pen.globalAlpha = 0.14;
  pen.fillStyle = colour;
  pen.fill();
  pen.globalAlpha = 1;
}
