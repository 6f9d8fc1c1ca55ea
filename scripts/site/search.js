// Ranks what Sphinx's search has found, and shows the words around it without asking a server.
// Comes after searchtools.js; `PAGES` stands above, written by searching.py.
"use strict";

const AROUND = 120; // characters before what was found, and after it
const asked = () => (new URLSearchParams(location.search).get("q") || "").trim().toLowerCase();

function countOf(text, words) {
  return words ? text.split(words).length - 1 : 0;
}

// A page that says it often ranks before one that says it once, but not ten times as high.
Scorer.score = ([name, title, , , score]) => {
  const page = PAGES[name];
  if (!page) return score;
  page.lower ??= page.text.toLowerCase();
  const named = title.toLowerCase() === asked() ? 40 : 0;
  return score + named + page.weight + 4 * Math.log2(1 + countOf(page.lower, asked()));
};

// The page's address in place of its content, which a page that was opened as a file cannot fetch.
window.fetch = async (url) => ({ text: async () => url });

Search.makeSearchSummary = (url, words, anchor) => {
  const root = document.documentElement.dataset.content_root;
  const page = PAGES[url.slice(root.length).replace(/\.html$/, "")];
  if (!page) return null;
  const from = page.sections[(anchor || "").slice(1)] || 0;
  const text = page.text.slice(from);
  const lower = text.toLowerCase();
  const places = [asked(), ...words].map((word) => lower.indexOf(word)).filter((at) => at >= 0);
  const begin = Math.max((places[0] ?? 0) - AROUND, 0);
  const summary = document.createElement("p");
  summary.classList.add("context");
  const dots = [begin ? "… " : "", begin + 2 * AROUND < text.length ? " …" : ""];
  summary.textContent = dots[0] + text.slice(begin, begin + 2 * AROUND).trim() + dots[1];
  return summary;
};
