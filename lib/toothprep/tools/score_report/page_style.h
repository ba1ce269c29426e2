// The page's styles: light and dark by the reader's setting, always light on paper (A4).
#pragma once

namespace toothprep {

inline constexpr const char* kPageStyle = R"css(
:root {
  color-scheme: light dark;
  --page: #f4f6f8; --card: #ffffff; --ink: #18212c; --muted: #5b6877; --line: #dde3ea; --soft: #eef2f6;
  --accent: #1463b0; --good: #14804a; --warn: #a15c00; --bad: #c02a2a;
  --good-soft: #dff3e7; --warn-soft: #fdf0d8; --bad-soft: #fde4e4;
  --tooth: #f5ead0; --tooth-line: #7d5f22; --removed: #cfe2f6; --original: #6f8298;
  --pulp: #eda9a4; --pulp-line: #b8463f; --dentin: #c08a2d; --target: #0f8a5f; --fit: #6d28b8; --grid: #18212c12;
  --force: #1463b0; --felt: #e08a1e; --power: #7a4fb5; --stall: #e0a01e; --pulp-ev: #c02a2a; --neighbour: #a02a8a;
  --contact: #7e93a8;
}
@media (prefers-color-scheme: dark) {
  :root {
    --page: #10151b; --card: #182029; --ink: #e4eaf1; --muted: #97a5b5; --line: #2b3643; --soft: #1f2933;
    --accent: #62adf2; --good: #4fc88c; --warn: #f0ab45; --bad: #ff7474;
    --good-soft: #143526; --warn-soft: #3a2c12; --bad-soft: #421c1f;
    --tooth: #5d5238; --tooth-line: #e6cf94; --removed: #223d57; --original: #8fa3b8;
    --pulp: #7a3a37; --pulp-line: #f08b84; --dentin: #d8a64e; --target: #4fd6a2; --fit: #c79bff; --grid: #ffffff12;
    --force: #62adf2; --felt: #f0ab45; --power: #b795ee; --stall: #e0a01e; --pulp-ev: #ff7474; --neighbour: #e07acb;
    --contact: #6d8197;
  }
}
* { box-sizing: border-box; }
body { margin: 0; background: var(--page); color: var(--ink);
  font: 15px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", "DejaVu Sans", Arial, sans-serif; }
main { max-width: 1000px; margin: 0 auto; padding: 28px 20px 40px; }
h1 { font-size: 25px; line-height: 1.25; margin: 0 0 4px; overflow-wrap: anywhere; }
h2 { font-size: 18px; margin: 0 0 14px; }
h3 { font-size: 14px; margin: 0 0 6px; color: var(--muted); font-weight: 600; }
section, header { background: var(--card); border: 1px solid var(--line); border-radius: 10px; padding: 22px 24px;
  margin: 0 0 18px; }
.muted { color: var(--muted); }
.small-text { font-size: 13px; }
.top { display: flex; gap: 24px; justify-content: space-between; align-items: flex-start; flex-wrap: wrap; }
.top > div:first-child { flex: 1 1 380px; }
.verdict { min-width: 216px; border-radius: 10px; padding: 12px 16px; background: var(--soft); }
.verdict b { display: block; font-size: 22px; line-height: 1.2; letter-spacing: .02em; }
.verdict .total { font-size: 15px; }
.verdict.pass { background: var(--good-soft); } .verdict.pass b { color: var(--good); }
.verdict.fail { background: var(--bad-soft); } .verdict.fail b { color: var(--bad); }
.total-bar { display: block; margin-top: 8px; }
.total-bar .t-back { fill: var(--line); } .total-bar .t-fill { fill: currentColor; }
.total-bar .t-range { stroke: var(--ink); stroke-width: 1.5; } .total-bar .t-pass { stroke: var(--ink); stroke-width: 2; }
.verdict.pass .total-bar { color: var(--good); } .verdict.fail .total-bar { color: var(--bad); }
ul.reasons { margin: 16px 0 0; padding: 12px 16px 12px 34px; border-radius: 8px; background: var(--bad-soft); }
ul.notes { margin: 16px 0 0; padding: 12px 16px 12px 34px; border-radius: 8px; background: var(--warn-soft); }
ul.reasons li::marker { color: var(--bad); } ul.notes li::marker { color: var(--warn); }
dl.facts { display: grid; grid-template-columns: max-content 1fr; gap: 3px 16px; margin: 14px 0 0; font-size: 14px; }
dl.facts dt { color: var(--muted); } dl.facts dd { margin: 0; overflow-wrap: anywhere; }
code { font: 12px/1.4 ui-monospace, "SF Mono", Menlo, Consolas, "DejaVu Sans Mono", monospace; color: var(--muted);
  overflow-wrap: anywhere; }
table { border-collapse: collapse; width: 100%; font-size: 14px; }
th { text-align: left; font-weight: 600; color: var(--muted); font-size: 13px; border-bottom: 1px solid var(--line);
  padding: 0 12px 6px 0; }
td { padding: 7px 12px 7px 0; border-bottom: 1px solid var(--line); vertical-align: top; }
tr:last-child td { border-bottom: 0; }
td.number, th.number { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
td:last-child, th:last-child { padding-right: 0; }
tr.group th { padding-top: 18px; color: var(--ink); font-size: 14px; }
.reason { color: var(--muted); font-size: 13px; }
.chip { display: inline-block; border-radius: 999px; padding: 1px 9px; font-size: 12px; font-weight: 600; white-space: nowrap; }
.chip.ideal { background: var(--good-soft); color: var(--good); }
.chip.tolerated { background: var(--warn-soft); color: var(--warn); }
.chip.outside { background: var(--bad-soft); color: var(--bad); }
.chip.failed { background: var(--bad); color: var(--card); }
.chip.unsure { border: 1px dashed var(--warn); color: var(--warn); padding: 0 8px; margin-left: 4px; }
details { font-size: 13px; } summary { cursor: pointer; } summary::marker { color: var(--muted); }
details p { margin: 4px 0 0; color: var(--muted); max-width: 62ch; }
.gallery { display: grid; grid-template-columns: repeat(auto-fit, minmax(280px, 1fr)); gap: 18px; }
figure { margin: 0; break-inside: avoid; }
figure img { display: block; width: 100%; height: auto; border-radius: 8px; border: 1px solid var(--line); }
figcaption { font-size: 13px; color: var(--muted); margin-top: 6px; }
.drawings { display: flex; flex-wrap: wrap; gap: 22px 28px; }
.drawings figcaption { margin: 0 0 6px; color: var(--ink); font-weight: 600; font-size: 14px; text-transform: none; }
svg { max-width: 100%; height: auto; }
svg.plot { display: block; width: 100%; }
svg text { font-size: 13px; fill: var(--ink); }
svg text.small { font-size: 12px; fill: var(--muted); }
.legend { list-style: none; display: flex; flex-wrap: wrap; gap: 4px 20px; margin: 16px 0 0; padding: 0; font-size: 13px; }
.legend li { display: flex; align-items: center; gap: 7px; }
.tooth { fill: var(--tooth); } .removed { fill: var(--removed); } .pulp { fill: var(--pulp); }
.prepared { fill: none; stroke: var(--tooth-line); stroke-width: 2; stroke-linejoin: round; }
.original { fill: none; stroke: var(--original); stroke-width: 1.2; stroke-dasharray: 5 3; }
.pulp-line { fill: none; stroke: var(--pulp-line); stroke-width: 1.2; }
.dentin { fill: none; stroke: var(--dentin); stroke-width: 1.3; stroke-dasharray: 1.5 3; stroke-linecap: round; }
.target { fill: none; stroke: var(--target); stroke-width: 1.6; stroke-dasharray: 8 3; }
.fit { stroke: var(--fit); stroke-width: 1.8; } .dimension { stroke: var(--accent); stroke-width: 1.3; }
.ruler { stroke: var(--ink); stroke-width: 1.5; }
.grid { stroke: var(--grid); stroke-width: 1; }
text.label { fill: var(--fit); font-weight: 600; paint-order: stroke; stroke: var(--card); stroke-width: 3.5px; stroke-linejoin: round; }
text.label.dim { fill: var(--accent); }
svg.plot .grid { stroke: var(--line); } .axis { stroke: var(--muted); stroke-width: 1; } .zero { stroke: var(--ink); stroke-width: 1; }
.band1 { fill: var(--good); opacity: .16; } .band2 { fill: var(--good); opacity: .10; }
.bar-left { fill: var(--bad); } .bar-taken { fill: var(--accent); }
svg text.taken { fill: var(--accent); } svg text.left { fill: var(--bad); }
.curve-force { fill: var(--force); stroke: var(--force); stroke-width: 1; stroke-linejoin: round; }
.curve-felt { fill: var(--felt); fill-opacity: .25; stroke: var(--felt); stroke-width: 1.2; stroke-linejoin: round; }
.curve-power { fill: var(--power); fill-opacity: .45; stroke: var(--power); stroke-width: 1; stroke-linejoin: round; }
.limit { stroke: var(--bad); stroke-width: 1.2; stroke-dasharray: 6 4; }
svg text.limit-text { fill: var(--bad); paint-order: stroke; stroke: var(--card); stroke-width: 3px; }
.lane { fill: var(--soft); }
.ev-contact { fill: var(--contact); } .ev-stall { fill: var(--stall); } .ev-pulp { fill: var(--pulp-ev); }
.ev-neighbour { fill: var(--neighbour); } .ev-force { fill: var(--felt); }
.shade { opacity: .18; }
svg.gauge { display: block; width: 170px; max-width: none; } td.range { white-space: nowrap; } .g-outside { fill: var(--line); } .g-fail { fill: var(--bad); opacity: .45; }
.g-tolerated { fill: var(--stall); opacity: .55; } .g-ideal { fill: var(--good); opacity: .75; }
.g-mark { fill: var(--ink); stroke: var(--card); stroke-width: 1.2; } .g-whisker { stroke: var(--ink); stroke-width: 1.6; }
svg text.g-text { font-size: 10.5px; fill: var(--muted); }
footer { color: var(--muted); font-size: 13px; padding: 0 4px; }
@media screen and (max-width: 760px) {
  main { padding: 12px 8px; } section, header { padding: 16px 14px; }
  .gauge-cell, .range { display: none; } table code { overflow-wrap: anywhere; }
}
@media print {
  :root {
    color-scheme: light;
    --page: #ffffff; --card: #ffffff; --ink: #000000; --muted: #444b54; --line: #cfd6de; --soft: #f0f3f6;
    --accent: #1463b0; --good: #14804a; --warn: #8a4f00; --bad: #b02020;
    --good-soft: #e6f5ec; --warn-soft: #fdf3e0; --bad-soft: #fdeaea;
    --tooth: #f5ead0; --tooth-line: #7d5f22; --removed: #cfe2f6; --original: #6f8298;
    --pulp: #eda9a4; --pulp-line: #b8463f; --dentin: #c08a2d; --target: #0f8a5f; --fit: #6d28b8; --grid: #00000012;
    --force: #1463b0; --felt: #e08a1e; --power: #7a4fb5; --stall: #e0a01e; --pulp-ev: #c02a2a; --neighbour: #a02a8a;
    --contact: #7e93a8;
  }
  * { -webkit-print-color-adjust: exact; print-color-adjust: exact; }
  @page { size: A4; margin: 14mm; }
  body { font-size: 12px; } main { max-width: none; padding: 0; }
  section, header { border: 0; padding: 0; margin: 0 0 20px; border-radius: 0; }
  table { font-size: 11.5px; } td { padding-top: 4px; padding-bottom: 4px; } .reason, details, .legend, .small-text { font-size: 10.5px; }
  tr.group { break-after: avoid; } .legend { break-before: avoid; } details summary { list-style: none; } td code { font-size: 10px; }
  tr, figure, .verdict, ul { break-inside: avoid; } h2 { break-after: avoid; }
  .gallery { grid-template-columns: 1fr 1fr; } svg.gauge { width: 120px; }
  .drawings svg { width: 84mm; }
}
)css";

}  // namespace toothprep
