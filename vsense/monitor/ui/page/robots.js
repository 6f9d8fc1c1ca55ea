// The table of robots: those in trouble first, then as the head of a column was clicked.

import { byId, make, mark, write } from "./dom.js";
import { count, milliseconds, reading, volts } from "./format.js";

const STALE_MS = 500;
const WEAK_DBM = -75;
// Of a name, beside the column of signals and without it.
const LONG_NAME = { radio: 6, wide: 12 };
let longName = LONG_NAME.wide;

// What the experiment has for a robot: shown where not all have the same.
const RUNS = "runs";
// Of its Wi-Fi, as the robot hears it: shown where one tells it.
const SIGNAL = "signal";
const TEXTS = ["name", RUNS, "state"];

function align(name) {
  if (name === SIGNAL) return "n signal";
  return name === RUNS ? RUNS : TEXTS.includes(name) ? "" : "n";
}

// name of the column, head, what it shows, what it is sorted by, whether it is bad
const COLUMNS = [
  ["name", "robot", (r) => label(r), (r) => r.tag, () => false],
  [RUNS, "runs", (r) => r.expected ?? "", (r) => r.expected ?? "", () => false],
  ["state", "state", (r) => (r.connected ? r.state : "away"), (r) => `${r.connected} ${r.state}`, (r) => !r.connected],
  ["heard", "link", (r) => milliseconds(r.heard_ms), (r) => r.heard_ms ?? Infinity, (r) => r.heard_ms > STALE_MS],
  ["pose", "pose", (r) => milliseconds(r.pose_age_ms), (r) => r.pose_age_ms ?? Infinity, (r) => r.pose_age_ms > STALE_MS],
  [SIGNAL, "dBm", (r) => r.signal_dbm ?? "–", (r) => r.signal_dbm ?? 0, (r) => r.signal_dbm < WEAK_DBM || r.power_saving],
  ["battery", "battery", (r) => volts(r.battery_mv), (r) => r.battery_mv ?? Infinity, (r) => r.battery_low],
  ["errors", "errors", (r) => String(r.base_errors ?? 0), (r) => -(r.base_errors ?? 0), (r) => r.base_errors > 0 && r.trouble],
];

// A long name is cut off where two of them may still look the same.
function label({ tag, name }) {
  if (!name) return String(tag);
  return name.length > longName ? `${tag} ${name}` : name;
}

/** What is to be said about a robot beyond its row; "" where all is well. */
export function words(robot) {
  const parts = [robot.trouble];
  if (robot.stop_cause && !(robot.trouble ?? "").includes(robot.stop_cause)) parts.push(`stopped: ${robot.stop_cause}`);
  if (robot.doubt) parts.push(`identity: ${robot.doubt}`);
  if (robot.power_saving) parts.push("its Wi-Fi's power saving is on");
  if (robot.authenticated === false) parts.push("not authenticated: anybody can speak for it");
  return parts.filter(Boolean).join(" · ");
}

/** What its controller shows, in one line. */
export function shown(robot) {
  const parts = Object.entries(robot.shown ?? {}).map(([name, value]) => `${name} ${value === null ? "–" : typeof value === "number" ? reading(value) : value}`);
  return parts.join(" · ");
}

/** The table. */
export class Robots {
  constructor(store, choice) {
    this.store = store;
    this.choice = choice;
    this.table = byId("robots");
    this.note = byId("robots_note");
    this.sort = { column: 0, down: false };
    this.bodies = new Map();
    this.#head();
  }

