"""The console and the viewer as people use them, in Chromium.

Needs Debian's package `chromium` (or `$ETENDUE_CHROMIUM`) and the Python package `playwright`; skipped where they are missing.
With `$ETENDUE_SCREENSHOTS` naming a folder, pictures of the pages are written there.
"""

import hashlib
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import etendue
from etendue.console import serve
from etendue.console.settings import ConsoleSettings
from etendue.console.wire import encode_layer
from etendue.farm.service import Farm

from .conftest import PASSWORD, Background, Runner, actor, packed

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
CHROMIUM = os.environ.get("ETENDUE_CHROMIUM") or shutil.which("chromium")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium: apt-get install chromium, or set $ETENDUE_CHROMIUM")
FLAGS = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking"]
FLAGS += ["--disable-component-update", "--disable-sync"]
SHOTS = os.environ.get("ETENDUE_SCREENSHOTS")
WAIT_MS = 60_000

ROOM = """<scene version="3.0.0">
<sensor type="perspective"><float name="fov" value="45"/>
<transform name="to_world"><lookat origin="0, 1.2, 4.5" target="0, 0.6, 0" up="0, 1, 0"/></transform>
<film type="hdrfilm"><integer name="width" value="160"/><integer name="height" value="90"/></film></sensor>
<emitter type="constant"><rgb name="radiance" value="0.35, 0.4, 0.5"/></emitter>
<bsdf type="diffuse" id="floor"><texture type="checkerboard" name="reflectance"><rgb name="color0" value="0.7, 0.6, 0.5"/>
<rgb name="color1" value="0.3, 0.3, 0.32"/><transform name="to_uv"><scale value="12"/></transform></texture></bsdf>
<shape type="rectangle"><transform name="to_world"><scale value="6"/><rotate x="1" angle="-90"/></transform><ref id="floor"/></shape>
<shape type="sphere"><point name="center" x="-1.1" y="0.6" z="0"/><float name="radius" value="0.6"/>
<bsdf type="roughconductor"><string name="material" value="Au"/><float name="alpha" value="0.15"/></bsdf></shape>
<shape type="sphere"><point name="center" x="0.3" y="0.6" z="-0.4"/><float name="radius" value="0.6"/>
<bsdf type="diffuse"><rgb name="reflectance" value="0.7, 0.12, 0.08"/></bsdf></shape>
<shape type="sphere"><point name="center" x="1.4" y="0.45" z="0.5"/><float name="radius" value="0.45"/><bsdf type="dielectric"/></shape>
<shape type="sphere"><point name="center" x="2.5" y="4" z="2"/><float name="radius" value="0.6"/>
<emitter type="area"><rgb name="radiance" value="18, 16, 13"/></emitter></shape>
</scene>"""


@pytest.fixture(scope="module")
def chromium() -> Iterator[object]:
    with playwright.sync_playwright() as tool:
        browser = tool.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield browser
        browser.close()


class Watched:
    """A page, and what its console has said."""

    def __init__(self, chromium, **options: object) -> None:
        size = {"width": 1360, "height": 860}
        self.context = chromium.new_context(viewport=size, accept_downloads=True, reduced_motion="reduce", **options)
        self.page = self.context.new_page()
        self.page.set_default_timeout(WAIT_MS)
        self.faults: list[str] = []
        self.page.on("console", lambda m: self.faults.append(m.text) if m.type == "error" else None)
        self.page.on("pageerror", lambda e: self.faults.append(str(e)))
        # Names that carry scripts would open one.
        self.page.on("dialog", lambda d: (self.faults.append(f"dialog: {d.message}"), d.dismiss()))

    def shot(self, name: str) -> None:
        if SHOTS:
            self.page.wait_for_timeout(400)
            self.page.screenshot(path=Path(SHOTS) / f"{name}.png")


@pytest.fixture
def watched(chromium) -> Iterator[Watched]:
    made = Watched(chromium)
    yield made
    made.context.close()


