// One more rung of the ladder for a choice of effects.
(() => {
  const { S } = Studio;
  const rung = () => {
    const list = document.querySelector(".ladder ol");
    if (!list) return;
    list.querySelector(".rung.preview")?.remove();
    const e = S.shown && Studio.place(S.shown.errors), last = [...list.querySelectorAll(".rung:not(.forecast)")].at(-1);
    // an error of the other kind of motion is no rung of this ladder
    if (!e || !last || !Studio.preview() || (S.state.place && e.judged_on !== S.state.place)) return;
    const row = last.cloneNode(true);
    row.className = "rung preview " + Studio.colour(e);
    row.querySelector(".name").textContent = S.shown.which.startsWith("exact") ? "with the switches" : "with the switches (quick)";
    const floor = parseFloat(row.querySelector(".floor")?.style.left);
    const bar = row.querySelector(".error");
    // the floor gives the scale of the ladder
    if (bar && floor && e.noise_floor) bar.style.width = Math.min(100, (floor * e.held_out_error) / e.noise_floor) + "%";
    row.querySelector(".value").textContent = `${Studio.number(e.held_out_error)} N${e.times_floor ? ` · ${Studio.times(e.times_floor).replace(" floor", "")}, ${Studio.judged(e)}` : ""}`;
    list.append(row);
  };
  Studio.hear(rung);
})();
