/* SPDX-License-Identifier: BSD-3-Clause */
/* Tables that are wider than their column say that they scroll: site.css writes it above them. */
function markTables() {
   for (const table of document.querySelectorAll(".table-wrapper"))
      table.classList.toggle("scrolls", table.scrollWidth > table.clientWidth + 1);
}
window.addEventListener("load", () => (window.MathJax?.startup?.promise ?? Promise.resolve()).then(markTables));
window.addEventListener("resize", markTables);
