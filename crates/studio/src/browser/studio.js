// The panel: switches, the number that follows them, keeping and undoing, work in progress.
const Studio = (() => {
  const { make } = Numbers;
  const at = (id) => document.getElementById("studio-" + id);
  const token = new URLSearchParams(location.search).get("token");
  const S = { state: null, on: [], leftOut: [], takenIn: [], settings: {}, ticket: 0, exactDue: 0, shown: null, before: null, hears: [] };
  const number = (v) => (v === null || v === undefined || !Number.isFinite(v) ? "–" : v >= 100 ? v.toFixed(0) : v === 0 ? "0" : v.toPrecision(3));
  const unitOf = (u) => (u === "1" ? "" : " " + u.replace(/\^2/g, "²").replace(/\^3/g, "³").replace(/\*/g, "·"));
  // text whose parts between backticks are code
  const prose = (text) => text.split("`").map((part, i) => (i % 2 ? make("code", {}, part) : part.replace(/\^2/g, "²")));
  const times = (v) => (v === null || v === undefined ? "" : v.toPrecision(2) + " × floor");
  const same = (a, b) => a.length === b.length && a.every((k) => b.includes(k));
  const changed = () => Object.keys(S.settings).length > 0 || S.takenIn.length > 0;
  const preview = () => !same(S.on, S.state.model) || S.leftOut.length > 0 || changed();

  const ask = async (path, body) => {
    const how = body === undefined ? {} : { method: "POST", body: JSON.stringify(body), headers: { "content-type": "application/json" } };
    let answer;
    try {
      answer = await fetch(path, { ...how, headers: { ...how.headers, "x-aloft-token": token } });
    } catch {
      throw { problem: "The server does not answer.", hint: "it has ended; start `aloft studio` again and open the address that it prints" };
    }
    if (answer.status === 403) throw { problem: "The server was started again, or this address is not its own.", hint: "open the address that `aloft studio` printed last" };
    const found = await answer.json();
    if (!answer.ok) throw found;
    return found;
  };
  const problem = (e) => {
    at("problem").hidden = !e;
    at("problem").textContent = e ? (e.problem || String(e.message || e)) + (e.hint ? " Hint: " + e.hint + "." : "") : "";
  };

  // the choice of effects is part of the address, so that a reload or a link brings it back
  const remember = () => {
    const url = new URL(location.href);
    const put = (key, list, plain) => (same(list, plain) ? url.searchParams.delete(key) : url.searchParams.set(key, list.join(",")));
    put("on", S.on, S.state.model);
    put("without", S.leftOut, []);
    history.replaceState(null, "", url);
  };
  const recall = () => {
    const url = new URL(location.href), known = S.state.switches.map((s) => s.key);
    const list = (key) => (url.searchParams.get(key) ?? "").split(",").filter(Boolean);
    if (url.searchParams.has("on") && known.length) S.on = list("on").filter((k) => known.includes(k));
    S.leftOut = list("without").filter((t) => S.state.trials.some((x) => x.name === t));
  };

  const place = (errors) => errors.find((e) => e.judged_on === "flight") || errors[0];
  const present = () => S.state.revisions.at(-1)?.errors ?? [];
  // errors, which kind they are, and what came with them
  const show = (errors, which, model) => {
    const e = place(errors), before = place(present());
    S.shown = { errors, which, model };
    if (!e) { at("which").textContent = which; return; }
    at("place").textContent = `Held-out error in ${e.judged_on}`;
    at("value").textContent = number(e.held_out_error) + " N";
    at("times").textContent = times(e.times_floor) + (e.at_floor ? ", at the floor" : e.signal === "unknown" ? "" : ", " + e.signal);
    at("times").className = "studio-times " + e.signal;
    const most = 1.04 * Math.max(e.held_out_error, before?.held_out_error ?? 0, e.noise_floor_ci95?.[1] ?? 0, e.noise_floor ?? 0);
    const part = (v) => (100 * Math.min(1, Math.max(0, v / most))).toFixed(2) + "%";
    const gauge = document.querySelector(".studio-gauge"), bar = (name) => gauge.querySelector("." + name);
    bar("error").style.width = part(e.held_out_error);
    bar("error").className = "error " + e.signal;
    bar("before").style.width = preview() && before ? part(before.held_out_error) : "0";
    bar("before").hidden = !preview();
    bar("floor").style.left = part(e.noise_floor ?? 0);
    bar("floor").hidden = !e.noise_floor;
    bar("band").hidden = !e.noise_floor_ci95;
    if (e.noise_floor_ci95) { bar("band").style.left = part(e.noise_floor_ci95[0]); bar("band").style.width = part(e.noise_floor_ci95[1] - e.noise_floor_ci95[0]); }
    at("which").replaceChildren(...prose(which));
    const other = errors.filter((x) => x !== e).map((x) => `in ${x.judged_on}: ${number(x.held_out_error)} N, ${times(x.times_floor)}`);
    const gone = which.startsWith("quick") && present().filter((x) => !errors.some((y) => y.judged_on === x.judged_on)).map((x) => `in ${x.judged_on}: with the exact number`);
    other.push(...(gone || []));
    if (preview() && before) other.unshift(`the present model: ${number(before.held_out_error)} N, ${times(before.times_floor)}`);
    at("other").textContent = other.join(" · ");
    at("live").textContent = `${which.replaceAll("`", "")}: ${number(e.held_out_error)} newtons, ${times(e.times_floor)}${e.at_floor ? ", at the floor" : ""}`;
    S.hears.forEach((hear) => hear());
  };

  // what to write into the pipeline file, so that what was tried holds for every command
  const lines = () => {
    const sections = {};
    for (const [path, value] of Object.entries(S.settings)) {
      const [section, ...rest] = path.split(".");
      (sections[section] ??= []).push(rest.length > 1 ? `${rest[0]}: {${rest.slice(1).join(".")}: ${value}}` : `${rest[0]}: ${value}`);
    }
    const out = Object.entries(sections).map(([section, list]) => `${section}: {${list.join(", ")}}`);
    if (S.leftOut.length) out.push(`trials: {exclude: [${S.leftOut.map((t) => `{trial: ${t}, reason: "…"}`).join(", ")}]}`);
    at("lines").replaceChildren(...(out.length ? [`To make it permanent, in ${S.state.pipeline}: `, ...out.flatMap((l) => [make("code", {}, l), " "])] : []));
  };

  const buttons = () => {
    lines();
    const some = preview();
    at("keep").disabled = !some || S.leftOut.length > 0 || changed() || same(S.on, S.state.model) || S.state.preparing;
    at("reset").disabled = !some;
    at("undo").disabled = S.state.revisions.length < 2;
    at("run").hidden = S.state.current;
    at("keep").title = S.leftOut.length > 0 || changed() ? "Effects can be kept; recordings and settings are changed in the pipeline file." : "";
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
    at("parameters").replaceChildren(moved.length ? table(["parameter of the body", "value", "change"], moved.slice(0, 8).map((b) => [b.name, Numbers.short(b.value) + " " + b.unit, (b.by > 0 ? "+" : "") + Numbers.short(b.by)])) : "");
  };

  const bars = (model) => {
    const size = (t) => t.flight ?? t.contact, most = Math.max(...(S.before?.trials ?? model.trials).map((t) => size(t) ?? 0), ...model.trials.map((t) => size(t) ?? 0));
    for (const t of model.trials) {
      const row = [...document.querySelectorAll(".studio-trial")].find((r) => r.dataset.trial === t.trial);
      if (!row) continue;
      const v = size(t);
      row.querySelector(".bar i").style.width = v ? (100 * v) / most + "%" : "0";
      row.querySelector(".size").textContent = v ? number(v) + " N" : "–";
    }
  };

  // the quick number at once, then the exact one when nothing changed for a moment
  const flip = async () => {
    const ticket = ++S.ticket, started = performance.now();
    clearTimeout(S.exactDue);
    remember();
    buttons();
    problem(null);
    if (S.state.preparing || !S.state.switches.length) return;
    if (!changed()) {
      try {
        const found = await ask("/api/model", { effects: S.on, left_out: S.leftOut });
        if (ticket !== S.ticket) return;
        if (!found.model) {
          at("which").textContent = `${found.because}: the exact number follows`;
          return exact(ticket);
        }
        if (!S.before && !preview()) S.before = found.model;
        const geometry = S.leftOut.length ? ", in the geometry of all recordings" : "";
        show(preview() ? found.model.errors : present().length ? present() : found.model.errors, preview() ? `quick: from stored rows${geometry}; the exact number follows` : "the present model", found.model);
        coefficients(found.model, false);
        bars(found.model);
        S.flipped = performance.now() - started;
        document.getElementById("studio").dataset.milliseconds = S.flipped.toFixed(1);
      } catch (e) {
        if (ticket === S.ticket) problem(e);
        return;
      }
    }
    if (preview()) S.exactDue = setTimeout(() => exact(ticket), changed() ? 0 : 450);
  };
  const exact = (ticket) => {
    const changes = { settings: S.settings, left_out: S.leftOut, taken_in: S.takenIn };
    ask("/api/job", { job: "exact", ticket, effects: S.on, changes }).catch(problem);
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
      const kind = S.state.model.includes(s.key) ? " held" : S.state.asked?.found.includes(s.key) ? " found" : "";
      const ratio = c && c.held_out_ratio !== null && !kind.includes("held") ? "leaves " + Math.round(100 * c.held_out_ratio) + " %" : "";
      const label = make("label", { class: "studio-switch" + kind }, box, make("span", { class: "name" }, s.title), make("span", { class: "ratio", title: "the ranking's own estimate of the error that this effect alone leaves" }, ratio), make("span", { class: "key" }, s.key));
      return make("li", {}, label);
    });
    at("list").replaceChildren(...rows);
    const asked = S.state.asked;
    const said = asked ? (asked.of_present_results ? "" : "From a discovery on other results; ask it again. ") + asked.words : "It was not asked yet which effect is missing.";
    at("verdict").replaceChildren(...prose(S.state.preparing ? "The switches are being prepared …" : said));
    at("ask").hidden = Boolean(asked?.of_present_results);
    if (S.state.problem) problem(S.state.problem);
  };

  const trials = () => {
    at("trials").replaceChildren(...S.state.trials.map((t) => {
      const box = make("input", { type: "checkbox" });
      box.checked = t.excluded ? S.takenIn.includes(t.name) : !S.leftOut.includes(t.name);
      box.onchange = () => {
        const list = t.excluded ? "takenIn" : "leftOut", add = t.excluded ? box.checked : !box.checked;
        S[list] = add ? [...S[list], t.name] : S[list].filter((n) => n !== t.name);
        flip();
      };
      const note = t.excluded ? ` (excluded: ${t.excluded})` : "";
      return make("li", {}, make("label", { class: "studio-trial", "data-trial": t.name }, box, make("span", { class: "name" }, t.name + note), make("span", { class: "bar" }, make("i", {})), make("span", { class: "size" }, "")));
    }));
  };

  const settings = () => {
    const field = (s) => {
      const input = make("input", { type: "number", step: "any", "aria-label": `${s.title}${s.unit ? ", " + s.unit : ""}`, name: s.path, value: String(S.settings[s.path] ?? s.value) });
      const row = make("div", { class: "studio-setting" }, make("span", {}, s.title), input, make("span", { class: "unit" }, s.unit), ...(s.note ? [make("span", { class: "note" }, s.note)] : []));
      const mark = () => row.classList.toggle("changed", s.path in S.settings);
      input.onchange = () => {
        const v = parseFloat(input.value);
        if (!Number.isFinite(v) || v === s.value) { delete S.settings[s.path]; input.value = String(s.value); } else S.settings[s.path] = v;
        mark();
        flip();
      };
      mark();
      return row;
    };
    const own = S.state.settings.filter((s) => !s.path.startsWith("ik.weights.")), markers = S.state.settings.filter((s) => s.path.startsWith("ik.weights."));
    const more = make("details", {}, make("summary", {}, "Weights of single markers"), ...markers.map(field));
    at("settings").replaceChildren(...own.map(field), ...(markers.length ? [more] : []));
    at("settings").onsubmit = (e) => e.preventDefault();
  };

  const work = (words, done, of, left) => {
    at("work").hidden = words === null;
    if (words === null) return;
    at("work-words").textContent = words + (left ? `, about ${left < 1.5 ? "1 s" : Math.round(left) + " s"} left` : "");
    at("progress").max = Math.max(1, of);
    at("progress").value = done;
  };

  const load = async () => {
    S.state = await ask("/api/state");
    S.on = [...S.state.model];
    recall();
    switches();
    trials();
    settings();
    buttons();
    if (!S.state.current && S.state.stale.length) problem({ problem: "The results are not up to date: " + S.state.stale.join("; ") + "." });
    if (present().length) show(present(), "the present model", null);
    if (!S.state.preparing && S.state.switches.length) {
      S.before = (await ask("/api/model", { effects: S.state.model, left_out: [] })).model;
      bars(S.before);
      coefficients(S.before, false);
      await flip();
    }
    work(S.state.busy.length ? S.state.busy[0] : null, 0, 1);
  };

  const JOBS = { prepare: "Preparing the switches", run: "Running", discover: "Looking for missing effects", exact: "Exact number", keep: "Keeping", undo: "Undoing" };
  const listen = () => {
    const from = new EventSource("/api/events?token=" + token);
    let lost = false;
    const on = (name, hear) => from.addEventListener(name, (e) => hear(JSON.parse(e.data)));
    on("progress", (p) => work(`${JOBS[p.job] ?? p.job}: ${p.words}, ${p.done} of ${p.of}`, p.done, p.of, p.seconds_left));
    on("ready", () => { work(null); if (S.state?.preparing || !S.state?.switches.length) load().catch(problem); });
    on("exact", (e) => {
      if (e.ticket !== S.ticket) return;
      work(null);
      show(e.model.errors, "exact: all stages, as `effect add` computes it", e.model);
      coefficients(e.model, true);
    });
    on("problem", (e) => { work(null); problem(e); });
    // results changed, perhaps from another tab: the whole page is read again
    on("changed", () => { const url = new URL(location.href); url.searchParams.delete("on"); history.replaceState(null, "", url); location.reload(); });
    from.onerror = async () => {
      lost = true;
      try { await ask("/api/state"); } catch (e) { problem(e); if (e.hint?.includes("printed")) from.close(); }
    };
    from.onopen = () => { if (lost) { lost = false; problem(null); load().catch(problem); } };
  };

  const job = (body) => { problem(null); work(JOBS[body.job] + " …", 0, 1); ask("/api/job", body).catch((e) => { work(null); problem(e); }); };
  at("keep").onclick = () => { clearTimeout(S.exactDue); job({ job: "keep", effects: S.on }); };
  at("undo").onclick = () => job({ job: "undo" });
  at("run").onclick = () => job({ job: "run" });
  at("discover").onclick = () => job({ job: "discover" });
  at("reset").onclick = () => {
    Object.assign(S, { on: [...S.state.model], leftOut: [], takenIn: [], settings: {} });
    switches();
    trials();
    settings();
    flip();
  };
  listen();
  load().catch(problem);
  return { S, ask, preview, number, times, place, present, hear: (f) => S.hears.push(f) };
})();
