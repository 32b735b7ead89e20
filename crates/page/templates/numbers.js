// Packed numbers back to lists; colours of the theme; CSV. (`pack.rs` says how numbers are packed.)
const Numbers = (() => {
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const list = (packed) => {
    if (Array.isArray(packed)) return packed.map((v) => (v === null ? NaN : v));
    const view = new DataView(bytes(packed.b).buffer);
    if (packed.$ === "f4") return Array.from({ length: view.byteLength / 4 }, (_, i) => view.getFloat32(4 * i, true));
    return Array.from({ length: view.byteLength / 2 }, (_, i) => {
      const n = view.getInt16(2 * i, true);
      return n === -32768 ? NaN : n * packed.s;
    });
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
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue("--" + name).trim();
  return { list, save, colour };
})();
