// The chosen robot from near: its LEDs, what it senses and how old that is.

import { Brush } from "./brush.js";
import { byId, fit, inside, make, mark, penOf, write } from "./dom.js";
import { degrees, milliseconds, radio, reading, volts } from "./format.js";
import { FromAbove } from "./projections.js";
import { ERRORS, wordsOf } from "./robots.js";
import { rgb, sceneOf } from "./scene.js";
import { drawLedGlow, drawLeds, drawRays, rayColour } from "./scene_robots.js";
import { chartable } from "./series.js";
import * as theme from "./theme.js";

const UP = Math.PI / 2;
const BARS_FROM = 3;
/** Reads red, green, blue and alpha, 0 to 255 each. */
const COLOUR_SENSOR = "rgb_ground";

/** @typedef {{ x: number, y: number, yaw: number, speed: number }} Pose */
/** What of a fact can be charted.
 * @typedef {{ label?: string, unit?: string, now(row: RobotRow, pose: Pose | null): ChartValues }} FactChart */

/** Facts that are numbers: what to chart of a row of /robots and of a pose.
 * @type {Record<string, FactChart>} */
const CHARTS = {
  place: { unit: "m", now: (_, pose) => pose && [pose.x, pose.y] },
  heading: { label: "speed", unit: "m/s", now: (_, pose) => pose && [pose.speed] },
  wheels: { unit: "steps/s", now: (row) => [row.left_steps_s, row.right_steps_s] },
  link: { unit: "ms", now: (row) => [row.heard_ms] },
  "Wi-Fi": { label: "signal", unit: "dBm", now: (row) => [row.signal_dbm] },
  battery: { unit: "V", now: (row) => [typeof row.battery_mv === "number" ? row.battery_mv / 1000 : null] },
};

/** The panel. */
export class Robot {
  /** @param {Store} store @param {RobotSelection} selection */
  constructor(store, selection) {
    this.store = store;
    this.selection = selection;
    this.panel = byId("robot");
    this.canvas = byId("near");
    this.pen = penOf(this.canvas);
    this.facts = byId("robot_facts");
    this.rows = byId("readings");
    byId("robot_close").addEventListener("click", () => selection.choose(null));
  }

  /** Renews the panel; called a few times per second. */
  render() {
    const { tag } = this.selection;
    this.panel.hidden = tag === null;
    if (tag === null) return;
    const robot = this.store.robot(tag);
    write(byId("robot_name"), `Robot ${tag}`);
    write(byId("robot_note"), this.store.name(tag));
    this.#renderFacts(tag, robot);
    this.#draw(tag, robot?.leds ?? 0);
    this.#renderReadings(tag);
  }

