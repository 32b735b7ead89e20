// Packed numbers back to lists; colours of the theme; libraries of the page; CSV. (`pack.rs` says
// how numbers are packed.)
const Numbers = (() => {
  const nonce = document.currentScript.nonce;
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  // text that `pack.rs` compressed
  const inflated = (text) => new TextDecoder().decode(FFLATE.inflateSync(bytes(text)));
  const list = (packed) => {
    if (Array.isArray(packed)) return packed.map((v) => (v === null ? NaN : v));
    const view = new DataView(bytes(packed.b).buffer);
    if (packed.$ === "f4") return Array.from({ length: view.byteLength / 4 }, (_, i) => view.getFloat32(4 * i, true));
    return Array.from({ length: view.byteLength / 2 }, (_, i) => {
      const n = view.getInt16(2 * i, true);
      return n === -32768 ? NaN : n * packed.s;
    });
  };
  const read = (figure) => JSON.parse(figure.querySelector("script").textContent);
  // a number with about three digits, for people
  const short = (v) => {
    const a = Math.abs(v);
    if (!Number.isFinite(v)) return "–";
    if (a >= 100) return v.toFixed(0);
    if (a === 0) return "0";
    return a >= 0.001 ? String(+v.toPrecision(3)) : v.toExponential(1);
  };
  // a library that the page holds compressed becomes a script when it is first needed
  const library = (name) => {
    const text = document.getElementById("library-" + name);
    if (!text || text.dataset.run) return;
    text.dataset.run = "yes";
    const program = document.createElement("script");
    program.nonce = nonce;
    program.textContent = inflated(text.textContent);
    document.head.append(program);
  };
  const make = (tag, attributes = {}, ...children) => {
    const el = document.createElement(tag);
    for (const [k, v] of Object.entries(attributes)) el.setAttribute(k, v);
    el.append(...children);
    return el;
  };
  // seven digits: what single precision holds
  const text = (v) => (typeof v === "number" ? (Number.isFinite(v) ? String(+v.toPrecision(7)) : "") : v ?? "");
  const quote = (v) => (/[",\n]/.test(v) ? '"' + String(v).replace(/"/g, '""') + '"' : String(v));
  const save = (name, rows) => {
    const lines = rows.map((r) => r.map((v) => quote(text(v))).join(","));
    const a = document.createElement("a");
    a.href = URL.createObjectURL(new Blob(["\ufeff" + lines.join("\n") + "\n"], { type: "text/csv" }));
    a.download = name.toLowerCase().replace(/[^a-z0-9]+/g, "_").replace(/^_|_$/g, "").slice(0, 70) + ".csv";
    a.click();
    setTimeout(() => URL.revokeObjectURL(a.href), 1000);
  };
  const tones = new Map();
  const colour = (name) => {
    if (!tones.has(name)) tones.set(name, getComputedStyle(document.documentElement).getPropertyValue("--" + name).trim());
    return tones.get(name);
  };
  // other colours hold from now on
  const recoloured = () => tones.clear();
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", recoloured);
  // a colour of the theme with an opacity
  const faint = (name, alpha) => colour(name) + Math.round(255 * alpha).toString(16).padStart(2, "0");
  return { inflated, list, read, short, library, make, save, colour, recoloured, faint };
})();
