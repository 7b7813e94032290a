"""Do all methods make the same picture? Z-tests between them, on scenes that all of them can render.

Renders each scene with a reference method (`path`; `bdpt` where small lamps shine through glass) and with the others, with several
seeds, and compares means over blocks of the picture: a difference is measured in its own standard error, found from the spread between
seeds. Prints a Markdown table: the deviation of the whole picture's mean and how many standard errors that is (Z), the noise of a block,
the share of blocks beyond three standard errors (1% by chance with 8 seeds), the largest t of a block after the stated allowance. Ends
with code 1 where any block of any method differs by more than chance (1% for the whole picture, Šidák's correction for its blocks) and
the allowance explain.

Methods with a blur (`sppm`, `pathmap`, `vcm`, `particles`) are rendered with two radii, and what they would give with none is
extrapolated: for `pathmap` and `vcm` the error falls with the square of the radius, for `sppm` and `particles`, whose seams along edges
and borders of media are dark, with the radius.

    python bench/methods.py [SCENES_FOLDER] [--etendue target/release/etendue] [--seeds 8] [--effort 1] [--scene NAME] [--method NAME]

SCENES_FOLDER may hold cornell.xml, caustic.xml and many-lights.xml; without it the small scenes of this file alone are rendered.
Needs numpy only.
"""

from __future__ import annotations

import argparse
import math
import resource
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

WIDTH, HEIGHT, BLOCK = 64, 48, 8
# (samples per pixel, first radius over the scene's unit or none, allowance)
METHODS = {
    "path": (128, None, 0.0),
    "bdpt": (24, None, 0.005),
    "vcm": (16, 1.0, 0.02),
    "mlt": (48, None, 0.01),
    "light": (48, None, 0.005),
    "mnee": (64, None, 0.005),
    "pathmap": (32, 1.0, 0.02),
    "sppm": (24, 1.0, 0.02),
    "photon": (24, 1.0, 0.05),
    "particles": (16, 1.0, 0.06),
    "radiosity": (16, None, 0.03),
}
BLURRED = {"vcm": 2.0, "sppm": 1.0, "pathmap": 2.0, "particles": 1.0}

HEAD = """<scene version="3.0.0"><integrator type="path"/>
<sensor type="perspective"><string name="fov_axis" value="y"/><float name="fov" value="{fov}"/>
<transform name="to_world"><lookat origin="{eye}" target="{target}" up="0, 1, 0"/></transform>
<film type="hdrfilm"><integer name="width" value="64"/><integer name="height" value="48"/><rfilter type="box"/></film></sensor>
<bsdf type="twosided" id="white"><bsdf type="diffuse"><rgb name="reflectance" value="0.7, 0.7, 0.7"/></bsdf></bsdf>
<bsdf type="twosided" id="red"><bsdf type="diffuse"><rgb name="reflectance" value="0.6, 0.2, 0.1"/></bsdf></bsdf>
<bsdf type="twosided" id="black"><bsdf type="diffuse"><rgb name="reflectance" value="0, 0, 0"/></bsdf></bsdf>
<bsdf type="dielectric" id="glass"><float name="int_ior" value="1.5"/><float name="ext_ior" value="1.0"/></bsdf>
<bsdf type="twosided" id="mirror"><bsdf type="conductor"><rgb name="eta" value="1, 1, 1"/><rgb name="k" value="6, 6, 6"/></bsdf></bsdf>
"""


def wall(material: str, turn: str, at: str) -> str:
    """Return a wall of 2 × 2."""
    return f'<shape type="rectangle"><transform name="to_world">{turn}<translate value="{at}"/></transform><ref id="{material}"/></shape>\n'


def block(material: str, turn: str, at: str) -> str:
    """Return a block of 2 × 2 × 2."""
    return wall(material, turn, at).replace('"rectangle"', '"cube"')


