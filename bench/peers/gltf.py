"""A small reader of glTF files as `etendue convert` writes them: meshes in world space, materials as numbers, the camera.

It needs numpy alone. It reads no pictures, and no lights but surfaces that shine: what has those is refused by name.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from serve import CannotError

TYPES = {5120: np.int8, 5121: np.uint8, 5122: np.int16, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
# What of each extension of materials is taken; the thickness of a closed body says nothing.
KNOWN = {
    "KHR_materials_emissive_strength": {"emissiveStrength"},
    "KHR_materials_ior": {"ior"},
    "KHR_materials_specular": {"specularFactor"},
    "KHR_materials_transmission": {"transmissionFactor"},
    "KHR_materials_volume": {"thicknessFactor"},
}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}


@dataclass
class Material:
    """Metallic-roughness numbers; colors are linear."""

    color: tuple[float, float, float]
    metallic: float
    roughness: float
    specular: float
    transmission: float
    ior: float
    emission: tuple[float, float, float]


@dataclass
class Mesh:
    """Points (n, 3) and normals (n, 3) or None in world space, triangles (m, 3), number of the material."""

    points: np.ndarray
    normals: np.ndarray | None
    triangles: np.ndarray
    material: int


@dataclass
class Scene:
    """What a file holds; the camera looks along −z of its matrix, `yfov` is in radians."""

    meshes: list[Mesh]
    materials: list[Material]
    world_from_camera: np.ndarray
    yfov: float


def read(path: Path) -> Scene:
    """Return the scene of a .gltf file with buffers beside it, or of a .glb file."""
    data = path.read_bytes()
    if data[:4] == b"glTF":
        # Length and kind of a chunk, then its bytes: the tree, then the buffer.
        end = 20 + int.from_bytes(data[12:16], "little")
        tree, buffers = json.loads(data[20:end]), [data[end + 8 :]]
    else:
        tree = json.loads(data)
        buffers = [(path.parent / b["uri"]).read_bytes() for b in tree["buffers"]]
    scene = Scene([], [material(m) for m in tree["materials"]], np.eye(4), 0.0)
    for root in tree["scenes"][tree.get("scene", 0)]["nodes"]:
        walk(tree, buffers, root, np.eye(4), scene)
    if scene.yfov == 0:
        raise CannotError("no camera")
    return scene


def material(given: dict) -> Material:
    """Return the numbers of a material."""
    if "Texture" in json.dumps(given):
        raise CannotError("textures: the reader of this benchmark takes numbers alone")
    pbr, more = given.get("pbrMetallicRoughness", {}), given.get("extensions", {})
    strange = [f"{name}: {key}" for name, values in more.items() for key in values if key not in KNOWN.get(name, set())]
    if strange or given.get("alphaMode", "OPAQUE") != "OPAQUE":
        raise CannotError("; ".join(strange) or f"alphaMode {given['alphaMode']}")

    def extension(name: str, key: str, default: float) -> float:
        return more.get(f"KHR_materials_{name}", {}).get(key, default)

    strength = extension("emissive_strength", "emissiveStrength", 1.0)
    return Material(
        tuple(pbr.get("baseColorFactor", (1, 1, 1, 1))[:3]),
        pbr.get("metallicFactor", 1.0),
        pbr.get("roughnessFactor", 1.0),
        extension("specular", "specularFactor", 1.0),
        extension("transmission", "transmissionFactor", 0.0),
        extension("ior", "ior", 1.5),
        tuple(strength * x for x in given.get("emissiveFactor", (0, 0, 0))),
    )


def accessor(tree: dict, buffers: list[bytes], index: int) -> np.ndarray:
    """Return the numbers of an accessor, a row for each element."""
    a = tree["accessors"][index]
    view = tree["bufferViews"][a["bufferView"]]
    if "byteStride" in view or "sparse" in a:
        raise CannotError("interleaved or sparse buffers")
    start = view.get("byteOffset", 0) + a.get("byteOffset", 0)
    width = WIDTHS[a["type"]]
    return np.frombuffer(buffers[view["buffer"]], TYPES[a["componentType"]], a["count"] * width, start).reshape(-1, width)


def matrix(node: dict) -> np.ndarray:
    """Return the matrix from a node to its parent."""
    if "matrix" in node:
        return np.array(node["matrix"]).reshape(4, 4).T
    x, y, z, w = node.get("rotation", (0, 0, 0, 1))
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    out = np.eye(4)
    out[:3, :3] = turn * np.array(node.get("scale", (1, 1, 1)))
    out[:3, 3] = node.get("translation", (0, 0, 0))
    return out


def walk(tree: dict, buffers: list[bytes], index: int, parent: np.ndarray, scene: Scene) -> None:
    """Add a node and all below it to the scene."""
    node = tree["nodes"][index]
    world = parent @ matrix(node)
    if "KHR_lights_punctual" in node.get("extensions", {}):
        raise CannotError("lights that are no surfaces: the reader of this benchmark does not take them")
    if "camera" in node:
        scene.world_from_camera = world
        scene.yfov = tree["cameras"][node["camera"]]["perspective"]["yfov"]
    for p in tree["meshes"][node["mesh"]]["primitives"] if "mesh" in node else []:
        points = accessor(tree, buffers, p["attributes"]["POSITION"]) @ world[:3, :3].T + world[:3, 3]
        normals = None
        if "NORMAL" in p["attributes"]:
            normals = accessor(tree, buffers, p["attributes"]["NORMAL"]) @ np.linalg.inv(world[:3, :3])
            normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
        order = accessor(tree, buffers, p["indices"]).reshape(-1, 3)
        if np.linalg.det(world[:3, :3]) < 0:
            order = order[:, ::-1]
        scene.meshes.append(Mesh(points, normals, order, p["material"]))
    for child in node.get("children", []):
        walk(tree, buffers, child, world, scene)
