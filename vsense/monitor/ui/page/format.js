// Numbers as people read them.

const NONE = "–";

/** 75.34 -> "1:15.3"
 * @param {number | null | undefined} seconds */
export function clock(seconds, digits = 1) {
  if (seconds === null || seconds === undefined) return NONE;
  const tens = 10 ** digits;
  const rounded = Math.round(Math.max(seconds, 0) * tens) / tens;
  const minutes = Math.floor(rounded / 60);
  const rest = (rounded - 60 * minutes).toFixed(digits).padStart(digits ? digits + 3 : 2, "0");
  return `${minutes}:${rest}`;
}

/** 41.2 -> "41 ms", 3200 -> "3.2 s"
 * @param {number | null | undefined} value */
export function milliseconds(value) {
  if (value === null || value === undefined) return NONE;
  if (value < 999.5) return `${Math.round(value)} ms`;
  return value < 99_950 ? `${(value / 1000).toFixed(1)} s` : `${Math.round(value / 60_000)} min`;
}

/** 212000000000 -> "212 GB"
 * @param {number | null | undefined} value */
export function bytes(value) {
  if (value === null || value === undefined) return NONE;
  const units = ["B", "kB", "MB", "GB", "TB"];
  let unit = 0;
  let left = value;
  while (left >= 999.5 && unit < units.length - 1) {
    left /= 1000;
    unit += 1;
  }
  return `${left < 9.95 && unit > 0 ? left.toFixed(1) : Math.round(left)} ${units[unit]}`;
}

/** A reading, short: 3 -> "3", 0.1234 -> "0.123"
 * @param {number | null | undefined} value */
export function reading(value) {
  if (value === null || value === undefined) return NONE;
  if (Number.isInteger(value)) return String(value);
  return Math.abs(value) >= 1000 || Math.abs(value) < 0.001 ? value.toExponential(1) : value.toFixed(3);
}

/** What a robot tells of its Wi-Fi; what it does not know is left out.
 * @param {RobotRow} robot */
export function radio(robot) {
  const parts = [typeof robot.signal_dbm === "number" ? `${robot.signal_dbm} dBm` : NONE];
  if (typeof robot.bit_rate_mbit_s === "number") parts.push(`${robot.bit_rate_mbit_s} Mbit/s`);
  if (robot.retries) parts.push(`${robot.retries} given up`);
  if (robot.power_saving) parts.push("power saving");
  return parts.join(" · ");
}

/** @param {number | null | undefined} mv */
export const volts = (mv) => (mv === null || mv === undefined ? NONE : `${(mv / 1000).toFixed(2)} V`);
/** 0.25 -> "0.25", 97.31 -> "97"
 * @param {number} value */
export const times = (value) => (value < 10 ? String(Math.round(100 * value) / 100) : value.toFixed(0));
/** @param {number} rad */
export const degrees = (rad) => `${Math.round((rad * 180) / Math.PI)}°`;
/** @param {number | null | undefined} hz */
export const rate = (hz) => (hz === null || hz === undefined ? NONE : `${hz.toFixed(hz < 99.5 ? 1 : 0)} Hz`);
/** @param {number} n @param {string} noun */
export const count = (n, noun) => `${n} ${n === 1 ? noun : `${noun}s`}`;
/** @param {string} text */
export const capital = (text) => text.slice(0, 1).toUpperCase() + text.slice(1);

/** @type {Record<string, string>} */
const UNITS = { m_s: "m/s", mm: "mm", cm: "cm", m: "m", s: "s", rad: "rad" };

/** Measures that bear their names of older recordings. */
const RENAMED = new Map([["lit_in_cone", "LEDs on in cone"]]);

/** A measure's name in words, and its unit: light_distance_m -> "light distance", "m"
 * @param {string} name */
export function labelOf(name) {
  const [, stem, unit] = /^(.+)_(m_s|mm|cm|m|s|rad)$/.exec(name) ?? [name, name, ""];
  return { label: RENAMED.get(stem) ?? stem.replaceAll("_", " "), unit: UNITS[unit] };
}
