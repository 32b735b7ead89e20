// One chapter at a time; figures drawn when they come into view; tables sorted; CSV; theme and
// print.
(() => {
  const chapters = [...document.querySelectorAll(".chapter")];
  const drawings = [...document.querySelectorAll(".drawing")];
  const drawn = new Set();
  const drawer = (el) => (el.classList.contains("player") ? Player : el.classList.contains("map") ? Maps : Charts);
  const draw = (el) => {
    if (drawn.has(el)) return;
    drawn.add(el);
    try {
      drawer(el).draw(el);
    } catch (e) {
      el.textContent = "This figure could not be drawn: " + e.message;
    }
  };
  // words first: figures are drawn after the page has been painted
  const later = (el) => requestAnimationFrame(() => setTimeout(() => draw(el)));
  const seen = new IntersectionObserver((list) => list.forEach((e) => { if (e.isIntersecting) later(e.target); }), { rootMargin: "300px" });
  drawings.forEach((d) => seen.observe(d));
  document.querySelectorAll("details").forEach((d) => d.addEventListener("toggle", () => d.open && d.querySelectorAll(".drawing").forEach(draw)));

  const title = document.title;
  let all = false;
  const show = (move) => {
    const id = decodeURIComponent(location.hash.slice(1));
    const target = id ? document.getElementById(id) : null;
    const chapter = target?.closest(".chapter") || chapters[0];
    all = all || id === "draw-all";
    chapters.forEach((c) => { c.hidden = !all && c !== chapter; });
    document.querySelectorAll("nav a").forEach((a) => {
      const own = a.getAttribute("href") === "#" + chapter.id;
      a.toggleAttribute("aria-current", own);
      if (own) { a.setAttribute("aria-current", "page"); a.scrollIntoView({ block: "nearest" }); }
    });
    if (chapter !== chapters[0]) document.title = chapter.querySelector(".chapter-title").textContent + " · " + title;
    else document.title = title;
    if (all) drawings.forEach(draw);
    if (move) setTimeout(() => (target && target !== chapter ? target.scrollIntoView() : window.scrollTo(0, 0)));
  };
  window.addEventListener("hashchange", () => { unfold(false); show(true); });
  show(location.hash.length > 1);

  // libraries while nothing else is to do, so that the first figure of the next chapter need not
  // wait
  const idle = window.requestIdleCallback || setTimeout;
  idle(() => { Numbers.library("uplot"); idle(() => Numbers.library("three")); });

  const menu = document.querySelector("nav .menu");
  const unfold = (open) => { menu.setAttribute("aria-expanded", open); document.body.classList.toggle("chapters-open", open); };
  menu.addEventListener("click", () => unfold(menu.getAttribute("aria-expanded") !== "true"));

  // print what is shown, in the light theme, or everything
  const repaint = () => {
    Numbers.recoloured();
    [...drawn].filter((d) => !d.classList.contains("player") && d.offsetParent).forEach((d) => drawer(d).draw(d));
    Player.renderAll();
  };
  window.addEventListener("beforeprint", () => {
    document.documentElement.classList.add("print");
    drawings.filter((d) => d.offsetParent).forEach(draw);
    repaint();
  });
  window.addEventListener("afterprint", () => {
    document.documentElement.classList.remove("print");
    repaint();
  });
  document.getElementById("print-all").addEventListener("click", async () => {
    document.querySelectorAll("details").forEach((d) => { d.open = true; });
    chapters.forEach((c) => { c.hidden = false; });
    drawings.forEach(draw);
    setTimeout(() => window.print(), 300);
  });

  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
    drawn.forEach((d) => { if (!d.classList.contains("player") && !d.offsetParent) drawn.delete(d); });
    repaint();
  });

  const csv = (b) => b.addEventListener("click", () => {
    const figure = b.closest("figure"), table = figure.querySelector("script") ? null : figure.querySelector("table");
    const name = (b.closest(".chapter")?.querySelector(".chapter-title").textContent ?? "") + " " + figure.querySelector(".what").textContent;
    const rows = table
      ? [...table.rows].map((r) => [...r.cells].map((c) => c.innerText.trim().replace(/\n+/g, ": ")))
      : (figure.querySelector(".player") ? Player : figure.querySelector(".drawing.chart") ? Charts : Maps).rows(figure);
    Numbers.save(name.trim(), rows);
  });
  document.querySelectorAll("button.csv").forEach(csv);

  // two columns of a table at a time; `first` names the one on the left
  const pair = (figure, first) => {
    const table = figure.querySelector("table"), names = [...table.tHead.rows[0].cells].slice(1).map((c) => c.textContent);
    const left = Math.max(0, names.indexOf(first)), starts = [left, left === 0 ? 1 : 0];
    const chosen = starts.map((start, side) => {
      const select = document.createElement("select");
      select.setAttribute("aria-label", side ? "Second subject" : "First subject");
      names.forEach((name, i) => select.add(new Option(name, i + 1, i === start, i === start)));
      return select;
    });
    const show = () => {
      const two = chosen.map((s) => Number(s.value));
      [...table.rows].forEach((row) => {
        const cells = [...row.cells].sort((a, b) => Number(a.dataset.at ?? a.cellIndex) - Number(b.dataset.at ?? b.cellIndex));
        cells.forEach((cell, i) => { cell.dataset.at = i; cell.hidden = i > 0 && !two.includes(i); });
        // in the order in which they were chosen
        row.append(...cells, ...new Set(two.map((i) => cells[i])));
      });
    };
    chosen.forEach((s) => s.addEventListener("change", show));
    const line = document.createElement("p");
    line.className = "choose";
    line.append(chosen[0], " beside ", chosen[1]);
    figure.querySelector(".scroll").before(line);
    show();
  };
  document.querySelectorAll("figure.pair").forEach((figure) => pair(figure));
  window.Tables = { pair, csv };

  // a click on a head sorts by it
  const key = (cell) => { const t = cell.innerText.trim(), v = parseFloat(t.replace("−", "-")); return Number.isFinite(v) ? v : t; };
  document.querySelectorAll("figure.table:not(.pair) table").forEach((table) => {
    const body = table.tBodies[0];
    if (body.rows.length < 3) return;
    [...table.tHead.rows[0].cells].forEach((head, i) => {
      if (!head.textContent.trim()) return;
      const button = document.createElement("button");
      button.type = "button";
      button.className = "sort";
      button.append(...head.childNodes);
      head.append(button);
      button.addEventListener("click", () => {
        const up = head.getAttribute("aria-sort") !== "ascending";
        [...table.tHead.rows[0].cells].forEach((h) => h.removeAttribute("aria-sort"));
        head.setAttribute("aria-sort", up ? "ascending" : "descending");
        const rows = [...body.rows].sort((a, b) => {
          const [x, y] = [key(a.cells[i]), key(b.cells[i])];
          const order = typeof x === typeof y ? (x < y ? -1 : x > y ? 1 : 0) : typeof x === "number" ? -1 : 1;
          return up ? order : -order;
        });
        body.append(...rows);
      });
    });
  });

  document.querySelectorAll("button.copy-text, button.copy-command").forEach((b) => b.addEventListener("click", async () => {
    const text = b.previousElementSibling;
    try {
      await navigator.clipboard.writeText(text.textContent);
      b.textContent = "Copied";
    } catch {
      const range = document.createRange();
      range.selectNodeContents(text);
      getSelection().removeAllRanges();
      getSelection().addRange(range);
      b.textContent = "Selected: press Ctrl+C";
    }
    setTimeout(() => { b.textContent = "Copy"; }, 2500);
  }));
})();
