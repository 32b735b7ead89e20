// Line charts: uPlot panels that share the abscissa, the time of the player, and a choice of
// flight, contact or all.
const Charts = (() => {
  const COLOURS = ["c0", "c1", "c2", "c3", "c4", "c5"];
  const drawn = new Map();
  const read = (figure) => {
    const f = Numbers.read(figure);
    f.lists = f.lists.map(Numbers.list);
    return f;
  };
  const gaps = (list) => Array.from(list, (v) => (Number.isFinite(v) ? v : null));
  const inside = (shades, x) => shades.some(([a, b]) => x >= a && x <= b);

  // one colour a name over all panels of a figure
  const palette = (f) => {
    const names = [];
    return (name, wanted) => {
      if (wanted) return wanted;
      if (!names.includes(name)) names.push(name);
      return COLOURS[names.indexOf(name) % COLOURS.length];
    };
  };

  // columns of uPlot: the curves of a panel on one abscissa
  const columns = (f, panel, colour) => {
    const curves = [];
    for (const b of panel.bands) {
      const [mean, sd] = [f.lists[b.mean], f.lists[b.sd]];
      const ink = colour(b.name, b.colour);
      curves.push({ x: b.x, y: gaps(mean.map((m, i) => m + sd[i])), ink, edge: true }, { x: b.x, y: gaps(mean.map((m, i) => m - sd[i])), ink, edge: true, closes: true });
      curves.push({ x: b.x, y: gaps(mean), ink, name: b.name, line: true, width: 2 });
    }
    for (const s of panel.series) curves.push({ ...s, y: gaps(f.lists[s.y]), ink: colour(s.name, s.colour) });
    const xs = [...new Set(curves.map((c) => c.x))];
    if (xs.length < 2) return { data: [Array.from(f.lists[xs[0]] || []), ...curves.map((c) => c.y)], curves };
    const groups = xs.map((x) => curves.filter((c) => c.x === x));
    const data = uPlot.join(xs.map((x, i) => [Array.from(f.lists[x]), ...groups[i].map((c) => c.y)]));
    return { data, curves: groups.flat() };
  };

  const draw = (el) => {
    Numbers.library("uplot");
    drawn.get(el)?.forget();
    const figure = el.closest("figure"), f = read(figure);
    const colour = palette(f);
    const timed = Boolean(f.recording), flights = f.shades.length > 0 && timed;
    const state = { mode: flights ? f.focus : "all", window: null };
    const plots = [];
    const ink = { text: Numbers.colour("ink"), dim: Numbers.colour("dim"), grid: Numbers.colour("grid"), line: Numbers.colour("line") };

    // what is shown of a list in the present mode; values elsewhere would set the scale
    const masked = (x, y) => (state.mode === "all" ? y : y.map((v, i) => (inside(f.shades, x[i]) === (state.mode === "flight") ? v : null)));
    const extent = (x, ys) => {
      let low = Infinity, high = -Infinity;
      x.forEach((at, i) => {
        if (state.window && (at < state.window[0] || at > state.window[1])) return;
        // where a flight begins and ends the filter mixes in contact: these values do not set the
        // scale
        if (state.mode === "flight" && !f.shades.some(([a, b]) => at > a + 0.17 * (b - a) && at < b - 0.17 * (b - a))) return;
        for (const y of ys) if (y[i] !== null && y[i] !== undefined) { low = Math.min(low, y[i]); high = Math.max(high, y[i]); }
      });
      return [low, high];
    };
    const span = () => {
      if (state.window) return state.window;
      const x = plots.length ? plots[0].all[0] : [0, 1];
      const [from, to] = [x[0], x[x.length - 1]];
      if (state.mode === "all" || !f.shades.length) return [from, to];
      const first = f.shades[0][0], last = f.shades[f.shades.length - 1][1], room = 0.06 * (last - first);
      return state.mode === "flight" ? [Math.max(from, first - room), Math.min(to, last + room)] : [from, to];
    };

    const panelsEl = Numbers.make("div", { class: "panels", style: `--columns:${f.columns};--rows:${f.rows}` });
    const legend = Numbers.make("p", { class: "legend" });
    const shown = new Set();
    const key = (name, ink, dashed, points) => {
      if (!name || shown.has(name)) return;
      shown.add(name);
      legend.append(Numbers.make("span", {}, Numbers.make("i", { class: points ? "point" : dashed ? "dashed" : "line", style: `--swatch:var(--${ink})` }), " " + name));
    };

    f.panels.forEach((panel) => {
      const { data, curves } = columns(f, panel, colour);
      curves.filter((c) => !c.edge && !c.quiet).forEach((c) => key(c.name, c.ink, c.dashed, c.points && !c.line));
      const told = Numbers.make("span", { class: "told" });
      const place = Numbers.make("div", { class: "panel-plot" });
      const box = Numbers.make("div", { class: "panel" }, Numbers.make("p", { class: "panel-title" }, Numbers.make("b", {}, panel.title), panel.title && panel.y ? ", " + panel.y : panel.y, " ", told), place);
      panelsEl.append(box);
      const named = panel.ticks.length > 0;
      const series = [{ label: f.x }, ...curves.map((c) => ({
        label: c.name || "", stroke: Numbers.colour(c.ink), width: c.edge || c.line === false ? 0 : c.width || 1.6, dash: c.dashed ? [6, 4] : undefined,
        points: { show: Boolean(c.points), size: 7, fill: Numbers.colour(c.ink) }, paths: c.line === false ? () => null : undefined,
      }))];
      const bands = curves.flatMap((c, i) => (c.edge && !c.closes ? [{ series: [i + 1, i + 2], fill: Numbers.faint(c.ink, 0.2) }] : []));
      const holder = { all: data, place, told, panel, curves };
      const lines = (u) => {
        const { ctx, bbox } = u;
        ctx.save();
        ctx.font = `${11 * devicePixelRatio}px system-ui, sans-serif`;
        ctx.strokeStyle = ctx.fillStyle = ink.dim;
        ctx.setLineDash([3 * devicePixelRatio, 3 * devicePixelRatio]);
        for (const l of panel.lines) {
          const at = u.valToPos(l.at, l.upright ? "x" : "y", true);
          ctx.beginPath();
          if (l.upright) { ctx.moveTo(at, bbox.top); ctx.lineTo(at, bbox.top + bbox.height); } else { ctx.moveTo(bbox.left, at); ctx.lineTo(bbox.left + bbox.width, at); }
          ctx.stroke();
          if (l.upright) ctx.fillText(l.label, at + 4 * devicePixelRatio, bbox.top + 12 * devicePixelRatio);
          else { ctx.textAlign = "right"; ctx.fillText(l.label, bbox.left + bbox.width - 4, at - 4); ctx.textAlign = "left"; }
        }
        ctx.restore();
      };
      const shade = (u) => {
        const { ctx, bbox } = u;
        ctx.save();
        ctx.fillStyle = Numbers.colour("shade");
        for (const [a, b] of f.shades) {
          const [from, to] = [a, b].map((v) => Math.min(bbox.left + bbox.width, Math.max(bbox.left, u.valToPos(v, "x", true))));
          if (to > from) ctx.fillRect(from, bbox.top, to - from, bbox.height);
        }
        ctx.restore();
      };
      const u = new uPlot({
        width: 300, height: f.panel_px, series, bands, legend: { show: false },
        scales: {
          x: { time: false, range: () => { const [a, b] = span(); return named ? [-0.4, panel.ticks.length - 0.6] : a === b ? [a - 1, b + 1] : [a, b]; } },
          y: { distr: panel.log ? 3 : 1, range: (u, low, high) => {
            if (panel.log) return uPlot.rangeLog(low ?? 0.1, high ?? 1, 10, true);
            let [a, b] = extent(u.data[0], u.data.slice(1));
            if (!Number.isFinite(a)) return [0, 1];
            if (panel.from_zero) a = Math.min(0, a);
            for (const l of panel.lines) if (!l.upright) { a = Math.min(a, l.at); b = Math.max(b, l.at); }
            const room = (state.mode === "flight" ? 0.25 : 0.06) * (b - a || Math.abs(a) || 1);
            return [panel.from_zero && a === 0 ? 0 : a - room, b + room];
          } },
        },
        axes: [
          { stroke: ink.dim, grid: { stroke: ink.grid, width: 1 }, ticks: { stroke: ink.line, size: 4, width: 1 }, size: 26, font: "11px system-ui, sans-serif",
            ...(named ? { splits: () => panel.ticks.map((_, i) => i), values: () => panel.ticks } : {}) },
          { stroke: ink.dim, grid: { stroke: ink.grid, width: 1 }, ticks: { stroke: ink.line, size: 4, width: 1 }, size: 52, font: "11px system-ui, sans-serif", values: (_, v) => v.map((x) => (x === null ? "" : Numbers.short(x))) },
        ],
        cursor: { y: false, drag: { x: true, y: false, setScale: false }, points: { size: 6 }, bind: { dblclick: () => () => { state.window = null; refresh(); } } },
        hooks: {
          drawClear: [shade], draw: [lines],
          setSelect: [(u) => {
            if (u.select.width < 6) return;
            state.window = [u.posToVal(u.select.left, "x"), u.posToVal(u.select.left + u.select.width, "x")];
            u.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
            refresh();
            if (timed) el.dispatchEvent(new CustomEvent("stretch", { bubbles: true, detail: { recording: f.recording, from: state.window[0], to: state.window[1] } }));
          }],
          setCursor: [(u) => {
            if (!u.cursor.event || u.cursor.left < 0) return;
            const at = u.posToVal(u.cursor.left, "x");
            point(at);
            if (timed) Time.set(f.recording, at, el);
          }],
        },
      }, data, place);
      holder.u = u;
      plots.push(holder);
    });

    // puts the cursors of all panels at an abscissa and tells the values there
    let wide = true;
    const point = (at) => {
      if (!wide) return;
      for (const p of plots) {
        const i = p.u.valToIdx(at), left = p.u.valToPos(at, "x");
        const hidden = !Number.isFinite(left) || left < 0 || left > p.u.bbox.width / devicePixelRatio;
        if (!p.u.cursor.event || Math.abs((p.u.cursor.left ?? -10) - left) > 1) p.u.setCursor({ left: hidden ? -10 : left, top: hidden ? -10 : 1 }, false);
        const values = p.curves.map((c, k) => [c, p.u.data[k + 1][i]]).filter(([c, v]) => !c.edge && v !== null && v !== undefined);
        p.told.textContent = hidden ? "" : values.slice(0, 4).map(([c, v]) => (c.name ? c.name + " " : "") + Numbers.short(v)).join(" · ");
      }
    };
    const refresh = () => {
      for (const p of plots) p.u.setData([p.all[0], ...p.all.slice(1).map((y) => masked(p.all[0], y))]);
      buttons.forEach((b) => b.setAttribute("aria-pressed", b.dataset.mode === state.mode && !state.window ? "true" : "false"));
      step?.querySelector("span") && (step.querySelector("span").textContent = alone() < 0 ? "each flight" : `flight ${alone() + 1} of ${f.shades.length}`);
    };
    const alone = () => (state.window && state.mode === "flight" ? f.shades.findIndex(([a, b]) => Math.abs((a + b) / 2 - (state.window[0] + state.window[1]) / 2) < 1e-6) : -1);
    const one = (by) => {
      const k = (alone() + by + f.shades.length + (alone() < 0 && by < 0 ? 1 : 0)) % f.shades.length, [a, b] = f.shades[k], room = 0.04 * (b - a);
      Object.assign(state, { mode: "flight", window: [a - room, b + room] });
      refresh();
      if (timed) { Time.set(f.recording, (a + b) / 2, el); point((a + b) / 2); }
    };
    const button = (words, mode) => {
      const b = Numbers.make("button", { type: "button", "data-mode": mode, "aria-pressed": "false" }, words);
      b.onclick = () => { Object.assign(state, { mode, window: null }); refresh(); };
      return b;
    };
    const buttons = flights ? [button("Flight", "flight"), button("Contact", "contact"), button("All", "all")] : [];
    let step = null;
    if (f.shades.length > 1 && flights) {
      const [before, after] = [["‹", "Previous flight", -1], ["›", "Next flight", 1]].map(([sign, label, by]) => { const b = Numbers.make("button", { type: "button", "aria-label": label }, sign); b.onclick = () => one(by); return b; });
      step = Numbers.make("span", { class: "step" }, before, Numbers.make("span", {}, "each flight"), after);
    }
    const tools = flights ? [Numbers.make("div", { class: "chart-tools", role: "toolbar", "aria-label": "Part shown" }, ...buttons, ...(step ? [step] : []), Numbers.make("span", { class: "hint" }, "Drag to zoom, double-click to reset; the player follows the pointer."))] : [];
    const foot = Numbers.make("p", { class: "x-title" }, f.x);
    el.replaceChildren(...tools, legend, panelsEl, foot);
    el.style.minHeight = "";
    const fit = () => { wide = el.clientWidth > 0; plots.forEach((p) => { const width = p.place.clientWidth; if (width > 0 && width !== p.u.width) p.u.setSize({ width, height: f.panel_px }); }); };
    const watch = new ResizeObserver(fit);
    watch.observe(el);
    fit();
    refresh();
    if (timed) Time.on(f.recording, el, point);
    drawn.set(el, { fit, forget: () => { watch.disconnect(); Time.off(f.recording, el); plots.forEach((p) => p.u.destroy()); } });
  };

  const rows = (figure) => {
    const f = read(figure), out = [["quantity", "curve", f.x, "value", "sd"]];
    for (const p of f.panels) {
      const quantity = [p.title, p.y].filter(Boolean).join(", ");
      for (const b of p.bands) f.lists[b.x].forEach((x, i) => out.push([quantity, b.name, x, f.lists[b.mean][i], f.lists[b.sd][i]]));
      for (const s of p.series) f.lists[s.x].forEach((x, i) => out.push([quantity, s.name, p.ticks[x] ?? x, f.lists[s.y][i], ""]));
    }
    return out;
  };
  return { draw, rows, fit: (el) => drawn.get(el)?.fit() };
})();
