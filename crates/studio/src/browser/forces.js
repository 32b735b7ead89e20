// What the chapters show of a choice of effects: the forces that the model predicts, in the curves
// and in the player.
(() => {
  const { S } = Studio;
  const AXES = ["Force x", "Force y", "Force z", "Moment x", "Moment y", "Moment z"];
  const NAME = "with the switches";
  let asked = "";

  const nearest = (list, t) => {
    let low = 0, high = list.length - 1;
    while (high - low > 1) { const m = (low + high) >> 1; if (list[m] <= t) low = m; else high = m; }
    return Math.abs(list[high] - t) < Math.abs(list[low] - t) ? high : low;
  };

  const curves = (figure, found) => {
    const script = figure.querySelector("script"), el = figure.querySelector(".drawing.chart");
    figure.dataset.plain ??= script.textContent;
    const f = JSON.parse(figure.dataset.plain);
    for (const { name, colour, series } of found) f.panels.forEach((panel) => {
      const k = AXES.indexOf(panel.title), own = panel.series.find((s) => s.name === "identified");
      if (k < 0 || !own || !series) return;
      const x = Numbers.list(f.lists[own.x]);
      f.lists.push(x.map((t) => series.predicted[k][nearest(series.time_s, t)]));
      panel.series.push({ ...own, y: f.lists.length - 1, name, colour });
    });
    script.textContent = JSON.stringify(f);
    if (el.childElementCount) Charts.draw(el);
  };

  // the model's arrow: the predicted force turned from the root to the room
  const player = (el, found) => {
    const open = Player.of(el);
    if (!open) return;
    const { d } = open.scene, arrow = d.arrows.find((a) => a.of === "predicted");
    if (!arrow) return;
    arrow.plain ??= arrow.vector;
    arrow.vector = arrow.plain;
    if (found) arrow.vector = Array.from(d.t).flatMap((t, i) => {
      const j = nearest(found.time_s, t), s = d.segments.findIndex((x) => x.parent === null), q = d.turns.slice(4 * (i * d.segments.length + s), 4 * (i * d.segments.length + s) + 4);
      const v = [0, 1, 2].map((k) => found.predicted[k][j] ?? NaN), [x, y, z, w] = q;
      const u = [y * v[2] - z * v[1] + w * v[0], z * v[0] - x * v[2] + w * v[1], x * v[1] - y * v[0] + w * v[2]];
      return [v[0] + 2 * (y * u[2] - z * u[1]), v[1] + 2 * (z * u[0] - x * u[2]), v[2] + 2 * (x * u[1] - y * u[0])];
    });
    open.render();
  };

  // recordings whose curves are on the chapter that is shown
  const shown = () => {
    const chapter = [...document.querySelectorAll(".chapter")].find((c) => !c.hidden);
    const figures = [...(chapter?.querySelectorAll("figure.plot") ?? [])].filter((g) => g.querySelector(".drawing.chart, .drawing.player"));
    const of = (g) => { try { return JSON.parse(g.dataset.plain ?? g.querySelector("script").textContent); } catch { return {}; } };
    return figures.map((g) => ({ g, f: of(g) })).filter(({ f }) => f.recording && (f.kind === "player" || f.panels?.some((p) => AXES.includes(p.title))));
  };

  const draw = async () => {
    const on = !S.state.preparing && !Studio.same(S.on, S.state.model);
    const key = JSON.stringify([on, S.on, S.pair, location.hash]);
    if (key === asked) return;
    asked = key;
    const all = shown(), found = {};
    const drawn = S.pair ? S.pair.map((m, i) => ({ ...m, colour: ["effect", "c3"][i] })) : on ? [{ effects: S.on, name: NAME, colour: "effect" }] : [];
    for (const name of new Set(all.map(({ f }) => f.recording))) {
      found[name] = [];
      for (const m of drawn) {
        let series = null;
        try { series = await Live.ask("/api/series", { trial: name, effects: m.effects }); } catch { /* no curve of this recording */ }
        found[name].push({ ...m, series });
      }
    }
    if (key !== asked) return;
    for (const { g, f } of all) {
      if (f.kind === "player") player(g.querySelector(".drawing.player"), on ? found[f.recording].at(-1)?.series : null);
      else curves(g, found[f.recording]);
    }
  };

  // the number first; curves and player follow when it has been painted and no other flip came
  let due = 0;
  Studio.hooks.changed.push(() => clearTimeout(due));
  Studio.hear(() => {
    clearTimeout(due);
    due = setTimeout(() => requestAnimationFrame(() => setTimeout(draw)), 150);
  });
  S.pairChanged = () => draw();
  window.addEventListener("hashchange", () => setTimeout(() => { if (S.shown) draw(); }, 50));
})();