def ball(at: str, radius: float, material: str, light: str = "", inside: str = "") -> str:
    """Return a sphere."""
    glow = f'<emitter type="area"><rgb name="radiance" value="{light}"/></emitter>' if light else ""
    body = f'<point name="center" value="{at}"/><float name="radius" value="{radius}"/><ref id="{material}"/>{glow}{inside}'
    return f'<shape type="sphere">{body}</shape>\n'


ROOM = (
    HEAD.format(fov=39, eye="0, 0, 3.9", target="0, 0, 0")
    + wall("white", '<rotate x="1" angle="-90"/>', "0, -1, 0")
    + wall("white", '<rotate x="1" angle="90"/>', "0, 1, 0")
    + wall("white", "", "0, 0, -1")
    + wall("red", '<rotate y="1" angle="90"/>', "-1, 0, 0")
    + wall("white", '<rotate y="1" angle="-90"/>', "1, 0, 0")
)
FOG = (
    '<medium type="homogeneous" id="fog"><rgb name="sigma_t" value="0.8, 0.7, 0.6"/><rgb name="albedo" value="0.8, 0.8, 0.8"/>'
    '<phase type="hg"><float name="g" value="0.3"/></phase></medium><bsdf type="null" id="none"/>\n'
)
LAMP = ball("0.1, 0.55, 0", 0.2, "black", "8, 7, 5")
GLASS = ball("0.45, -0.55, 0.2", 0.4, "glass")
MIRROR = ball("-0.45, -0.55, -0.2", 0.4, "mirror")
END = "</scene>\n"
HIDDEN = '<integrator type="path"><boolean name="hide_emitters" value="true"/>'


@dataclass
class Scene:
    """A scene with the methods that can render all of it."""

    text: str
    methods: list[str]
    # A length that photons' radii are shares of.
    unit: float = 1.0
    # What the others are compared with.
    reference: str = "path"


LIGHT_FROM_BOTH_ENDS = ["bdpt", "vcm", "mlt", "sppm", "photon", "particles"]
DIFFUSE = [*LIGHT_FROM_BOTH_ENDS, "light", "radiosity"]
SMALL = {
    "room": Scene(ROOM + LAMP + ball("-0.35, -0.6, 0", 0.4, "red") + END, DIFFUSE),
    "glass": Scene(ROOM + LAMP + GLASS + MIRROR + END, [*LIGHT_FROM_BOTH_ENDS, "pathmap"]),
    "sky": Scene(
        HEAD.format(fov=39, eye="0, 0.6, 4.5", target="0, -0.4, 0")
        + wall("white", '<scale value="3"/><rotate x="1" angle="-90"/>', "0, -1, 0")
        + block("red", '<scale x="0.3" y="0.8" z="0.3"/><rotate y="1" angle="25"/>', "-0.7, -0.4, -0.3")
        + block("white", '<scale x="0.35" y="0.35" z="0.35"/><rotate y="1" angle="-20"/>', "0.1, -0.65, 0.5")
        + ball("0.9, -0.55, 0", 0.45, "red")
        + '<emitter type="sky"><vector name="sun_direction" value="0.5, 0.4, 0.6"/><float name="sky_scale" value="5"/></emitter>'
        + END,
        DIFFUSE,
    ),
    "fog": Scene(
        FOG + ROOM + LAMP + ball("0, -0.35, 0.1", 0.6, "none", inside='<ref name="interior" id="fog"/>') + END,
        LIGHT_FROM_BOTH_ENDS,
    ),
    "furnace": Scene(
        HEAD.format(fov=35, eye="0, 0, 5", target="0, 0, 0")
        + ball("0, 0, 0", 1.0, "white")
        + ball("1.2, -0.5, 0.3", 0.4, "glass")
        + '<emitter type="constant"><rgb name="radiance" value="1, 1, 1"/></emitter>'
        + END,
        LIGHT_FROM_BOTH_ENDS,
    ),
}
# Scenes of others: their methods and reference.
SHARED = {
    "cornell": (DIFFUSE, "path"),
    "caustic": (["path", "vcm", "mlt", "mnee", "pathmap", "sppm", "photon", "particles"], "bdpt"),
    "many-lights": (DIFFUSE, "path"),
}


