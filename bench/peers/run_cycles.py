"""Renders with Cycles. Run by an interpreter that has the package bpy; see serve.py.

Blender is under the GPL. It is a program apart here, which a benchmark starts and talks to by pipes: this file is only for use with it,
holds nothing of the product, and nothing of the product imports it or needs it.

The scene comes as glTF, which Blender imports itself. From the job come size, depth, environment map, and two habits of Mitsuba that glTF
does not tell of: lamps shine to one side, and rough surfaces scatter once. No denoiser, adaptive sampling, clamping, blur of caustics or
threshold of lights.
"""

from __future__ import annotations

import math
import tempfile
import time
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix
from serve import serve, threads

# Blender has z up where glTF has y up; Mitsuba's maps begin a quarter turn from Blender's.
BLENDER_FROM_GLTF = Matrix(((1, 0, 0), (0, 0, -1), (0, 1, 0)))
QUARTER = Matrix.Rotation(math.pi / 2, 3, "Z")


def check(options: dict) -> str:
    """Return the version."""
    return bpy.app.version_string


def environment(world, settings: dict) -> None:
    """Let an environment map, or one color, shine from everywhere."""
    world.use_nodes = True
    nodes, links = world.node_tree.nodes, world.node_tree.links
    background = next(n for n in nodes if n.type == "BACKGROUND")
    if "radiance" in settings:
        background.inputs["Color"].default_value = (*settings["radiance"], 1)
        return
    background.inputs["Strength"].default_value = settings["scale"]
    picture = nodes.new("ShaderNodeTexEnvironment")
    picture.image = bpy.data.images.load(settings["file"])
    picture.image.colorspace_settings.name = "Linear Rec.709"
    mapping = nodes.new("ShaderNodeMapping")
    world_from_map = Matrix([row[:3] for row in settings["world_from_map"][:3]])
    turn = QUARTER @ BLENDER_FROM_GLTF @ world_from_map.inverted() @ BLENDER_FROM_GLTF.transposed()
    mapping.inputs["Rotation"].default_value = turn.to_euler("XYZ")
    links.new(nodes.new("ShaderNodeTexCoord").outputs["Generated"], mapping.inputs["Vector"])
    links.new(mapping.outputs["Vector"], picture.inputs["Vector"])
    links.new(picture.outputs["Color"], background.inputs["Color"])


def as_mitsuba(material) -> None:
    """Let rough surfaces scatter once, and lamps shine to the side of their normals alone."""
    tree = material.node_tree
    for node in [n for n in tree.nodes if n.type == "BSDF_PRINCIPLED"]:
        node.distribution = "GGX"
        if node.inputs["Emission Strength"].default_value > 0 and max(node.inputs["Emission Color"].default_value[:3]) > 0:
            # Nothing is mixed in on the back. A factor on the strength would hide from Cycles how bright the lamp is.
            geometry, mix = tree.nodes.new("ShaderNodeNewGeometry"), tree.nodes.new("ShaderNodeMixShader")
            out = node.outputs["BSDF"].links[0].to_socket
            tree.links.new(geometry.outputs["Backfacing"], mix.inputs[0])
            tree.links.new(node.outputs["BSDF"], mix.inputs[1])
            tree.links.new(mix.outputs[0], out)
            material.cycles.emission_sampling = "FRONT"


def load(job: dict):
    """Return what renders the scene."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=job["gltf"])
    scene = bpy.context.scene
    scene.camera = next(o for o in scene.objects if o.type == "CAMERA")
    scene.world = bpy.data.worlds.new("world")
    scene.world.use_nodes = True
    next(n for n in scene.world.node_tree.nodes if n.type == "BACKGROUND").inputs["Color"].default_value = (0, 0, 0, 1)
    if job["environment"]:
        environment(scene.world, job["environment"])
    if job["converted"]:
        for material in bpy.data.materials:
            if material.use_nodes:
                as_mitsuba(material)
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = job["width"], job["height"], 100
    scene.render.threads_mode, scene.render.threads = "FIXED", threads()
    # Keeps what has been built from picture to picture.
    scene.render.use_persistent_data = True
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    scene.render.image_settings.color_mode = "RGB"
    scene.render.image_settings.exr_codec = "ZIP"
    how = scene.cycles
    how.device = "CPU"
    how.use_denoising = how.use_adaptive_sampling = False
    how.sample_clamp_direct = how.sample_clamp_indirect = how.blur_glossy = how.light_sampling_threshold = 0
    how.caustics_reflective = how.caustics_refractive = True
    how.pixel_filter_type = "BOX"
    # Mitsuba counts camera rays and shadow rays as well.
    bounces = job["max_depth"] - 2
    how.max_bounces = how.diffuse_bounces = how.glossy_bounces = how.transmission_bounces = how.transparent_max_bounces = bounces
    folder = tempfile.mkdtemp()

    def render(spp: int, seed: int) -> tuple[np.ndarray, float]:
        how.samples, how.seed = spp, seed
        start = time.process_time()
        bpy.ops.render.render()
        seconds = time.process_time() - start
        file = str(Path(folder) / "picture.exr")
        bpy.data.images["Render Result"].save_render(file)
        image = bpy.data.images.load(file)
        image.colorspace_settings.name = "Non-Color"
        pixels = np.empty(job["width"] * job["height"] * 4, np.float32)
        image.pixels.foreach_get(pixels)
        bpy.data.images.remove(image)
        Path(file).unlink()
        return pixels.reshape(job["height"], job["width"], 4)[::-1, :, :3], seconds

    # Builds.
    render(1, 0)
    return render


if __name__ == "__main__":
    serve(check, load)
