// The chosen robot from near: its LEDs, what it senses and how old that is.

import { rayColour, rays, ringLeds, BODY_LED } from "./arena_robots.js";
import { glow } from "./arena_things.js";
import { byId, fit, make, mark, write } from "./dom.js";
import { degrees, milliseconds, radio, reading, volts } from "./format.js";
import { words } from "./robots.js";
import { chartable } from "./series.js";
import * as theme from "./theme.js";

const UP = Math.PI / 2;
const BARS_FROM = 3;

/** Facts that are numbers: what to chart of a row of /robots and of a pose. */
const CHARTS = {
  place: { unit: "m", now: (row, pose) => [pose.x, pose.y] },
  heading: { label: "speed", unit: "m/s", now: (row, pose) => [pose.speed] },
  wheels: { unit: "steps/s", now: (row) => [row.left_steps_s, row.right_steps_s] },
  link: { unit: "ms", now: (row) => [row.heard_ms] },
  "Wi-Fi": { label: "signal", unit: "dBm", now: (row) => [row.signal_dbm] },
  battery: { unit: "V", now: (row) => [typeof row.battery_mv === "number" ? row.battery_mv / 1000 : null] },
};

/** The panel. */
export class Robot {
  constructor(store, choice) {
    this.store = store;
    this.choice = choice;
    this.panel = byId("robot");
    this.canvas = byId("near");
    this.pen = this.canvas.getContext("2d");
    this.facts = byId("robot_facts");
    this.rows = byId("readings");
    byId("robot_close").addEventListener("click", () => choice.choose(null));
  }

  /** Renews the panel; called a few times per second. */
  tell() {
    const tag = this.choice.tag;
    this.panel.hidden = tag === null;
    if (tag === null) return;
    const robot = this.store.robot(tag);
    const pose = this.#pose(tag);
    write(byId("robot_name"), this.store.name(tag));
    write(byId("robot_note"), `tag ${tag}`);
    this.#facts(robot, pose);
    const sensed = this.store.sensed(tag);
    this.#draw(robot, tag);
    this.#readings(sensed);
  }

