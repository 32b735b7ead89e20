// Stretches of time to leave out: drawn in a chart or typed, listed, taken back, part of the
// address.
(() => {
  const { make } = Numbers;
  const { S, at } = Studio;
  S.cuts = [];
  Studio.others.push(() => S.cuts.length > 0);
  const text = (c) => `${c.trial}:${c.from_s}-${c.to_s}`;
  Studio.recorded.cut = (url) => Studio.put(url, "cut", S.cuts.map(text), []);
  const read = (t) => { const m = t.match(/^(.*):([\d.]+)-([\d.]+)$/); return m && { trial: m[1], from_s: +m[2], to_s: +m[3] }; };
  const form = at("cut"), trial = form.elements.namedItem("trial"), from = form.elements.namedItem("from"), to = form.elements.namedItem("to"), told = at("cut-told");
  const show = () => {
    at("cuts").replaceChildren(...S.cuts.map((c) => {
      const back = make("button", { type: "button", "aria-label": `Restore ${c.from_s} to ${c.to_s} s of ${c.trial}` }, "Restore");
      back.onclick = () => { S.cuts = S.cuts.filter((x) => x !== c); show(); Studio.flip(); form.querySelector("button").focus(); };
      return make("li", { class: "studio-cut" }, make("span", {}, `${c.trial}: ${c.from_s} to ${c.to_s} s`), back);
    }));
  };
  const add = (c) => {
    S.cuts = [...S.cuts, c];
    show();
    Studio.flip();
  };
  Studio.hooks.state.push(() => {
    const names = S.state.trials.map((t) => t.name);
    trial.replaceChildren(...names.map((n) => make("option", {}, n)));
    S.cuts = Studio.list("cut").map(read).filter((c) => c && names.includes(c.trial) && c.to_s > c.from_s);
    show();
  });
  const reset = Studio.hooks.reset;
  Studio.hooks.reset = () => { reset(); S.cuts = []; show(); };
  form.onsubmit = (e) => {
    e.preventDefault();
    const [a, b] = [parseFloat(from.value), parseFloat(to.value)];
    if (!(b > a)) { told.textContent = "The end must be after the start (seconds)."; from.focus(); return; }
    told.textContent = "";
    add({ trial: trial.value, from_s: a, to_s: b });
  };
  // a stretch drawn in a chart is offered, not taken: the same gesture enlarges it
  document.addEventListener("stretch", (e) => {
    const { recording, from: a, to: b } = e.detail;
    if (![...trial.options].some((o) => o.value === recording)) return;
    trial.value = recording;
    from.value = Math.max(0, a).toFixed(3);
    to.value = b.toFixed(3);
    const figure = e.target.closest("figure");
    figure.querySelector(".leave-out")?.remove();
    const button = make("button", { type: "button", class: "leave-out" }, `Leave out ${Number(from.value).toFixed(2)} to ${b.toFixed(2)} s`);
    const [x, y] = [Math.max(0, a), b].map((v) => +v.toFixed(3));
    button.onclick = () => { add({ trial: recording, from_s: x, to_s: y }); button.remove(); };
    (figure.querySelector(".chart-tools") ?? figure).append(button);
  });
})();
