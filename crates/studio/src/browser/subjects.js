// Two subjects of the study side by side: the table of the report over all subjects, read from
// their results when this part is opened.
(() => {
  const { S, at } = Studio;
  let asked = false;
  const load = async () => {
    if (asked || !at("subjects").open) return;
    asked = true;
    at("subjects-told").textContent = "Reading the results of all subjects …";
    const found = await Live.ask("/api/subjects").catch((e) => { asked = false; at("subjects-told").textContent = ""; throw e; });
    if (found.html) {
      at("subjects-table").innerHTML = found.html;
      const own = S.state.session;
      at("subjects-table").querySelectorAll("figure.pair").forEach((f) => Tables.pair(f, own));
      at("subjects-table").querySelectorAll("button.csv").forEach(Tables.csv);
    }
    const words = found.html ? [] : ["Fewer than two subjects have results; run `aloft run` on the whole study."];
    at("subjects-told").replaceChildren(...Studio.prose([...words, ...found.without.map((w) => `Not in the table: ${w}.`)].join(" ")));
  };
  Studio.hooks.state.push(() => { at("subjects").hidden = !S.state.several_subjects; });
  at("subjects").addEventListener("toggle", () => load().catch(Studio.problem));
})();
