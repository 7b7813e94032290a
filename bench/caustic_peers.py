"""How well does `--integrator auto` find caustics, against other programs at equal CPU time?

Renders caustic.xml of a folder with scenes by `auto` and by those peers that are given: Mitsuba's `path` and `ptracer`, any variant of it,
and LuxCore's `BIDIRCPU` (the scene rebuilt through its API, spheres as meshes of 256 × 128, the mirror without Fresnel's change with the
angle). Each picture takes about the given CPU seconds of all threads, and two seeds are averaged. Prints a Markdown table of
relMSE = mean((x − ref)² / (ref² + 0.01)) without the worst 0.1% of the pixels, against the folder's reference picture (whose own noise
counts as everyone's error), of 1 / (relMSE × CPU seconds), and of *noise*: the same error as the two seeds show it, which knows nothing of
the reference, of blur and of differences between the scenes.

    python bench/caustic_peers.py SCENES_FOLDER [--etendue target/release/etendue] [--seconds 12] [--mitsuba PYTHON] [--luxcore PYTHON]

PYTHON is an interpreter with the packages mitsuba (and numpy), or pyluxcore (and numpy). For variants of Mitsuba that need LLVM set
DRJIT_LIBLLVM_PATH. What loads, compiles or warms up does not count for peers; for `auto` all but loading counts, its pilot included. Needs
numpy and OpenEXR.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenEXR
from caustics import relmse
from methods import read_pfm

# A renderer: samples (or passes) and seed in, picture and CPU seconds out.
Render = Callable[[int, int], "tuple[np.ndarray, float]"]

MITSUBA = """
import sys, time, numpy as np, mitsuba as mi
variant, scene, integrator, spp, seed, out = sys.argv[1:]
mi.set_variant(variant)
scene = mi.load_file(scene)
how = mi.load_dict({"type": integrator, "max_depth": 16, "rr_depth": 5})
if variant.startswith("llvm"):
    np.array(mi.render(scene, integrator=how, spp=int(spp), seed=1000))
before = time.process_time()
picture = np.array(mi.render(scene, integrator=how, spp=int(spp), seed=int(seed)))
used = time.process_time() - before
np.save(out, picture[..., :3])
print(used)
"""

LUXCORE = """
import math, os, sys, time, numpy as np, pyluxcore as lux
folder, passes, seed, out = sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), sys.argv[4]
lux.Init(lambda text: None)
scene = lux.Scene()
def give(text):
    p = lux.Properties()
    p.SetFromString(text)
    scene.Parse(p)
def ball(name, center, radius, columns=256, rows=128):
    points, normals, triangles = [], [], []
    for j in range(rows + 1):
        for i in range(columns):
            t, f = math.pi * j / rows, 2 * math.pi * i / columns
            n = (math.sin(t) * math.cos(f), math.cos(t), math.sin(t) * math.sin(f))
            normals.append(n)
            points.append(tuple(c + radius * x for c, x in zip(center, n)))
    for j in range(rows):
        for i in range(columns):
            a, b = j * columns + i, j * columns + (i + 1) % columns
            triangles += [(a, b, b + columns), (a, b + columns, a + columns)]
    scene.DefineMesh(name, points, triangles, normals, None, None, None)
give('''
scene.camera.type = "perspective"
scene.camera.lookat.orig = 0 0 3.9
scene.camera.lookat.target = 0 0 0
scene.camera.up = 0 1 0
scene.camera.fieldofview = 50.91732
scene.camera.lensradius = 0
scene.camera.autofocus.enable = 0
scene.materials.white.type = "matte"
scene.materials.white.kd = 0.7 0.7 0.7
scene.materials.left.type = "matte"
scene.materials.left.kd = 0.35 0.35 0.35
scene.materials.right.type = "matte"
scene.materials.right.kd = 0.5 0.5 0.5
scene.materials.glass.type = "glass"
scene.materials.glass.kr = 1 1 1
scene.materials.glass.kt = 1 1 1
scene.materials.glass.interiorior = 1.5
scene.materials.glass.exteriorior = 1.0
scene.materials.mirror.type = "mirror"
scene.materials.mirror.kr = 0.9 0.9 0.9
scene.materials.lamp.type = "matte"
scene.materials.lamp.kd = 0 0 0
scene.materials.lamp.emission = 110 95 75
''')
ball("m_glass", (0.55, -0.55, 0.25), 0.45)
ball("m_mirror", (-0.55, -0.5, -0.35), 0.5)
ball("m_lamp", (0, 0.8, 0), 0.06, 64, 32)
text = ""
for name, material in dict(floor="white", ceiling="white", back="white", left="left", right="right").items():
    text += f'scene.shapes.m_{name}.type = "mesh"\\nscene.shapes.m_{name}.ply = "{folder}/meshes/caustic_{name}.ply"\\n'
    text += f'scene.objects.{name}.shape = "m_{name}"\\nscene.objects.{name}.material = "{material}"\\n'
