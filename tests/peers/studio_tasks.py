#!/usr/bin/env python3
"""Six tasks on the live page by keyboard alone, the page that was sent, and a study of 99 recordings, in headless Chromium.

    V/bin/python tests/peers/studio_tasks.py target/release/aloft [--shots FOLDER] [--trials 99] [--chromium PATH]

(`studio_browser.py` says how to make V.) The demonstration is copied to a temporary folder, run, and asked for missing effects. Tasks: switch on what is
missing and keep it; leave out a recording and take it back; write a law with an error in it, correct it, see its interval, keep it; leave out a stretch of
time, which a reload restores; compare two revisions and write notes; set two subjects side by side. Then the report of that study is opened as a file: its switches give the program's
numbers without a network. Last, a simulated study of many recordings is scrolled and played, and frame times are measured.
Exit code 1 where something of this does not hold.
"""
import argparse
import json
import pathlib
import shutil
import statistics
import subprocess
import sys
import tempfile

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import sync_playwright
from studio_browser import FAILED, Server, check, until

REPO = pathlib.Path(__file__).resolve().parents[2]
READY = "Studio.S.state && !Studio.S.state.preparing && document.querySelectorAll('.studio-switch').length > 0 && Studio.S.before"
MANY = """name: many
seed: 41
body: {{kind: chain, throws: {{recordings: {trials}, throws: 3}}}}
capture: {{marker_noise_m: 0.0003, gap_fraction: 0.005}}
hidden: [{{effect: quadratic_drag, drag_area_m2: 0.03}}]
"""
SUBJECT = """name: {name}
seed: {seed}
body: {{kind: human, person: {{sex: {sex}, height_m: {height}, mass_kg: {mass}}}, protocol: {{jumps: 6, exercises: 1}}}}
capture: {{marker_noise_m: 0.0003, soft_tissue_m: 0.003}}
"""
# frame times while something goes on, ms
FRAMES = """(seconds) => new Promise((done) => {
    const out = [], end = performance.now() + 1000 * seconds;
    let last = performance.now();
    const next = (now) => { out.push(now - last); last = now; now < end ? requestAnimationFrame(next) : done(out.slice(1)); };
    requestAnimationFrame(next);
})"""


def tab_to(page, expression, most=160):
    """Presses Tab until the focused element fulfils an expression of `e`."""
    for _ in range(most):
        if page.evaluate(f"(() => {{ const e = document.activeElement; return Boolean({expression}); }})()"):
            return True
        page.keyboard.press("Tab")
    return False


def restart(page):
    page.evaluate("document.activeElement?.blur(); document.getElementById('studio').setAttribute('tabindex', '-1'); document.getElementById('studio').focus()")


def shown(page):
    return page.evaluate("Studio.place(Studio.S.shown.errors).held_out_error")


