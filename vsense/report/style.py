"""How the page looks: light, dark, and on paper."""

CSS = """
:root {
  color-scheme: light dark;
  --paper: #ffffff; --ink: #1d2329; --soft: #5a6570; --line: #d9dee3; --tint: #f4f6f8;
  --warn: #7a4b00; --warn-tint: #fff4dc; --bad: #9b2c00; --bad-tint: #fdebe3; --link: #005c94;
}
@media (prefers-color-scheme: dark) {
  :root {
    --paper: #14181c; --ink: #e6eaee; --soft: #a3aeb8; --line: #323a42; --tint: #1d2328;
    --warn: #ffd48a; --warn-tint: #362a12; --bad: #ffb595; --bad-tint: #3b1f14; --link: #7cc4f5;
  }
}
* { box-sizing: border-box; }
body {
  margin: 0 auto; padding: 2rem 1.5rem 4rem; max-width: 61rem; background: var(--paper);
  color: var(--ink); font: 16px/1.5 system-ui, "Helvetica Neue", Arial, sans-serif;
}
h1 { font-size: 1.9rem; line-height: 1.2; margin: 0 0 .25rem; }
h2 {
  font-size: 1.4rem; margin: 3rem 0 .25rem; padding-top: 1rem; border-top: 2px solid var(--ink);
}
h3 { font-size: 1.08rem; margin: 2rem 0 .5rem; }
p { margin: .4rem 0; max-width: 46rem; }
a { color: var(--link); }
.soft { color: var(--soft); }
nav ul { margin: .5rem 0 0; padding-left: 1.2rem; }
.tiles {
  display: grid; grid-template-columns: repeat(auto-fill, minmax(9.2rem, 1fr)); gap: .6rem;
  margin: 1rem 0; padding: 0;
}
.tiles div { background: var(--tint); border-radius: .5rem; padding: .55rem .75rem; }
.tiles dt { color: var(--soft); font-size: .82rem; }
.tiles dd { margin: 0; font-size: 1.2rem; font-weight: 600; font-variant-numeric: tabular-nums; }
.note { border-left: 4px solid; border-radius: .25rem; padding: .5rem .8rem; margin: .6rem 0; }
.note.warning { color: var(--warn); background: var(--warn-tint); }
.note.trouble { color: var(--bad); background: var(--bad-tint); }
.figures { display: grid; grid-template-columns: 1fr 1fr; gap: 1.2rem 1.4rem; align-items: start; }
figure { margin: 0; min-width: 0; break-inside: avoid; }
figure.wide { grid-column: 1 / -1; }
figure img {
  display: block; max-width: 100%; height: auto; background: #fff; border-radius: .35rem;
}
figcaption { font-size: .88rem; line-height: 1.42; color: var(--soft); margin-top: .4rem; }
figcaption b { color: var(--ink); }
.scroll { overflow-x: auto; }
table {
  border-collapse: collapse; font-size: .88rem; margin: .4rem 0; width: 100%;
  font-variant-numeric: tabular-nums;
}
caption { text-align: left; color: var(--soft); font-size: .88rem; padding-bottom: .4rem; }
caption b { color: var(--ink); }
thead th { border-bottom: 1.5px solid var(--ink); vertical-align: bottom; }
thead th.of { text-align: center; border-bottom: 1px solid var(--line); }
th, td { padding: .26rem .55rem; text-align: left; border-bottom: 1px solid var(--line); }
th { font-weight: 600; }
td.n, th.n { text-align: right; }
td.n { white-space: nowrap; }
tbody th { font-weight: 400; }
details { margin-top: 1rem; }
summary { cursor: pointer; font-weight: 600; }
pre {
  background: var(--tint); border-radius: .5rem; padding: .8rem; font-size: .78rem;
  white-space: pre-wrap; overflow-x: auto;
}
footer { margin-top: 3rem; padding-top: .8rem; border-top: 1px solid var(--line); }
@media (max-width: 44rem) { .figures { grid-template-columns: 1fr; } }
@media print {
  :root {
    color-scheme: light;
    --paper: #fff; --ink: #000; --soft: #444; --line: #bbb; --tint: #f2f2f2; --link: #000;
    --warn: #5c3900; --warn-tint: #fff; --bad: #7a2300; --bad-tint: #fff;
  }
  body { max-width: none; padding: 0; font-size: 10.5pt; }
  h2 { break-before: page; }
  h2.first { break-before: auto; }
  h2, h3 { break-after: avoid; }
  .figures { display: block; }
  figure { display: inline-block; width: 48.5%; vertical-align: top; margin: 0 1% 5mm 0; }
  figure.wide { display: block; width: 100%; }
  .tiles { grid-template-columns: repeat(4, 1fr); }
  .scroll { overflow: visible; }
  table { font-size: 7.5pt; }
  th, td { padding: 1pt 3pt; }
  figcaption, caption { font-size: 8.5pt; }
  tr, .tiles { break-inside: avoid; }
  details, nav { display: none; }
}
@page { margin: 16mm; }
"""
