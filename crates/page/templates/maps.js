// Maps with many columns, on a canvas; numbers of maps and dot plots for the CSV.
const Maps = (() => {
  const ROW = 14, LEFT = 92, TOP = 6, FOOT = 40;
  const read = (figure) => {
    const f = Numbers.read(figure);
    f.z = f.z.map(Numbers.list);
    f.shade = f.shade?.map(Numbers.list);
    f.x = f.x.$ ? Numbers.list(f.x) : f.x;
    return f;
  };
  const drawn = new Map();
  const draw = (el) => {
    const f = read(el.closest("figure"));
    Time.off(f.recording, el);
    const n = f.x.length, height = TOP + f.y.length * ROW + FOOT, timed = Boolean(f.recording);
    const canvas = Numbers.make("canvas", { "aria-hidden": "true" });
    const line = Numbers.make("i", { class: "map-line" }), told = Numbers.make("p", { class: "hint" });
    const ends = Numbers.make("p", { class: "shades" }, f.legend[0] + " ", Numbers.make("span", {}, ...Array.from({ length: 9 }, (_, k) => Numbers.make("i", { class: "h" + k }))), " " + f.legend[1] + " · " + f.unit);
    el.replaceChildren(Numbers.make("div", { class: "map-box" }, canvas, line), ends, told);
    el.style.minHeight = "";
    const width = () => el.clientWidth;
    const at = (k) => LEFT + ((width() - LEFT - 8) * k) / n;
    const paint = () => {
      const ratio = devicePixelRatio || 1, w = width();
      if (!w) return;
      canvas.width = Math.round(w * ratio); canvas.height = Math.round(height * ratio);
      canvas.style.height = height + "px";
      const g = canvas.getContext("2d");
      g.scale(ratio, ratio);
      g.font = "11px system-ui, sans-serif";
      const shades = Array.from({ length: 9 }, (_, k) => Numbers.colour("h" + k));
      f.y.forEach((name, r) => {
        g.fillStyle = Numbers.colour("ink");
        g.textAlign = "right";
        g.fillText(name.length > 14 ? name.slice(0, 13) + "…" : name, LEFT - 6, TOP + r * ROW + 11);
        for (let k = 0; k < n; k++) {
          const s = f.shade[r][k];
          if (!Number.isFinite(s)) continue;
          g.fillStyle = shades[s];
          g.fillRect(at(k), TOP + r * ROW, at(k + 1) - at(k) + 0.5, ROW - 1);
        }
      });
      g.fillStyle = Numbers.colour("dim");
      g.textAlign = "center";
      const [from, to] = [f.x[0], f.x[n - 1]], base = TOP + f.y.length * ROW;
      if (typeof from === "string") {
        const every = Math.ceil(60 / Math.max(1, at(1) - at(0)));
        f.x.forEach((name, k) => k % every || g.fillText(name.length > 9 ? name.slice(0, 8) + "…" : name, (at(k) + at(k + 1)) / 2, base + 13));
        g.fillText(f.x_title, (LEFT + w) / 2, base + 30);
        return;
      }
      const raw = (to - from) / Math.max(2, w / 110), power = 10 ** Math.floor(Math.log10(raw)), by = [1, 2, 5, 10].map((s) => s * power).find((s) => s >= raw);
      for (let v = Math.ceil(from / by) * by; v <= to; v += by) g.fillText(String(+v.toPrecision(6)), at((n * (v - from)) / (to - from)), base + 13);
      g.fillText(f.x_title, (LEFT + w) / 2, base + 30);
    };
    const mark = (seconds) => {
      const share = (seconds - f.x[0]) / (f.x[n - 1] - f.x[0]);
      line.hidden = !(share >= 0 && share <= 1);
      line.style.left = at(n * share) + "px";
      line.style.height = f.y.length * ROW + "px";
    };
    line.hidden = true;
    canvas.onpointermove = (e) => {
      const box = canvas.getBoundingClientRect(), k = Math.floor(((e.clientX - box.left - LEFT) * n) / (box.width - LEFT - 8)), r = Math.floor((e.clientY - box.top - TOP) / ROW);
      if (k < 0 || k >= n || r < 0 || r >= f.y.length) return;
      told.textContent = `${f.y[r]} at ${typeof f.x[k] === "string" ? f.x[k] : Numbers.short(f.x[k])}: ${Number.isFinite(f.z[r][k]) ? Numbers.short(f.z[r][k]) + " " + f.unit : "not seen"}`;
      if (timed) { mark(f.x[k]); Time.set(f.recording, f.x[k], el); }
    };
    const old = drawn.get(el);
    if (old) old.disconnect();
    const watch = new ResizeObserver(paint);
    watch.observe(el);
    drawn.set(el, watch);
    paint();
    if (timed) Time.on(f.recording, el, mark);
  };
  const rows = (figure) => {
    const f = Numbers.read(figure);
    if (f.kind === "dots") {
      const out = [["name", "kind", f.x, "lower", "upper"]];
      for (const s of f.series) {
        const [v, low, high] = [s.values, s.lower, s.upper].map(Numbers.list);
        f.names.forEach((name, i) => Number.isFinite(v[i]) && out.push([name, s.name, v[i], low[i], high[i]]));
      }
      return out;
    }
    const m = read(figure);
    return [["row", m.x_title || "column", m.unit], ...m.y.flatMap((y, i) => m.x.map((x, j) => [y, x, m.z[i][j]]))];
  };
  return { draw, rows };
})();
