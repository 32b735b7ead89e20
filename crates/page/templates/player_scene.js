// What the player shows: reads a recording, computes places of points on segments, lists what is
// drawn in a frame. Knows no way of drawing.
const PlayerScene = (() => {
  const LISTS = ["t", "flight", "origins", "turns", "measured", "com"];
  const read = (figure) => {
    const d = Numbers.read(figure);
    for (const key of LISTS) d[key] = Numbers.list(d[key]);
    d.ghost = d.ghost && Numbers.list(d.ghost);
    for (const a of d.arrows) { a.foot = Numbers.list(a.foot); a.vector = Numbers.list(a.vector); }
    return d;
  };
  const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
  const less = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
  const times = (a, k) => [a[0] * k, a[1] * k, a[2] * k];
  const size = (a) => Math.hypot(a[0], a[1], a[2]);
  const known = (a) => Number.isFinite(a[0]) && Number.isFinite(a[1]) && Number.isFinite(a[2]);
  const triple = (list, i) => [list[3 * i], list[3 * i + 1], list[3 * i + 2]];
  // v turned by a quaternion x, y, z, w
  const turned = (q, v) => {
    const [x, y, z, w] = q, u = [y * v[2] - z * v[1] + w * v[0], z * v[0] - x * v[2] + w * v[1], x * v[1] - y * v[0] + w * v[2]];
    return [v[0] + 2 * (y * u[2] - z * u[1]), v[1] + 2 * (z * u[0] - x * u[2]), v[2] + 2 * (x * u[1] - y * u[0])];
  };
  const product = (a, b) => [
    a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1], a[3] * b[1] - a[0] * b[2] + a[1] * b[3] + a[2] * b[0],
    a[3] * b[2] + a[0] * b[1] - a[1] * b[0] + a[2] * b[3], a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2]];

  // shade of a multiple of the noise floor; the same limits as in the maps (`heat.rs`)
  const FLOORS = [1.25, 1.75, 2.5, 3.5, 5, 7, 10, 16];
  const shade = (heat) => FLOORS.filter((f) => heat >= f).length;
  const ARROWS = { measured: "measured", predicted: "predicted", effect: "effect", couple: "effect" };

  const open = (figure) => {
    const d = read(figure);
    const n = d.t.length, ns = d.segments.length, nm = d.markers.length;
    const origin = (f, s) => triple(d.origins, f * ns + s);
    const turn = (f, s) => d.turns.slice(4 * (f * ns + s), 4 * (f * ns + s) + 4);
    const on = (f, p) => add(origin(f, p.segment), turned(turn(f, p.segment), p.at_m));
    const measured = (f, m) => triple(d.measured, f * nm + m);
    const com = (f) => triple(d.com, f);

    // middle and size of what moves
    const low = [1e9, 1e9, 0], high = [-1e9, -1e9, 0.4];
    let reach = 0.08;
    for (let f = 0; f < n; f++) {
      const centre = com(f);
      const points = [...d.segments.map((_, s) => origin(f, s)), ...(f % 4 ? [] : [...d.ends, ...d.markers].map((p) => on(f, p)))];
      for (const p of points) if (known(p)) {
        for (let k = 0; k < 3; k++) { low[k] = Math.min(low[k], p[k]); high[k] = Math.max(high[k], p[k]); }
        if (known(centre)) reach = Math.max(reach, size(less(p, centre)));
      }
    }
    const middle = low.map((v, k) => (v + high[k]) / 2), radius = Math.max(0.3, 0.5 * size(less(high, low)));
    const bounds = { low, high, middle, radius, reach, tall: 0.5 * (high[2] - low[2]), wide: 0.5 * Math.hypot(high[0] - low[0], high[1] - low[1]) };
    const thick = Math.min(0.012, 0.018 * reach);

    const flights = [];
    for (let i = 0, from = -1; i <= n; i++) {
      const up = i < n && d.flight[i] > 0.5;
      if (up && from < 0) from = i;
      if (!up && from >= 0) { flights.push([from, i - 1]); from = -1; }
    }

    // what does not move: made once, so that a way of drawing may keep what it made of it
    const ground = [];
    const grid = bounds.wide > 2 ? 1 : 0.5;
    const [x0, x1, y0, y1] = [0, 1].flatMap((k) => [Math.floor(low[k] / grid - 1) * grid, Math.ceil(high[k] / grid + 1) * grid]);
    // lines of the floor as two paths, whose turns lie on its borders
    const [along, across] = [[], []];
    for (let x = x0, k = 0; x <= x1 + 1e-6; x += grid, k++) across.push(...(k % 2 ? [[x, y1, 0], [x, y0, 0]] : [[x, y0, 0], [x, y1, 0]]));
    for (let y = y0, k = 0; y <= y1 + 1e-6; y += grid, k++) along.push(...(k % 2 ? [[x1, y, 0], [x0, y, 0]] : [[x0, y, 0], [x1, y, 0]]));
    ground.push({ kind: "line", points: across, colour: "floor-line" }, { kind: "line", points: along, colour: "floor-line" });
    for (const p of d.plates) ground.push({ kind: "face", points: p.map((c) => [c[0], c[1], c[2] + 0.002]), colour: "plate", alpha: 0.9 }, { kind: "line", points: [...p, p[0]].map((c) => [c[0], c[1], c[2] + 0.004]), colour: "line" });
    const foot = [x0, y0, 0.002], axis = 0.6 * grid, names = [];
    [["x", [axis, 0, 0]], ["y", [0, axis, 0]], ["z", [0, 0, axis]]].forEach(([name, v]) => {
      ground.push({ kind: "arrow", from: foot, to: add(foot, v), colour: "dim", thick: 0.6 * thick });
      names.push({ at: add(foot, times(v, 1.18)), text: name, colour: "dim" });
    });
    // the way of the centre of mass, and how much of it is done in each frame
    const path = [], done = [];
    for (let f = 0; f < n; f++) { if (known(com(f))) path.push(com(f)); done.push(path.length); }

    // drawn parts of a frame; `show` says which, `scale` multiplies the length of arrows
    const frame = (f, show, scale) => {
      const items = [...ground], labels = [...names];

      const skeleton = (offset, colour, alpha, ghost) => {
        d.segments.forEach((s, i) => {
          const at = add(origin(f, i), offset), q = turn(f, i);
          if (!known(at)) return;
          const own = ghost || s.heat === null || shade(s.heat) === 0 ? colour : "h" + shade(s.heat);
          items.push({ kind: "ball", at: add(at, turned(q, s.centre_m)), turn: product(q, s.turn), radii: s.radii_m, colour: own, alpha, name: ghost ? undefined : i });
          if (!ghost && s.parent !== null) items.push({ kind: "rod", from: origin(f, s.parent), to: at, thick, colour: "bone", alpha: 1 });
        });
        if (!ghost) for (const e of d.ends) items.push({ kind: "rod", from: origin(f, e.segment), to: on(f, e), thick: 0.8 * thick, colour: "bone", alpha: 1 });
      };
      if (show.segments) skeleton([0, 0, 0], "body", 0.62, false);
      const away = d.ghost && triple(d.ghost, f);
      if (show.ghost && away && known(away) && size(away) > 1e-4) skeleton(away, "ghost", 0.24, true);

      const dot = Math.min(0.009, 0.03 * reach);
      d.markers.forEach((m, i) => {
        const seen = measured(f, i), there = on(f, m);
        if (show.markers && known(seen)) items.push({ kind: "ball", at: seen, turn: [0, 0, 0, 1], radii: [dot, dot, dot], colour: "measured-marker", alpha: 1 });
        if (show.errors && known(seen) && known(there)) {
          items.push({ kind: "rod", from: there, to: seen, thick: 0.35 * dot, colour: "marker-error", alpha: 1 }, { kind: "ball", at: there, turn: [0, 0, 0, 1], radii: [0.55 * dot, 0.55 * dot, 0.55 * dot], colour: "model-marker", alpha: 1 });
        }
      });

      if (show.centre) {
        items.push({ kind: "line", points: path, colour: "line" }, { kind: "line", points: path, count: done[f], colour: "centre" });
        if (known(com(f))) items.push({ kind: "ball", at: com(f), turn: [0, 0, 0, 1], radii: [2 * thick, 2 * thick, 2 * thick], colour: "centre", alpha: 1 });
      }

      const up = d.flight[f] > 0.5 ? 1 : 0, perMetre = d.newtons_per_m[up] / scale;
      for (const kind of d.arrows) {
        const effect = kind.of === "effect" || kind.of === "couple";
        if (!(effect ? show.effects : show.forces)) continue;
        let best = -1, most = 0;
        for (let i = 0; i < kind.n; i++) {
          const at = triple(kind.foot, f * kind.n + i), v = triple(kind.vector, f * kind.n + i);
          if (!known(at) || !known(v)) continue;
          if (kind.anchor) items.push({ kind: "line", points: [at, kind.anchor], colour: "effect", dashed: kind.suspected, moves: true }, { kind: "ball", at: kind.anchor, turn: [0, 0, 0, 1], radii: [2.5 * thick, 2.5 * thick, 2.5 * thick], colour: "effect", alpha: 1 });
          const length = size(v);
          if (kind.of === "couple") {
            if (length > 0) items.push({ kind: "ring", at, axis: times(v, 1 / length), size: Math.min(1.2 * reach, (10 * length) / perMetre), colour: "effect", alpha: kind.suspected ? 0.5 : 1 });
          } else if (length / perMetre > 0.004) items.push({ kind: "arrow", from: at, to: add(at, times(v, 1 / perMetre)), colour: ARROWS[kind.of], thick: kind.of === "measured" ? 1.5 * thick : kind.of === "predicted" ? thick : 0.8 * thick, alpha: kind.suspected ? 0.6 : 1 });
          if (length > most || best < 0) { most = length; best = i; }
        }
        if (effect && best >= 0) {
          const at = triple(kind.foot, f * kind.n + best), v = triple(kind.vector, f * kind.n + best);
          labels.push({ at: kind.anchor ? times(add(at, kind.anchor), 0.5) : add(at, times(v, kind.of === "couple" ? 0 : 1 / perMetre)), text: kind.name + (kind.suspected ? "?" : ""), colour: "effect", keep: true });
        }
      }
      if (show.effects) for (const m of d.masses) {
        const at = on(f, m), r = Math.cbrt(Math.abs(m.mass_kg) / 4000);
        if (known(at)) { items.push({ kind: "ball", at, turn: [0, 0, 0, 1], radii: [r, r, r], colour: "effect", alpha: m.suspected ? 0.5 : 0.9 }); labels.push({ at, text: m.name + (m.suspected ? "?" : ""), colour: "effect", keep: true }); }
      }
      return { items, labels };
    };

    // sizes of what acts in a frame, N; null where nothing is known
    const acting = (f) => d.arrows.map((kind) => {
      const sum = [0, 0, 0];
      let any = false;
      for (let i = 0; i < kind.n; i++) { const v = triple(kind.vector, f * kind.n + i); if (known(v)) { any = true; for (let k = 0; k < 3; k++) sum[k] += v[k]; } }
      return { name: kind.name, of: kind.of, suspected: kind.suspected, size: any ? size(sum) : null };
    });
    return { d, n, bounds, flights, frame, acting, com, marker: on, measured, origin };
  };

  const rows = (figure) => {
    const s = open(figure), { d } = s, out = [["time, s", "in flight", "kind", "name", "x, m", "y, m", "z, m", "x, N", "y, N", "z, N"]];
    const put = (f, kind, name, at, v = ["", "", ""]) => known(at) && out.push([d.t[f], d.flight[f], kind, name, ...at, ...v]);
    for (let f = 0; f < s.n; f++) {
      d.segments.forEach((x, i) => put(f, "origin of segment", x.name, s.origin(f, i)));
      d.markers.forEach((m, i) => { put(f, "measured marker", m.name, s.measured(f, i)); put(f, "model marker", m.name, s.marker(f, m)); });
      put(f, "centre of mass", "", s.com(f));
      for (const a of d.arrows) for (let i = 0; i < a.n; i++) put(f, a.of === "couple" ? "moment, N·m" : "force", a.name, triple(a.foot, f * a.n + i), triple(a.vector, f * a.n + i));
    }
    return out;
  };
  return { open, rows, shade };
})();
