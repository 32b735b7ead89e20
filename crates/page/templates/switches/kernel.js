// The model with any choice of effects, computed in the page. `switch_kernel.rs` and `rotated.rs`
// say what the numbers are; a test compares what is computed here with what the program computes.
const Kernel = (() => {
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  // a packed matrix as a list of columns (`pack::matrix`)
  const matrix = (m) => {
    const view = new DataView(bytes(m.b).buffer), out = [];
    // an integer of four or five bytes
    const whole = (at) => (m.n === 4 ? view.getInt32(at, true) : view.getUint32(at, true) + view.getInt8(at + 4) * 4294967296);
    let at = 0;
    for (let j = 0; j < m.c; j++) {
      const column = new Float64Array(m.r), filled = m.u ? Math.min(m.r, j + 1) : m.r, half = Math.trunc(m.e[j] / 2);
      for (let i = 0; i < filled; i++, at += m.n) column[i] = whole(at) * 2 ** half * 2 ** (m.e[j] - half);
      out.push(column);
    }
    return out;
  };
  const dot = (a, b) => { let s = 0; for (let i = 0; i < a.length; i++) s += a[i] * b[i]; return s; };
  const norm = (a) => Math.sqrt(dot(a, a));
  const subtract = (a, b, by) => { for (let i = 0; i < a.length; i++) a[i] -= by * b[i]; };

  // columns to orthonormal ones Q and the triangle R (each column orthogonalised twice)
  const orthogonal = (columns) => {
    const q = [], r = [];
    for (const c of columns) {
      const v = Float64Array.from(c), own = new Float64Array(q.length + 1);
      for (let twice = 0; twice < 2; twice++) q.forEach((u, i) => { const s = dot(u, v); own[i] += s; subtract(v, u, s); });
      own[q.length] = norm(v);
      for (let i = 0; i < v.length; i++) v[i] /= own[q.length] || 1;
      q.push(v);
      r.push(own);
    }
    return { q, r };
  };
  // what columns leave of b, and the shares of the columns
  const project = ({ q, r }, b) => {
    const rest = Float64Array.from(b), share = new Float64Array(q.length);
    for (let twice = 0; twice < 2; twice++) q.forEach((u, i) => { const s = dot(u, rest); share[i] += s; subtract(rest, u, s); });
    const x = new Float64Array(q.length);
    for (let j = q.length - 1; j >= 0; j--) {
      let s = share[j];
      for (let k = j + 1; k < q.length; k++) s -= r[k][j] * x[k];
      x[j] = s / r[j][j];
    }
    return { rest, x };
  };
  // Householder: the same columns as a trapezoid of as many rows as columns
  const reduced = (columns) => {
    const c = columns.map((x) => Float64Array.from(x)), rows = c[0]?.length ?? 0, kept = Math.min(rows, c.length);
    for (let j = 0; j < kept; j++) {
      const v = c[j].slice(j), length = norm(v);
      if (length === 0) continue;
      v[0] += v[0] < 0 ? -length : length;
      const square = dot(v, v);
      for (let k = j; k < c.length; k++) {
        const own = c[k].subarray(j), by = (2 * dot(v, own)) / square;
        subtract(own, v, by);
      }
      c[j].fill(0, j + 1);
    }
    return c.map((x) => x.slice(0, kept));
  };

  // Variance of a row: restricted maximum likelihood, as `System::row_variance`. For each trial
  // variance the rows are weighed by it, and the effects' columns made orthonormal in `q`; what
  // they leave of b is in `rest`.
  const variance = (rows, effects, b, d) => {
    const s2 = rows.singular.map((s) => s * s), plain = project(orthogonal(effects), b), m = b.length, k = effects.length;
    const total = Math.max(dot(plain.rest, plain.rest), Number.MIN_VALUE), n = rows.n_rows;
    const high = Math.log(total / Math.max(n, 1)) + 1, low = high - 28, grid = 113;
    const root = new Float64Array(m), rest = new Float64Array(m), q = effects.map(() => new Float64Array(m)), length = new Float64Array(k);
    const clear = (v, j) => {
      for (let i = 0; i < j; i++) {
        const u = q[i];
        let s = 0;
        for (let r = 0; r < m; r++) s += u[r] * v[r];
        for (let r = 0; r < m; r++) v[r] -= s * u[r];
      }
    };
    // a second time only where the first left little, whose rounding would matter
    const orthogonalise = (v, j) => {
      if (!j) return;
      const before = norm(v);
      clear(v, j);
      if (norm(v) < 0.1 * before) clear(v, j);
    };
    const weigh = (v) => {
      for (let r = 0; r < m; r++) root[r] = 1 / Math.sqrt(r < d ? v + s2[r] : v);
      for (let j = 0; j < k; j++) {
        const own = q[j], e = effects[j];
        for (let r = 0; r < m; r++) own[r] = e[r] * root[r];
        orthogonalise(own, j);
        length[j] = norm(own);
        for (let r = 0; r < m; r++) own[r] /= length[j];
      }
      for (let r = 0; r < m; r++) rest[r] = b[r] * root[r];
      orthogonalise(rest, k);
    };
    const unlikely = (log) => {
      weigh(Math.exp(log));
      let sum = dot(rest, rest) + (n - d) * log;
      for (let r = 0; r < d; r++) sum -= 2 * Math.log(root[r]);
      for (let j = 0; j < k; j++) sum += 2 * Math.log(length[j]);
      return sum;
    };
    const slope = (log) => {
      const v = Math.exp(log);
      weigh(v);
      let sum = n - m;
      for (let r = 0; r < m; r++) {
        let left = 1 - rest[r] * rest[r];
        for (let j = 0; j < k; j++) left -= q[j][r] * q[j][r];
        sum += v * root[r] * root[r] * left;
      }
      return sum;
    };
    const at = (i) => low + ((high - low) * i) / (grid - 1);
    let best = 0, least = Infinity;
    for (let i = 0; i < grid; i++) { const u = unlikely(at(i)); if (u < least) { least = u; best = i; } }
    let a = at(Math.max(0, best - 1)), c = at(Math.min(best + 1, grid - 1));
    for (let i = 0; i < 46; i++) { const middle = 0.5 * (a + c); if (slope(middle) > 0) c = middle; else a = middle; }
    return Math.exp(0.5 * (a + c));
  };

  // Columns that the rows determine, as `Visible`: their places among the chosen ones.
  const determined = (rows, top, bottom, d) => {
    const whole = top.map((t, j) => Float64Array.from([...t, ...bottom[j]])), norms = whole.map(norm);
    const zero = 1e-12 * Math.max(rows.longest, ...norms), largest = Math.max(0, ...rows.singular);
    const inside = Array.from({ length: d }, (_, i) => rows.singular[i] > 1e-12 * largest);
    const outside = (v) => (rows.saturated && rows.prior_weight !== null ? v : v.map((x, i) => (i < d && inside[i] ? 0 : x)));
    const basis = [], out = [];
    whole.forEach((w, j) => {
      if (norms[j] <= zero) return;
      const v = outside(w).map((x) => x / norms[j]);
      for (let twice = 0; twice < 2; twice++) basis.forEach((u) => subtract(v, u, dot(u, v)));
      const rest = norm(v);
      if (rest < 1e-8) return;
      basis.push(v.map((x) => x / rest));
      out.push(j);
    });
    return out;
  };

  // Sizes of the chosen effects and of the body's directions, from rotated rows.
  const solve = (rows, chosen) => {
    const d = rows.singular.length, k = rows.top.length - 1, theta = new Float64Array(chosen.length);
    const below = reduced([...chosen, k].map((j) => rows.bottom[j]));
    const seen = determined(rows, chosen.map((j) => rows.top[j]), below.slice(0, -1), d);
    const join = (top, bottom) => Float64Array.from([...top, ...bottom]);
    const effects = seen.map((i) => join(rows.top[chosen[i]], below[i])), b = join(rows.top[k], below[chosen.length]);
    const weight = rows.prior_weight === null ? 0 : rows.prior_weight * variance(rows, effects, b, d);
    const floor = weight > 0 ? 0 : 1e-13 * Math.max(0, ...rows.singular);
    const known = (i) => rows.singular[i] > floor;
    const root = Float64Array.from(b, (_, i) => (i < d && known(i) ? Math.sqrt(weight / (rows.singular[i] ** 2 + weight)) : 1));
    const by = (c) => c.map((x, i) => x * root[i]);
    const { x } = project(orthogonal(effects.map(by)), by(b));
    seen.forEach((i, j) => { theta[i] = x[j]; });
    const y = new Float64Array(d);
    for (let i = 0; i < d; i++) {
      if (!known(i)) continue;
      let left = b[i];
      effects.forEach((e, j) => { left -= e[i] * x[j]; });
      y[i] = (rows.singular[i] * left) / (rows.singular[i] ** 2 + weight);
    }
    return { theta, y };
  };

  // Sum of squares of the errors in the windows of a trial.
  const squares = (windows, { theta, y }, chosen) => {
    const w = windows.rows, d = y.length, e = Float64Array.from(w[w.length - 1]);
    for (let i = 0; i < d; i++) subtract(e, w[i], -y[i]);
    chosen.forEach((j, i) => subtract(e, w[d + j], -theta[i]));
    return dot(e, e);
  };

  // as `Grade::of` and `Graded::at_best` of the program, whose limits and order of grades these are
  const graded = ({ limits, grades, best }, times, at, below) => {
    const plain = times === null || !Number.isFinite(times) ? "not_judged" : times >= limits.poor ? "poor" : at ? (below ? "below_floor" : "at_floor") : times < limits.fair ? "good" : "fair";
    const worse = (a, b) => grades.indexOf(a) > grades.indexOf(b);
    const least = (now, b) => (worse(b.grade, now.grade) && (now.grade !== "not_judged" || b.grade === "poor") ? b : now);
    return best.reduce(least, { grade: plain, because: null });
  };
  const against = (k, place, error, windows, floor) => {
    // a floor that is known too roughly does not judge an error within its interval
    const most = floor?.ci95?.[1] ?? null;
    const undecided = most !== null && error <= most && most > k.limits.known * floor.noise_floor;
    const times = floor && !undecided ? error / floor.noise_floor : null, at = most !== null && !undecided ? error <= most : null;
    const { grade, because } = graded(k, times, at, at && error < floor.ci95[0]);
    // what is poor for a reason of its own is at no floor
    const at_floor = at && !(grade === "poor" && because);
    return { judged_on: place, held_out_error: error, windows, noise_floor: floor?.noise_floor ?? null, noise_floor_ci95: floor?.ci95 ?? null, times_floor: times, at_floor, grade, because };
  };

  // packed numbers to lists, once
  const open = (k) => {
    const rows = (r) => r && { ...r, top: matrix(r.top), bottom: matrix(r.bottom), spread: r.spread && matrix(r.spread) };
    const windows = (w) => w && { ...w, rows: matrix(w.rows) };
    return { ...k, all: rows(k.all), trials: k.trials.map((t) => ({ ...t, without: rows(t.without), flight: windows(t.flight), contact: windows(t.contact) })) };
  };
  // the model with the switches `on` (keys); null with a reason where it takes the program
  const model = (k, on) => {
    const places = on.map((key) => k.switches.findIndex((s) => s.key === key));
    if (places.includes(-1)) return { model: null, because: `\`${on[places.indexOf(-1)]}\` is not among the switches of this page` };
    // models that the program computed
    const known = k.known.find((m) => m.effects.length === on.length && on.every((key) => m.effects.includes(key)));
    if (known) return { model: { ...known, effects: on } };
    // rows in the metric of their noise give other choices only nearly
    if (k.only_known) return { model: null, because: "this page holds the model, each switch flipped once and what was found; `aloft studio` computes other choices" };
    // rows with contact do not give a model that is identified without it, nor the other way round
    if ((k.always_contact || places.some((i) => k.with_contact[i])) !== k.contact) {
      return { model: null, because: "this choice changes whether the model is identified from contact as well, and this page has no numbers for it" };
    }
    const first = []; k.columns.reduce((sum, n, i) => { first[i] = sum; return sum + n; }, 0);
    const chosen = places.flatMap((i) => Array.from({ length: k.columns[i] }, (_, c) => first[i] + c));
    const all = solve(k.all, chosen), sums = { flight: [0, 0], contact: [0, 0] };
    const trials = k.trials.map((t) => {
      const own = t.without ? solve(t.without, chosen) : all, out = { trial: t.name, flight: null, contact: null };
      for (const place of ["flight", "contact"]) {
        if (!t[place]) continue;
        const s = squares(t[place], own, chosen);
        sums[place][0] += s;
        sums[place][1] += t[place].windows;
        out[place] = Math.sqrt(s / t[place].windows);
      }
      return out;
    });
    const errors = ["flight", "contact"].filter((p) => sums[p][1]).map((p) => against(k, p, Math.sqrt(sums[p][0] / sums[p][1]), sums[p][1], k[p + "_floor"]));
    // as the program: no model of a body stands so far below the floor
    if (errors.some((e) => e.noise_floor && e.held_out_error < 0.05 * e.noise_floor)) return { model: null, because: "these effects together can replace the body's weight, so the model cannot be evaluated" };
    const names = places.flatMap((i) => k.switches[i].coefficients.map(([n]) => k.switches[i].key + "." + n));
    const base = k.base.map(([name, unit], i) => [name, k.all.mean[i] + (k.all.spread ?? []).reduce((s, c, j) => s + c[i] * all.y[j], 0), unit]);
    return { model: { effects: on, errors, coefficients: names.map((n, i) => [n, all.theta[i]]), base, trials } };
  };
  return { open, model };
})();
