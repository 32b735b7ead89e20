#!/usr/bin/env python3
"""Times a report page in a browser that runs already: first paint, load, and all figures of the first screen.

    python3 -m venv V && V/bin/pip install playwright
    V/bin/python tests/peers/report_open.py REPORT.html [MORE.html ...]

Each page is opened nine times in headless Chromium (`chromium` on the path) at 1440 x 900 with software WebGL, each time without what the
time before left; medians and the longest times, ms. An almost empty page gives the browser's own share.
"""
import pathlib
import shutil
import statistics
import sys

from playwright.sync_api import sync_playwright

READY = """() => new Promise((done) => {
  const look = () => {
    const paint = performance.getEntriesByName("first-contentful-paint")[0];
    const shown = [...document.querySelectorAll(".drawing")].filter((d) => d.offsetParent && d.getBoundingClientRect().top < innerHeight);
    if (!paint || !shown.every((d) => d.querySelector("canvas"))) return setTimeout(look, 5);
    done([paint.startTime, performance.getEntriesByType("navigation")[0].loadEventEnd, performance.now()]);
  };
  look();
})"""


def main():
    chromium = shutil.which("chromium") or sys.exit("skipped: no chromium")
    with sync_playwright() as p:
        browser = p.chromium.launch(executable_path=chromium, args=["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"])
        for name in sys.argv[1:]:
            times = []
            for _ in range(9):
                context = browser.new_context(viewport={"width": 1440, "height": 900})
                page = context.new_page()
                page.goto("about:blank")
                page.goto(pathlib.Path(name).resolve().as_uri())
                times.append(page.evaluate(READY))
                context.close()
            columns = zip(["painted", "loaded", "drawn"], zip(*times))
            print(name, *(f"{what} {statistics.median(t):.0f} (longest {max(t):.0f})" for what, t in columns))
        browser.close()


main()
