// The table of robots: those in trouble first, then as the head of a column was clicked.

import { byId, make, mark, write } from "./dom.js";
import { count, milliseconds, reading, volts } from "./format.js";

const STALE_MS = 500;
const WEAK_DBM = -75;
/** What a robot does.
 * @type {Record<string, string>} */
const WORDS = { run: "runs", pause: "paused", stop: "stopped", homing: "goes home" };
/** What stands under "errors". */
export const ERRORS = "times its daemon lost the microcontroller; 1 or 2 at the start are usual";

/** `key` is what it is sorted by.
 * @typedef {object} Column
 * @property {string} head
 * @property {string} style its class.
 * @property {(robot: RobotRow) => string} text
 * @property {(robot: RobotRow) => string | number} key
 * @property {(robot: RobotRow) => unknown} [isBad] */

// What the experiment has for a robot is shown where not all have the same; the signal of its Wi-Fi
// where one says it.
/** @type {Column[]} */
const COLUMNS = [
  { head: "robot", style: "", text: (robot) => String(robot.tag), key: (robot) => robot.tag },
  { head: "runs", style: "runs", text: (robot) => robot.expected ?? "", key: (robot) => robot.expected ?? "" },
  {
    head: "state", style: "",
    text: stateOf,
    key: stateOf,
    isBad: (robot) => !robot.connected || robot.held,
  },
  {
    head: "link", style: "n",
    text: (robot) => milliseconds(robot.heard_ms),
    key: (robot) => robot.heard_ms ?? Infinity,
    isBad: (robot) => (robot.heard_ms ?? 0) > STALE_MS,
  },
  {
    head: "pose", style: "n",
    text: (robot) => milliseconds(robot.pose_age_ms),
    key: (robot) => robot.pose_age_ms ?? Infinity,
    isBad: (robot) => (robot.pose_age_ms ?? 0) > STALE_MS,
  },
  {
    head: "dBm", style: "n signal",
    text: (robot) => String(robot.signal_dbm ?? "–"),
    key: (robot) => robot.signal_dbm ?? 0,
    isBad: (robot) => (robot.signal_dbm ?? 0) < WEAK_DBM || robot.power_saving,
  },
  {
    head: "battery", style: "n",
    text: (robot) => volts(robot.battery_mv),
    key: (robot) => robot.battery_mv ?? Infinity,
    isBad: (robot) => robot.battery_low,
  },
  {
    head: "errors", style: "n",
    text: (robot) => String(robot.base_errors ?? 0),
    key: (robot) => -(robot.base_errors ?? 0),
    isBad: (robot) => (robot.base_errors ?? 0) > 0 && robot.trouble,
  },
];

/** @param {RobotRow} robot */
function stateOf({ connected, held, state }) {
  if (!connected) return "away";
  return held ? "stands" : WORDS[state] ?? state;
}

/** What is to be said about a robot beyond its row; "" where all is well.
 * @param {RobotRow} robot */
export function wordsOf(robot) {
  const parts = [robot.trouble];
  if (robot.stop_cause && !(robot.trouble ?? "").includes(robot.stop_cause)) parts.push(`stopped: ${robot.stop_cause}`);
  if (robot.doubt) parts.push(`identity: ${robot.doubt}`);
  if (robot.power_saving) parts.push("its Wi-Fi's power saving is on");
  if (robot.authenticated === false) parts.push("not authenticated: anybody can speak for it");
  return parts.filter(Boolean).join(" · ");
}

/** What its controller shows, in one line.
 * @param {RobotRow} robot */
function shownBy(robot) {
  const parts = Object.entries(robot.shown ?? {});
  return parts.map(([name, value]) => `${name} ${typeof value === "string" ? value : reading(value)}`).join(" · ");
}

/** A robot's rows of the table.
 * @param {() => void} choose */
function rowsOf(choose) {
  const lamp = make("i", { className: "lamp" });
  const name = make("span");
  const data = COLUMNS.slice(1).map(({ style }) => make("td", { className: style }));
  const row = make("tr", {}, make("td", {}, lamp, name), ...data);
  const wordsCell = make("td", { colSpan: COLUMNS.length });
  const wordsRow = make("tr", { className: "words", hidden: true }, wordsCell);
  const body = make("tbody", {}, row, wordsRow);
  body.addEventListener("click", choose);
  return { body, row, lamp, cells: [name, ...data], wordsRow, wordsCell };
}

/** The table. */
export class Robots {
  #sort = { column: 0, down: false };
  /** By tag.
   * @type {Map<number, ReturnType<typeof rowsOf>>} */
  #bodies = new Map();

