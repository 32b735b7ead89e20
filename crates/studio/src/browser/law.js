// A law of one's own: written in the page, checked as it is tried, a switch at once, kept with the
// model.
(() => {
  const { make } = Numbers;
  const { S, at, prose, problem } = Studio;
  const form = at("law"), field = (name) => form.elements.namedItem(name);
  const FORCE = ["x", "y", "z"].flatMap((a) => ["force_" + a, "moment_" + a]);
  let wanted = null;

  const words = () => S.state.law_words;
  Studio.hooks.state.push(() => {
    const link = field("link"), kept = link.value;
    link.replaceChildren(...words().links.map((l) => make("option", { value: l }, l === "body" ? "body (centre of mass)" : l === "all" ? "every link" : l)));
    if (kept) link.value = kept;
    else link.value = words().links[2] ?? "body";
    if (wanted && S.state.switches.some((s) => s.key === wanted)) {
      if (!S.on.includes(wanted)) S.on.push(wanted);
      wanted = null;
    }
  });

  // the coefficients are the names that are neither quantities nor functions
  const known = () => new Set([...words().quantities.map(([n]) => n), ...words().functions]);
  const names = () => {
    const all = FORCE.flatMap((f) => field(f).value.match(/[A-Za-z_]\w*/g) ?? []), have = known();
    return [...new Set(all)].filter((n) => !have.has(n));
  };
  const units = {};
  const coefficients = () => {
    const box = at("law-units");
    box.replaceChildren(...names().map((n) => {
      const input = make("input", { type: "text", name: "unit_" + n, value: units[n] ?? "", placeholder: "N*s/m", autocomplete: "off", spellcheck: "false" });
      input.oninput = () => { units[n] = input.value.trim(); };
      return make("label", { class: "law-unit" }, make("span", {}, "unit of ", make("code", {}, n)), input);
    }));
  };

  // completion: quantities, functions and coefficients that begin like the word before the cursor
  const list = at("law-words");
  let target = null, active = -1;
  const word = (input) => input.value.slice(0, input.selectionStart).match(/[A-Za-z_]\w*$/)?.[0] ?? "";
  const close = () => { list.hidden = true; active = -1; target?.removeAttribute("aria-activedescendant"); target?.setAttribute("aria-expanded", "false"); };
  const offer = (input) => {
    const begun = word(input);
    const all = [...words().quantities, ...words().functions.map((f) => [f + "(", "function"])];
    const fits = begun ? all.filter(([n]) => n.startsWith(begun) && n !== begun).slice(0, 8) : [];
    target = input;
    if (!fits.length) return close();
    active = -1;
    list.replaceChildren(...fits.map(([n, unit], i) => {
      const item = make("li", { role: "option", id: "law-word-" + i, "aria-selected": "false", "data-word": n }, make("code", {}, n), make("span", {}, unit === "1" ? "" : Studio.unitOf(unit)));
      item.onmousedown = (e) => { e.preventDefault(); take(n); };
      return item;
    }));
    list.hidden = false;
    input.setAttribute("aria-expanded", "true");
    input.after(list);
  };
  const take = (n) => {
    const begun = word(target), to = target.selectionStart;
    target.setRangeText(n, to - begun.length, to, "end");
    close();
    coefficients();
  };
  const move = (by) => {
    const items = [...list.children];
    active = (active + by + items.length) % items.length;
    items.forEach((item, i) => item.setAttribute("aria-selected", String(i === active)));
    target.setAttribute("aria-activedescendant", items[active].id);
  };
  FORCE.forEach((name) => {
    const input = field(name);
    input.oninput = () => { input.removeAttribute("aria-invalid"); coefficients(); offer(input); };
    input.onblur = close;
    input.onkeydown = (e) => {
      if (list.hidden) return;
      if (e.key === "ArrowDown" || e.key === "ArrowUp") { e.preventDefault(); move(e.key === "ArrowDown" ? 1 : -1); }
      else if ((e.key === "Enter" || e.key === "Tab") && active >= 0) { e.preventDefault(); take(list.children[active].dataset.word); }
      else if (e.key === "Escape") { e.preventDefault(); close(); }
    };
  });

  const spec = () => {
    const three = (what) => {
      const own = ["x", "y", "z"].map((a) => field(`${what}_${a}`).value.trim());
      return own.some(Boolean) ? own.map((f) => f || "0") : null;
    };
    const place = ["x", "y", "z"].map((a) => field("at_" + a).value.trim());
    const point = { link: field("link").value };
    if (place.some(Boolean)) point.position_m = place.map((v) => parseFloat(v) || 0);
    const out = { id: field("name").value.trim(), title: field("title").value.trim(), point, axes: field("axes").value, coefficients: names().map((name) => ({ name, unit: units[name] ?? "" })) };
    for (const what of ["force", "moment"]) { const f = three(what); if (f) out[what] = f; }
    return out;
  };

  const told = at("law-problem");
  const wrong = (w) => {
    told.hidden = !w;
    told.textContent = w ? w.problem.replace(/^./, (c) => c.toUpperCase()).replace(/\.?$/, ".") : "";
    FORCE.concat("name").forEach((n) => field(n).removeAttribute("aria-invalid"));
    if (!w) return;
    const [, what, k] = w.entry.match(/^(force|moment)\[(\d)\]/) ?? [], unit = w.entry.match(/^coefficients\[(\d+)\]/);
    const input = what ? field(`${what}_${"xyz"[k]}`) : unit ? form.querySelectorAll(".law-unit input")[+unit[1]] : w.entry === "id" ? field("name") : null;
    if (!input) return;
    input.setAttribute("aria-invalid", "true");
    input.focus();
    if (w.position !== null && input.setSelectionRange) input.setSelectionRange(w.position, input.value.length);
  };
  form.onsubmit = async (e) => {
    e.preventDefault();
    wrong(null);
    const missing = names().find((n) => !(units[n] ?? "").trim());
    if (missing) {
wrong({ problem: `“${missing}” is not a known quantity or function and is treated as a coefficient: enter its unit`, entry: "", position: null });
      form.elements.namedItem("unit_" + missing)?.focus();
      return;
    }
    try {
      const found = await Live.ask("/api/law", spec());
      if (found.wrong) return wrong(found.wrong);
      wanted = found.key;
      S.state.preparing = true;
      Live.work("The law becomes a switch", 0, 1);
    } catch (e) { problem(e); }
  };
})();