for name in ("glass", "mirror", "lamp"):
    text += f'scene.objects.o_{name}.shape = "m_{name}"\\nscene.objects.o_{name}.material = "{name}"\\n'
give(text)
config = lux.Properties()
config.SetFromString(f'''
renderengine.type = "BIDIRCPU"
renderengine.seed = {seed + 1}
sampler.type = "SOBOL"
path.maxdepth = 16
light.maxdepth = 16
film.width = 400
film.height = 300
film.filter.type = "NONE"
film.imagepipelines.0.0.type = "NOP"
film.outputs.1.type = "RGB"
film.outputs.1.filename = "out.exr"
batch.haltspp = {passes}
''')
session = lux.RenderSession(lux.RenderConfig(config, scene))
before = time.process_time()
session.Start()
while not session.HasDone():
    time.sleep(0.02)
    session.UpdateStats()
used = time.process_time() - before
film = session.GetFilm()
picture = np.zeros(400 * 300 * 3, np.float32)
film.GetOutputFloat(lux.FilmOutputType.RGB, picture, 0)
np.save(out, picture.reshape(300, 400, 3)[::-1])
session.Stop()
print("CPU", used, flush=True)
# Its own end of a process may crash.
os._exit(0)
"""


def own(command: str, scene: Path, out: Path) -> Render:
    """Return `auto`."""

    def run(method: str, spp: int, seed: int) -> float:
        before = cpu_seconds()
        options = ["--integrator", method, "--spp", str(spp), "--seed", str(seed), "--filter", "box", "-q", "-o", str(out)]
        subprocess.run([command, "render", str(scene), "--width", "400", "--height", "300", *options], check=True, stderr=subprocess.PIPE)
        return cpu_seconds() - before

    load = min(run("normals", 1, 0) for _ in range(2))

    def render(spp: int, seed: int) -> tuple[np.ndarray, float]:
        used = run("auto", spp, seed) - load
        return read_pfm(out), used

    return render


def peer(python: str, script: str, arguments: list[str], out: Path) -> Render:
    """Return a program that is driven by a script."""

    def render(spp: int, seed: int) -> tuple[np.ndarray, float]:
        run = [python, "-c", script, *arguments, str(spp), str(seed), str(out)]
        done = subprocess.run(run, check=True, capture_output=True, text=True)
        return np.load(out).astype(np.float64), float(done.stdout.split()[-1])

    return render


def cpu_seconds() -> float:
    """Return the CPU seconds of all children that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def measure(name: str, render: Render, reference: np.ndarray, seconds: float) -> str:
    """Return a row: samples for about so many CPU seconds, and the mean error of two pictures."""
    spp = 2
    while (used := render(spp, 1)[1]) < seconds / 3:
        spp *= 2
    spp = max(1, round(spp * seconds / used))
    pictures, times = zip(*(render(spp, seed) for seed in (2, 3)), strict=True)
    used, error = float(np.mean(times)), float(np.mean([relmse(p, reference) for p in pictures]))
    # Half of the squared difference of two pictures is the variance of one.
    noise = relmse(reference + (pictures[0] - pictures[1]) / np.sqrt(2), reference)
    mean = float(np.mean(pictures) / reference.mean() - 1)
    return f"| {name} | {spp} | {used:.1f} | {error:.4f} | {noise:.4f} | {mean:+.2%} | {1 / (used * error):.3g} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="holds caustic.xml and refs/caustic.exr")
    parser.add_argument("--etendue", default="target/release/etendue", help="the command")
    parser.add_argument("--seconds", type=float, default=12.0, help="CPU seconds of a picture")
    parser.add_argument("--mitsuba", metavar="PYTHON", help="a Python with the package mitsuba")
    parser.add_argument("--variant", action="append", default=[], help="variants of Mitsuba; default: scalar_rgb and llvm_ad_rgb")
    parser.add_argument("--luxcore", metavar="PYTHON", help="a Python with the package pyluxcore")
    args = parser.parse_args()
    with OpenEXR.File(str(args.folder / "refs/caustic.exr")) as f:
        reference = f.channels()["RGB"].pixels.astype(np.float64)
    sys.stdout.write("| program | samples | CPU s | relMSE | noise | mean | efficiency |\n" + "|---" * 7 + "|\n")
    with tempfile.TemporaryDirectory() as temporary:
        out = Path(temporary)
        scene = args.folder / "caustic.xml"
        rows = [("`auto`", own(args.etendue, scene, out / "o.pfm"))]
        if args.mitsuba:
            for variant in args.variant or ["scalar_rgb", "llvm_ad_rgb"]:
                for method in ("path", "ptracer"):
                    arguments = [variant, str(scene), method]
                    rows.append((f"Mitsuba `{method}`, {variant}", peer(args.mitsuba, MITSUBA, arguments, out / "m.npy")))
        if args.luxcore:
            rows.append(("LuxCore `BIDIRCPU`", peer(args.luxcore, LUXCORE, [str(args.folder.resolve())], out / "l.npy")))
        for name, render in rows:
            sys.stdout.write(measure(name, render, reference, args.seconds) + "\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
