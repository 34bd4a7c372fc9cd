
"use strict";
// Sorting and enlarging are extras: without them the page shows all there is.
for (const table of document.querySelectorAll("table.all")) {
  table.classList.add("sortable");
  const body = table.tBodies[0];
  for (const head of table.tHead.rows[0].cells) {
    head.tabIndex = 0;
    const sort = () => {
      const down = head.getAttribute("aria-sort") === "ascending";
      for (const other of table.tHead.rows[0].cells) other.removeAttribute("aria-sort");
      head.setAttribute("aria-sort", down ? "descending" : "ascending");
      const column = head.cellIndex;
      // Rows without a number stay last, whichever way the others go.
      const key = (row) => (column === 0 ? row.cells[0].textContent : row.cells[column].dataset.v);
      const order = (a, b) => (column === 0 ? a.localeCompare(b) : a - b);
      body.append(...[...body.rows].sort((r, s) => {
        const a = key(r), b = key(s);
        if (a === undefined || b === undefined) return (a === undefined) - (b === undefined);
        return down ? order(b, a) : order(a, b);
      }));
    };
    head.addEventListener("click", sort);
    head.addEventListener("keydown", (event) => { if (event.key === "Enter") sort(); });
  }
}
for (const image of document.querySelectorAll(".sheet img")) {
  image.addEventListener("click", () => image.parentElement.classList.toggle("wide"));
}
