"""Other renderers on the scenes of our benchmarks, each driven by a script that the interpreter with its package runs.

Mitsuba reads its XML files. Cycles and LuxCore are given what `etendue convert` writes of them, and Cycles reads .glb files itself. What
glTF cannot say comes with the job: `scene_job` takes the environment map and the depth from the file.
"""

from __future__ import annotations

import contextlib
import json
import math
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ET
from collections import Counter
from pathlib import Path

import numpy as np

from peers.serve import ANSWER

HERE = Path(__file__).parent
# Bounces that the references of scenes without a depth of their own have, and camera and shadow rays.
DEPTH = 18


class RefusedError(Exception):
    """Why a peer does not render a scene."""


class Peer:
    """A program that renders, in a process for each scene, which loads it once."""

    def __init__(self, name: str, python: str, driver: str, **options: str) -> None:
        self.name, self.options = name, options
        self.command = [python, str(HERE / f"run_{driver}.py")]
        self.reads_gltf = driver != "mitsuba"

    def check(self) -> str | None:
        """Return why it does not run here, or None; the version becomes part of the name."""
        try:
            done = subprocess.run([*self.command, "--check", json.dumps(self.options)], capture_output=True, text=True, check=False)
        except OSError as error:
            return str(error)
        said = [line for line in done.stdout.splitlines() if line.startswith(ANSWER)]
        if not said:
            return (done.stderr.strip().splitlines() or [f"exit status {done.returncode}"])[-1]
        version = json.loads(said[-1][len(ANSWER) :])["version"]
        program, _, rest = self.name.partition(" ")
        self.name = f"{program} {version} {rest}".strip()
        return None

    def given(self, job: dict) -> bool:
        """Return whether it renders a converted scene, instead of reading the file itself."""
        return self.reads_gltf and job["converted"]

    def open(self, job: dict) -> Running:
        """Return the program with a scene loaded; raises RefusedError."""
        return Running(self, job)


class Running:
    """A peer that has a scene."""

    def __init__(self, peer: Peer, job: dict) -> None:
        self.folder = tempfile.TemporaryDirectory()
        self.log = Path(self.folder.name) / "log.txt"
        with self.log.open("w") as log:
            self.process = subprocess.Popen(peer.command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log, text=True)
        self.ask({**job, **peer.options})

    def ask(self, what: dict) -> dict:
        """Return the answer to a job."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        # What has ended is found when it does not answer.
        with contextlib.suppress(BrokenPipeError):
            self.process.stdin.write(json.dumps(what) + "\n")
            self.process.stdin.flush()
        for line in self.process.stdout:
            if line.startswith(ANSWER):
                answer = json.loads(line[len(ANSWER) :])
                if "error" in answer:
                    self.close()
                    raise RefusedError(answer["error"])
                return answer
        last = (self.log.read_text(errors="replace").strip().splitlines() or ["it has ended"])[-1]
        self.close()
        raise RefusedError(last)

    def render(self, spp: int, seed: int) -> tuple[np.ndarray, float]:
        """Return a picture (height, width, 3) and the CPU seconds of its rendering."""
        out = f"{self.folder.name}/picture.npy"
        seconds = self.ask({"spp": spp, "seed": seed, "out": out})["seconds"]
        return np.load(out).astype(np.float64), seconds

    def close(self) -> None:
        """End the program."""
        if self.process.stdin is not None and not self.process.stdin.closed:
            with contextlib.suppress(BrokenPipeError):
                self.process.stdin.close()
        self.process.wait()
        self.folder.cleanup()


def present(wanted: list[Peer]) -> list[Peer]:
    """Return the peers that run here; says on stderr which do not, and why."""
    found = []
    for peer in wanted:
        why = peer.check()
        if why is None:
            found.append(peer)
        else:
            print(f"not measured: {peer.name}: {why}", file=sys.stderr)
    return found


def scene_job(command: str, scene: Path, width: int, height: int, folder: Path, convert: bool) -> dict:
    """Return what drivers need of a scene, and write it as glTF into the folder if any of them wants it.

    `source` is the scene's file and `gltf` the one for programs that read glTF; `converted` says that these differ. `environment` is None,
    `{"radiance": color}`, or `{"file", "scale", "world_from_map"}` with a matrix of Mitsuba's convention (y up).
    """
    job = {"source": str(scene.resolve()), "gltf": "", "converted": False, "width": width, "height": height}
    job |= {"max_depth": DEPTH, "environment": None}
    if scene.suffix == ".xml":
        tree = ET.parse(scene).getroot()
        defaults = {d.get("name"): d.get("value") for d in tree.iter("default")}
        for depth in tree.findall("integrator/integer[@name='max_depth']"):
            job["max_depth"] = int(value(depth, defaults))
        for emitter in tree.findall("emitter"):
            job["environment"] = environment(emitter, defaults, scene) or job["environment"]
        job["converted"] = True
        if convert:
            job["gltf"] = str(folder / "scene.gltf")
            done = subprocess.run([command, "convert", str(scene), job["gltf"]], check=True, capture_output=True, text=True)
            lost = Counter(line.split("not written: ", 1)[1] for line in done.stderr.splitlines() if "not written: " in line)
            print(f"{scene.name} as glTF: {'; '.join(f'{what} (×{n})' for what, n in lost.items())}", file=sys.stderr)
    else:
        job["gltf"] = job["source"]
    return job


def value(element: ET.Element, defaults: dict) -> str:
    """Return the value of an element, with `$name` looked up."""
    said = element.get("value", "")
    return defaults[said[1:]] if said.startswith("$") else said


def environment(emitter: ET.Element, defaults: dict, scene: Path) -> dict | None:
    """Return what shines from everywhere; None for other lights, which glTF has."""
    if emitter.get("type") == "constant":
        numbers = [float(x) for x in value(emitter.find("*[@name='radiance']"), defaults).replace(",", " ").split()]
        return {"radiance": numbers * 3 if len(numbers) == 1 else numbers}
    if emitter.get("type") != "envmap":
        return None
    named = {e.get("name"): e for e in emitter}
    turn = np.eye(3)
    for step in named.get("to_world", []):
        if step.tag == "rotate":
            axis = np.array([float(step.get(a, 0)) for a in "xyz"])
            turn = rotation(axis / np.linalg.norm(axis), math.radians(float(step.get("angle", 0)))) @ turn
        elif step.tag == "matrix":
            numbers = [float(x) for x in step.get("value", "").replace(",", " ").split()]
            turn = np.array(numbers).reshape(math.isqrt(len(numbers)), -1)[:3, :3] @ turn
        else:
            raise SystemExit(f"{scene}: an environment map with <{step.tag}> is not handed to peers")
    matrix = np.eye(4)
    matrix[:3, :3] = turn
    scale = float(value(named["scale"], defaults)) if "scale" in named else 1.0
    file = (scene.parent / value(named["filename"], defaults)).resolve()
    return {"file": str(file), "scale": scale, "world_from_map": matrix.tolist()}


def rotation(axis: np.ndarray, angle: float) -> np.ndarray:
    """Return the matrix that turns about a unit axis (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
