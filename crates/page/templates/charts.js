// Charts: loads the plotting library when the first is drawn; unpacks the numbers, puts on the theme, draws; gives the numbers back as CSV.
const Charts = (() => {
  // no button that sends a subject's data to a server
  const away = ["sendChartToCloud", "sendDataToCloud", "editInChartStudio"];
  const options = {
    responsive: true, displaylogo: false, plotlyServerURL: "",
    modeBarButtonsToRemove: [...away, "lasso2d", "select2d", "autoScale2d"],
  };
  const named = (text) => {
    if (text === "$sequence") return [0, 1, 2, 3, 4].map((i) => [i / 4, Numbers.colour("seq" + i)]);
    const [name, alpha] = text.slice(1).split("/");
    const c = Numbers.colour(name);
    if (!alpha) return c;
    const n = parseInt(c.slice(1), 16);
    return `rgba(${n >> 16},${(n >> 8) & 255},${n & 255},${alpha})`;
  };
  const unpack = (v, lists) => {
    if (typeof v === "string") return v.startsWith("$") ? named(v) : v;
    if (v === null || typeof v !== "object") return v;
    if (Array.isArray(v)) return v.map((x) => unpack(x, lists));
    if (v.$ === "list") return lists[v.i];
    if (v.$) return Numbers.list(v);
    return Object.fromEntries(Object.entries(v).map(([k, x]) => [k, unpack(x, lists)]));
  };
  const read = (figure) => {
    const f = JSON.parse(figure.querySelector("script").textContent);
    f.lists = f.lists.map(Numbers.list);
    return f;
  };
  const library = () => {
    if (typeof Plotly !== "undefined") return;
    const program = document.createElement("script");
    program.textContent = document.getElementById("plotting-library").textContent;
    document.head.append(program);
  };
  const draw = (el) => {
    library();
    const f = read(el.closest("figure"));
    el.style.height = el.dataset.height + "px";
    return Plotly.react(el, unpack(f.data, f.lists), unpack(f.layout, f.lists), options);
  };
  const rows = (figure) => {
    const f = read(figure);
    const data = unpack(f.data, f.lists).filter((t) => t.csv !== false);
    if (data[0]?.type === "heatmap") {
      const t = data[0];
      return [["row", f.x || "column", f.panels[0]], ...t.y.flatMap((y, i) => t.x.map((x, j) => [y, x, (t.values || t.z)[i][j]]))];
    }
    if (data[0]?.names) {
      const out = [["name", "kind", f.x, "lower", "upper"]];
      for (const t of data) t.x.forEach((x, i) => Number.isFinite(x) && out.push([t.names[i], t.name, x, x - t.error_x?.arrayminus[i], x + t.error_x?.array[i]]));
      return out;
    }
    const out = [["quantity", "curve", f.x, "value", "sd or half interval"]];
    for (const t of data) {
      const panel = f.panels[(+t.yaxis.slice(1) || 1) - 1];
      const spread = t.sd || t.error_y?.array;
      t.x.forEach((x, i) => out.push([panel, t.name, x, t.y[i], spread ? spread[i] : ""]));
    }
    return out;
  };
  return { draw, rows, library };
})();