@pytest.fixture
def site(farm: Farm, runner: Runner) -> Iterator[str]:
    """The console of a farm that works."""
    farm.accounts.update(actor(farm, "root"), "ada", password=PASSWORD)
    background = Background(runner)
    with serve.running(farm, ConsoleSettings(poll_secs=0.2, local_key="the-key"), port=0) as address:
        yield address
    background.stop()


def state(page) -> str:
    return str(page.evaluate("document.body.dataset.state"))


def until(page, script: str, argument: object = None) -> None:
    """Wait until a script says so. Playwright's own way compiles text in the page, which our pages forbid."""
    end = time.monotonic() + WAIT_MS / 1000
    while not page.evaluate(script, argument):
        assert time.monotonic() < end, script
        page.wait_for_timeout(50)


def wait_for_state(page, *states: str) -> None:
    until(page, "states => states.includes(document.body.dataset.state)", list(states))


def finish(page, farm: Farm, job: int) -> None:
    """Wait until a job is done: a few seconds; much longer only where the machine has a lot else to do."""
    root = actor(farm, "root")
    end = time.monotonic() + 240
    while farm.jobs.get(root, job).state != "done":
        assert time.monotonic() < end, farm.jobs.get(root, job)
        page.wait_for_timeout(100)


def go_by_keys(page, key: str, selector: str) -> None:
    """Go to a page by `g` and a key; again where a busy machine took more than 1.5 s between both."""
    for _ in range(10):
        page.keyboard.press("g")
        page.keyboard.press(key)
        try:
            page.wait_for_selector(selector, timeout=WAIT_MS / 10)
        except playwright.TimeoutError:
            continue
        return
    raise AssertionError(selector)


def cancel(page) -> None:
    page.click("#do-cancel")
    page.click("dialog button:has-text('Cancel the rendering')")
    wait_for_state(page, "cancelled")


def colors(page, selector: str = "#stage canvas") -> int:
    """Return how many colors the picture has: 1 for an empty one."""
    script = """s => { const c = document.querySelector(s);
        const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
        const seen = new Set(); for (let i = 0; i < d.length; i += 4)
            seen.add(d[i] << 16 | d[i + 1] << 8 | d[i + 2]); return seen.size; }"""
    return int(page.evaluate(script, selector))


def mean(page, selector: str = "#stage canvas") -> float:
    script = """s => { const c = document.querySelector(s);
        const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
        let sum = 0; for (let i = 0; i < d.length; i += 4) sum += d[i] + d[i + 1] + d[i + 2]; return sum / (d.length * 0.75); }"""
    return float(page.evaluate(script, selector))


