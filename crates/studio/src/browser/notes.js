// Notes, kept with the results and shown in the report.
(() => {
  const { S, at, problem } = Studio;
  const text = at("notes"), button = at("notes-keep"), told = at("notes-told");
  let before = "";
  Studio.hooks.state.push(() => {
    // what is being written is not lost when the results change
    if (text.value === before) text.value = S.state.notes;
    before = S.state.notes;
    button.disabled = text.value === before;
  });
  text.oninput = () => { button.disabled = text.value === before; told.textContent = ""; };
  button.onclick = async () => {
    try {
      const after = text.value;
      await Live.ask("/api/notes", { before, after });
      before = after;
      button.disabled = text.value === before;
      told.textContent = "Kept.";
      problem(null);
    } catch (e) { problem(e); }
  };
})();
