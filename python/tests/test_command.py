import json
import pickle
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

import etendue

from .conftest import XML

ROOT = Path(__file__).parent.parent.parent
SCRIPT = Path(sys.executable).parent / "etendue"


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run([str(a) for a in arguments], capture_output=True, text=True, timeout=120, check=False)


@pytest.mark.parametrize("command", [[SCRIPT], [sys.executable, "-m", "etendue"]])
def test_the_command_is_there(command: list[object]) -> None:
    result = run(*command, "--version")
    assert result.returncode == 0
    assert result.stdout.strip() == f"etendue {etendue.__version__}"


def test_exit_codes_pass_through(tmp_path: Path) -> None:
    assert run(SCRIPT, "paint").returncode == 2
    missing = run(SCRIPT, "render", tmp_path / "none.xml", "-o", tmp_path / "a.png")
    assert missing.returncode == 4
    assert "none.xml" in missing.stderr
    broken = tmp_path / "broken.xml"
    broken.write_text('<scene version="3.0.0">\n<shape type="spere"/></scene>')
    result = run(SCRIPT, "render", broken, "-o", tmp_path / "a.png")
    assert result.returncode == 3
    assert f"{broken}:2:" in result.stderr


def test_the_command_renders_what_python_renders(tmp_path: Path) -> None:
    scene, output = tmp_path / "scene.xml", tmp_path / "picture.exr"
    scene.write_text(XML)
    result = run(SCRIPT, "render", scene, "-o", output, "--spp", "4", "--seed", "7", "--progress", "json")
    assert result.returncode == 0, result.stderr
    assert (etendue.read_image(output) == etendue.load(scene).render(spp=4, seed=7)).all()
    events = [json.loads(line) for line in result.stderr.splitlines() if line.startswith("{")]
    assert events[-1]["fraction"] == 1.0


def test_errors_go_to_other_processes_whole() -> None:
    with pytest.raises(etendue.SceneError) as caught:
        etendue.load_string("<scene/>" + "x")
    copy = pickle.loads(pickle.dumps(caught.value))
    assert (str(copy), copy.faults) == (str(caught.value), caught.value.faults)


def test_the_example_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("ETENDUE_EXAMPLE_SPP", "2")
    monkeypatch.setenv("ETENDUE_EXAMPLE_WIDTH", "48")
    namespace = runpy.run_path(str(ROOT / "examples" / "first_render.py"))
    assert namespace["picture"].shape == (27, 48, 3)
    assert {path.name for path in tmp_path.glob("out/*")} >= {"first_render.png", "first_render.exr"}
