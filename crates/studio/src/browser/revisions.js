// Two revisions of the model side by side: error, ratio, effects, parameters, and the forces that
// both predict.
(() => {
  const { make } = Numbers;
  const { S, at, number, times } = Studio;
  const [left, right] = [at("left"), at("right")], draw = at("both-forces");
  const NOW = "now";
  S.pair = null;
  const name = (r) => `${r.revision} · ${r.effects.length ? r.effects.join(" + ") : "no effects"}`;
  const effects = (value) => (value === NOW ? S.on : S.state.revisions.find((r) => String(r.revision) === value)?.effects ?? []);
  const known = (keys) => keys.every((k) => S.state.switches.some((s) => s.key === k));
  const options = (select, plain) => {
    const kept = select.value;
    const own = S.state.revisions.map((r) => make("option", { value: String(r.revision) }, name(r)));
    select.replaceChildren(...own, make("option", { value: NOW }, "the switches as they are"));
    select.value = [...select.options].some((o) => o.value === kept) ? kept : plain;
  };
  let ticket = 0;
  const compare = async () => {
    if (!at("revisions").open) { S.pair = null; return; }
    const mine = ++ticket, keys = [effects(left.value), effects(right.value)];
    const missing = keys.flat().filter((k) => !known([k]));
    const models = await Promise.all(keys.map(async (k) => (known(k) && !S.state.preparing ? (await Live.ask("/api/model", { effects: k })).model : null)));
    if (mine !== ticket) return;
    // a revision has its own exact error; the switches the quick one
    const error = (value, model) => Studio.place(S.state.revisions.find((r) => String(r.revision) === value)?.errors ?? model?.errors ?? []);
    const errors = [left.value, right.value].map((v, i) => error(v, models[i]));
    const rows = [["held-out error, N", ...errors.map((e) => (e ? number(e.held_out_error) : "–"))], ["ratio", ...errors.map((e) => (e ? `${times(e.times_floor)}, ${Studio.judged(e)}` : "–"))]];
    const sizes = models.map((m) => new Map(m?.coefficients ?? []));
    for (const n of new Set(sizes.flatMap((m) => [...m.keys()]))) rows.push([n, ...sizes.map((m) => (m.has(n) ? Numbers.short(m.get(n)) : "–"))]);
    const base = models.map((m) => new Map((m?.base ?? []).map((b) => [b[0], b])));
    const scale = {};
    for (const b of base[0].values()) scale[b[2]] = Math.max(scale[b[2]] ?? 0, Math.abs(b[1]));
    const moved = [...base[0].values()].map((b) => [b, base[1].get(b[0])]).filter(([, b]) => b);
    moved.sort(([a, b], [c, d]) => Math.abs(d[1] - c[1]) / (scale[c[2]] || 1) - Math.abs(b[1] - a[1]) / (scale[a[2]] || 1));
    for (const [a, b] of moved.slice(0, 8)) if (a[1] !== b[1]) rows.push([`${a[0]}, ${a[2]}`, Numbers.short(a[1]), Numbers.short(b[1])]);
    const head = make("tr", {}, make("td", {}), ...[left, right].map((s) => make("th", { scope: "col" }, s.value === NOW ? "switches" : "revision " + s.value)));
    at("pair").replaceChildren(make("table", {}, make("thead", {}, head), make("tbody", {}, ...rows.map((r) => make("tr", {}, make("th", { scope: "row" }, r[0]), ...r.slice(1).map((v) => make("td", {}, v)))))));
    at("pair-told").textContent = missing.length ? `No switch for ${[...new Set(missing)].join(", ")}: only the error is stored.` : "";
    S.pair = draw.checked && !missing.length ? [left, right].map((s, i) => ({ effects: keys[i], name: s.value === NOW ? "switches" : "revision " + s.value })) : null;
    S.pairChanged?.();
  };
  Studio.hooks.state.push(() => {
    options(left, String(S.state.revisions[0]?.revision ?? NOW));
    options(right, S.state.revisions.length > 1 ? String(S.state.revisions.at(-1).revision) : NOW);
  });
  const later = () => compare().catch(Studio.problem);
  Studio.hooks.flipped.push(later);
  left.onchange = right.onchange = draw.onchange = later;
  at("revisions").addEventListener("toggle", later);
})();
