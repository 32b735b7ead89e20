#!/usr/bin/env python3
"""Uses the live page in headless Chromium as a person would, by keyboard, and measures how long a flip takes.

    python3 -m venv V && V/bin/pip install playwright axe-playwright-python
    V/bin/python tests/peers/studio_browser.py target/release/aloft pipelines/demo.yaml [--workspace DIR] [--flips 50] [--shots FOLDER] [--chromium PATH]

The workspace (a temporary one if none is given) is run and asked for missing effects first. Then: the page opens without errors and without
violations of accessibility rules (axe); the switch of the effect that was found is flipped by keyboard; the number is that of `discover --json`;
flips are timed; a second tab is opened; the effect is kept; both tabs show it after they were read again; `history` has it; the server is killed
and started again; undo. Wrong tokens, foreign origins and paths are refused. Exit code 1 where something of this does not hold.
"""
import argparse
import json
import pathlib
import signal
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import sync_playwright

FAILED = []


def check(holds, words):
    print(("ok      " if holds else "FAILED  ") + words, flush=True)
    if not holds:
        FAILED.append(words)


def until(page, expression, seconds=30):
    """Waits until an expression holds; the page's security policy forbids what Playwright would do by itself."""
    end = time.time() + seconds
    while time.time() < end:
        try:
            if page.evaluate(expression):
                return
        except Exception as e:  # the page is being read again
            if time.time() > end - 1:
                raise e
        time.sleep(0.03)
    raise TimeoutError(expression)