def test_from_signing_in_to_the_file(site: str, watched: Watched, farm: Farm, tmp_path: Path) -> None:
    page = watched.page
    page.goto(site)
    page.fill("#name", "ada")
    page.fill("#password", "wrong password")
    page.click("button:has-text('Sign in')")
    page.wait_for_selector(".fault:visible")
    assert page.text_content(".fault") == "Name or password is wrong"
    # The refusal itself is told by the browser.
    watched.faults.clear()
    watched.shot("sign-in")
    page.fill("#password", PASSWORD)
    page.keyboard.press("Enter")
    page.wait_for_selector("#jobs")
    assert page.text_content("#who") == "ada"

    # A file that is no scene is refused with a sentence; then one that is.
    go_by_keys(page, "s", "#drop")
    page.set_input_files("#file", {"name": "notes.txt", "mimeType": "text/plain", "buffer": b"hello"})
    page.wait_for_selector("#main > .fault:visible")
    assert "zip files or single scenes" in page.text_content("#main > .fault")
    watched.faults.clear()
    lossy = ROOM.replace("</scene>", '<shape type="sphere"><float name="flip" value="1"/></shape></scene>')
    page.set_input_files("#file", {"name": "lossy.xml", "mimeType": "text/xml", "buffer": lossy.encode()})
    page.wait_for_selector("#report:visible, #main > .fault:visible")
    data = packed(room_xml=ROOM).read()
    # Dropped, as people do.
    transfer = page.evaluate_handle(
        "bytes => { const t = new DataTransfer(); t.items.add(new File([new Uint8Array(bytes)], 'room.zip')); return t; }", list(data)
    )
    page.dispatch_event("#drop", "drop", {"dataTransfer": transfer})
    until(page, "document.querySelector('#report h2')?.textContent === 'room.zip'")
    assert "Everything in this scene is honored" in page.text_content("#report")
    watched.faults.clear()
    name = "Room <img src=x onerror=alert(1)>"
    page.fill("#job-name", name)
    # More than will be done while we look.
    page.fill("#spp", "20000")
    page.check("#aov-normal")
    watched.shot("submit")
    page.click("#send")

    # Progress and picture come while it runs.
    page.wait_for_selector("#stage[data-version]")
    first = int(page.get_attribute("#stage", "data-version"))
    assert page.text_content("h1") == name
    until(page, "v => Number(document.querySelector('#stage').dataset.version) > v", first)
    assert colors(page) > 50
    assert 0 < float(page.evaluate("document.querySelector('.meter progress').value")) < 1
    assert state(page) == "running"
    watched.shot("job-running")
    page.select_option("#compare", "split")
    watched.shot("job-compare")
    page.select_option("#compare", "off")

    # Cancel, go on, and cancel again.
    cancel(page)
    page.click("#do-retry")
    wait_for_state(page, "running")
    first = int(page.get_attribute("#stage", "data-version"))
    until(page, "v => Number(document.querySelector('#stage').dataset.version) > v", first)
    cancel(page)
    # The same again, with so few samples that it ends.
    page.click("a:has-text('Submit again')")
    page.wait_for_selector("#order:visible")
    until(page, "document.querySelector('#spp').value === '20000'")
    page.fill("#spp", "4")
    page.click("#send")
    page.wait_for_selector("#stage[data-version]")
    wait_for_state(page, "done")
    until(page, "document.querySelector('#progress').textContent === '100 %'")
    page.wait_for_selector("#downloads a:has-text('EXR')")

    # Exposure and layers are the browser's.
    before = mean(page)
    page.evaluate("document.activeElement.blur()")
    for _ in range(3):
        page.keyboard.press("e")
    until(page, "document.querySelector('output').textContent === '+1.5 stops'")
    page.wait_for_timeout(100)
    assert mean(page) > before + 10
    page.select_option("#layer", "normal")
    until(page, "document.querySelector('#layer').value === 'normal'")
    page.select_option("#layer", "rgb")
    box = page.locator("#stage").bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    until(page, "document.querySelector('.pixel').textContent.includes(':')")
    page.mouse.wheel(0, -600)
    until(page, "parseFloat(document.querySelector('.under .mono').textContent) > 1000")

    with page.expect_download() as waiting:
        page.click("#downloads a:has-text('EXR')")
    file = tmp_path / "room.exr"
    waiting.value.save_as(file)
    job = farm.jobs.find(actor(farm, "ada")).items[0]
    output = next(o for o in farm.pictures.outputs(actor(farm, "ada"), job.id) if o.format == "exr")
    assert hashlib.sha256(file.read_bytes()).hexdigest() == output.sha256
    with page.expect_download() as waiting:
        page.click("#save-png")
    waiting.value.save_as(tmp_path / "room.png")
    assert etendue.read_image(tmp_path / "room.png").shape == (90, 160, 3)

    for tab in ("units", "files", "log", "scene"):
        page.click(f"#tab-{tab}")
        page.wait_for_selector(f"#panel-{tab}:visible")
    page.click("#tab-units")
    page.wait_for_selector("#units tbody tr")
    page.click("#tab-log")
    page.wait_for_selector(".log tbody tr")
    assert "submitted" in page.text_content("#panel-log")

    # The table: names are text, filters and keys work.
    page.click("a.brand")
    page.wait_for_selector("#jobs tbody tr")
    assert page.text_content("#jobs .name") == name
    page.keyboard.press("/")
    page.keyboard.type("nothing of the kind")
    page.wait_for_selector(".nothing:visible")
    page.fill("#search", "room")
    page.wait_for_selector("#jobs tbody tr")
    page.keyboard.press("Escape")
    page.keyboard.press("j")
    page.keyboard.press("Enter")
    page.wait_for_selector("#stage")
    assert not watched.faults