def fog_first(text: str) -> str:
    """Move what is before the scene's element into it."""
    start = text.index("<scene")
    head, rest = text[:start], text[start:]
    end = rest.index(">") + 1
    return rest[:end] + head + rest[end:]


def read_pfm(path: Path) -> np.ndarray:
    """Return a picture (height, width, 3)."""
    with path.open("rb") as f:
        kind, size, scale = f.readline(), f.readline().split(), float(f.readline())
        width, height = int(size[0]), int(size[1])
        values = np.frombuffer(f.read(), "<f4" if scale < 0 else ">f4")
    channels = 3 if kind.strip() == b"PF" else 1
    return np.flipud(values.reshape(height, width, channels)).astype(np.float64)


def blocks(picture: np.ndarray) -> np.ndarray:
    """Return the means of blocks (rows, columns, 3)."""
    h, w = HEIGHT // BLOCK, WIDTH // BLOCK
    means: np.ndarray = picture.reshape(h, BLOCK, w, BLOCK, 3).mean((1, 3))
    return means


class Runner:
    """Renders and remembers nothing but blocks."""

    def __init__(self, args: argparse.Namespace, folder: Path) -> None:
        """Render by the command of the arguments, with files in `folder`."""
        self.args, self.folder = args, folder

    def render(self, scene: Path, method: str, spp: int, seed: int, extra: list[str]) -> np.ndarray:
        """Return the blocks of one picture."""
        out = self.folder / "out.pfm"
        size = ["--width", str(WIDTH), "--height", str(HEIGHT), "--filter", "box", "--max-depth", str(self.args.depth)]
        run = [
            self.args.etendue,
            "render",
            str(scene),
            "--integrator",
            method,
            *size,
            "--spp",
            str(spp),
            "--seed",
            str(seed),
            "-q",
            "-o",
            str(out),
        ]
        subprocess.run([*run, *self.args.search, *extra], check=True, stderr=subprocess.PIPE)
        return blocks(read_pfm(out))

    def seeds(self, scene: Path, method: str, unit: float) -> np.ndarray:
        """Return the blocks of all seeds (seed, rows, columns, 3), without blur."""
        spp, radius, _ = METHODS[method]
        spp = max(1, int(spp * self.args.effort))
        first = 1000 * (1 + list(METHODS).index(method))
        found = []
        for i in range(self.args.seeds):
            if method in BLURRED and radius is not None:
                wide, narrow = (
                    self.render(scene, method, spp, first + 2 * i + k, ["--photon-radius", str(0.08 * unit / (1 + k)), *photons(method)])
                    for k in (0, 1)
                )
                factor = 2.0 ** BLURRED[method]
                found.append((factor * narrow - wide) / (factor - 1.0))
            else:
                found.append(self.render(scene, method, spp, first + i, photons(method)))
        return np.stack(found)


def photons(method: str) -> list[str]:
    """Return the settings of a method's photons; so few that a disk of the given radius limits what an estimate of a map sees."""
    return {
        "sppm": ["--photons", "30000"],
        "pathmap": ["--photons", "30000"],
        "photon": ["--photons", "300000"],
        "particles": ["--photons", "10000", "--photon-neighbors", "256"],
        "radiosity": ["--radiosity-gather", "1"],
    }.get(method, [])


def student(t: float, freedom: int) -> float:
    """Return the two-sided probability of a larger |t|."""
    angle = np.linspace(math.atan(abs(t) / math.sqrt(freedom)), math.pi / 2, 20001)
    density = np.cos(angle) ** (freedom - 1)
    norm = math.gamma((freedom + 1) / 2) / (math.gamma(freedom / 2) * math.sqrt(math.pi))
    return float(2 * norm * np.trapezoid(density, angle))