  #pose(tag) {
    const robots = this.store.arena?.robots;
    const row = robots?.tag.indexOf(tag) ?? -1;
    return row < 0 ? null : { x: robots.x_m[row], y: robots.y_m[row], yaw: robots.yaw_rad[row], speed: robots.speed_m_s[row] };
  }

  #facts(robot, pose) {
    const trouble = robot ? words(robot) : "not known to the run";
    const wheels = robot ? `${robot.left_steps_s ?? "–"} / ${robot.right_steps_s ?? "–"} steps/s` : "–";
    const all = [
      ["place", pose ? `${pose.x.toFixed(3)}, ${pose.y.toFixed(3)} m` : "not seen"],
      ["heading", pose ? `${degrees(pose.yaw)} · ${(100 * (pose.speed ?? 0)).toFixed(0)} cm/s` : "–"],
      ["wheels", wheels],
      ["link", robot ? `${milliseconds(robot.heard_ms)}${robot.udp === false ? " · no UDP" : ""}` : "–"],
      ["Wi-Fi", robot ? radio(robot) : "–"],
      ["battery", robot ? volts(robot.battery_mv) : "–"],
      ["controller", this.store.controller(this.choice.tag)?.id || "–"],
      ["program", robot ? `${robot.controller ?? "–"} ${robot.hash ?? ""}` : "–"],
    ];
    const { part, uid } = this.store.part(this.choice.tag);
    if (part !== undefined && part !== this.choice.tag) all.push(["plays", `the part of ${part}`]);
    if (uid) all.push(["uid", uid]);
    for (const [name, value] of Object.entries(robot?.shown ?? {})) {
      all.push([name, value === null ? "–" : typeof value === "number" ? reading(value) : value]);
    }
    if (trouble) all.unshift(["trouble", trouble]);
    if (this.facts.childElementCount !== 2 * all.length) {
      this.facts.replaceChildren(...all.flatMap(() => [make("span"), make("b")]));
    }
    all.forEach(([name, text], index) => {
      const value = this.facts.children[2 * index + 1];
      write(this.facts.children[2 * index], name);
      write(value, text);
      value.title = text;
      mark(value, "bad", name === "trouble");
      chartable(value, this.#chart(name, robot));
    });
  }

  /** What of a fact can be shown over time. */
  #chart(name, robot) {
    const tag = this.choice.tag;
    const told = CHARTS[name] ?? (typeof robot?.shown?.[name] === "number" && { now: (row) => [row.shown?.[name]] });
    if (!told || !robot) return null;
    const now = (store) => told.now(store.robot(tag) ?? {}, this.#pose(tag) ?? {});
    return { key: `${tag}/fact/${name}`, label: `${told.label ?? name} of ${this.store.name(tag)}`, unit: told.unit, now };
  }

  #draw(robot, tag) {
    const { canvas, pen, store } = this;
    fit(canvas);
    const [x, y] = [canvas.width / 2, canvas.height / 2];
    const radius = canvas.width * 0.17;
    const leds = robot?.leds ?? 0;
    pen.clearRect(0, 0, canvas.width, canvas.height);
    const lit = (store.signals?.leds.tag ?? []).indexOf(tag);
    if (lit >= 0) glow(pen, x, y, 1.7 * radius, `rgb(${store.signals.leds.color[lit].join(" ")})`, 0.55);
    if (leds & 0xff) glow(pen, x, y, 1.9 * radius, theme.colours.lit, 0.25);
    if (leds & BODY_LED) glow(pen, x, y, 0.8 * radius, "rgb(40 200 80)", 0.7);
    rays(pen, [x, y, UP], radius, 0.97 * x, store, tag, theme.colours, 0.028 * canvas.width);
    pen.strokeStyle = leds & 0xff ? theme.colours.lit : theme.colours.robot;
    pen.lineWidth = 0.2 * radius;
    pen.beginPath();
    pen.arc(x, y, radius, 0, 2 * Math.PI);
    pen.moveTo(x, y);
    pen.lineTo(x, y - 0.8 * radius);
    pen.stroke();
    if (leds) ringLeds(pen, x, y, UP, radius, leds, theme.colours.lit);
  }

  #readings(sensed) {
    while (this.rows.rows.length > sensed.length) this.rows.deleteRow(-1);
    sensed.forEach(({ sensor, values, age_ns }, index) => {
      const row = this.rows.rows[index] ?? this.rows.insertRow();
      while (row.cells.length < 3) row.insertCell();
      this.#name(row.cells[0], sensor, sensed);
      this.#values(row.cells[1], sensor, values, age_ns);
      chartable(row.cells[1], this.#reading(sensor));
      write(row.cells[2], age_ns === null ? "never" : milliseconds(age_ns / 1e6));
    });
  }

  #reading(sensor) {
    const tag = this.choice.tag;
    const now = (store) => numbers(store.sensed(tag).find((each) => each.sensor.name === sensor.name));
    return { key: `${tag}/reading/${sensor.name}`, label: `${sensor.name} of ${this.store.name(tag)}`, unit: sensor.unit ?? "", tag, now };
  }

  #name(cell, sensor, sensed) {
    if (cell.textContent !== sensor.name) cell.replaceChildren(make("i"), sensor.name);
    cell.title = `${sensor.name} (${sensor.layout})`;
    const sensors = sensed.map((each) => each.sensor);
    const colour = rayColour(sensors, sensor.name, theme.colours);
    cell.firstChild.style.background = colour ?? "transparent";
  }

  // Few numbers are written, many are bars: nobody reads twenty-four decimals.
  #values(cell, sensor, values, age_ns) {
    const shown = measured(sensor, values);
    if (age_ns === null || shown.length < BARS_FROM) {
      const text = age_ns === null ? "–" : shown.map(reading).join(", ");
      write(cell, sensor.unit && age_ns !== null ? `${text} ${sensor.unit}` : text);
      return;
    }
    const peak = this.store.peak(sensor.name, shown);
    let bars = cell.firstElementChild;
    if (bars?.childElementCount !== shown.length) {
      bars = make("div", { className: "bars" }, ...shown.map(() => make("u")));
      cell.replaceChildren(bars);
    }
    cell.title = shown.map(reading).join(", ");
    shown.forEach((value, at) => {
      bars.children[at].style.height = `${Math.min(100, (100 * Math.abs(value ?? 0)) / peak)}%`;
    });
  }
}

/** A reading without the angles that some sensors tell along with it. */
const measured = (sensor, values) => (sensor.angles_rad?.length ? values.slice(0, sensor.angles_rad.length) : values);

const numbers = (sensed) => (sensed && sensed.age_ns !== null ? measured(sensed.sensor, sensed.values) : null);