  /** @param {number} tag @returns {Pose | null} */
  #pose(tag) {
    const robots = this.store.arena?.robots;
    const row = robots?.tag.indexOf(tag) ?? -1;
    if (!robots || row < 0) return null;
    return { x: robots.x_m[row], y: robots.y_m[row], yaw: robots.yaw_rad[row], speed: robots.speed_m_s[row] };
  }

  /** @param {number} tag @param {RobotRow | null} robot */
  #renderFacts(tag, robot) {
    const problems = [...this.#trouble(robot), ...this.#errors(robot)];
    const facts = [...problems, ...this.#motion(tag, robot), ...this.#program(tag, robot)];
    if (this.facts.childElementCount !== 2 * facts.length) {
      this.facts.replaceChildren(...facts.flatMap(() => [make("span"), make("b")]));
    }
    facts.forEach(([name, text], index) => {
      const value = /** @type {HTMLElement} */ (this.facts.children[2 * index + 1]);
      write(this.facts.children[2 * index], name);
      write(value, text);
      value.title = text;
      mark(value, "bad", name === "trouble");
      mark(value, "long", name === "errors");
      chartable(value, this.#chartOf(name, tag, robot));
    });
  }

  /** @param {RobotRow | null} robot @returns {[string, string][]} */
  #trouble(robot) {
    const trouble = robot ? wordsOf(robot) : "not known to the run";
    return trouble ? [["trouble", trouble]] : [];
  }

  /** @param {RobotRow | null} robot @returns {[string, string][]} */
  #errors(robot) {
    return robot?.base_errors ? [["errors", `${robot.base_errors}: ${ERRORS}`]] : [];
  }

  /** @param {number} tag @param {RobotRow | null} robot @returns {[string, string][]} */
  #motion(tag, robot) {
    const pose = this.#pose(tag);
    return [
      ["place", pose ? `${pose.x.toFixed(3)}, ${pose.y.toFixed(3)} m` : "not seen"],
      ["heading", pose ? `${degrees(pose.yaw)} · ${(100 * (pose.speed ?? 0)).toFixed(0)} cm/s` : "–"],
      ["wheels", robot ? `${robot.left_steps_s ?? "–"} / ${robot.right_steps_s ?? "–"} steps/s` : "–"],
      ["link", robot ? `${milliseconds(robot.heard_ms)}${robot.udp === false ? " · no UDP" : ""}` : "–"],
      ["Wi-Fi", robot ? radio(robot) : "–"],
      ["battery", robot ? volts(robot.battery_mv) : "–"],
    ];
  }

  /** @param {number} tag @param {RobotRow | null} robot @returns {[string, string][]} */
  #program(tag, robot) {
    /** @type {[string, string][]} */
    const facts = [
      ["controller", this.store.controller(tag)?.id || "–"],
      ["program", robot ? `${robot.controller ?? "–"} ${robot.hash ?? ""}` : "–"],
    ];
    const known = this.store.experiment?.robots?.find((body) => body.tag === tag);
    const alone = "the run's machine: where that or the link fails, only the robot stops itself";
    if (known?.driven_here) facts.push(["driven from", alone]);
    const { part, uid } = this.store.part(tag);
    if (part !== undefined && part !== tag) facts.push(["role", `that of ${part}`]);
    if (uid) facts.push(["uid", uid]);
    for (const [name, value] of Object.entries(robot?.shown ?? {})) {
      facts.push([name, typeof value === "string" ? value : reading(value)]);
    }
    return facts;
  }

  /** What of a fact can be shown over time.
   * @param {string} name @param {number} tag @param {RobotRow | null} robot @returns {ChartSource | null} */
  #chartOf(name, tag, robot) {
    if (!robot) return null;
    let chart = CHARTS[name];
    if (!chart && typeof robot.shown?.[name] === "number") chart = { now: (row) => [numberOf(row.shown?.[name])] };
    if (!chart) return null;
    return {
      key: `${tag}/fact/${name}`,
      label: `${chart.label ?? name} of ${tag}`,
      unit: chart.unit,
      now: (store) => {
        const row = store.robot(tag);
        return row && chart.now(row, this.#pose(tag));
      },
    };
  }

  /** The view has the robot's middle as origin and pixels instead of metres.
   * @param {number} tag @param {number} leds */
  #draw(tag, leds) {
    const { canvas, pen, store } = this;
    fit(canvas);
    const { width, height } = canvas;
    const radius = width * 0.17;
    const brush = new Brush(pen, new FromAbove(width / 2, height / 2));
    const { colours } = theme;
    pen.clearRect(0, 0, width, height);
    const lit = store.signals?.leds.tag.indexOf(tag) ?? -1;
    if (store.signals && lit >= 0) brush.halo([0, 0, 0], 2.4 * radius, rgb(store.signals.leds.color[lit]));
    drawLedGlow(brush, [0, 0, 0], radius, leds, colours.led);
    const scene = sceneOf(brush, store, colours, tag, store.arena, store.signals);
    drawRays(scene, [0, 0, 0], UP, radius, (0.97 * width) / 2, 0.028 * width);
    pen.strokeStyle = colours.robot;
    pen.lineWidth = 0.2 * radius;
    pen.beginPath();
    pen.arc(width / 2, height / 2, radius, 0, 2 * Math.PI);
    pen.moveTo(width / 2, height / 2);
    pen.lineTo(width / 2, height / 2 - 0.8 * radius);
    pen.stroke();
    drawLeds(brush, [0, 0], UP, radius, leds, colours.led);
  }

  /** @param {number} tag */
  #renderReadings(tag) {
    const sensed = this.store.sensed(tag);
    const sensors = sensed.map(({ sensor }) => sensor);
    while (this.rows.rows.length > sensed.length) this.rows.deleteRow(-1);
    sensed.forEach(({ sensor, values, age_ns }, index) => {
      const row = this.rows.rows[index] ?? this.rows.insertRow();
      while (row.cells.length < 3) row.insertCell();
      this.#renderName(row.cells[0], sensor, sensors);
      this.#renderValues(row.cells[1], sensor, values, age_ns);
      chartable(row.cells[1], this.#readingChart(tag, sensor));
      write(row.cells[2], age_ns === null ? "never" : milliseconds(age_ns / 1e6));
    });
  }

  /** @param {number} tag @param {Sensor} sensor @returns {ChartSource} */
  #readingChart(tag, sensor) {
    return {
      key: `${tag}/reading/${sensor.name}`,
      label: `${sensor.name} of ${tag}`,
      tag,
      now: (store) => numbersOf(store.sensed(tag).find((sensed) => sensed.sensor.name === sensor.name)),
    };
  }

  /** @param {HTMLElement} cell @param {Sensor} sensor @param {Sensor[]} sensors */
  #renderName(cell, sensor, sensors) {
    if (cell.textContent !== sensor.name) cell.replaceChildren(make("i"), sensor.name);
    cell.title = `${sensor.name} (${sensor.layout})`;
    const colour = rayColour(sensors, sensor.name, theme.colours);
    inside(cell, "i").style.background = colour ?? "transparent";
  }

  /** Few numbers are written, a colour is shown beside its numbers, many numbers are bars.
   * @param {HTMLElement} cell @param {Sensor} sensor @param {(number | null)[]} values
   * @param {number | null} age_ns */
  #renderValues(cell, sensor, values, age_ns) {
    const shown = measured(sensor, values);
    const isColour = sensor.name === COLOUR_SENSOR;
    if (age_ns === null || shown.length < BARS_FROM || isColour) {
      const text = age_ns === null ? "–" : shown.map(reading).join(", ");
      write(cell, text);
      if (isColour && !cell.querySelector("i")) cell.prepend(make("i"));
      if (isColour) inside(cell, "i").style.background = age_ns === null ? "" : rgb(shown.slice(0, 3));
      return;
    }
    const peak = this.store.peak(sensor.name, shown);
    let bars = cell.firstElementChild;
    if (bars?.childElementCount !== shown.length) {
      bars = make("div", { className: "bars" }, ...shown.map(() => make("u")));
      cell.replaceChildren(bars);
    }
    cell.title = shown.map(reading).join(", ");
    [...bars.children].forEach((bar, at) => {
      const share = Math.min(1, Math.abs(shown[at] ?? 0) / peak);
      /** @type {HTMLElement} */ (bar).style.height = `${100 * share}%`;
    });
  }
}

/** A reading without the angles that some sensors tell along with it.
 * @param {Sensor} sensor @param {(number | null)[]} values */
const measured = (sensor, values) => (sensor.angles_rad?.length ? values.slice(0, sensor.angles_rad.length) : values);

/** @param {SensorReading | undefined} sensed @returns {ChartValues} */
const numbersOf = (sensed) => (sensed && sensed.age_ns !== null ? measured(sensed.sensor, sensed.values) : null);

/** @param {unknown} value */
const numberOf = (value) => (typeof value === "number" ? value : null);