def test_bakes_studies_and_photon_maps_from_the_page(site: str, watched: Watched, farm: Farm, runner: Runner) -> None:
    me = farm.accounts.local()
    package = farm.upload(me, packed(room_xml=ROOM), "room.zip")
    page = watched.page
    page.goto(f"{site}/enter?key=the-key")
    page.wait_for_selector("#main h1")
    orders: dict[str, dict[str, str]] = {
        "bake": {"#bake-resolution": "96", "#spp": "8"},
        "photons": {"#photons": "20000"},
        "study": {"#axes": "integrator=path,normals\nspp=1,2"},
    }
    made = {"bake": {"room.glb"}, "photons": {"room.photons"}, "study": {f"room.{n:04}.exr" for n in (1, 2, 3, 4)}}
    for command, fields in orders.items():
        page.goto(f"{site}/submit?package={package.id}")
        page.wait_for_selector("#order:visible")
        assert page.is_visible("#frames-field")
        page.select_option("#command", command)
        assert not page.is_visible("#frames-field")
        for field, value in fields.items():
            page.fill(field, value)
        if command == "study":
            page.uncheck("#format-png")
        watched.shot(f"submit-{command}")
        page.click("#send")
        page.wait_for_selector("#stage[data-version]")
        wait_for_state(page, "done")
        page.wait_for_selector("#downloads a")
        job = farm.jobs.find(me).items[0]
        assert {o.name for o in farm.pictures.outputs(me, job.id)} == made[command]
        until(page, "document.querySelector('#progress').textContent === '100 %'")
        assert colors(page) > 50
        watched.shot(f"job-{command}")
        # What was ordered comes back into the form.
        page.click("a:has-text('Submit again')")
        page.wait_for_selector("#order:visible")
        until(page, "c => document.querySelector('#command').value === c", command)
        for field, value in fields.items():
            assert page.input_value(field) == value
    assert not watched.faults


CUT_OFF = """{
    const real = window.fetch;
    let isFirst = true;
    window.fetch = async (url, options) => {
        const response = await real(url, options);
        if (isFirst && String(url).includes('/layers/') && response.status === 200) {
            isFirst = false;
            window.isCutOff = false;
            const { signal } = options;
            response.arrayBuffer = () => new Promise((_, reject) => signal.addEventListener('abort', () => {
                window.isCutOff = true;
                reject(signal.reason);
            }));
        }
        return response;
    };
}"""


def test_a_picture_cut_off_half_way_is_asked_for_again(site: str, watched: Watched, farm: Farm) -> None:
    ada = actor(farm, "ada")
    package = farm.upload(ada, packed(room_xml=ROOM), "room.zip")
    job = farm.jobs.submit(ada, {"package": package.id, "settings": {"spp": 4, "width": 48}})
    page = watched.page
    page.goto(f"{site}/enter?key=the-key")
    finish(page, farm, job.id)
    page.add_init_script(CUT_OFF)
    page.goto(f"{site}/jobs/{job.id}")
    until(page, "window.isCutOff === false")
    # News of the job has the page ask again while its first answer is still on the way.
    farm.jobs.set_priority(ada, job.id, 7)
    until(page, "window.isCutOff === true")
    page.wait_for_selector("#stage[data-version]")


