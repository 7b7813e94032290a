import copy
from typing import Any

import pytest

import etendue

XML = """<scene version="3.0.0">
    <default name="spp" value="8"/>
    <integrator type="path"><integer name="max_depth" value="5"/></integrator>
    <sensor type="perspective">
        <float name="fov" value="40"/>
        <transform name="to_world"><lookat origin="0, 1, 4" target="0, 0.5, 0" up="0, 1, 0"/></transform>
        <film type="hdrfilm"><integer name="width" value="48"/><integer name="height" value="32"/></film>
        <sampler type="independent"><integer name="sample_count" value="$spp"/></sampler>
    </sensor>
    <bsdf type="diffuse" id="white"><rgb name="reflectance" value="0.7, 0.7, 0.7"/></bsdf>
    <shape type="rectangle">
        <transform name="to_world"><scale value="5"/><rotate x="1" angle="-90"/></transform>
        <ref id="white"/>
    </shape>
    <shape type="sphere">
        <point name="center" x="0" y="0.5" z="0"/><float name="radius" value="0.5"/>
        <bsdf type="diffuse"><rgb name="reflectance" value="0.8, 0.2, 0.1"/></bsdf>
    </shape>
    <emitter type="constant"><rgb name="radiance" value="1"/></emitter>
</scene>
"""

_DICT = {
    "type": "scene",
    "integrator": {"type": "path", "max_depth": 5},
    "sensor": {
        "type": "perspective",
        "fov": 40,
        "to_world": etendue.Transform().look_at([0, 1, 4], [0, 0.5, 0], [0, 1, 0]),
        "film": {"type": "hdrfilm", "width": 48, "height": 32},
        "sampler": {"type": "independent", "sample_count": 8},
    },
    "white": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.7, 0.7, 0.7]}},
    "floor": {
        "type": "rectangle",
        "to_world": etendue.Transform().rotate([1, 0, 0], -90).scale(5),
        "bsdf": {"type": "ref", "id": "white"},
    },
    "ball": {
        "type": "sphere",
        "center": [0, 0.5, 0],
        "radius": 0.5,
        "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.8, 0.2, 0.1]}},
    },
    "sky": {"type": "constant", "radiance": {"type": "rgb", "value": 1}},
}


@pytest.fixture
def description() -> dict[str, Any]:
    """A red ball on a white floor under a white sky; a copy that tests may change."""
    return copy.deepcopy(_DICT)


@pytest.fixture(scope="session")
def scene() -> etendue.Scene:
    """The same as XML."""
    return etendue.load_string(XML)
