"use strict";
const cases = document.getElementById("cases"), sections = [...cases.children];
const filter = document.getElementById("filter"), failed = document.getElementById("failed"), order = document.getElementById("order");

/* a link to a mechanism or to a row opens the enclosing section */
function follow() {
  const target = document.getElementById(decodeURIComponent(location.hash.slice(1)));
  if (!target) return;
  for (let box = target.querySelector("details.case") || target; box; box = box.parentElement)
    if (box.tagName === "DETAILS") box.open = true;
  target.scrollIntoView();
}
addEventListener("hashchange", follow);
follow();

function apply() {
  const words = filter.value.toLowerCase().split(/\s+/).filter(Boolean);
  const holds = (text) => words.every((word) => text.toLowerCase().includes(word));
  for (const section of sections) {
    const named = holds(section.dataset.name);
    let matching = named;
    for (const row of section.querySelectorAll(".checks tbody tr")) {
      const shown = (named || holds(`${section.dataset.name} ${row.cells[0].textContent}`)) && (!failed.checked || row.classList.contains("no"));
      row.hidden = !shown;
      matching ||= shown;
    }
    section.hidden = !matching || (failed.checked && section.dataset.passed === "1");
  }
}

if (filter) {
  filter.addEventListener("input", apply);
  failed.addEventListener("change", apply);
  order.addEventListener("change", () => {
    const key = order.value, sorted = [...sections];
    if (key === "name") sorted.sort((a, b) => a.dataset.name.localeCompare(b.dataset.name));
    else if (key) sorted.sort((a, b) => b.dataset[key] - a.dataset[key]);
    cases.append(...sorted);
  });
  filter.form.addEventListener("submit", (event) => event.preventDefault());
  const unfold = document.getElementById("unfold");
  unfold.addEventListener("click", () => {
    const open = unfold.textContent === "open all";
    for (const box of document.querySelectorAll("details.case")) box.open = open;
    unfold.textContent = open ? "close all" : "open all";
  });
}

/* a click on a heading sorts the rows of its table; a second click reverses them */
for (const head of document.querySelectorAll("th[data-sort]")) head.addEventListener("click", () => {
  const body = head.closest("table").tBodies[0], column = head.cellIndex, sign = head.dataset.sign === "1" ? -1 : 1;
  head.dataset.sign = sign;
  const value = (row) => (head.dataset.sort === "number" ? -row.cells[column].dataset.value : row.cells[column].textContent);
  const compare = (a, b) => (typeof a === "number" ? a - b : a.localeCompare(b));
  body.append(...[...body.rows].sort((a, b) => sign * compare(value(a), value(b))));
});