def test_every_page_in_both_themes_is_accessible(site: str, watched: Watched, farm: Farm, runner: Runner) -> None:
    ada = actor(farm, "ada")
    package = farm.upload(ada, packed(room_xml=ROOM), "room.zip")
    for number in range(3):
        order = {"package": package.id, "name": f"shot {number:02}", "settings": {"spp": 4, "width": 48}, "priority": number}
        farm.jobs.submit(ada, order)
    spin = farm.upload(ada, packed(spin_pov=SPIN), "spin.zip")
    film = farm.jobs.submit(ada, {"package": spin.id, "frames": "1-6", "settings": {"width": 128, "height": 72}, "formats": ["exr", "png"]})
    page = watched.page
    page.goto(f"{site}/enter?key=the-key")
    page.wait_for_selector("#jobs tbody tr")
    finish(page, farm, film.id)
    paths = {"jobs": "/", "job": f"/jobs/{film.id}", "submit": f"/submit?package={package.id}", "nodes": "/nodes", "cost": "/cost"}
    paths |= {"log": "/log", "account": "/account", "users": "/users"}
    for theme in ("light", "dark"):
        page.evaluate("t => localStorage.setItem('etendue-theme', t)", theme)
        for name, path in paths.items():
            page.goto(site + path)
            page.wait_for_selector("#main h1")
            page.wait_for_timeout(250)
            if name == "job":
                page.wait_for_selector("#stage[data-version]")
                page.wait_for_selector("#frames img:visible")
            watched.shot(f"{name}-{theme}")
            assert page.evaluate(NAMELESS) == [], (name, theme)
            assert page.evaluate(PALE) == [], (name, theme)
    page.set_viewport_size({"width": 420, "height": 800})
    for path in ("/", f"/jobs/{film.id}", "/submit"):
        page.goto(site + path)
        page.wait_for_selector("#main h1")
        assert page.evaluate("document.documentElement.scrollWidth") <= 421, path
    watched.shot("narrow")
    assert not watched.faults


SPIN = """#version 3.7; global_settings { assumed_gamma 1 }
camera { location <0, 2, -6> look_at <0, 0.6, 0> right x*16/9 } light_source { <5, 9, -7> rgb 1 } background { rgb <0.2, 0.3, 0.45> }
plane { y, 0 pigment { checker rgb 0.8 rgb 0.35 } }
box { -0.7, 0.7 rotate <0, 90 * clock, 0> translate y * 0.7 pigment { rgb <0.95, 0.6, 0.1> } finish { specular 0.5 } }
sphere { <2 * cos(2 * pi * clock), 0.4, 2 * sin(2 * pi * clock)>, 0.4 pigment { rgb <0.2, 0.4, 0.9> } finish { reflection 0.3 } }
"""

NAMELESS = """() => [...document.querySelectorAll('button, a[href], input, select, textarea, [role=img], progress')].filter(e => {
    if (e.hidden || !e.getClientRects().length && !e.matches('.visually-hidden')) return false;
    const labels = e.labels ? [...e.labels].map(l => l.textContent).join('') : '';
    const text = e.matches('input, select, textarea, progress') ? '' : e.textContent;
    return !(e.getAttribute('aria-label') || labels || text || '').trim() && !e.getAttribute('aria-labelledby');
}).map(e => e.outerHTML.slice(0, 120))"""

PALE = """() => {
    const parse = c => { const m = c.match(/[\\d.]+/g).map(Number);
        return c.startsWith('color(') ? [...m.slice(0, 3).map(v => 255 * v), m[3] ?? 1] : [...m.slice(0, 3), m[3] ?? 1]; };
    const light = ([r, g, b]) => { const f = v => (v /= 255) <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4;
        return 0.2126 * f(r) + 0.7152 * f(g) + 0.0722 * f(b); };
    const behind = e => { for (; e; e = e.parentElement) {
            const c = parse(getComputedStyle(e).backgroundColor); if (c[3] > 0.99) return c; }
        return [255, 255, 255, 1]; };
    const bad = [];
    for (const e of document.querySelectorAll('body *')) {
        const own = [...e.childNodes].some(n => n.nodeType === 3 && n.textContent.trim());
        if (!own || !e.getClientRects().length || e.matches(':disabled, option, .visually-hidden, .skip, noscript')) continue;
        if (e.closest('.stage')) continue;
        const [a, b] = [light(parse(getComputedStyle(e).color)), light(behind(e))];
        const ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
        if (ratio < 4.5) bad.push(`${ratio.toFixed(2)} ${e.tagName}.${e.className}: ${e.textContent.trim().slice(0, 30)}`);
    }
    return bad;
}"""


