// Player: time, view, switches, keyboard. Drawn by `player_gl.js`, or by `player_canvas.js` where
// the browser has no WebGL.
const Player = (() => {
  const PLAYERS = new Set(), OPEN = new Map();
  const { make } = Numbers;
  const PARTS = [["segments", "segments"], ["markers", "markers"], ["errors", "marker errors"], ["centre", "centre of mass"], ["forces", "forces"], ["effects", "effects"], ["ghost", "without effects"]];
  const KEYS = [["space", "play, pause"], ["← →", "one frame"], ["[ ]", "previous, next flight"], ["Home End", "first, last frame"], ["shift + arrows", "turn"], ["+ −", "zoom"], ["f", "follow the body"], ["1 2 3 4", "3-D, side, front, top"]];
  const VIEWS = [["3-D", -0.9, 0.16], ["side", -Math.PI / 2, 0], ["front", 0, 0], ["top", -Math.PI / 2, Math.PI / 2 - 0.001]];
  const turned = (q, v) => {
    const [x, y, z, w] = q, u = [y * v[2] - z * v[1] + w * v[0], z * v[0] - x * v[2] + w * v[1], x * v[1] - y * v[0] + w * v[2]];
    return [v[0] + 2 * (y * u[2] - z * u[1]), v[1] + 2 * (z * u[0] - x * u[2]), v[2] + 2 * (x * u[1] - y * u[0])];
  };

  const build = (el) => {
    const scene = PlayerScene.open(el.closest("figure")), { d, n, bounds } = scene;
    const effects = d.arrows.some((a) => a.of === "effect" || a.of === "couple") || d.masses.length > 0;
    const has = { effects, ghost: Boolean(d.ghost), forces: d.arrows.some((a) => a.of === "measured" || a.of === "predicted") };
    const parts = PARTS.filter(([key]) => has[key] ?? true);
    const state = { frame: Math.min(d.first, n - 1), playing: false, speed: 0.5, yaw: -0.9, pitch: 0.16, zoom: 1, clock: 0, scale: 1, follow: bounds.radius > 2.2 * bounds.reach, show: Object.fromEntries(PARTS.map(([k]) => [k, true])) };
    const label = el.getAttribute("aria-label");
    const canvas = make("canvas", { tabindex: "0", role: "application", "aria-label": label + " Space plays, arrow keys step, shift and arrow keys turn." });
    const play = make("button", { type: "button", class: "play", "aria-label": "Play" }, "▶");
    const slider = make("input", { type: "range", min: 0, max: n - 1, value: state.frame, "aria-label": "Time" });
    const time = make("output", { "aria-live": "off" });
    const speed = make("select", { "aria-label": "Speed" });
    for (const [v, words] of [[1, "real time"], [0.5, "half"], [0.25, "quarter"], [0.1, "tenth"]]) speed.append(make("option", v === 0.5 ? { value: v, selected: "" } : { value: v }, words));
    const force = make("select", { "aria-label": "Length of arrows" });
    for (const v of [1, 3, 10]) force.append(make("option", { value: v }, `arrows × ${v}`));
    const look = (i) => { Object.assign(state, { yaw: VIEWS[i][1], pitch: VIEWS[i][2], zoom: 1 }); render(); };
    const views = VIEWS.map(([name], i) => { const b = make("button", { type: "button", "aria-label": "View: " + name }, name); b.onclick = () => look(i); return b; });
    const box = (words, kind, on, change) => {
      const input = make("input", { type: "checkbox" });
      input.checked = on;
      input.onchange = () => { change(input.checked); render(); };
      return make("label", { class: "switch " + kind }, input, make("i", { "aria-hidden": "true" }), words);
    };
    const switches = parts.map(([key, words]) => box(words, key, true, (v) => { state.show[key] = v; }));
    const follow = box("follow", "follow", state.follow, (v) => { state.follow = v; });
    const marks = make("div", { class: "flights", "aria-hidden": "true" });
    for (const [a, b] of scene.flights) marks.append(make("i", { style: `left:${(100 * a) / Math.max(1, n - 1)}%;width:${(100 * (b - a)) / Math.max(1, n - 1)}%`, title: "flight" }));
    const told = make("p", { class: "reading" }), hint = make("p", { class: "hint" });
    const keys = make("details", { class: "keys" }, make("summary", {}, "Keys"), make("dl", {}, ...KEYS.flatMap(([k, words]) => [make("dt", {}, k), make("dd", {}, words)])));
    const hot = d.segments.some((s) => s.heat !== null && PlayerScene.shade(s.heat) > 0), rated = d.segments.some((s) => s.heat !== null);
    const heat = rated ? make("p", { class: "shades" }, "error explainable by a segment: at the floor ", make("span", {}, ...Array.from({ length: 9 }, (_, k) => make("i", { class: k ? "h" + k : "body" }))), " 16 times the floor" + (hot ? "" : " (no single segment could carry it)")) : "";
    el.replaceChildren(told, canvas,
      make("div", { class: "controls" }, play, make("div", { class: "track" }, marks, slider), time, speed),
      make("div", { class: "controls" }, ...switches, follow),
      make("div", { class: "controls" }, ...views, force, keys), heat, hint);
    el.style.minHeight = "";

    // perspective: `eye` at a distance of six radii, so that one metre in the middle is
    // `view.metre` pixels
    let view = null, size = [canvas.clientWidth, canvas.clientHeight];
    const look_at = () => {
      const [width, height] = size;
      const c = state.follow ? scene.com(state.frame) : bounds.middle, at = c.every(Number.isFinite) ? c : bounds.middle;
      const metre = state.zoom * (state.follow ? (0.4 * Math.min(width, height)) / bounds.reach : Math.min((0.45 * height) / (bounds.tall + 0.2 * bounds.wide), (0.46 * width) / (bounds.wide + 0.1)));
      const [sy, cy, sp, cp] = [Math.sin(state.yaw), Math.cos(state.yaw), Math.sin(state.pitch), Math.cos(state.pitch)];
      const distance = 6 * (state.follow ? bounds.reach * 1.5 : bounds.radius), toward = [cy * cp, sy * cp, sp];
      view = { width, height, ratio: Math.min(2, devicePixelRatio || 1), at, metre, distance, sy, cy, sp, cp, eye: at.map((v, k) => v + toward[k] * distance), angle: (2 * Math.atan(height / 2 / (metre * distance)) * 180) / Math.PI };
    };
    const project = (p) => {
      const [x, y, z] = p.map((v, k) => v - view.at[k]);
      const u = -x * view.sy + y * view.cy, w = x * view.cy + y * view.sy;
      const depth = w * view.cp + z * view.sp, v = z * view.cp - w * view.sp, s = view.metre / Math.max(0.05, 1 - depth / view.distance);
      return [view.width / 2 + u * s, view.height / 2 - v * s, depth, s];
    };
    const reading = (f) => {
      const parts = [d.flight[f] > 0.5 ? "in flight" : "on the ground or held"];
      for (const a of scene.acting(f)) {
        if (a.of === "couple") continue;
        const zero = a.of === "measured" && a.size === null && d.flight[f] > 0.5;
        if (a.size !== null || zero) parts.push(`${a.name}${a.suspected ? "?" : ""} ${Numbers.short(zero ? 0 : a.size)} N`);
      }
      return parts.join(" · ");
    };
    const render = () => {
      const [width, height] = size;
      if (!width || !height) return;
      look_at();
      const w = Math.round(width * view.ratio), h = Math.round(height * view.ratio);
      if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; }
      const colour = Numbers.colour, g = canvas.getContext("2d"), f = state.frame;
      g.setTransform(view.ratio, 0, 0, view.ratio, 0, 0);
      g.clearRect(0, 0, width, height);
      const frame = scene.frame(f, state.show, state.scale);
      el.dataset.with = PlayerGl.draw(g, frame, view, colour) ? "webgl" : PlayerCanvas.draw(g, frame, view, colour, project, turned) && "canvas";
      // words on top
      const taken = [];
      for (const l of frame.labels) {
        let [x, y] = project(l.at);
        if (!Number.isFinite(x)) continue;
        g.font = l.keep ? "600 12px system-ui, sans-serif" : "11px system-ui, sans-serif";
        const wide = g.measureText(l.text).width;
        if (l.keep) { x = Math.max(6, Math.min(width - wide - 6, x + 6)); y = Math.max(16, Math.min(height - 30, y)); while (taken.some((t) => Math.abs(t[0] - x) < wide && Math.abs(t[1] - y) < 14)) y += 15; taken.push([x, y]); }
        g.strokeStyle = colour("ground"); g.lineWidth = 3; g.lineJoin = "round";
        g.strokeText(l.text, x, y);
        g.fillStyle = colour(l.colour);
        g.fillText(l.text, x, y);
      }
      slider.value = f;
      time.textContent = d.t[f].toFixed(2) + " s";
      told.textContent = reading(f);
      slider.setAttribute("aria-valuetext", d.t[f].toFixed(2) + " seconds, " + reading(f));
    };
    const go = (frame, quiet) => {
      state.frame = Math.max(0, Math.min(n - 1, frame));
      if (!quiet) Time.set(d.recording, d.t[state.frame], el);
      render();
    };
    const tick = (now) => {
      if (!state.playing || !el.isConnected) return;
      const due = d.t[state.frame] + ((now - state.clock) / 1000) * state.speed;
      if (size[0] && due > d.t[Math.min(state.frame + 1, n - 1)]) {
        let f = state.frame;
        while (f < n - 1 && d.t[f + 1] <= due) f++;
        state.clock = now;
        go(f >= n - 1 ? 0 : f);
      }
      requestAnimationFrame(tick);
    };
    const toggle = () => {
      state.playing = !state.playing;
      play.textContent = state.playing ? "❚❚" : "▶";
      play.setAttribute("aria-label", state.playing ? "Pause" : "Play");
      state.clock = performance.now();
      if (state.playing) requestAnimationFrame(tick);
    };
    play.onclick = toggle;
    slider.oninput = () => go(+slider.value);
    speed.onchange = () => { state.speed = +speed.value; };
    force.onchange = () => { state.scale = +force.value; render(); };
    let grip = null;
    const tilt = (yaw, pitch) => { state.yaw += yaw; state.pitch = Math.max(-0.2, Math.min(Math.PI / 2 - 0.001, state.pitch + pitch)); render(); };
    canvas.onpointerdown = (e) => { grip = [e.clientX, e.clientY]; canvas.setPointerCapture(e.pointerId); };
    canvas.onpointerup = canvas.onpointercancel = () => { grip = null; };
    canvas.onpointermove = (e) => {
      if (!view) return;
      if (grip) { const [x, y] = grip; grip = [e.clientX, e.clientY]; return tilt(-(e.clientX - x) * 0.008, (e.clientY - y) * 0.008); }
      const box = canvas.getBoundingClientRect(), x = e.clientX - box.left, y = e.clientY - box.top;
      const places = d.markers.map((m, i) => { const f = state.frame, seen = scene.measured(f, i), there = scene.marker(f, m); return { at: project(Number.isFinite(seen[0]) ? seen : there), name: m.name, gap: Math.hypot(...seen.map((v, k) => v - there[k])) }; });
      const near = places.map((p) => [Math.hypot(p.at[0] - x, p.at[1] - y), p]).filter((p) => p[0] < 12).sort((a, b) => a[0] - b[0])[0];
      hint.textContent = near ? `${near[1].name}: ` + (Number.isFinite(near[1].gap) ? `${(near[1].gap * 1000).toFixed(1)} mm between measured and model` : "not seen in this frame") : words;
    };
    canvas.addEventListener("wheel", (e) => { if (!e.ctrlKey && document.activeElement !== canvas) return; e.preventDefault(); state.zoom *= Math.exp(-e.deltaY * 0.001); render(); }, { passive: false });
    const flight = (by) => {
      const starts = scene.flights.map(([a, b]) => (a + b) >> 1), f = by > 0 ? starts.find((s) => s > state.frame) : starts.filter((s) => s < state.frame).pop();
      if (f !== undefined) go(f);
    };
    canvas.onkeydown = (e) => {
      if (e.ctrlKey || e.metaKey || e.altKey) return;
      const turns = { ArrowLeft: [0.1, 0], ArrowRight: [-0.1, 0], ArrowUp: [0, 0.08], ArrowDown: [0, -0.08] }[e.key];
      const acts = { " ": toggle, ArrowLeft: () => go(state.frame - 1), ArrowRight: () => go(state.frame + 1), Home: () => go(0), End: () => go(n - 1), "[": () => flight(-1), "]": () => flight(1),
        "+": () => { state.zoom *= 1.15; render(); }, "=": () => { state.zoom *= 1.15; render(); }, "-": () => { state.zoom /= 1.15; render(); }, f: () => follow.querySelector("input").click(), 1: () => look(0), 2: () => look(1), 3: () => look(2), 4: () => look(3) };
      if (e.shiftKey && turns) tilt(...turns);
      else if (acts[e.key]) acts[e.key]();
      else return;
      e.preventDefault();
    };
    slider.onkeydown = (e) => { if (e.key === " ") { toggle(); e.preventDefault(); } };
    const per = d.newtons_per_m, unplaced = d.unplaced.length ? ` In the model without a place: ${d.unplaced.join(", ")}.` : "";
    const words = (has.forces || has.effects ? `Arrows: 1 m for ${Numbers.short(per[0])} N` + (per[1] !== per[0] && scene.flights.length ? ` on the ground, ${Numbers.short(per[1])} N in flight` : "") + ". " : "") + "Drag to turn; click, then wheel to zoom; point at a marker for its error." + unplaced;
    hint.textContent = words;
    new ResizeObserver(() => { size = [canvas.clientWidth, canvas.clientHeight]; render(); }).observe(canvas);
    PLAYERS.add(render);
    OPEN.set(el, { scene, render });
    Time.on(d.recording, el, (seconds) => {
      let k = 0, high = n - 1;
      while (high - k > 1) { const m = (k + high) >> 1; if (d.t[m] <= seconds) k = m; else high = m; }
      go(Math.abs(d.t[high] - seconds) < Math.abs(d.t[k] - seconds) ? high : k, true);
    });
    render();
  };
  return { draw: build, rows: PlayerScene.rows, of: (el) => OPEN.get(el), renderAll: () => PLAYERS.forEach((r) => r()) };
})();
