"""Render with the installed package, away from the sources: a picture from Python and one from the command."""

import subprocess
import sys
import tempfile
from pathlib import Path

import etendue

SCENE = """<scene version="3.0.0">
    <sensor type="perspective">
        <transform name="to_world"><lookat origin="0, 0, 5" target="0, 0, 0" up="0, 1, 0"/></transform>
        <film type="hdrfilm"><integer name="width" value="32"/><integer name="height" value="24"/></film>
    </sensor>
    <shape type="sphere"/>
    <emitter type="constant"/>
</scene>
"""


def main() -> None:
    """Render twice and compare."""
    root = Path(__file__).resolve().parent.parent
    installed = Path(etendue.__file__).resolve()
    assert (root / "python") not in installed.parents, f"{installed} is not the installed package"
    picture = etendue.load_string(SCENE).render(spp=4)
    assert picture.shape == (24, 32, 3)
    assert picture.mean() > 0.1
    with tempfile.TemporaryDirectory() as folder:
        scene, output = Path(folder, "scene.xml"), Path(folder, "picture.exr")
        scene.write_text(SCENE, encoding="utf-8")
        command = Path(sys.executable).parent / "etendue"
        subprocess.run([command, "render", scene, "-o", output, "--spp", "4", "--quiet"], check=True)
        assert (etendue.read_image(output) == picture).all(), "the command renders another picture than Python"
    sys.stdout.write(f"The installed package works: {installed.parent}\n")


if __name__ == "__main__":
    main()
