// What a live page adds to the panel of switches: the program as its source, exact numbers,
// recordings, settings, keeping and undoing, and work in progress.
const Live = (() => {
  const { make } = Numbers;
  const { S, at, problem, number, flip, prose } = Studio;
  const token = new URLSearchParams(location.search).get("token");
  Object.assign(S, { leftOut: [], takenIn: [], cuts: [], settings: {}, exactDue: 0 });
  const changed = () => Object.keys(S.settings).length > 0 || S.takenIn.length > 0;
  Studio.others.push(() => S.leftOut.length > 0 || changed());
  Studio.recorded.without = (url) => Studio.put(url, "without", S.leftOut, []);

  const ask = async (path, body) => {
    const how = body === undefined ? {} : { method: "POST", body: JSON.stringify(body), headers: { "content-type": "application/json" } };
    let answer;
    try {
      answer = await fetch(path, { ...how, headers: { ...how.headers, "x-aloft-token": token } });
    } catch {
      throw { problem: "No connection to the server.", hint: "it has ended; start `aloft studio` again and open the address that it prints" };
    }
    if (answer.status === 403) throw { problem: "The server was started again, or this address is not its own.", hint: "open the address that `aloft studio` printed last" };
    const found = await answer.json();
    if (!answer.ok) throw found;
    return found;
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

  Studio.hooks.changed.push(() => {
    lines();
    at("keep").disabled = !Studio.preview() || S.leftOut.length > 0 || S.cuts.length > 0 || changed() || Studio.same(S.on, S.state.model) || S.state.preparing;
    at("undo").disabled = S.state.revisions.length < 2;
    at("run").hidden = S.state.current;
    at("keep").title = S.leftOut.length > 0 || S.cuts.length > 0 || changed() ? "Effects can be kept; recordings and settings are changed in the pipeline file." : "";
  });

  Studio.hooks.flipped.push((model) => {
    const size = (t) => t.flight ?? t.contact, most = Math.max(...(S.before?.trials ?? model.trials).map((t) => size(t) ?? 0), ...model.trials.map((t) => size(t) ?? 0));
    const rows = new Map([...document.querySelectorAll(".studio-trial")].map((r) => [r.dataset.trial, r]));
    for (const t of model.trials) {
      const row = rows.get(t.trial);
      if (!row) continue;
      const v = size(t);
      row.querySelector(".bar i").style.width = v ? (100 * v) / most + "%" : "0";
      row.querySelector(".size").textContent = v ? number(v) + " N" : "–";
    }
  });

  // the quick number at once, then the exact one when nothing changed for a moment
  S.source = {
    model: async (on) => {
      clearTimeout(S.exactDue);
      if (changed()) return null;
      const found = await ask("/api/model", { effects: on, left_out: { trials: S.leftOut, stretches: S.cuts } });
      return { ...found, words: S.leftOut.length || S.cuts.length ? ", in the geometry of all recordings" : "" };
    },
    plain: (on) => ask("/api/model", { effects: on }),
    next: () => (S.cuts.length ? "stretches are left out of the quick number only" : "the exact number follows"),
    later: "with the exact number",
    after: (ticket, found) => {
      if (Studio.preview() && !S.cuts.length) S.exactDue = setTimeout(() => exact(ticket), found?.model ? 450 : 0);
    },
  };
  const exact = (ticket) => {
    const changes = { settings: S.settings, left_out: S.leftOut, taken_in: S.takenIn };
    ask("/api/job", { job: "exact", ticket, effects: S.on, changes }).catch(problem);
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

  // what a discovery knows before it ends; a new piece of work begins with none
  const soFar = (words) => at("so-far").append(make("li", {}, ...Studio.prose("So far: " + words)));
  const work = (words, done, of, left) => {
    at("work").hidden = words === null;
    if (words === null) at("so-far").replaceChildren();
    if (words === null) return;
    at("work-words").textContent = words + (left ? `, about ${left < 1.5 ? "1 s" : Math.round(left) + " s"} left` : "");
    at("progress").max = Math.max(1, of);
    at("progress").value = done;
  };

  Studio.hooks.state.push(() => {
    S.leftOut = Studio.list("without").filter((t) => S.state.trials.some((x) => x.name === t));
    trials();
    settings();
    at("ask").hidden = S.state.preparing || Boolean(S.state.asked?.of_present_results);
    if (!S.state.current && S.state.stale.length) problem({ problem: "The results are not up to date: " + S.state.stale.join("; ") + "." });
  });
  Studio.hooks.reset = () => {
    Object.assign(S, { leftOut: [], takenIn: [], settings: {} });
    trials();
    settings();
  };
  const load = async () => {
    await Studio.begin(await ask("/api/state"));
    work(S.state.busy.length ? S.state.busy[0] : null, 0, 1);
  };

  const JOBS = { prepare: "Preparing the switches", run: "Running", discover: "Looking for missing effects", exact: "Exact number", keep: "Keeping", undo: "Undoing" };
  const listen = () => {
    const from = new EventSource("/api/events?token=" + token);
    let lost = false;
    const on = (name, hear) => from.addEventListener(name, (e) => hear(JSON.parse(e.data)));
    on("progress", (p) => work(`${JOBS[p.job] ?? p.job}: ${p.words}, ${p.done} of ${p.of}`, p.done, p.of, p.seconds_left));
    on("so_far", (p) => soFar(p.words));
    on("ready", () => { work(null); if (S.state?.preparing || !S.state?.switches.length) load().catch(problem); });
    on("exact", (e) => {
      if (e.ticket !== S.ticket) return;
      work(null);
      Studio.show(e.model.errors, "exact: all stages, as `effect add` computes it", e.model);
      Studio.coefficients(e.model, true);
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
  listen();
  load().catch(problem);
  return { ask, job, work };
})();
