// Light and dark, and the style sheet's colours for the canvases.

import { remember, remembered } from "./dom.js";

const NAMES = [
  "paper", "card", "ink", "muted", "blue", "amber", "red", "floor", "grid", "solid", "solid-line", "robot",
  "led", "trail", "virtual", "stranger", "cone", "lamp", "ray", "ray2", "ray3",
  "series1", "series2", "series3", "series4", "series5", "series6",
];
const dark = window.matchMedia("(prefers-color-scheme: dark)");

/** The colours as canvases take them, by their names in style.css; replaced when they change.
 * @type {Record<string, string>} */
export let colours = {};
/** Grows with every change, so that what was drawn before can be told from what is right now. */
export let version = 0;

/** Reads the colours again, where the style sheet has others now. */
export function refresh() {
  const probe = document.createElement("i");
  document.body.append(probe);
  colours = Object.fromEntries(NAMES.map((name) => {
    probe.style.color = `var(--${name})`;
    return [name, getComputedStyle(probe).color];
  }));
  probe.remove();
  version += 1;
}

export const isDark = () => (document.documentElement.dataset.theme ?? (dark.matches ? "dark" : "light")) === "dark";

/** @param {string} theme */
function choose(theme) {
  if (theme === "light" || theme === "dark") document.documentElement.dataset.theme = theme;
  refresh();
}

export function toggle() {
  const theme = isDark() ? "light" : "dark";
  remember("theme", theme);
  choose(theme);
}

dark.addEventListener("change", refresh);
choose(remembered("theme", ""));
