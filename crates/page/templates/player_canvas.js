// Draws a frame of the player on a plain canvas, where the browser has no WebGL.
const PlayerCanvas = (() => {
  const alpha = (css, a) => (a >= 1 ? css : css.slice(0, 7) + Math.round(255 * a).toString(16).padStart(2, "0"));
  const centre = (item) => item.at || (item.from ? item.from.map((x, k) => (x + item.to[k]) / 2) : item.points[item.points.length >> 1]);
  const flat = (item) => item.kind === "face" || (item.kind === "line" && item.colour !== "effect");
  // `project` gives x, y (pixels), depth, and pixels per metre there
  const draw = (g, frame, view, colour, project, turned) => {
    const order = frame.items.filter((i) => i.kind !== "line" || (i.count ?? i.points.length) > 1).map((item) => [flat(item) ? -1e9 : project(centre(item))[2], item]).sort((a, b) => a[0] - b[0]);
    g.lineCap = "round";
    for (const [, item] of order) {
      const css = alpha(colour(item.colour), item.alpha ?? 1);
      g.strokeStyle = g.fillStyle = css;
      if (item.kind === "ball") {
        const [x, y, , s] = project(item.at);
        if (!Number.isFinite(x)) continue;
        // the outline of an ellipsoid: the projected axes make a matrix whose square is the ellipse
        let [a, b, c] = [0, 0, 0];
        item.radii.forEach((r, k) => {
          const p = project(item.at.map((v, i) => v + turned(item.turn, [0, 1, 2].map((j) => (j === k ? r : 0)))[i]));
          const [u, v] = [p[0] - x, p[1] - y];
          a += u * u; b += u * v; c += v * v;
        });
        const root = Math.hypot((a - c) / 2, b), middle = (a + c) / 2;
        g.beginPath();
        g.ellipse(x, y, Math.max(1, Math.sqrt(middle + root)), Math.max(1, Math.sqrt(Math.max(0, middle - root))), 0.5 * Math.atan2(2 * b, a - c), 0, 7);
        g.fill();
      } else if (item.kind === "ring") {
        const [x, y, , s] = project(item.at);
        g.lineWidth = 2; g.beginPath(); g.arc(x, y, item.size * s, 0, 5.2); g.stroke();
      } else if (item.kind === "face" || item.kind === "line") {
        g.beginPath();
        (item.count === undefined ? item.points : item.points.slice(0, item.count)).map(project).forEach((p, i) => (i ? g.lineTo(p[0], p[1]) : g.moveTo(p[0], p[1])));
        g.setLineDash(item.dashed ? [5, 4] : []);
        if (item.kind === "face") { g.closePath(); g.fill(); } else { g.lineWidth = item.colour === "effect" ? 2 : 1.2; g.stroke(); }
        g.setLineDash([]);
      } else {
        const p = project(item.from), q = project(item.to), width = Math.max(1, 2 * item.thick * p[3]);
        if (![...p, ...q].every(Number.isFinite)) continue;
        const length = Math.hypot(q[0] - p[0], q[1] - p[1]), ux = (q[0] - p[0]) / length, uy = (q[1] - p[1]) / length;
        const h = item.kind === "arrow" ? Math.min(Math.max(8, 3 * width), length) : 0;
        g.lineWidth = width;
        g.beginPath(); g.moveTo(p[0], p[1]); g.lineTo(q[0] - ux * h * 0.8 || q[0], q[1] - uy * h * 0.8 || q[1]); g.stroke();
        if (h > 1) { g.beginPath(); g.moveTo(q[0], q[1]); g.lineTo(q[0] - ux * h - uy * h * 0.42, q[1] - uy * h + ux * h * 0.42); g.lineTo(q[0] - ux * h + uy * h * 0.42, q[1] - uy * h - ux * h * 0.42); g.fill(); }
      }
    }
    return true;
  };
  return { draw };
})();