def test_the_browser_maps_tones_as_the_renderer_does(site: str, watched: Watched) -> None:
    rng = np.random.default_rng(3)
    picture = np.exp2(rng.uniform(-12, 9, (24, 32, 3))).astype(np.float32)
    picture[0, 0] = [0.0, -1.0, 70000.0]
    message = list(encode_layer("rgb", picture, {}))
    watched.page.goto(site)
    halves = np.clip(picture, -65504, 65504).astype(np.float16).astype(np.float32)
    for operator in ("standard", "filmic", "aces", "agx"):
        for exposure in (0.0, -2.5):
            script = """async ([bytes, operator, exposure]) => {
                const { decode } = await import('/static/js/picture.js');
                const { develop } = await import('/static/js/tone.js');
                return [...develop(decode(new Uint8Array(bytes).buffer), { operator, exposure })];
            }"""
            shown = np.array(watched.page.evaluate(script, [message, operator, exposure])).reshape(24, 32, 4)
            expected = etendue.tonemap(halves, operator, exposure=exposure) * 255
            assert np.abs(shown[:, :, :3] - expected).max() < 1.01, (operator, exposure)
            assert (shown[:, :, 3] == 255).all()


def test_view_follows_the_hand(watched: Watched, tmp_path: Path) -> None:
    scene = tmp_path / "room.xml"
    scene.write_text(ROOM)
    command = [sys.executable, "-m", "etendue", "view", str(scene), "--no-browser", "--spp", "256", "--width", "320"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            url = re.search(r"http://\S+", process.stdout.readline())
            assert url is not None
            page = watched.page
            page.goto(url[0])
            until(page, "Number(document.body.dataset.spp) >= 16")
            # The key is not in the address any more.
            assert "token" not in page.url
            assert colors(page) > 50
            watched.shot("view")
            before = page.evaluate("document.querySelector('canvas').toDataURL()")
            generation = int(page.evaluate("document.body.dataset.generation"))
            box = page.locator("#stage").bounding_box()
            x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
            page.mouse.move(x, y)
            page.mouse.down()
            for step in range(8):
                page.mouse.move(x + 12 * step, y + 4 * step)
                page.wait_for_timeout(20)
            page.mouse.up()
            until(page, "g => Number(document.body.dataset.generation) > g && Number(document.body.dataset.spp) >= 16", generation)
            assert page.evaluate("document.querySelector('canvas').toDataURL()") != before
            page.keyboard.press("l")
            until(page, "document.querySelector('#layer').value !== 'rgb'")
            page.keyboard.press("Shift+L")
            generation = int(page.evaluate("document.body.dataset.generation"))
            page.select_option("#integrator", "normals")
            until(page, "g => Number(document.body.dataset.generation) > g", generation)
            with page.expect_download() as waiting:
                page.click("#save-png")
            waiting.value.save_as(tmp_path / "saved.png")
            assert etendue.read_image(tmp_path / "saved.png").shape == (180, 320, 3)
            # A mistake in the file is told, and its correction shown.
            scene.write_text(ROOM.replace('type="dielectric"', 'type="dielectrc"'))
            page.wait_for_selector("#error:visible")
            assert "dielectrc" in page.text_content("#error")
            scene.write_text(ROOM.replace("0.7, 0.12, 0.08", "0.1, 0.2, 0.9"))
            page.wait_for_selector("#error", state="hidden")
            assert page.evaluate(NAMELESS) == []
            assert page.evaluate(PALE) == []
            assert not watched.faults
        finally:
            process.terminate()
