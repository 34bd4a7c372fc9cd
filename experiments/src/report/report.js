"use strict";
// Sorting, filtering and enlarging are optional. Without this script, the page still shows all content.
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
      const numeric = head.classList.contains("n");
      // Rows without a value come last in both sort directions.
      const key = (row) => (numeric ? row.cells[column].dataset.v : row.cells[column].textContent || undefined);
      const order = (a, b) => (numeric ? a - b : a.localeCompare(b, "en", { numeric: true }));
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
// Adds a filter that shows only the rows that contain every typed word.
for (const input of document.querySelectorAll("input.filter")) {
  const section = input.closest("section");
  const rows = [...section.querySelectorAll("table.all tbody tr")];
  const count = section.querySelector(".count");
  const filter = () => {
    const words = input.value.toLowerCase().split(/\s+/).filter(Boolean);
    let shown = 0;
    for (const row of rows) {
      const text = [...row.cells].filter((cell) => !cell.classList.contains("n")).map((cell) => cell.textContent).join(" ").toLowerCase();
      row.hidden = !words.every((word) => text.includes(word));
      shown += !row.hidden;
    }
    count.textContent = words.length ? `${shown} of ${rows.length} rows` : "";
  };
  input.addEventListener("input", filter);
  filter();
}
for (const image of document.querySelectorAll(".sheet img")) {
  image.addEventListener("click", () => image.parentElement.classList.toggle("wide"));
}
