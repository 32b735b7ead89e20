#!/usr/bin/env python3
"""Opens a report page in headless Chromium as a reader would: size, time to load, time to the first chart, errors; screenshots on request.

    python tests/peers/report_page.py REPORT.html [--chapters ID ...] [--repeat N] [--shots FOLDER]

Times are wall times of the browser (performance.now() since navigation), in a fresh profile each time. Without --chapters every chapter
is opened once, so that a figure that cannot be drawn is found. Exit code 1 where the page reports an error or takes something from outside.
"""
import argparse
import json
import pathlib
import queue
import re
import shutil
import subprocess
import sys
import tempfile
import threading
from http.server import BaseHTTPRequestHandler, HTTPServer

FLAGS = ["--headless", "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking",
         "--disable-component-update", "--disable-sync", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]

# runs before everything else on the page: tells when it was loaded, when the first figure of the
# chapter was drawn, and what went wrong
PROBE = """<script>(() => {
  const errors = [];
  addEventListener("error", (e) => errors.push(String(e.message)));
  addEventListener("load", () => {
    const loaded = performance.now();
    const tell = (drawn) => {
      const failed = [...document.querySelectorAll(".drawing")].map((d) => d.textContent).filter((t) => t.startsWith("This figure could not"));
      const paint = performance.getEntriesByName("first-contentful-paint")[0]?.startTime;
      navigator.sendBeacon("http://127.0.0.1:PORT/", JSON.stringify({ paint, loaded, drawn, errors: errors.concat(failed),
        chapters: [...document.querySelectorAll(".chapter")].map((c) => c.id),
        outside: performance.getEntriesByType("resource").map((r) => r.name).filter((n) => !n.startsWith("data:") && !n.startsWith("blob:")) }));
    };
    const wait = () => {
      const shown = [...document.querySelectorAll(".drawing")].filter((d) => d.offsetParent && d.getBoundingClientRect().top < innerHeight);
      const done = shown.filter((d) => d.querySelector("canvas") || d.textContent.startsWith("This figure could not"));
      if (done.length === shown.length) return setTimeout(() => tell(shown.length ? performance.now() : null));
      if (performance.now() > 60000) return tell(-1);
      setTimeout(wait, 5);
    };
    wait();
  });
})();</script>"""


def serve():
    told = queue.Queue()

    class Ear(BaseHTTPRequestHandler):
        def do_POST(self):
            told.put(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
            self.send_response(204)
            self.end_headers()

        def log_message(self, *_):
            pass

    server = HTTPServer(("127.0.0.1", 0), Ear)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    return server.server_port, told


def visit(chromium, page, anchor, told, folder):
    profile = tempfile.mkdtemp(dir=folder)
    process = subprocess.Popen([chromium, *FLAGS, f"--user-data-dir={profile}", "--window-size=1440,1000", "--remote-debugging-port=0",
                                f"file://{page}#{anchor}"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        return told.get(timeout=120)
    finally:
        process.terminate()
        process.wait()


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("page", type=pathlib.Path)
    arguments.add_argument("--chapters", nargs="*")
    arguments.add_argument("--repeat", type=int, default=1)
    arguments.add_argument("--shots", type=pathlib.Path)
    a = arguments.parse_args()
    chromium = shutil.which("chromium") or shutil.which("google-chrome") or sys.exit("skipped: no chromium")
    html = a.page.read_text()
    print(f"{a.page}: {a.page.stat().st_size / 1e6:.2f} MB")
    port, told = serve()
    wrong = False
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        probed = pathlib.Path(folder) / "page.html"
        # the page's own policy would not let the probe run
        open_page = re.sub(r'<meta http-equiv="Content-Security-Policy"[^>]*>', "", html, count=1)
        probed.write_text(open_page.replace("<head>", "<head>" + PROBE.replace("PORT", str(port)), 1))
        chapters = a.chapters or ["", *re.findall(r'<article class="chapter" id="([^"]+)"', html)]
        for chapter in chapters:
            seen = [visit(chromium, probed, chapter, told, folder) for _ in range(a.repeat)]
            least = {k: min((s[k] for s in seen if s.get(k) is not None), default=None) for k in ("paint", "loaded", "drawn")}
            show = ", ".join(f"{k} {v:.0f} ms" for k, v in least.items() if v is not None)
            trouble = {t for s in seen for t in s["errors"] + s["outside"]}
            wrong |= bool(trouble)
            print(f"  {chapter or '(as it opens)':28} {show}{'  WRONG: ' + '; '.join(sorted(trouble)) if trouble else ''}")
            for width, height in [(1440, 900), (600, 900)] if a.shots else []:
                a.shots.mkdir(parents=True, exist_ok=True)
                subprocess.run([chromium, *FLAGS, f"--user-data-dir={folder}/shots", f"--window-size={width},{height}", "--virtual-time-budget=8000",
                                f"--screenshot={a.shots / f'{chapter}-{width}.png'}", f"file://{a.page.resolve()}#{chapter}"],
                               stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, timeout=180, check=False)
    sys.exit(1 if wrong else 0)


main()
