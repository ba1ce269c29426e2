// Search over `sections` (sections.js): [place, heading, page, text] each. All words have to occur; headings come first.
const field = document.getElementById("search"), found = document.getElementById("found");
field.addEventListener("input", () => {
  const words = field.value.toLowerCase().split(/\s+/).filter((w) => w.length > 1);
  found.replaceChildren();
  if (!words.length) return;
  const has = (text) => words.every((w) => text.toLowerCase().includes(w));
  const rank = (s) => (has(s[1]) ? 0 : has(s[2] + " " + s[1]) ? 1 : 2);
  const hits = sections.filter((s) => has(s.slice(1).join(" "))).sort((a, b) => rank(a) - rank(b));
  for (const [place, heading, page] of hits.slice(0, 20)) {
    const link = document.createElement("a"), where = document.createElement("small");
    link.href = field.dataset.top + "/" + place;
    link.textContent = heading;
    where.textContent = page;
    link.append(where);
    found.append(link);
  }
  if (!hits.length) found.textContent = "Nothing found.";
});