def compare(name: str, method: str, found: np.ndarray, expected: np.ndarray) -> tuple[str, bool]:
    """Return a row of the table, and whether the method agrees."""
    n = len(found)
    a, b = found.mean(0), expected.mean(0)
    error = np.sqrt((found.var(0, ddof=1) + expected.var(0, ddof=1)) / n)
    slack = METHODS[method][2] * b + 1e-3 * b.mean()
    t = np.maximum(np.abs(a - b) - slack, 0) / np.maximum(error, 1e-9)
    p = 1 - (1 - 0.01) ** (1 / t.size)
    worst = np.unravel_index(int(t.argmax()), t.shape)
    agrees = student(float(t.max()), 2 * (n - 1)) >= p
    noise = float(np.median(error / np.maximum(b, 1e-3 * b.mean())))
    beyond = float((np.abs(a - b) > 3 * error).mean())
    relative = (a[worst] - b[worst]) / max(b[worst], 1e-3 * b.mean())
    mean = a.mean() / b.mean() - 1
    pictures = [x.reshape(n, -1).mean(1) for x in (found, expected)]
    z = (pictures[0].mean() - pictures[1].mean()) / math.sqrt(sum(x.var(ddof=1) for x in pictures) / n)
    verdict = "agrees" if agrees else f"**differs**: block {worst[0]}, {worst[1]} by {relative:+.1%}"
    return f"| {name} | {method} | {mean:+.2%} | {z:+.1f} | {noise:.2%} | {beyond:.0%} | {t.max():.1f} | {verdict} |", agrees


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, nargs="?", help="scenes of others")
    parser.add_argument("--etendue", default="target/release/etendue", help="the command")
    parser.add_argument("--seeds", type=int, default=8, help="pictures of each method")
    parser.add_argument("--effort", type=float, default=1.0, help="factor on the samples")
    parser.add_argument("--depth", type=int, default=12, help="longest path")
    parser.add_argument("--scene", action="append", default=[], help="only this scene")
    parser.add_argument("--method", action="append", default=[], help="only this method")
    args = parser.parse_args()
    args.search = []
    good = True
    sys.stdout.write("| scene | method | mean | Z | noise of a block | blocks beyond 3σ | largest t | |\n" + "|---" * 8 + "|\n")
    with tempfile.TemporaryDirectory() as temporary:
        runner = Runner(args, Path(temporary))
        scenes = []
        for name, scene in SMALL.items():
            path = Path(temporary) / f"{name}.xml"
            path.write_text(fog_first(scene.text), encoding="utf-8")
            scenes.append((name, path, scene.methods, scene.unit, scene.reference))
        if args.folder:
            args.search = ["-L", str(args.folder)]
            for name in SHARED:
                # Lamps smaller than a pixel would be most of the noise where the camera sees them.
                text = (args.folder / f"{name}.xml").read_text(encoding="utf-8").replace('<integrator type="path">', HIDDEN, 1)
                (Path(temporary) / f"{name}.xml").write_text(text, encoding="utf-8")
            scenes += [(name, Path(temporary) / f"{name}.xml", methods, 1.0, reference) for name, (methods, reference) in SHARED.items()]
        for name, path, methods, unit, reference in scenes:
            if args.scene and name not in args.scene:
                continue
            expected = runner.seeds(path, reference, unit)
            for method in methods:
                if args.method and method not in args.method:
                    continue
                row, agrees = compare(name, method, runner.seeds(path, method, unit), expected)
                good &= agrees
                sys.stdout.write(row + "\n")
                sys.stdout.flush()
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    sys.stderr.write(f"{used.ru_utime + used.ru_stime:.0f} CPU seconds\n")
    sys.exit(0 if good else 1)


if __name__ == "__main__":
    main()
