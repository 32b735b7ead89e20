#!/usr/bin/env python3
"""Frame times of a report page while it is scrolled and while its player plays, in headless Chromium with software WebGL.

    V/bin/python tests/peers/report_frames.py REPORT.html [--seconds 4] [--chromium PATH]

(`studio_browser.py` says how to make V.) A page of 100 recordings: one recording of the demonstration many times over, as `studio_tasks.py` makes them, `aloft run`, `aloft report`.
"""
import argparse
import pathlib
import statistics

from playwright.sync_api import sync_playwright
from studio_tasks import FRAMES


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("report")
    parser.add_argument("--seconds", type=float, default=4)
    parser.add_argument("--chromium", default="/usr/bin/chromium")
    args = parser.parse_args()
    with sync_playwright() as p:
        browser = p.chromium.launch(executable_path=args.chromium, args=["--no-sandbox", "--disable-gpu"])
        page = browser.new_page(viewport={"width": 1440, "height": 1000})
        page.goto(pathlib.Path(args.report).resolve().as_uri())
        page.wait_for_timeout(4000)

        def measure(what, start):
            page.evaluate(start)
            times = sorted(page.evaluate(FRAMES, args.seconds))
            page.evaluate("clearInterval(window.going)")
            print(
                f"{what}: {len(times)} frames in {args.seconds:g} s, median {statistics.median(times):.0f} ms, "
                f"95 % {times[int(0.95 * len(times))]:.0f} ms, worst {times[-1]:.0f} ms"
            )

        measure("scrolling", "window.going = setInterval(() => window.scrollBy(0, 40), 16)")
        page.evaluate("window.scrollTo(0, 0); document.querySelector('.drawing.player').scrollIntoView()")
        page.wait_for_timeout(2500)
        measure("playing", "document.querySelector('.drawing.player button').click()")
        browser.close()


if __name__ == "__main__":
    main()
