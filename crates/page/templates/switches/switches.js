// The panel of switches: a choice of effects, the number that follows it, sizes and parameters.
// Where the numbers come from is the business of a source: the program behind a live page, or the
// page itself.
const Studio = (() => {
  const { make } = Numbers;
  const at = (id) => document.getElementById("studio-" + id);
  const S = { state: null, source: null, on: [], ticket: 0, shown: null, before: null };
  const hears = [], hooks = { changed: [], flipped: [], state: [] };
  const number = (v) => (v === null || v === undefined || !Number.isFinite(v) ? "–" : v >= 100 ? v.toFixed(0) : v === 0 ? "0" : v.toPrecision(3));
  const unitOf = (u) => (u === "1" ? "" : " " + u.replace(/\^2/g, "²").replace(/\^3/g, "³").replace(/\*/g, "·"));
  // text whose parts between backticks are code
  const prose = (text) => text.split("`").map((part, i) => (i % 2 ? make("code", {}, part) : part.replace(/\^2/g, "²")));
  const two = (v) => (v >= 100 ? v.toFixed(0) : v.toPrecision(2));
  const times = (v) => (v === null || v === undefined ? "" : two(v) + " × floor");
  // error, and its ratio to the floor where there is one
  const size = (e) => [`${number(e.held_out_error)} N`, times(e.times_floor)].filter(Boolean).join(", ");
  // words and colour of a grade: the program's own table
  const judged = (e) => S.state.grades[e.grade].words + (e.because ? ": " + S.state.reserves[e.because] : "");
  const colour = (e) => S.state.grades[e.grade].signal;
  const same = (a, b) => a.length === b.length && a.every((k) => b.includes(k));
  // what differs from the present model: a choice of effects, or what a live page adds to it
  const others = [];
  const preview = () => !same(S.on, S.state.model) || others.some((differs) => differs());
  const problem = (e) => {
    at("problem").hidden = !e;
    at("problem").textContent = e ? (e.problem || String(e.message || e)) + (e.hint ? " Hint: " + e.hint + "." : "") : "";
  };

  // the choice of effects is part of the address, so that a reload or a link brings it back
  const recorded = {};
  const put = (url, key, list, plain) => (same(list, plain) ? url.searchParams.delete(key) : url.searchParams.set(key, list.join(",")));
  const list = (key) => (new URL(location.href).searchParams.get(key) ?? "").split(",").filter(Boolean);
  const remember = () => {
    const url = new URL(location.href);
    put(url, "on", S.on, S.state.model);
    Object.values(recorded).forEach((write) => write(url));
    // a page opened as a file may not change its address in every browser
    try { history.replaceState(null, "", url); } catch { /* the choice is not remembered */ }
  };
  const recall = () => {
    const known = S.state.switches.map((s) => s.key);
    if (new URL(location.href).searchParams.has("on") && known.length) S.on = list("on").filter((k) => known.includes(k));
  };

  // the kind of motion that the first screen judges
  const place = (errors) => errors.find((e) => e.judged_on === S.state.place) || errors.find((e) => e.judged_on === "flight") || errors[0];
  const present = () => S.state.revisions.at(-1)?.errors ?? [];
  // errors, which kind they are, and what came with them
  const show = (errors, which, model) => {
    const e = place(errors), before = place(present());
    S.shown = { errors, which, model };
    if (!e) { at("which").textContent = which; return; }
    at("place").textContent = `Held-out error in ${e.judged_on}`;
    at("value").textContent = number(e.held_out_error) + " N";
    at("times").textContent = [times(e.times_floor), judged(e)].filter(Boolean).join(", ");
    at("times").className = "studio-times " + colour(e);
    const most = 1.04 * Math.max(e.held_out_error, before?.held_out_error ?? 0, e.noise_floor_ci95?.[1] ?? 0, e.noise_floor ?? 0);
    const part = (v) => (100 * Math.min(1, Math.max(0, v / most))).toFixed(2) + "%";
    const gauge = document.querySelector(".studio-gauge"), bar = (name) => gauge.querySelector("." + name);
    bar("error").style.width = part(e.held_out_error);
    bar("error").className = "error " + colour(e);
    bar("before").style.width = preview() && before ? part(before.held_out_error) : "0";
    bar("before").hidden = !preview();
    bar("floor").style.left = part(e.noise_floor ?? 0);
    bar("floor").hidden = !e.noise_floor;
    bar("band").hidden = !e.noise_floor_ci95;
    if (e.noise_floor_ci95) { bar("band").style.left = part(e.noise_floor_ci95[0]); bar("band").style.width = part(e.noise_floor_ci95[1] - e.noise_floor_ci95[0]); }
    at("which").replaceChildren(...prose(which));
    const other = errors.filter((x) => x !== e).map((x) => `in ${x.judged_on}: ${size(x)}`);
    const gone = which.startsWith("quick") ? present().filter((x) => !errors.some((y) => y.judged_on === x.judged_on)) : [];
    other.push(...gone.map((x) => `in ${x.judged_on}: ${S.source.later}`));
    if (preview() && before) other.unshift(`the present model: ${size(before)}`);
    at("other").replaceChildren(...prose(other.join(" · ")));
    at("live").textContent = `${which.replaceAll("`", "")}: ${number(e.held_out_error)} newtons, ${times(e.times_floor)}, ${judged(e)}`;
    hears.forEach((hear) => hear());
  };

  const buttons = () => {
    at("reset").disabled = !preview();
    // the headline keeps describing the model as it is
    document.documentElement.classList.toggle("switched", preview());
    hooks.changed.forEach((hear) => hear());
  };

  const coefficients = (model, exact) => {
    const unit = (name) => {
      const s = S.state.switches.find((x) => name.startsWith(x.key + ".")), c = s?.coefficients.find(([n]) => name === s.key + "." + n);
      return c ? unitOf(c[1]) : "";
    };
    const line = (c) => (Array.isArray(c) ? { name: c[0], value: c[1], ci95: null } : c);
    const rows = (model.coefficients ?? []).map(line);
    const half = (c) => (c.ci95 ? " ± " + Numbers.short((c.ci95[1] - c.ci95[0]) / 2) : "");
    const table = (head, body) => make("table", {}, make("thead", {}, make("tr", {}, ...head.map((h) => make("th", { scope: "col" }, h)))), make("tbody", {}, ...body.map((r) => make("tr", {}, make("th", { scope: "row" }, r[0]), ...r.slice(1).map((v) => make("td", {}, v))))));
    at("coefficients").replaceChildren(rows.length ? table(["coefficient", exact ? "value ± 95 %" : "value"], rows.map((c) => [c.name, Numbers.short(c.value) + half(c) + unit(c.name)])) : make("p", { class: "studio-hint" }, "The model holds no effect."));
    const old = new Map((S.before?.base ?? []).map((b) => [b[0], b[1]]));
    const moved = (model.base ?? []).map((b) => ({ name: b[0], value: b[1], unit: b[b.length - 1], by: b[1] - (old.get(b[0]) ?? b[1]) }));
    // relative to the size of parameters of the same unit
    const scale = {};
    moved.forEach((b) => { scale[b.unit] = Math.max(scale[b.unit] ?? 0, Math.abs(b.value)); });
    moved.sort((a, b) => Math.abs(b.by / (scale[b.unit] || 1)) - Math.abs(a.by / (scale[a.unit] || 1)));
    at("parameters").replaceChildren(!moved.length && S.source.without_parameters ? make("p", { class: "studio-hint" }, ...prose(S.source.without_parameters)) : moved.length ? table(["parameter of the body", "value", "change"], moved.slice(0, 8).map((b) => [b.name, Numbers.short(b.value) + " " + b.unit, (b.by > 0 ? "+" : "") + Numbers.short(b.by)])) : "");
  };

  const flip = async () => {
    const ticket = ++S.ticket, started = performance.now();
    remember();
    buttons();
    problem(null);
    if (S.state.preparing || !S.state.switches.length) return;
    try {
      const found = await S.source.model(S.on);
      if (ticket !== S.ticket) return;
      if (found && !found.model) {
        // the number of another choice must not stay
        const why = `${found.because}: ${S.source.later}`;
        at("value").textContent = "–";
        at("times").textContent = "";
        document.querySelector("#studio .studio-gauge .error").style.width = "0";
        document.querySelector(".ladder .rung.preview")?.remove();
        at("which").replaceChildren(...prose(why));
        at("live").textContent = why.replaceAll("`", "");
      }
      else if (found) {
        if (!S.before && !preview()) S.before = found.model;
        const words = preview() ? `quick: from stored rows${found.words ?? ""}; ${S.source.next(S.on)}` : "the present model";
        show(preview() ? found.model.errors : present().length ? present() : found.model.errors, words, found.model);
        coefficients(found.model, false);
        hooks.flipped.forEach((hear) => hear(found.model));
        S.flipped = performance.now() - started;
        document.getElementById("studio").dataset.milliseconds = S.flipped.toFixed(1);
      }
      S.source.after?.(ticket, found);
    } catch (e) {
      if (ticket === S.ticket) problem(e);
    }
  };

  const switches = () => {
    const about = new Map((S.state.asked?.candidates ?? []).map((c) => [c.key, c]));
    const rows = S.state.switches.map((s) => {
      const c = about.get(s.key), box = make("input", { type: "checkbox", role: "switch", "data-key": s.key });
      box.checked = S.on.includes(s.key);
      box.onchange = () => {
        S.on = box.checked ? [...S.on, s.key] : S.on.filter((k) => k !== s.key);
        flip();
      };
      const from = { own: " own", found: " law", draft: " draft" }[s.from] ?? "";
      const kind = S.state.model.includes(s.key) ? " held" : S.state.asked?.found.includes(s.key) ? " found" : from;
      const ratio = c && c.held_out_ratio !== null && !kind.includes("held") ? "leaves " + Math.round(100 * c.held_out_ratio) + " %" : "";
      const label = make("label", { class: "studio-switch" + kind }, box, make("span", { class: "name" }, s.title), make("span", { class: "ratio", title: "estimate from the ranking of the error that this effect alone leaves" }, ratio), make("span", { class: "key" }, s.key));
      return make("li", {}, label);
    });
    at("list").replaceChildren(...rows);
    const asked = S.state.asked;
    const said = asked ? (asked.of_present_results ? "" : "From a discovery of other results; run it again. ") + asked.words : "`discover` has not been run.";
    at("verdict").replaceChildren(...prose(S.state.preparing ? "The switches are being prepared …" : said));
    if (S.state.problem) problem(S.state.problem);
  };

  // a new state of the results: what the program knows before a switch is flipped
  const begin = async (state) => {
    S.state = state;
    S.on = [...state.model];
    recall();
    hooks.state.forEach((hear) => hear());
    switches();
    buttons();
    if (present().length) show(present(), "the present model", null);
    if (state.preparing || !state.switches.length) return;
    S.before = (await S.source.plain(state.model)).model;
    if (S.before) {
      coefficients(S.before, false);
      hooks.flipped.forEach((hear) => hear(S.before));
    }
    await flip();
  };
  // a part that is opened is seen
  document.querySelectorAll(".studio-part").forEach((d) => d.addEventListener("toggle", () => d.open && d.scrollIntoView({ block: "nearest" })));
  at("reset").onclick = () => {
    S.on = [...S.state.model];
    hooks.reset?.();
    switches();
    flip();
  };
  return { S, at, make, prose, problem, show, coefficients, switches, buttons, flip, begin, preview, same, number, times, judged, colour, unitOf, place, present, put, list, hooks, others, recorded, hear: (f) => hears.push(f) };
})();