  /** @param {Store} store @param {RobotSelection} selection */
  constructor(store, selection) {
    this.store = store;
    this.selection = selection;
    this.table = byId("robots");
    this.head = byId("robots_head");
    this.note = byId("robots_note");
    this.heads = COLUMNS.map(({ head, style }, column) => {
      const button = make("button", { type: "button" }, head);
      button.addEventListener("click", () => this.#sortBy(column));
      return make("th", { className: style, scope: "col", title: head === "errors" ? ERRORS : "" }, button);
    });
    this.head.replaceChildren(make("tr", {}, ...this.heads));
  }

  /** @param {number} column */
  #sortBy(column) {
    this.#sort = { column, down: this.#sort.column === column && !this.#sort.down };
    this.render();
  }

  /** The robots as the table shows them, from the top, also before it is rendered.
   * @returns {RobotRow[]} */
  get #sorted() {
    const all = [...this.store.rows.keys()].flatMap((tag) => this.store.robot(tag) ?? []);
    return all.sort((a, b) => this.#compare(a, b));
  }

  /** Their tags. */
  get order() {
    return this.#sorted.map((robot) => robot.tag);
  }

  /** Renews the table; called a few times per second. */
  render() {
    const { robots, rows, experiment } = this.store;
    // Who only tracks knows no robots, but markers.
    byId("robots_panel").hidden = !robots && experiment?.mode === "track";
    if (!robots) return;
    mark(this.table, "mixed", (experiment?.controllers?.length ?? 0) > 1);
    mark(this.table, "radio", robots.signal_dbm?.some((dbm) => dbm !== null));
    this.heads.forEach((head, column) => {
      const direction = this.#sort.down ? "descending" : "ascending";
      const sorted = column === this.#sort.column ? direction : "none";
      if (head.getAttribute("aria-sort") !== sorted) head.setAttribute("aria-sort", sorted);
    });
    for (const [tag, { body }] of this.#bodies) {
      if (rows.has(tag)) continue;
      body.remove();
      this.#bodies.delete(tag);
    }
    this.#renderBodies();
    this.#renderNote(robots);
  }

  /** @param {RobotRow} a @param {RobotRow} b */
  #compare(a, b) {
    const worse = Number(Boolean(b.trouble)) - Number(Boolean(a.trouble));
    const dubious = Number(Boolean(b.doubt)) - Number(Boolean(a.doubt));
    if (worse || dubious) return worse || dubious;
    const { key } = COLUMNS[this.#sort.column];
    const [left, right] = [key(a), key(b)];
    let order = a.tag - b.tag;
    if (left !== right) order = left < right ? -1 : 1;
    return this.#sort.down ? -order : order;
  }

  /** Only what has to move is moved: a hundred rows stay where they are. */
  #renderBodies() {
    /** @type {Element} */
    let before = this.head;
    for (const robot of this.#sorted) {
      const rows = this.#rowsOf(robot.tag);
      this.#renderRow(robot, rows);
      if (before.nextSibling !== rows.body) before.after(rows.body);
      before = rows.body;
    }
  }

  /** @param {number} tag */
  #rowsOf(tag) {
    let rows = this.#bodies.get(tag);
    if (!rows) {
      rows = rowsOf(() => this.selection.choose(this.selection.tag === tag ? null : tag));
      this.#bodies.set(tag, rows);
    }
    return rows;
  }

  /** @param {RobotRow} robot @param {ReturnType<typeof rowsOf>} rows */
  #renderRow(robot, { body, row, lamp, cells, wordsRow, wordsCell }) {
    COLUMNS.forEach(({ text, isBad }, column) => {
      write(cells[column], text(robot));
      if (isBad) mark(cells[column], "bad", isBad(robot));
    });
    row.cells[0].title = robot.name ?? "";
    mark(lamp, "on", (robot.leds ?? 0) & 0xff);
    const trouble = wordsOf(robot);
    const text = trouble || shownBy(robot);
    write(wordsCell, text);
    mark(wordsCell, "shown", !trouble);
    wordsRow.hidden = !text;
    mark(body, "bad", robot.trouble);
    mark(body, "doubt", robot.doubt || robot.stop_cause);
    mark(body, "chosen", robot.tag === this.selection.tag);
  }

  /** @param {RobotsMessage} robots */
  #renderNote({ tag, connected, seen, trouble }) {
    const there = connected.filter(Boolean).length;
    const inView = seen.filter(Boolean).length;
    const bad = trouble.filter(Boolean).length;
    const parts = [`${there} of ${tag.length} connected`, `${inView} seen`];
    // Simulated robots have no links, and nobody overlooks them.
    if (this.store.experiment?.command === "sim") parts.splice(0, 2, count(tag.length, "simulated robot"));
    if (bad) parts.push(`⚠ ${count(bad, "robot")} in trouble`);
    const virtual = this.store.world?.entities.filter(({ kind }) => kind === "robot").length;
    if (virtual) parts.push(`${virtual} virtual`);
    write(this.note, parts.join(" · "));
  }
}
