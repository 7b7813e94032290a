"""The report on all methods of a scene."""

from pathlib import Path

import pytest

import etendue

SCENE = """<scene version="3.0.0">
    <sensor type="perspective"><film type="hdrfilm"><integer name="width" value="24"/>
        <integer name="height" value="16"/></film></sensor>
    <shape type="sphere"><point name="center" x="0" y="0" z="4"/><float name="radius" value="1"/></shape>
    <emitter type="constant"/>
</scene>"""


def test_a_study_measures_each_method(tmp_path: Path) -> None:
    scene = tmp_path / "ball.xml"
    scene.write_text(SCENE, encoding="utf-8")
    folder = tmp_path / "report"
    report = etendue.study(scene, folder, methods=["path", "direct"], spp=32, reference_spp=512, threads=1)
    path, direct = report["methods"]
    assert [path["method"], direct["method"]] == ["path", "direct"]
    assert [p["spp"] for p in path["points"]] == [1, 2, 4, 8, 16, 32]
    # A convex body in a constant environment sees direct light alone: both have noise and nothing else.
    for method in (path, direct):
        errors = [p["relmse"] for p in method["points"]]
        assert errors[-1] < errors[0] / 8
        assert method["final"]["mean_ratio"] == pytest.approx([1, 1, 1], abs=0.02)
    page = (folder / "index.html").read_text(encoding="utf-8")
    for name in ("error.svg", "path.png", "direct-flip.png", "reference.png"):
        assert name in page
        assert (folder / name).stat().st_size > 100
    assert etendue.read_image(folder / "path.exr").shape == (16, 24, 3)


def test_a_study_refuses_what_does_not_fit(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    scene = tmp_path / "ball.xml"
    scene.write_text(SCENE, encoding="utf-8")
    with pytest.raises(etendue.Error):
        etendue.study(scene, tmp_path / "report", methods=["magic"])
    assert "no integrator `magic`" in capfd.readouterr().err
    reference = tmp_path / "small.png"
    etendue.write_image(reference, etendue.read_image(_picture(tmp_path))[:8])
    with pytest.raises(etendue.Error):
        etendue.study(scene, tmp_path / "report", methods=["path"], spp=1, reference=reference)


def _picture(folder: Path) -> Path:
    picture = folder / "ball.png"
    etendue.write_image(picture, etendue.load_string(SCENE).render(spp=1))
    return picture
