// Draws a frame of the player with three.js. One WebGL context serves all players of the page
// (browsers allow about sixteen): each picture is copied to the player's own canvas.
const PlayerGl = (() => {
  let stage = null, failed = false;
  const begin = () => {
    if (stage || failed) return stage;
    try {
      // ask before the library is read: without WebGL it is not needed
      if (!document.createElement("canvas").getContext("webgl2")) throw new Error("no WebGL");
      Numbers.library("three");
      const renderer = new THREE.WebGLRenderer({ antialias: true, alpha: true });
      renderer.setClearColor(0x000000, 0);
      const scene = new THREE.Scene(), camera = new THREE.PerspectiveCamera(40, 1, 0.01, 200);
      camera.up.set(0, 0, 1);
      const sky = new THREE.HemisphereLight(0xffffff, 0x8c96a3, 2.1), sun = new THREE.DirectionalLight(0xffffff, 1.5);
      scene.add(sky, sun);
      const shapes = {
        ball: new THREE.SphereGeometry(1, 24, 16), dot: new THREE.SphereGeometry(1, 10, 7), rod: new THREE.CylinderGeometry(1, 1, 1, 12), head: new THREE.ConeGeometry(1, 1, 16), ring: new THREE.TorusGeometry(1, 0.035, 8, 40, 5.2),
      };
      stage = { renderer, scene, camera, sun, shapes, pools: {}, materials: new Map(), used: {}, paths: new WeakMap(), size: "" };
    } catch {
      failed = true;
    }
    return stage;
  };
  const material = (kind, css, alpha) => {
    const key = kind + css + alpha;
    if (!stage.materials.has(key)) {
      const options = { color: css, transparent: alpha < 1, opacity: alpha, depthWrite: alpha > 0.5 };
      const Kind = kind === "line" ? THREE.LineBasicMaterial : kind === "face" ? THREE.MeshBasicMaterial : THREE.MeshLambertMaterial;
      stage.materials.set(key, new Kind(kind === "face" ? { ...options, side: THREE.DoubleSide } : options));
    }
    return stage.materials.get(key);
  };
  const next = (kind) => {
    const pool = (stage.pools[kind] ||= []), i = (stage.used[kind] = (stage.used[kind] ?? -1) + 1);
    if (!pool[i]) {
      pool[i] = kind === "line" ? new THREE.Line(new THREE.BufferGeometry()) : kind === "face" ? new THREE.Mesh(new THREE.BufferGeometry()) : new THREE.Mesh(stage.shapes[kind]);
      pool[i].frustumCulled = false;
      stage.scene.add(pool[i]);
    }
    pool[i].visible = true;
    return pool[i];
  };
  const UP = [0, 1, 0], FRONT = [0, 0, 1];
  const along = (mesh, base, v) => {
    const [a, b] = (stage.ends ??= [new THREE.Vector3(), new THREE.Vector3()]);
    mesh.quaternion.setFromUnitVectors(a.set(...base), b.set(...v).normalize());
  };
  // the corners of a path or face; those of one that does not move are kept with its points
  const corners = (item) => {
    const own = item.kind === "face" ? [0, 1, 2, 0, 2, 3].map((k) => item.points[k] || item.points[0]) : item.points;
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(own.flat()), 3));
    return geometry;
  };
  const shape = (mesh, item) => {
    if (item.moves) {
      const held = mesh.own?.getAttribute("position");
      if (held && held.count === item.points.length) {
        item.points.forEach((p, i) => held.setXYZ(i, ...p));
        held.needsUpdate = true;
      } else {
        mesh.own?.dispose();
        mesh.own = corners(item);
      }
      mesh.geometry = mesh.own;
    } else {
      if (!stage.paths.has(item.points)) stage.paths.set(item.points, corners(item));
      mesh.geometry = stage.paths.get(item.points);
    }
    mesh.geometry.setDrawRange(0, item.count ?? Infinity);
  };
  const rod = (from, to, thick, css, alpha) => {
    const v = to.map((x, k) => x - from[k]), length = Math.hypot(...v);
    if (!(length > 1e-6)) return;
    const mesh = next("rod");
    mesh.material = material("rod", css, alpha);
    mesh.position.set(...from.map((x, k) => x + v[k] / 2));
    mesh.scale.set(thick, length, thick);
    along(mesh, UP, v);
  };
  const put = (item, css) => {
    const alpha = item.alpha ?? 1;
    if (item.kind === "ball") {
      // markers are small: fewer corners show the same
      const mesh = next(item.radii[0] < 0.02 && item.radii[0] === item.radii[1] ? "dot" : "ball");
      mesh.material = material("ball", css, alpha);
      mesh.position.set(...item.at);
      mesh.quaternion.set(...item.turn);
      mesh.scale.set(...item.radii);
    } else if (item.kind === "rod") rod(item.from, item.to, item.thick, css, alpha);
    else if (item.kind === "arrow") {
      const v = item.to.map((x, k) => x - item.from[k]), length = Math.hypot(...v), head = Math.min(8 * item.thick, 0.6 * length);
      if (!(length > 1e-6)) return;
      const neck = item.to.map((x, k) => x - (v[k] / length) * head);
      rod(item.from, neck, item.thick, css, alpha);
      const mesh = next("head");
      mesh.material = material("rod", css, alpha);
      mesh.position.set(...item.to.map((x, k) => x - (v[k] / length) * head * 0.5));
      mesh.scale.set(2.6 * item.thick, head, 2.6 * item.thick);
      along(mesh, UP, v);
    } else if (item.kind === "ring") {
      const mesh = next("ring");
      mesh.material = material("rod", css, alpha);
      mesh.position.set(...item.at);
      mesh.scale.set(item.size, item.size, item.size);
      along(mesh, FRONT, item.axis);
    } else if (item.dashed) {
      const [a, b] = item.points, at = (k) => a.map((x, i) => x + ((b[i] - x) * k) / 29);
      for (let k = 0; k < 29; k += 2) put({ ...item, dashed: false, points: [at(k), at(k + 1)] }, css);
    } else {
      const mesh = next(item.kind);
      shape(mesh, item);
      mesh.material = material(item.kind, css, alpha);
    }
  };
  // `view`: width and height in CSS pixels, ratio, eye, at, and the vertical angle in degrees
  const draw = (context, frame, view, colour) => {
    if (!begin()) return false;
    const { renderer, scene, camera, sun, pools } = stage;
    stage.used = {};
    for (const pool of Object.values(pools)) for (const mesh of pool) mesh.visible = false;
    for (const item of frame.items) put(item, colour(item.colour));
    // a change of size makes new buffers: only where the players differ
    const size = [view.width, view.height, view.ratio].join();
    if (stage.size !== size) {
      stage.size = size;
      renderer.setPixelRatio(view.ratio);
      renderer.setSize(view.width, view.height, false);
    }
    camera.fov = view.angle;
    camera.aspect = view.width / view.height;
    camera.near = view.distance / 50;
    camera.far = view.distance * 20;
    camera.position.set(...view.eye);
    camera.lookAt(...view.at);
    camera.updateProjectionMatrix();
    sun.position.set(view.eye[0] - 0.4 * view.distance, view.eye[1], view.eye[2] + view.distance);
    renderer.render(scene, camera);
    if (renderer.getContext().isContextLost()) return false;
    context.drawImage(renderer.domElement, 0, 0, view.width, view.height);
    return true;
  };
  return { draw };
})();
