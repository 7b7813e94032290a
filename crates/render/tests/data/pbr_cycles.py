"""Makes pbr_cycles.json: directional albedos of Blender's Principled BSDF, measured with Cycles.

    pip install bpy==5.0.1
    python pbr_cycles.py pbr_cycles.json

A plane under a uniform sky of radiance one is seen by an orthographic camera under the cosines `mu`: what a pixel shows
is the directional albedo. Then the sky is black and a sun of irradiance one (across its beam) stands in the directions
`wi` (polar angle and azimuth in degrees, the camera's azimuth being 0): what a pixel shows is f |cos|. Parameters are set as Blender's glTF import sets them.
"""

import json
import math
import os
import sys
import tempfile

import bpy

MU = [0.999, 0.8, 0.5, 0.25, 0.1]
WI = [[30, 180], [50, 170], [70, 150], [20, 40], [80, 180]]
COLOR = [0.9, 0.5, 0.2]
CASES = [{"metallic": m, "roughness": r} for m in (0, 1) for r in (0.1, 0.3, 0.5, 0.8, 1.0)] + [
    {"metallic": 0.5, "roughness": 0.4},
    {"metallic": 0, "roughness": 0.3, "ior": 1.2},
    {"metallic": 0, "roughness": 0.6, "ior": 2.0},
    {"metallic": 0, "roughness": 0.4, "specular_color": [1.0, 0.6, 0.3]},
    {"metallic": 0, "roughness": 0.6, "clearcoat": 1.0, "clearcoat_roughness": 0.0},
    {"metallic": 0, "roughness": 0.1, "clearcoat": 1.0, "clearcoat_roughness": 0.3},
    {"metallic": 1, "roughness": 0.6, "clearcoat": 0.5, "clearcoat_roughness": 0.1},
    {"metallic": 0, "roughness": 0.2, "transmission": 1.0},
    {"metallic": 0, "roughness": 0.8, "transmission": 1.0},
    {"metallic": 0, "roughness": 0.5, "transmission": 0.5},
    {"metallic": 0, "roughness": 0.5, "sheen": 1.0, "sheen_roughness": 0.5},
]


def setup():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    c = scene.cycles
    c.samples, c.use_adaptive_sampling, c.use_denoising, c.max_bounces = 4096, False, False, 16
    c.sample_clamp_direct = c.sample_clamp_indirect = c.blur_glossy = 0
    c.pixel_filter_type = "BOX"
    r = scene.render
    r.resolution_x = r.resolution_y = 4
    r.image_settings.file_format, r.image_settings.color_depth = "OPEN_EXR", "32"
    world = bpy.data.worlds.new("w")
    scene.world = world
    world.use_nodes = True
    background = world.node_tree.nodes.get("Background") or world.node_tree.nodes.new("ShaderNodeBackground")
    out = next((n for n in world.node_tree.nodes if n.type == "OUTPUT_WORLD"), None) or world.node_tree.nodes.new("ShaderNodeOutputWorld")
    world.node_tree.links.new(background.outputs[0], out.inputs[0])
    background.inputs["Color"].default_value = (1, 1, 1, 1)
    background.inputs["Strength"].default_value = 1
    mesh = bpy.data.meshes.new("p")
    mesh.from_pydata([(-9, -9, 0), (9, -9, 0), (9, 9, 0), (-9, 9, 0)], [], [(0, 1, 2, 3)])
    plane = bpy.data.objects.new("p", mesh)
    scene.collection.objects.link(plane)
    material = bpy.data.materials.new("m")
    material.use_nodes = True
    mesh.materials.append(material)
    camera = bpy.data.objects.new("c", bpy.data.cameras.new("c"))
    camera.data.type, camera.data.ortho_scale = "ORTHO", 0.01
    scene.collection.objects.link(camera)
    scene.camera = camera
    sun = bpy.data.objects.new("s", bpy.data.lights.new("s", "SUN"))
    sun.data.angle = 0
    scene.collection.objects.link(sun)
    return scene, camera, sun, background, next(n for n in material.node_tree.nodes if n.type == "BSDF_PRINCIPLED")


scene, camera, sun, background, node = setup()
defaults = [(i, tuple(i.default_value) if hasattr(i.default_value, "__len__") else i.default_value)
            for i in node.inputs if hasattr(i, "default_value")]


def pixel():
    """The mean of the picture."""
    scene.render.filepath = path
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(path)
    image.colorspace_settings.name = "Non-Color"
    px = list(image.pixels)
    bpy.data.images.remove(image)
    return [float(f"{sum(px[k::4]) / 16:.5g}") for k in range(3)]


path = os.path.join(tempfile.mkdtemp(), "a.exr")
cases = []
for case in CASES:
    for socket, value in defaults:
        socket.default_value = value
    s = lambda name, value: setattr(node.inputs[name], "default_value", value)
    s("Base Color", (*COLOR, 1))
    s("Metallic", case["metallic"])
    s("Roughness", case["roughness"])
    s("IOR", case.get("ior", 1.5))
    s("Transmission Weight", case.get("transmission", 0))
    s("Coat Weight", case.get("clearcoat", 0))
    s("Coat Roughness", case.get("clearcoat_roughness", 0))
    s("Specular Tint", (*case.get("specular_color", [1, 1, 1]), 1))
    s("Sheen Weight", case.get("sheen", 0))
    s("Sheen Roughness", case.get("sheen_roughness", 0.5))
    values, lit = [], []
    for mu in MU:
        theta = math.acos(mu)
        camera.location = (5 * math.sin(theta), 0, 5 * mu)
        camera.rotation_euler = (0, theta, 0)
        background.inputs["Strength"].default_value, sun.data.energy, scene.cycles.samples = 1, 0, 4096
        values.append(pixel())
        background.inputs["Strength"].default_value, sun.data.energy, scene.cycles.samples = 0, 1, 256
        for polar, azimuth in WI:
            sun.rotation_euler = (0, math.radians(polar), math.radians(azimuth))
            lit.append(pixel())
    print(case, values, flush=True)
    cases.append({"params": case, "albedo": values, "values": lit})
with open(sys.argv[1], "w") as f:
    f.write('{"blender": "%s", "base_color": %s, "mu": %s, "wi": %s,\n "cases": [\n' % (bpy.app.version_string, COLOR, MU, WI))
    f.write(",\n".join(json.dumps(c, separators=(",", ":")) for c in cases) + "\n]}\n")
