#!/usr/bin/env python3
"""Makes studio_session.webp: a session on the live page, as an animated picture.

    cargo build --release
    python3 -m venv V && V/bin/pip install playwright axe-playwright-python pillow
    V/bin/python docs/pictures/studio_animation.py [--aloft target/release/aloft] [--chromium PATH] [--frames FOLDER]

The demonstration is copied to a temporary folder, run, and asked for missing effects. Headless Chromium opens the address that
`aloft studio` prints, flips the switch of what was found, presses Keep, and reads the page again. Every frame is a screenshot of that
page; only the pointer and the line of words below it are drawn afterwards. `--frames` also writes each frame as PNG, for looking at.
"""
import argparse
import io
import pathlib
import shutil
import subprocess
import sys
import tempfile

from PIL import Image, ImageDraw, ImageFont
from playwright.sync_api import sync_playwright

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parent.parent
sys.path.insert(0, str(ROOT / "tests/peers"))
from studio_browser import Server, until  # noqa: E402

# pixels of the page, and of the line of words below it; the book shows pictures at about 750 pixels
WIDTH, HEIGHT, WORDS = 850, 470, 40
AWAY = (826.0, 432.0)
INK, GROUND = "#1b2730", "#e3edf5"
READY = "Studio.S.state && !Studio.S.state.preparing && document.querySelectorAll('.studio-switch').length > 0 && Studio.S.before"
# the page shows the ladder on the left while the panel stays on the right
TO_LADDER = "window.scrollTo(0, document.querySelector('.ladder').getBoundingClientRect().top + scrollY - 14)"
# speed of the page's transitions while they are photographed; step between shades of the picture
SLOWER, STEP = 0.02, 12


class Film:
    def __init__(self, page):
        self.page, self.frames, self.milliseconds = page, [], []
        self.font = ImageFont.load_default(size=19)
        self.pointer = AWAY

    def frame(self, words, milliseconds, pointer=None):
        """Takes a screenshot and writes words below it."""
        page = Image.open(io.BytesIO(self.page.screenshot(timeout=120_000))).convert("RGB")
        self.add(page, words, milliseconds, pointer)

    def add(self, page, words, milliseconds, pointer=None):
        self.pointer = pointer or self.pointer
        whole = Image.new("RGB", (WIDTH, HEIGHT + WORDS), GROUND)
        whole.paste(page, (0, 0))
        draw = ImageDraw.Draw(whole)
        draw.text((16, HEIGHT + WORDS / 2), words, INK, self.font, anchor="lm")
        x, y = self.pointer
        shape = [(0, 0), (0, 17), (4, 13.5), (6.8, 19.5), (9.2, 18.4), (6.5, 12.6), (11.6, 12.2)]
        draw.polygon([(x + 1.1 * a, y + 1.1 * b) for a, b in shape], fill="#111111", outline="white")
        self.frames.append(whole)
        self.milliseconds.append(milliseconds)

    def move(self, words, to):
        """Moves the pointer on an unchanged page."""
        page = Image.open(io.BytesIO(self.page.screenshot(timeout=120_000))).convert("RGB")
        (x, y), steps = self.pointer, 3
        for k in range(1, steps + 1):
            self.add(page, words, 90, (x + (to[0] - x) * k / steps, y + (to[1] - y) * k / steps))
        self.milliseconds[-1] = 700

    def save(self, path):
        # shades that nobody can tell apart would double the file
        self.frames = [f.point(lambda v: min(255, (v + STEP // 2) // STEP * STEP)) for f in self.frames]
        first, *rest = self.frames
        first.save(path, save_all=True, append_images=rest, duration=self.milliseconds, loop=0, lossless=True, quality=100, method=6, minimize_size=True)


def middle(page, selector):
    box = page.locator(selector).first.bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def session(page, address):
    film = Film(page)
    page.goto(address)
    until(page, READY, 180)
    page.wait_for_timeout(2000)
    found = page.evaluate("Studio.S.state.asked.found[0]")
    switch = f'[data-key="{found}"]'
    film.frame("1  aloft studio pipelines/demo.yaml opens this page", 3000)
    page.evaluate(TO_LADDER)
    page.wait_for_timeout(800)
    film.frame("2  The ladder of models; beside it, every effect is a switch", 2000)
    film.move("2  The ladder of models; beside it, every effect is a switch", middle(page, switch))
    # the bar falls in 0.28 s; slower, so that screenshots can be taken meanwhile
    slow = page.context.new_cdp_session(page)
    slow.send("Animation.enable")
    slow.send("Animation.setPlaybackRate", {"playbackRate": SLOWER})
    page.mouse.click(*middle(page, switch))
    until(page, "Studio.S.shown.which.startsWith('quick')")
    for _ in range(3):
        film.frame("3  Drag is switched on: the error falls at once, a rung is added", 110)
        page.wait_for_timeout(int(70 / SLOWER))
    slow.send("Animation.setPlaybackRate", {"playbackRate": 1})
    page.wait_for_timeout(500)
    until(page, "Studio.S.shown.which.startsWith('exact')", 120)
    page.wait_for_timeout(1500)
    film.frame("3  Drag is switched on: the error falls at once, a rung is added", 3000)
    film.move("4  Keep makes it the model", middle(page, "#studio-keep"))
    with page.expect_navigation(timeout=120_000):
        page.mouse.click(*middle(page, "#studio-keep"))
    kept = f"{READY} && Studio.S.state.model.length === 1"
    until(page, kept, 120)
    page.wait_for_timeout(2000)
    page.evaluate(TO_LADDER)
    page.wait_for_timeout(800)
    film.frame("4  Kept: the effect is a revision of the model", 2500, AWAY)
    page.reload()
    until(page, kept, 120)
    page.wait_for_timeout(2000)
    page.evaluate("window.scrollTo(0, 0)")
    page.wait_for_timeout(800)
    film.frame("5  The page is loaded again: the model still has it", 4000, AWAY)
    return film


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--aloft", default=str(ROOT / "target/release/aloft"))
    arguments.add_argument("--chromium", default="/usr/bin/chromium")
    arguments.add_argument("--frames", type=pathlib.Path)
    a = arguments.parse_args()
    aloft = str(pathlib.Path(a.aloft).resolve())
    with tempfile.TemporaryDirectory() as name:
        place = pathlib.Path(name)
        (place / "pipelines").mkdir()
        shutil.copy(ROOT / "pipelines/demo.yaml", place / "pipelines/demo.yaml")
        shutil.copytree(ROOT / "fixtures/demo", place / "fixtures/demo")
        for command in ("run", "discover"):
            subprocess.run([aloft, command, "pipelines/demo.yaml"], check=True, capture_output=True, cwd=place)
        server = Server([aloft, "studio", "pipelines/demo.yaml"], cwd=place)
        with sync_playwright() as p:
            browser = p.chromium.launch(executable_path=a.chromium, args=["--no-sandbox", "--disable-gpu"])
            film = session(browser.new_page(viewport={"width": WIDTH, "height": HEIGHT}), server.address)
            browser.close()
        server.kill()
    path = HERE / "studio_session.webp"
    film.save(path)
    print(f"{path}: {len(film.frames)} frames, {sum(film.milliseconds) / 1e3:.1f} s, {path.stat().st_size} bytes")
    if a.frames:
        a.frames.mkdir(parents=True, exist_ok=True)
        for k, frame in enumerate(film.frames):
            frame.save(a.frames / f"{k:02}.png")


if __name__ == "__main__":
    main()