def frames(page, what, seconds, start):
    page.evaluate(start)
    times = page.evaluate(FRAMES, seconds)
    page.evaluate("clearInterval(window.going)")
    slow = sum(t > 50 for t in times) / len(times)
    print(f"        {what}: {len(times)} frames, median {statistics.median(times):.0f} ms, 95 % {sorted(times)[int(0.95 * len(times))]:.0f} ms, worst {max(times):.0f} ms, {100 * slow:.0f} % over 50 ms")
    return statistics.median(times)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("aloft")
    parser.add_argument("--shots")
    parser.add_argument("--trials", type=int, default=99, help="recordings of the large study, at most 99")
    parser.add_argument("--chromium", default="/usr/bin/chromium")
    args = parser.parse_args()
    temporary = tempfile.TemporaryDirectory()
    folder = pathlib.Path(temporary.name)
    shutil.copy(REPO / "pipelines/demo.yaml", folder / "demo.yaml")
    shutil.copytree(REPO / "fixtures/demo", folder / "recordings")
    words = [str(folder / "demo.yaml"), "--data", str(folder / "recordings"), "--workspace", str(folder / "ws")]
    aloft = lambda *w, words=words: subprocess.run([args.aloft, *w, *words], check=True, capture_output=True, text=True).stdout
    aloft("run")
    found = json.loads(aloft("discover", "--json"))
    key = found["found"][0]["key"]
    promised = next(e for e in found["errors_after"] if e["judged_on"] == "flight")["held_out_error"]
    aloft("report")
    server = Server([args.aloft, "studio", *words])

    with sync_playwright() as p:
        browser = p.chromium.launch(executable_path=args.chromium, args=["--no-sandbox", "--disable-gpu"])
        errors = []

        def tab(address, width=1440, height=1000, **options):
            page = browser.new_page(viewport={"width": width, "height": height}, **options)
            page.on("pageerror", lambda e: errors.append(str(e)))
            page.on("console", lambda m: errors.append(m.text) if m.type == "error" else None)
            page.goto(address)
            until(page, READY, 180)
            return page

        def shot(page, name, **options):
            if args.shots:
                page.screenshot(path=f"{args.shots}/{name}.png", timeout=180_000, **options)

        # the page that was sent
        file = (folder / "ws/report.html").as_uri()
        sent = tab(file)
        requests = []
        sent.on("request", lambda r: requests.append(r.url))
        restart(sent)
        check(tab_to(sent, f"e.dataset?.key === {json.dumps(key)}"), "sent page: Tab reaches the switch")
        sent.keyboard.press("Space")
        until(sent, "Studio.S.shown.which.startsWith('quick')")
        check(abs(shown(sent) / promised - 1) < 1e-6, f"sent page: {shown(sent):.6g} N is that of `discover --json`, {promised:.6g} N")
        check("effect add" in sent.locator("#studio-which").inner_text(), "sent page: the command that keeps it is there")
        check(sent.locator(".rung.preview").count() == 1, "sent page: the ladder shows one more rung")
        check(not requests, f"sent page: no request {requests[:2]}")
        times = sent.evaluate("""async (key) => {
            const box = document.querySelector(`[data-key="${CSS.escape(key)}"]`), out = [];
            for (let i = 0; i < 50; i++) { const from = performance.now(); box.click(); await new Promise((r) => requestAnimationFrame(() => setTimeout(r))); out.push(performance.now() - from); }
            return out;
        }""", key)
        print(f"        sent page, 50 flips to the painted number: median {statistics.median(times):.0f} ms, worst {max(times):.0f} ms")
        shot(sent, "sent")
        for width in [1440, 600]:
            sent.set_viewport_size({"width": width, "height": 1000})
            violations = [f"{v['id']} ({v['nodes'][0]['html'][:70]})" for v in Axe().run(sent).response["violations"]]
            check(not violations, f"sent page, axe at {width} px: {'; '.join(violations) or 'no violations'}")
            check(sent.evaluate("document.documentElement.scrollWidth <= innerWidth"), f"sent page: nothing is cut off at {width} px")
        shot(sent, "sent600", full_page=True)
        sent.close()
        dark = tab(file + f"?on={key}", color_scheme="dark")
        shot(dark, "sent_dark")
        dark.close()

        page = tab(server.address)
        # 1. what is missing, kept
        restart(page)
        tab_to(page, f"e.dataset?.key === {json.dumps(key)}")
        page.keyboard.press("Space")
        until(page, "Studio.S.shown.which.startsWith('exact')", 120)
        restart(page)
        check(tab_to(page, "e.id === 'studio-keep'"), "1. Tab reaches Keep")
        with page.expect_navigation(timeout=120_000):
            page.keyboard.press("Enter")
        until(page, f"{READY} && Studio.S.state.model.length === 1", 120)
        check(abs(shown(page) / promised - 1) < 0.02, f"1. by keyboard: {key} is kept, {shown(page):.4g} N")

        # 2. a recording left out and taken back
        whole = shown(page)
        restart(page)
        tab_to(page, "e.tagName === 'SUMMARY' && e.textContent === 'Recordings'")
        page.keyboard.press("Enter")
        check(tab_to(page, "e.closest?.('.studio-trial')"), "2. Tab reaches the recordings")
        page.keyboard.press("Space")
        until(page, "Studio.S.shown.which.startsWith('quick')")
        without = shown(page)
        page.keyboard.press("Space")
        until(page, "Studio.S.shown.which.startsWith('the present')")
        check(without != whole and abs(shown(page) / whole - 1) < 1e-9, f"2. by keyboard: without a recording {without:.4g} N, with it {whole:.4g} N")

        # 3. a law, wrong and right
        restart(page)
        tab_to(page, "e.tagName === 'SUMMARY' && e.textContent === 'A law of your own'")
        page.keyboard.press("Enter")
        tab_to(page, "e.name === 'name'")
        page.keyboard.type("side_wind")
        tab_to(page, "e.name === 'force_x'")
        page.keyboard.type("c * sped")
        tab_to(page, "e.name === 'unit_c'")
        page.keyboard.type("N*s/m")
        page.keyboard.press("Enter")
        until(page, "!document.getElementById('studio-law-problem').hidden")
        told = page.locator("#studio-law-problem").inner_text()
        check("sped" in told and "\n" not in told.strip(), f"3. an error is one sentence: {told}")
        shot(page, "law_wrong")
        restart(page)
        tab_to(page, "e.name === 'force_x'")
        page.keyboard.press("Control+A")
        page.keyboard.type("c * spe")
        until(page, "!document.getElementById('studio-law-words').hidden")
        shot(page, "law_words")
        page.keyboard.press("ArrowDown")
        page.keyboard.press("Enter")
        check(page.evaluate("document.getElementById('studio-law').elements.force_x.value") == "c * speed", "3. a quantity is completed")
        page.keyboard.press("Enter")
        until(page, "Studio.S.on.includes('side_wind') && Studio.S.shown.which.startsWith('exact')", 120)
        size = page.evaluate("Studio.S.shown.model.coefficients.find((c) => c.name === 'side_wind.c')")
        check(size and size["ci95"] is not None, f"3. the law with its interval: {size and size['value']:.3g}, {size and size['ci95']}")
        shot(page, "law")
        restart(page)
        tab_to(page, "e.id === 'studio-keep'")
        with page.expect_navigation(timeout=120_000):
            page.keyboard.press("Enter")
        until(page, f"{READY} && Studio.S.state.model.includes('side_wind')", 120)
        check((folder / "effects/side_wind.yaml").is_file(), "3. by keyboard: the law is kept as a file and in the model")
        restart(page)
        tab_to(page, "e.id === 'studio-undo'")
        with page.expect_navigation(timeout=120_000):
            page.keyboard.press("Enter")
        until(page, f"{READY} && !Studio.S.state.model.includes('side_wind')", 120)

        # 4. a stretch left out; the address brings it back
        restart(page)
        tab_to(page, "e.tagName === 'SUMMARY' && e.textContent === 'Recordings'")
        page.keyboard.press("Enter")
        tab_to(page, "e.name === 'from'")
        page.keyboard.type("1")
        page.keyboard.press("Tab")
        page.keyboard.type("4")
        page.keyboard.press("Enter")
        until(page, "Studio.S.cuts.length === 1 && Studio.S.shown.which.startsWith('quick')")
        cut = shown(page)
        page.reload()
        until(page, f"{READY} && Studio.S.shown.which.startsWith('quick')", 60)
        check(cut != whole and abs(shown(page) / cut - 1) < 1e-9, f"4. by keyboard: without a stretch {cut:.4g} N, and after a reload {shown(page):.4g} N")

        # 5. two revisions, notes
        restart(page)
        tab_to(page, "e.tagName === 'SUMMARY' && e.textContent.startsWith('Two revisions')")
        page.keyboard.press("Enter")
        until(page, "document.querySelectorAll('#studio-pair tbody tr').length > 3")
        rows = page.locator("#studio-pair tbody tr").all_inner_texts()
        check("held-out error" in rows[0] and any("drag_area" in r for r in rows), f"5. two revisions: {rows[0]!r}")
        shot(page, "revisions")
        tab_to(page, "e.tagName === 'SUMMARY' && e.textContent === 'Notes'")
        page.keyboard.press("Enter")
        tab_to(page, "e.id === 'studio-notes'")
        page.keyboard.type("The bearing of <link1> was oiled.")
        page.keyboard.press("Tab")
        page.keyboard.press("Enter")
        until(page, "document.getElementById('studio-notes-told').textContent === 'Kept.'")
        aloft("report")
        text = (folder / "ws/report.html").read_text()
        check("The bearing of &lt;link1&gt; was oiled." in text, "5. by keyboard: the notes are kept and in the report")
        page.evaluate("document.querySelectorAll('.studio details').forEach((d) => { d.open = true; })")
        for width in [1440, 600]:
            page.set_viewport_size({"width": width, "height": 1000})
            violations = [f"{v['id']} ({v['nodes'][0]['html'][:90]})" for v in Axe().run(page).response["violations"]]
            check(not violations, f"axe at {width} px, all parts open: {'; '.join(violations) or 'no violations'}")
            check(page.evaluate("document.documentElement.scrollWidth <= innerWidth"), f"nothing is cut off at {width} px")
        shot(page, "all600", full_page=True)
        page.close()
        server.kill()

        # 6. two subjects of a study
        study = folder / "study"
        study.mkdir()
        table = ["participant_id\tsex\theight\tmass"]
        for name, (sex, height, mass) in {"sub-01": ("F", 1.62, 58.0), "sub-02": ("M", 1.8, 77.5)}.items():
            scenario = folder / f"{name}.yaml"
            scenario.write_text(SUBJECT.format(name=name, sex=sex, height=height, mass=mass, seed=int(name[-1])))
            subprocess.run([args.aloft, "simulate", str(scenario), "--out", str(study / name)], check=True, capture_output=True)
            (study / name / "subject.yaml").unlink(missing_ok=True)
            table.append(f"{name}\t{sex}\t{height}\t{mass}")
        (study / "participants.tsv").write_text("\n".join(table) + "\n")
        of_study = [str(REPO / "pipelines/study.yaml"), "--data", str(study), "--workspace", str(folder / "of_study")]
        aloft("run", words=of_study)
        aloft("discover", "--subject", "sub-01", "--closed", words=of_study)
        server = Server([args.aloft, "studio", "--subject", "sub-01", *of_study])
        page = tab(server.address)
        restart(page)
        check(tab_to(page, "e.tagName === 'SUMMARY' && e.textContent === 'Two subjects side by side'"), "6. Tab reaches the subjects")
        page.keyboard.press("Enter")
        until(page, "document.querySelectorAll('#studio-subjects-table figure.pair select').length === 2", 60)
        first = page.locator("#studio-subjects-table figure.pair").inner_text()
        tab_to(page, "e.tagName === 'SELECT' && e.closest('figure.pair')")
        page.keyboard.press("ArrowDown")
        check("sub-01" in first and "sub-02" in first, "6. by keyboard: both subjects stand side by side")
        shot(page, "subjects")
        page.close()
        server.kill()

        if args.trials:
            scenario = folder / "many.yaml"
            scenario.write_text(MANY.format(trials=args.trials))
            subprocess.run([args.aloft, "simulate", str(scenario), "--out", str(folder / "laboratory")], check=True, capture_output=True)
            many = [str(REPO / "pipelines/chain.yaml"), "--data", str(folder / "laboratory"), "--workspace", str(folder / "many")]
            aloft("run", words=many)
            aloft("discover", words=many)
            server = Server([args.aloft, "studio", *many])
            page = tab(server.address)
            print(f"        {page.locator('.studio-trial').count()} recordings")
            median = frames(page, "scrolling the page", 4, "document.querySelectorAll('.studio details').forEach((d) => { d.open = true; }); window.going = setInterval(() => { window.scrollBy(0, 40); document.getElementById('studio').scrollBy(0, 40); }, 16)")
            check(median < 34, f"{args.trials} recordings scroll without lag (median)")
            page.evaluate("window.scrollTo(0, 0); document.querySelector('.drawing.player').scrollIntoView()")
            page.wait_for_timeout(3000)
            median = frames(page, "playing", 4, "document.querySelector('.drawing.player button').click()")
            check(median < 50, f"a recording of {args.trials} plays without lag (median)")
            shot(page, "many")
            server.kill()
        errors = [e for e in errors if "ERR_CONNECTION" not in e]
        check(not errors, "no errors on the pages" + ("" if not errors else ": " + "; ".join(errors[:3])))
        browser.close()
    sys.exit(1 if FAILED else 0)


if __name__ == "__main__":
    main()
