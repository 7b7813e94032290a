#!/usr/bin/env python3
"""Builds the command with profile-guided optimization: target/optimized/etendue.

Three steps: a build that counts what it does, runs of it on the scenes of this repository, and a build that the counts lay out and
inline by. The pictures are the same to the bit. The scenes of bench/training are there for what the others lack.

    python3 scripts/build_optimized.py      (or: make optimized)

Needs an `llvm-profdata` that reads the counts of the installed `rustc`: from `rustup component add llvm-tools`, or of a system's LLVM
that is about as new (Debian: llvm-19). `LLVM_PROFDATA` names one. Whether it fits is tried first, on an empty program.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TARGET = ROOT / "target" / "optimized"

# Each takes a few seconds, so that no part of the program looks cold beside another.
RUNS = [
    "bench/training/patterns.pov --width 480 --height 360",
    "bench/training/solids.pov --width 320 --height 240",
    "bench/training/light.pov --width 80 --height 60",
    "scenes/dream-car/dream-car.pov --width 320 --height 180 --antialias 0.3",
    "scenes/dream-car/dream-car.pov --integrator path --width 96 --height 54 --spp 4",
    "bench/training/solids.pov --integrator path --width 120 --height 90 --spp 4",
    "scenes/gallery/atrium.xml --integrator path --width 160 --height 120 --spp 16",
    "scenes/gallery/cove.xml --integrator path --width 160 --height 120 --spp 8",
    "scenes/gallery/media.xml --integrator path --width 120 --height 90 --spp 8",
    "scenes/particles/room.xml --integrator path --width 160 --height 120 --spp 8",
    "scenes/particles/flame.pbrt --integrator path --width 160 --height 120 --spp 16",
    "scenes/radiosity/cornell.xml --integrator path --width 192 --height 192 --spp 16",
    "scenes/baking/room.xml --integrator path --width 160 --height 120 --spp 16",
    "scenes/gallery/cove.xml --integrator bdpt --width 96 --height 72 --spp 4",
    "scenes/gallery/cove.xml --integrator vcm --width 96 --height 72 --spp 4",
    "scenes/gallery/cove.xml --integrator mlt --width 96 --height 72 --spp 8",
    "scenes/gallery/cove.xml --integrator sppm --width 96 --height 72 --spp 8",
    "scenes/gallery/cove.xml --integrator auto --width 96 --height 72 --spp 8",
    "scenes/radiosity/cornell.xml --integrator radiosity --width 256 --height 256 --spp 4",
    "scenes/gallery/atrium.xml --integrator raster --width 320 --height 240 --spp 4",
]


def run(command: list[str | Path], **variables: str) -> None:
    """Run a command; end with what it says where it fails."""
    done = subprocess.run(command, cwd=ROOT, env={**os.environ, **variables}, stdin=subprocess.DEVNULL, check=False)
    if done.returncode:
        sys.exit(f"build_optimized.py: this has failed ({done.returncode}): {' '.join(map(str, command))}")


def rustc(*arguments: str) -> str:
    """What the compiler answers."""
    return subprocess.run(["rustc", *arguments], cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()


def candidates(host: str) -> list[str]:
    """Programs that may merge the counts, the likeliest first."""
    if given := os.environ.get("LLVM_PROFDATA"):
        return [given]
    found = [str(Path(rustc("--print", "sysroot")) / "lib" / "rustlib" / host / "bin" / "llvm-profdata")]
    versions = {p.name for folder in os.get_exec_path() for p in Path(folder).glob("llvm-profdata-*")}
    found += sorted(versions, key=lambda name: -int(re.sub(r"\D", "", name) or 0))
    return [path for path in (shutil.which(name) for name in [*found, "llvm-profdata"]) if path]


def merger(host: str) -> str:
    """The program that merges counts, tried on an empty program from its build to its use."""
    tried = candidates(host)
    with tempfile.TemporaryDirectory() as folder:
        source, program, counts = (Path(folder) / name for name in ("empty.rs", "empty", "counts.profdata"))
        source.write_text("fn main() {}\n")
        for candidate in tried:
            steps: list[list[str | Path]] = [
                ["rustc", f"-Cprofile-generate={folder}/raw", source, "-o", program],
                [program],
                [candidate, "merge", "-o", counts, f"{folder}/raw"],
                ["rustc", f"-Cprofile-use={counts}", source, "-o", program],
            ]
            if all(subprocess.run(step, cwd=folder, capture_output=True, check=False).returncode == 0 for step in steps):
                return candidate
    what = f"none of {', '.join(tried)} reads the counts of {rustc('--version')}" if tried else "there is no llvm-profdata"
    sys.exit(f"build_optimized.py: {what}. Try `rustup component add llvm-tools`, or name one in LLVM_PROFDATA.")


def build(host: str, flags: str, folder: Path) -> Path:
    """Build the command with flags for the compiler."""
    # With a named target the flags are for the command alone, not for build scripts.
    command: list[str | Path] = [os.environ.get("CARGO", "cargo"), "build", "--release", "--locked", "-p", "etendue-cli", "--target", host]
    flags = f"{os.environ.get('RUSTFLAGS', '')} {flags}".strip()
    run(command, RUSTFLAGS=flags, CARGO_TARGET_DIR=str(folder))
    return folder / host / "release" / "etendue"


def train(binary: Path, counts: Path) -> None:
    """Render all scenes with a build that counts, one thread each, as counters shared by threads are slow and lose counts."""
    with tempfile.TemporaryDirectory() as folder:

        def render(numbered: tuple[int, str]) -> None:
            number, line = numbered
            words = line.split()
            out = Path(folder) / f"{number}.{'png' if words[0].endswith('.pov') else 'exr'}"
            run([binary, "render", *words, "-o", out, "--threads", "1", "-q"], LLVM_PROFILE_FILE=str(counts / f"{number}.profraw"))
            print(f"  {line}", flush=True)

        with ThreadPoolExecutor(os.cpu_count()) as pool:
            list(pool.map(render, enumerate(RUNS)))


def main() -> None:
    """Build, train, build."""
    host = next(line.split()[1] for line in rustc("-vV").splitlines() if line.startswith("host:"))
    tool = merger(host)
    counts = TARGET / "counts"
    shutil.rmtree(counts, ignore_errors=True)
    print("A build that counts", flush=True)
    counting = build(host, "-Cprofile-generate", TARGET / "counting")
    print("Runs of it", flush=True)
    train(counting, counts)
    merged = TARGET / "etendue.profdata"
    run([tool, "merge", "-o", merged, counts])
    print("The build that the counts guide", flush=True)
    made = build(host, f"-Cprofile-use={merged}", TARGET / "guided")
    shutil.copy2(made, TARGET / "etendue")
    print(f"The command is {TARGET / 'etendue'}")


if __name__ == "__main__":
    main()
