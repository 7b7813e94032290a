from pathlib import Path
from typing import Any

import numpy as np
import pytest

import etendue

from .conftest import XML


def test_text_file_and_dictionary_make_the_same_picture(tmp_path: Path, description: dict[str, Any]) -> None:
    path = tmp_path / "scene.xml"
    path.write_text(XML)
    from_text = etendue.load_string(XML).render()
    assert (etendue.load(path).render() == from_text).all()
    assert (etendue.load(str(path)).render() == from_text).all()
    # Matrices of a dictionary are computed by NumPy: last bits may differ.
    relmse = etendue.compare(etendue.load_dict(description).render(), from_text)["relmse"]
    assert relmse is not None
    assert relmse < 1e-6


def test_info_counts_what_is_there(description: dict[str, Any]) -> None:
    info = etendue.load_dict(description).info()
    assert (info["format"], info["width"], info["height"], info["spp"]) == ("mitsuba", 48, 32, 8)
    assert (info["shapes"], info["analytic_shapes"], info["triangles"]) == (2, 2, 0)
    assert [kind for _, kind in info["cameras"]] == ["perspective"]
    assert [kind for _, kind in info["lights"]] == ["constant"]


def test_defines_replace_keys() -> None:
    assert etendue.load_string(XML, defines={"spp": 3}).info()["spp"] == 3


def test_faults_of_a_file_have_their_places() -> None:
    text = '<scene version="3.0.0">\n  <shape type="spere"/>\n  <bsdf type="diffuse" id="a">\n    <float name="x" value="b"/>'
    with pytest.raises(etendue.SceneError, match=r"2:.*sphere") as caught:
        etendue.load_string(text.replace("<float", "<flot") + "\n  </bsdf>\n</scene>")
    error = caught.value
    assert isinstance(error, etendue.Error)
    assert isinstance(error, ValueError)
    assert len(error.faults) >= 2
    assert {fault.line for fault in error.faults} >= {2, 4}
    assert all(fault.file.endswith("<string>") and fault.column for fault in error.faults)
    assert any(fault.severity == "error" for fault in error.faults)


def test_faults_of_a_dictionary_have_their_keys(description: dict[str, Any]) -> None:
    description["ball"]["bsdf"]["reflectence"] = 0.5
    description["floor"]["bsdf"]["id"] = "wite"
    with pytest.raises(etendue.SceneError, match="did you mean `reflectance`") as caught:
        etendue.load_dict(description)
    assert {f.file for f in caught.value.faults} == {'dict["ball"]["bsdf"]["reflectence"]', 'dict["floor"]["bsdf"]'}


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("x", object(), "object means nothing"),
        ("x", {"kind": "sphere"}, "needs a `type`"),
        ("x", {"type": "spere"}, "did you mean `sphere`"),
        ("x", {"type": "sphere", "center": [0, 1]}, "shape"),
        ("x", {"type": "sphere", "radius": float("nan")}, "finite"),
        ("x", {"type": "sphere", "center": [0, float("inf"), 0]}, "finite"),
        ("x", {"type": "sphere", 3: 4}, "keys are texts"),
        ("x", {"type": "diffuse", "reflectance": {"type": "rgb", "value": [1, 2]}}, "one or three"),
        ("x", {"type": "diffuse", "reflectance": {"type": "spectrum", "value": [(500, 1), (400, 1)]}}, "rise"),
        ("type", "sphere", "not a scene"),
    ],
)
def test_hostile_dictionaries_are_refused(description: dict[str, Any], key: str, value: object, message: str) -> None:
    description[key] = value
    with pytest.raises(etendue.SceneError, match=message):
        etendue.load_dict(description)


def test_a_dictionary_that_contains_itself_is_refused(description: dict[str, Any]) -> None:
    description["ball"]["bsdf"] = {"type": "twosided"}
    description["ball"]["bsdf"]["inner"] = description["ball"]["bsdf"]
    with pytest.raises(etendue.SceneError, match="deep"):
        etendue.load_dict(description)


def test_arrays_are_textures(description: dict[str, Any]) -> None:
    green = np.zeros((2, 2, 3), dtype=np.float32)
    green[:, :, 1] = 0.5
    description["white"]["reflectance"] = {"type": "bitmap", "data": green, "raw": True}
    floor = etendue.load_dict(description).render(integrator="direct")[-4:].mean(axis=(0, 1))
    assert floor[1] > 10 * max(floor[0], floor[2])


def test_other_errors_are_told_apart(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError) as caught:
        etendue.load(tmp_path / "none.xml")
    assert Path(caught.value.filename) == tmp_path / "none.xml"
    other = tmp_path / "scene.blend"
    other.write_bytes(b"BLENDER")
    with pytest.raises(etendue.UnsupportedError, match="blend"):
        etendue.load(other)


def test_losses_are_told() -> None:
    text = XML.replace("</scene>", '<shape type="hair"/></scene>')
    losses = etendue.load_string(text).losses
    assert [loss.line for loss in losses] == [XML.count("\n", 0, XML.index("</scene>")) + 1]
    assert "hair" in losses[0].feature
    assert losses[0].effect
