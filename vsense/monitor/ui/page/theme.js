// Light and dark, and the style sheet's colours for the canvases.

import { remember, remembered } from "./dom.js";

const NAMES = [
  "paper", "card", "ink", "muted", "blue", "amber", "red", "floor", "grid", "solid", "solid-line", "robot",
  "lit", "trail", "virtual", "stranger", "cone", "lamp", "ray", "ray2", "ray3", "green",
];
const dark = window.matchMedia("(prefers-color-scheme: dark)");

/** The colours as canvases take them, by their names in style.css; replaced when they change. */
export let colours = {};
/** Grows with every change, so that what was drawn before can be told from what is right now. */
export let version = 0;

function resolve() {
  const probe = document.createElement("i");
  document.body.append(probe);
  const found = {};
  for (const name of NAMES) {
    probe.style.color = `var(--${name})`;
    found[name] = getComputedStyle(probe).color;
  }
  probe.remove();
  colours = found;
  version += 1;
}

export const isDark = () => (document.documentElement.dataset.theme ?? (dark.matches ? "dark" : "light")) === "dark";

function choose(theme) {
  if (theme === "light" || theme === "dark") document.documentElement.dataset.theme = theme;
  resolve();
}

export const refresh = resolve;

export function toggle() {
  const theme = isDark() ? "light" : "dark";
  remember("theme", theme);
  choose(theme);
}

dark.addEventListener("change", resolve);
choose(remembered("theme", ""));