class Server:
    def __init__(self, words, cwd=None):
        self.process = subprocess.Popen(words + ["--no-open"], cwd=cwd, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        self.address = self.process.stdout.readline().strip()
        self.base, self.token = self.address.split("/?token=")

    def status(self, path, **headers):
        try:
            return urllib.request.urlopen(urllib.request.Request(self.base + path, headers=headers)).status
        except urllib.error.HTTPError as e:
            return e.code

    def kill(self):
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("aloft")
    parser.add_argument("pipeline")
    parser.add_argument("--workspace")
    parser.add_argument("--data")
    parser.add_argument("--flips", type=int, default=50)
    parser.add_argument("--shots")
    parser.add_argument("--chromium", default="/usr/bin/chromium")
    args = parser.parse_args()
    temporary = tempfile.TemporaryDirectory()
    workspace = args.workspace or str(pathlib.Path(temporary.name) / "ws")
    words = [args.pipeline, "--workspace", workspace, *(["--data", args.data] if args.data else [])]
    aloft = lambda *w: json.loads(subprocess.run([args.aloft, *w, *words, "--json"], check=True, capture_output=True, text=True).stdout)
    subprocess.run([args.aloft, "run", *words], check=True, capture_output=True)
    found = aloft("discover")
    if not found["found"]:
        sys.exit("the discovery found nothing, so there is no switch to flip")
    key = found["found"][0]["key"]
    place = found["rounds"][0]["judged_on"]
    promised = next(e for e in found["errors_after"] if e["judged_on"] == place)["held_out_error"]
    server = Server([args.aloft, "studio", *words])

    with sync_playwright() as p:
        browser = p.chromium.launch(executable_path=args.chromium, args=["--no-sandbox", "--disable-gpu"])
        errors = []

        def tab(width=1600):
            page = browser.new_page(viewport={"width": width, "height": 1000})
            page.on("pageerror", lambda e: errors.append(str(e)))
            page.on("console", lambda m: errors.append(m.text) if m.type == "error" else None)
            return page

        def opened(page, address):
            started = time.time()
            page.goto(address)
            until(page, "Studio.S.state && !Studio.S.state.preparing && document.querySelectorAll('.studio-switch').length > 0 && Studio.S.before", 180)
            return time.time() - started

        shown = lambda page: page.evaluate("Studio.place(Studio.S.shown.errors).held_out_error")
        page = tab()
        print(f"        opened with switches after {opened(page, server.address):.1f} s, {page.locator('.studio-switch').count()} switches")
        page.wait_for_timeout(1500)
        if args.shots:
            page.screenshot(path=f"{args.shots}/before.png", timeout=120_000)

        # by keyboard alone: the switch is reached with Tab and flipped with Space
        page.evaluate("document.activeElement?.blur(); document.getElementById('studio-undo').scrollIntoView()")
        page.evaluate("document.getElementById('studio').setAttribute('tabindex', '-1'); document.getElementById('studio').focus()")
        for _ in range(60):
            page.keyboard.press("Tab")
            if page.evaluate("document.activeElement?.dataset?.key") == key:
                break
        check(page.evaluate("document.activeElement?.dataset?.key") == key, f"Tab reaches the switch of {key}")
        check(page.evaluate("getComputedStyle(document.activeElement).outlineStyle") != "none", "the focus is visible")
        before = shown(page)
        page.keyboard.press("Space")
        until(page, "Studio.S.shown.which.startsWith('quick')")
        quick = shown(page)
        check(quick < before, f"the error falls from {before:.4g} to {quick:.4g} N")
        check(abs(quick / promised - 1) < 0.02, f"the quick number {quick:.5g} N is that of `discover --json`, {promised:.5g} N")
        check("newtons" in page.locator("#studio-live").inner_text() and page.locator("#studio-live").get_attribute("aria-live") == "polite", "the number is announced")
        until(page, "Studio.S.shown.which.startsWith('exact')", 120)
        exact = shown(page)
        check(abs(exact / promised - 1) < 1e-6, f"the exact number {exact:.6g} N is that of `discover --json`, {promised:.6g} N")
        check(page.locator(".rung.preview").count() == 1, "the ladder shows one more rung")
        page.locator("#studio-sizes summary").press("Enter")
        if args.shots:
            page.screenshot(path=f"{args.shots}/exact.png", timeout=120_000)

        for shot in [1600, 700]:
            page.set_viewport_size({"width": shot, "height": 1000})
            violations = [v for v in Axe().run(page).response["violations"] if any("studio" in json.dumps(n["target"]) + n["html"] for n in v["nodes"])]
            check(not violations, f"axe at {shot} px: " + (", ".join(f"{v['id']} ({v['nodes'][0]['html'][:80]})" for v in violations) or "no violations"))
        page.set_viewport_size({"width": 1600, "height": 1000})

        # one flip after the other: from the key press to the new number on the page
        milliseconds = page.evaluate("""async ([key, flips]) => {
            const box = document.querySelector(`[data-key="${CSS.escape(key)}"]`), out = [];
            for (let i = 0; i < flips; i++) {
                const seen = new Promise((done) => { const w = new MutationObserver(() => { w.disconnect(); requestAnimationFrame(() => done()); }); w.observe(document.getElementById("studio-live"), { childList: true, characterData: true, subtree: true }); });
                const started = performance.now();
                box.click();
                await seen;
                out.push([performance.now() - started, Studio.S.flipped]);
                await new Promise((r) => setTimeout(r, 120));
            }
            return out;
        }""", [key, args.flips - args.flips % 2])
        for what, times in zip(["click to number painted", "request to answer"], zip(*milliseconds)):
            print(f"        {len(times)} flips, {what}: median {statistics.median(times):.0f} ms, worst {max(times):.0f} ms")

        # a reload keeps the choice; a second tab has its own
        page.reload()
        until(page, "Studio.S.before && Studio.S.shown", 60)
        check(page.evaluate("Studio.S.on.join()") == key, "a reload keeps the choice")
        second = tab(1200)
        opened(second, server.address)
        check(second.evaluate("Studio.S.on.length") == 0, "a second tab shows the model")

        page.locator("#studio-keep").focus()
        with second.expect_navigation(timeout=120_000), page.expect_navigation(timeout=120_000):
            page.keyboard.press("Enter")
        for name, each in [("the tab", page), ("the other tab", second)]:
            until(each, "Studio.S.state && !Studio.S.state.preparing && Studio.S.before && Studio.S.state.model.length === 1", 120)
            check(each.evaluate("Studio.S.state.model.join()") == key, f"{name} shows the kept effect")
            check(abs(shown(each) / promised - 1) < 0.02, f"{name}: {shown(each):.5g} N")
        history = aloft("history")["revisions"]
        check(history[-1]["effects"] == [key] and abs(history[-1]["held_out_error"] / promised - 1) < 0.02, "`history` has the revision")
        page.reload()
        until(page, "Studio.S.before", 60)
        check(page.evaluate("Studio.S.state.model.join()") == key, "still there after a reload")

        check(server.status("/") == 403 and server.status("/?token=" + "0" * 32) == 403, "wrong tokens are refused")
        check(server.status(f"/?token={server.token}", Origin="http://evil.example") == 403, "foreign origins are refused")
        check(server.status(f"/?token={server.token}", Host="evil.example") == 403, "foreign hosts are refused")
        check(all(server.status(f"{path}?token={server.token}") == 404 for path in ["/../../etc/passwd", "/%2e%2e/%2e%2e/etc/passwd", "/model.json"]), "no path leads to a file")
        left = server.status("/api/state?token=" + server.token)
        check(left == 200, "the right token passes")

        noted = len(errors)
        server.kill()
        until(page, "!document.getElementById('studio-problem').hidden", 30)
        check("No connection" in page.locator("#studio-problem").inner_text(), "a killed server is noticed")
        port = server.base.rsplit(":", 1)[1]
        server = Server([args.aloft, "studio", *words, "--port", port])
        until(page, "document.getElementById('studio-problem').textContent.includes('started again')", 60)
        check(True, "a new start is noticed, and its address asked for")
        del errors[noted:]
        opened(page, server.address)
        check(page.evaluate("Studio.S.state.model.join()") == key, "the new server has what was kept")
        page.locator("#studio-undo").focus()
        with page.expect_navigation(timeout=120_000):
            page.keyboard.press("Enter")
        until(page, "Studio.S.state && !Studio.S.state.preparing && Studio.S.before", 120)
        check(page.evaluate("Studio.S.state.model.length") == 0 and abs(shown(page) / before - 1) < 1e-6, f"undo: {shown(page):.5g} N")
        errors = [e for e in errors if "403" not in e and "ERR_CONNECTION" not in e]
        check(not errors, "no errors on the page" + ("" if not errors else ": " + "; ".join(errors[:3])))
        browser.close()
    server.kill()
    sys.exit(1 if FAILED else 0)


if __name__ == "__main__":
    main()
