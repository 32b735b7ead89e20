// Draws each chart when it comes into view, so that a page with many charts opens at once; saves tables and charts as CSV.
(() => {
  const options = { responsive: true, displaylogo: false, modeBarButtonsToRemove: ["lasso2d", "select2d"] };
  const draw = (el) => {
    const f = FIGURES[+el.dataset.figure];
    if (!f || el.dataset.drawn) return;
    el.dataset.drawn = "1";
    Plotly.newPlot(el, f.data, f.layout, options).then(() => f.frames && Plotly.addFrames(el, f.frames));
  };
  const charts = [...document.querySelectorAll(".chart")];
  if ("IntersectionObserver" in window && !location.hash.includes("draw-all")) {
    const seen = new IntersectionObserver((list) => list.forEach((e) => { if (e.isIntersecting) { draw(e.target); seen.unobserve(e.target); } }), { rootMargin: "400px" });
    charts.forEach((c) => seen.observe(c));
  } else {
    charts.forEach(draw);
  }
  window.addEventListener("beforeprint", () => charts.forEach(draw));
  const quote = (v) => (/[",\n]/.test(v) ? '"' + String(v).replace(/"/g, '""') + '"' : String(v));
  const save = (name, rows) => {
    const blob = new Blob([rows.map((r) => r.map((v) => quote(v ?? "")).join(",")).join("\n") + "\n"], { type: "text/csv" });
    const a = document.createElement("a");
    a.href = URL.createObjectURL(blob);
    a.download = name + ".csv";
    a.click();
    URL.revokeObjectURL(a.href);
  };
  const name = (fig) => fig.querySelector("figcaption").firstChild.textContent.trim().toLowerCase().replace(/[^a-z0-9]+/g, "_").slice(0, 60);
  document.querySelectorAll("button.csv").forEach((b) => b.addEventListener("click", () => {
    const fig = b.closest("figure");
    const table = fig.querySelector("table");
    if (table) return save(name(fig), [...table.rows].map((r) => [...r.cells].map((c) => c.textContent)));
    const f = FIGURES[+fig.querySelector(".chart").dataset.figure];
    const rows = [["series", "x", "y", "z"]];
    for (const t of f.data) {
      if (t.type === "heatmap") t.y.forEach((y, i) => t.x.forEach((x, j) => rows.push([y, x, t.z[i][j], ""])));
      else (t.x || []).forEach((x, i) => rows.push([t.name || "", x, (t.y || [])[i], (t.z || [])[i] ?? ""]));
    }
    save(name(fig), rows);
  }));
})();