  #head() {
    this.heads = COLUMNS.map(([name, text], column) => {
      const button = make("button", { type: "button" }, text);
      button.addEventListener("click", () => {
        this.sort = { column, down: this.sort.column === column && !this.sort.down };
        this.tell();
      });
      return make("th", { className: align(name), scope: "col" }, button);
    });
    this.table.tHead.replaceChildren(make("tr", {}, ...this.heads));
  }

  /** The robots as the table shows them, from the top. */
  get order() {
    return this.sorted?.map((robot) => robot.tag) ?? [];
  }

  /** Renews the table; called a few times per second. */
  tell() {
    const { robots, rows, experiment } = this.store;
    // Who only tracks knows no robots, but markers.
    this.table.closest(".card").hidden = !robots && experiment?.mode === "track";
    if (!robots) return;
    mark(this.table, "mixed", (experiment?.controllers?.length ?? 0) > 1);
    const radio = robots.signal_dbm?.some((dbm) => dbm !== null);
    longName = radio ? LONG_NAME.radio : LONG_NAME.wide;
    mark(this.table, "radio", radio);
    this.sorted = [...rows.keys()].map((tag) => this.store.robot(tag)).sort((a, b) => this.#compare(a, b));
    this.heads.forEach((head, column) => {
      const sorted = column === this.sort.column ? (this.sort.down ? "descending" : "ascending") : "none";
      if (head.getAttribute("aria-sort") !== sorted) head.setAttribute("aria-sort", sorted);
    });
    for (const robot of this.sorted) this.#row(robot);
    for (const [tag, { body }] of this.bodies) {
      if (rows.has(tag)) continue;
      body.remove();
      this.bodies.delete(tag);
    }
    this.#arrange();
    this.#count(robots);
  }

  #compare(a, b) {
    const worse = Number(Boolean(b.trouble)) - Number(Boolean(a.trouble)) || Number(Boolean(b.doubt)) - Number(Boolean(a.doubt));
    if (worse) return worse;
    const by = COLUMNS[this.sort.column][3];
    const [left, right] = [by(a), by(b)];
    const order = left < right ? -1 : left > right ? 1 : a.tag - b.tag;
    return this.sort.down ? -order : order;
  }

  #row(robot) {
    const { body, lamp, cells, wordsRow, wordsCell } = this.bodies.get(robot.tag) ?? this.#make(robot.tag);
    COLUMNS.forEach(([, , show, , bad], column) => {
      write(cells[column], show(robot));
      if (!column) cells[column].parentElement.title = robot.name ?? "";
      if (column) mark(cells[column], "bad", bad(robot));
    });
    mark(lamp, "on", robot.leds & 0xff);
    const trouble = words(robot);
    const text = trouble || shown(robot);
    write(wordsCell, text);
    mark(wordsCell, "shown", !trouble);
    wordsRow.hidden = !text;
    mark(body, "bad", robot.trouble);
    mark(body, "doubt", robot.doubt || robot.stop_cause);
    mark(body, "chosen", robot.tag === this.choice.tag);
  }

  #make(tag) {
    const lamp = make("i", { className: "lamp" });
    const label = make("span");
    const cells = COLUMNS.map(([name], column) => (column ? make("td", { className: align(name) }) : label));
    const wordsCell = make("td", { colSpan: COLUMNS.length });
    const wordsRow = make("tr", { className: "words", hidden: true }, wordsCell);
    const body = make("tbody", {}, make("tr", {}, make("td", {}, lamp, label), ...cells.slice(1)), wordsRow);
    body.addEventListener("click", () => this.choice.choose(this.choice.tag === tag ? null : tag));
    const made = { body, lamp, cells, wordsRow, wordsCell };
    this.bodies.set(tag, made);
    return made;
  }

  // Only what has to move is moved: a hundred rows stay where they are.
  #arrange() {
    let at = this.table.tHead;
    for (const { tag } of this.sorted) {
      const { body } = this.bodies.get(tag);
      if (at.nextSibling !== body) at.after(body);
      at = body;
    }
  }

  #count({ tag, connected, seen, trouble }) {
    const there = connected.filter(Boolean).length;
    const inView = seen.filter(Boolean).length;
    const bad = trouble.filter(Boolean).length;
    const parts = [`${there} of ${tag.length} connected`, `${inView} seen`];
    // Simulated robots have no links, and nobody overlooks them.
    if (this.store.experiment?.command === "sim") parts.splice(0, 2, count(tag.length, "simulated robot"));
    if (bad) parts.push(`${count(bad, "robot")} in trouble`);
    write(this.note, parts.join(" · "));
  }
}
