// Player: a recording in three dimensions on a canvas. Drag or arrow keys turn, wheel or + and − zoom, space plays.
const Player = (() => {
  const PLAYERS = [];
  const make = (tag, attributes = {}, ...children) => {
    const el = document.createElement(tag);
    for (const [k, v] of Object.entries(attributes)) el.setAttribute(k, v);
    el.append(...children);
    return el;
  };
  const read = (figure) => {
    const d = JSON.parse(figure.querySelector("script").textContent);
    for (const key of ["t", "flight", "joints", "measured", "modelled"]) d[key] = Numbers.list(d[key]);
    for (const a of d.arrows) a.at = Numbers.list(a.at);
    return d;
  };

  const build = (el) => {
    const d = read(el.closest("figure"));
    const n = d.t.length, nm = d.labels.length, nj = d.n_joints;
    const state = { frame: Math.min(d.first, n - 1), playing: false, speed: 0.5, yaw: -0.9, pitch: 0.16, zoom: 1, clock: 0,
      show: { model: true, "model markers": true, "measured markers": true, forces: true } };
    // the middle and the size of what moves
    const low = [1e9, 1e9, 0], high = [-1e9, -1e9, 0.5];
    const grow = (list) => { for (let i = 0; i < list.length; i++) if (Number.isFinite(list[i])) { const k = i % 3; low[k] = Math.min(low[k], list[i]); high[k] = Math.max(high[k], list[i]); } };
    grow(d.joints); grow(d.measured);
    const middle = low.map((v, k) => (v + high[k]) / 2);
    const radius = Math.max(0.3, 0.5 * Math.hypot(...low.map((v, k) => high[k] - v)));
    const tall = 0.5 * (high[2] - low[2]), wide = 0.5 * Math.hypot(high[0] - low[0], high[1] - low[1]);

    // a small body that travels far is followed
    const centres = d.t.map((_, f) => {
      const sum = [0, 0, 0]; let count = 0;
      for (let m = 0; m < nm; m++) { const i = 3 * (f * nm + m); if (Number.isFinite(d.modelled[i])) { count++; for (let k = 0; k < 3; k++) sum[k] += d.modelled[i + k]; } }
      return count ? sum.map((v) => v / count) : middle;
    });
    let size = 0.1;
    d.t.forEach((_, f) => { for (let m = 0; m < nm; m++) { const i = 3 * (f * nm + m), r = Math.hypot(...[0, 1, 2].map((k) => d.modelled[i + k] - centres[f][k])); if (r > size) size = r; } });
    state.follow = radius > 2.2 * size;

    const canvas = make("canvas", { tabindex: "0", role: "img", "aria-label": el.getAttribute("aria-label") + " Space plays; arrow keys turn; comma and full stop step." });
    const play = make("button", { type: "button", "aria-label": "Play" }, "▶ Play");
    const back = make("button", { type: "button", "aria-label": "One frame back" }, "◀");
    const on = make("button", { type: "button", "aria-label": "One frame on" }, "▶");
    const slider = make("input", { type: "range", min: 0, max: n - 1, value: state.frame, "aria-label": "Time" });
    const time = make("output", { "aria-live": "off" });
    const speed = make("select", { "aria-label": "Speed" });
    for (const [v, words] of [[1, "real time"], [0.5, "half speed"], [0.25, "quarter"], [0.1, "tenth"]]) speed.append(make("option", v === 0.5 ? { value: v, selected: "" } : { value: v }, words));
    const views = [["3-D", -0.9, 0.16], ["side", -Math.PI / 2, 0], ["front", 0, 0], ["top", -Math.PI / 2, Math.PI / 2 - 0.001]].map(([name, yaw, pitch]) => {
      const b = make("button", { type: "button", "aria-label": "View: " + name }, name);
      b.onclick = () => { Object.assign(state, { yaw, pitch, zoom: 1 }); render(); };
      return b;
    });
    const switches = Object.keys(state.show).map((name) => {
      const box = make("input", { type: "checkbox", checked: "" });
      box.onchange = () => { state.show[name] = box.checked; render(); };
      return make("label", { class: "switch " + name.replace(" ", "-") }, box, make("i", { "aria-hidden": "true" }), name);
    });
    const box = make("input", { type: "checkbox" });
    box.checked = state.follow;
    box.onchange = () => { state.follow = box.checked; render(); };
    switches.push(make("label", { class: "switch" }, box, "follow"));
    const marks = make("div", { class: "flights", "aria-hidden": "true" });
    for (let i = 0, from = -1; i <= n; i++) {
      const up = i < n && d.flight[i] > 0.5;
      if (up && from < 0) from = i;
      if (!up && from >= 0) { marks.append(make("i", { style: `left:${(100 * from) / (n - 1)}%;width:${(100 * (i - 1 - from)) / (n - 1)}%`, title: "flight" })); from = -1; }
    }
    const hint = make("p", { class: "hint" });
    el.replaceChildren(canvas,
      make("div", { class: "controls" }, play, back, on, make("div", { class: "track" }, marks, slider), time, speed),
      make("div", { class: "controls" }, ...switches, make("span", { class: "gap" }), ...views), hint);

    const point = (list, i) => [list[3 * i], list[3 * i + 1], list[3 * i + 2]];
    let view = null;
    const project = (p) => {
      const x = p[0] - view.at[0], y = p[1] - view.at[1], z = p[2] - view.at[2];
      const u = -x * view.sy + y * view.cy, w = x * view.cy + y * view.sy;
      const depth = w * view.cp + z * view.sp, v = z * view.cp - w * view.sp;
      const s = view.scale / Math.max(0.2, 1 - depth / (6 * radius));
      return [view.cx + u * s, view.cyy - v * s, depth];
    };
    const stroke = (g, a, b, colour, width) => {
      const p = project(a), q = project(b);
      if (![...p, ...q].every(Number.isFinite)) return;
      g.strokeStyle = colour; g.lineWidth = width;
      g.beginPath(); g.moveTo(p[0], p[1]); g.lineTo(q[0], q[1]); g.stroke();
    };
    const arrow = (g, a, b, colour) => {
      const p = project(a), q = project(b), length = Math.hypot(q[0] - p[0], q[1] - p[1]);
      if (!Number.isFinite(length) || length < 2) return;
      const ux = (q[0] - p[0]) / length, uy = (q[1] - p[1]) / length, h = Math.min(11, length);
      g.strokeStyle = g.fillStyle = colour; g.lineWidth = 3;
      g.beginPath(); g.moveTo(p[0], p[1]); g.lineTo(q[0] - ux * h * 0.8, q[1] - uy * h * 0.8); g.stroke();
      g.beginPath(); g.moveTo(q[0], q[1]); g.lineTo(q[0] - ux * h - uy * h * 0.42, q[1] - uy * h + ux * h * 0.42);
      g.lineTo(q[0] - ux * h + uy * h * 0.42, q[1] - uy * h - ux * h * 0.42); g.fill();
    };
    const floor = (g) => {
      const size = Math.max(high[0] - low[0], high[1] - low[1]) > 4 ? 1 : 0.5;
      const [x0, x1, y0, y1] = [Math.floor(low[0] / size - 1) * size, Math.ceil(high[0] / size + 1) * size, Math.floor(low[1] / size - 1) * size, Math.ceil(high[1] / size + 1) * size];
      const grid = Numbers.colour("grid");
      for (let x = x0; x <= x1 + 1e-6; x += size) stroke(g, [x, y0, 0], [x, y1, 0], grid, 1);
      for (let y = y0; y <= y1 + 1e-6; y += size) stroke(g, [x0, y, 0], [x1, y, 0], grid, 1);
      g.fillStyle = Numbers.colour("shade-solid");
      for (const plate of d.plates) {
        g.beginPath();
        plate.map(project).forEach((p, i) => (i ? g.lineTo(p[0], p[1]) : g.moveTo(p[0], p[1])));
        g.closePath(); g.fill(); g.strokeStyle = Numbers.colour("line"); g.lineWidth = 1; g.stroke();
      }
      const dim = Numbers.colour("dim");
      g.font = "11px system-ui, sans-serif"; g.fillStyle = dim;
      [[0.3, 0, 0, "x"], [0, 0.3, 0, "y"], [0, 0, 0.3, "z"]].forEach(([x, y, z, name]) => {
        const o = [x0, y0, 0], tip = [x0 + x, y0 + y, z];
        arrow(g, o, tip, dim);
        const q = project([x0 + 1.25 * x, y0 + 1.25 * y, 1.25 * z]);
        g.fillStyle = dim; g.fillText(name, q[0] - 3, q[1] + 3);
      });
    };
    let places = [];
    const render = () => {
      const ratio = window.devicePixelRatio || 1, width = el.clientWidth, height = 430;
      if (!width) return;
      if (canvas.width !== Math.round(width * ratio)) { canvas.width = Math.round(width * ratio); canvas.height = Math.round(height * ratio); canvas.style.height = height + "px"; }
      const g = canvas.getContext("2d");
      g.setTransform(ratio, 0, 0, ratio, 0, 0);
      g.clearRect(0, 0, width, height);
      view = { sy: Math.sin(state.yaw), cy: Math.cos(state.yaw), sp: Math.sin(state.pitch), cp: Math.cos(state.pitch), cx: width / 2, cyy: height / 2, at: state.follow ? centres[state.frame] : middle,
        scale: state.zoom * (state.follow ? (0.42 * Math.min(width, height)) / size : Math.min((0.44 * height) / (tall + 0.22 * wide), (0.44 * width) / (wide + 0.1))) };
      const f = state.frame, ink = Numbers.colour("ink"), c0 = Numbers.colour("c0"), c1 = Numbers.colour("c1"), arrowColours = [Numbers.colour("c2"), Numbers.colour("c3")];
      floor(g);
      g.lineCap = "round";
      if (state.show.model) {
        for (const [i, j] of d.bones) stroke(g, point(d.joints, f * nj + i), point(d.joints, f * nj + j), Numbers.colour("bone"), 5);
      }
      places = [];
      for (let m = 0; m < nm; m++) {
        const a = point(d.measured, f * nm + m), b = point(d.modelled, f * nm + m);
        const p = project(a), q = project(b);
        if (state.show["measured markers"] && state.show["model markers"]) stroke(g, a, b, c1, 1.5);
        if (state.show["model markers"] && Number.isFinite(q[0])) { g.strokeStyle = c0; g.lineWidth = 1.4; g.beginPath(); g.arc(q[0], q[1], 3.6, 0, 7); g.stroke(); }
        if (state.show["measured markers"] && Number.isFinite(p[0])) { g.fillStyle = c1; g.beginPath(); g.arc(p[0], p[1], 2.3, 0, 7); g.fill(); }
        places.push({ at: Number.isFinite(p[0]) ? p : q, m, gap: Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]) });
      }
      if (state.show.forces) {
        d.arrows.forEach((kind, k) => { for (let i = 0; i < kind.n; i++) { const at = 2 * (f * kind.n + i); arrow(g, point(kind.at, at), point(kind.at, at + 1), arrowColours[k % 2]); } });
      }
      // legend of the arrows
      g.font = "12px system-ui, sans-serif";
      let line = 18;
      if (state.show.forces) d.arrows.forEach((kind, k) => { if (kind.n) { g.fillStyle = arrowColours[k % 2]; g.fillRect(12, line - 5, 16, 3); g.fillStyle = ink; g.fillText(kind.name, 34, line); line += 17; } });
      if (d.flight[f] > 0.5) { g.font = "600 13px system-ui, sans-serif"; g.fillStyle = ink; g.textAlign = "right"; g.fillText("in flight: no external force", width - 12, 20); g.textAlign = "left"; }
      slider.value = f;
      time.textContent = d.t[f].toFixed(2) + " s";
      slider.setAttribute("aria-valuetext", d.t[f].toFixed(2) + " seconds" + (d.flight[f] > 0.5 ? ", in flight" : ""));
    };
    const go = (frame) => { state.frame = (frame + n) % n; render(); };
    const tick = (now) => {
      if (!state.playing) return;
      const due = d.t[state.frame] + ((now - state.clock) / 1000) * state.speed;
      if (el.clientWidth && due > d.t[Math.min(state.frame + 1, n - 1)]) {
        let f = state.frame;
        while (f < n - 1 && d.t[f + 1] <= due) f++;
        state.clock = now;
        go(f >= n - 1 ? 0 : f);
      }
      requestAnimationFrame(tick);
    };
    const toggle = () => {
      state.playing = !state.playing;
      play.textContent = state.playing ? "❚❚ Pause" : "▶ Play";
      play.setAttribute("aria-label", state.playing ? "Pause" : "Play");
      state.clock = performance.now();
      if (state.playing) requestAnimationFrame(tick);
    };
    play.onclick = toggle;
    back.onclick = () => go(state.frame - 1);
    on.onclick = () => go(state.frame + 1);
    slider.oninput = () => go(+slider.value);
    speed.onchange = () => { state.speed = +speed.value; };
    let grip = null;
    canvas.onpointerdown = (e) => { grip = [e.clientX, e.clientY]; canvas.setPointerCapture(e.pointerId); };
    canvas.onpointerup = () => { grip = null; };
    canvas.onpointermove = (e) => {
      if (grip) {
        state.yaw -= (e.clientX - grip[0]) * 0.008;
        state.pitch = Math.max(-0.2, Math.min(Math.PI / 2, state.pitch + (e.clientY - grip[1]) * 0.008));
        grip = [e.clientX, e.clientY];
        return render();
      }
      const box = canvas.getBoundingClientRect(), x = e.clientX - box.left, y = e.clientY - box.top;
      const near = places.map((p) => [Math.hypot(p.at[0] - x, p.at[1] - y), p]).filter((p) => p[0] < 12).sort((a, b) => a[0] - b[0])[0];
      hint.textContent = near ? `${d.labels[near[1].m]}: ` + (Number.isFinite(near[1].gap) ? `${(near[1].gap * 1000).toFixed(1)} mm between measured and model` : "not seen in this frame") : words;
    };
    canvas.addEventListener("wheel", (e) => { if (!e.ctrlKey && document.activeElement !== canvas) return; e.preventDefault(); state.zoom *= Math.exp(-e.deltaY * 0.001); render(); }, { passive: false });
    canvas.onkeydown = (e) => {
      const turn = { ArrowLeft: [0.1, 0], ArrowRight: [-0.1, 0], ArrowUp: [0, 0.08], ArrowDown: [0, -0.08] }[e.key];
      if (turn) { state.yaw += turn[0]; state.pitch = Math.max(-0.2, Math.min(Math.PI / 2, state.pitch + turn[1])); render(); }
      else if (e.key === " ") toggle();
      else if (e.key === ",") go(state.frame - 1);
      else if (e.key === ".") go(state.frame + 1);
      else if (e.key === "+" || e.key === "=") { state.zoom *= 1.15; render(); }
      else if (e.key === "-") { state.zoom /= 1.15; render(); }
      else return;
      e.preventDefault();
    };
    const words = `Point at a marker for its name and error. Drag, or arrow keys, to turn; click, then wheel or + and −, to zoom; space to play. Arrows: 1 m for ${d.newtons_per_m} N.`;
    hint.textContent = words;
    new ResizeObserver(render).observe(el);
    PLAYERS.push(render);
    render();
  };
  const rows = (figure) => {
    const d = read(figure), out = [["time, s", "in flight", "kind", "name", "x, m", "y, m", "z, m"]];
    const put = (f, kind, names, list) => names.forEach((name, k) => {
      const i = 3 * (f * names.length + k);
      if (Number.isFinite(list[i])) out.push([d.t[f], d.flight[f], kind, name, list[i], list[i + 1], list[i + 2]]);
    });
    for (let f = 0; f < d.t.length; f++) {
      put(f, "measured marker", d.labels, d.measured);
      put(f, "model marker", d.labels, d.modelled);
      put(f, "model point", d.joint_names, d.joints);
      for (const a of d.arrows) put(f, `arrow, 1 m for ${d.newtons_per_m} N`, Array.from({ length: 2 * a.n }, (_, k) => `${a.name} ${1 + (k >> 1)}: ${k % 2 ? "tip" : "foot"}`), a.at);
    }
    return out;
  };
  return { draw: build, rows, renderAll: () => PLAYERS.forEach((r) => r()) };
})();
