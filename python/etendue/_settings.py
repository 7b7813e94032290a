"""Typed keywords of `Scene.render`. Made by scripts/generate_settings.py; do not edit."""

from typing import TypedDict


class RenderSettings(TypedDict, total=False):
    """How to render a scene. None leaves the choice to the scene file, then to the renderer."""

    width: int | None
    """Width of the picture."""
    height: int | None
    """Height of the picture."""
    spp: int | None
    """Samples per pixel."""
    antialias: float | None
    """Smooth only pixels that differ from a neighbor by more than this, 0 to 3; 0 is off. POV-Ray scenes take 0.3 unless spp is given."""
    antialias_depth: int | None
    """Rows and columns of samples that antialiasing adds; 3 where not given."""
    integrator: str | None
    """How light is computed: path, direct, whitted, ao, normals."""
    sampler: str | None
    """Where samples come from: sobol (Owen-scrambled), independent, stratified, halton."""
    filter: str | None
    """Reconstruction filter: box, tent, gaussian, mitchell, blackman-harris, lanczos."""
    seed: int | None
    """Selects the random numbers: the same seed gives the same picture, bit for bit."""
    max_depth: int | None
    """Longest path in edges from the camera; 0 shows lights only, 1 direct light."""
    rr_depth: int | None
    """Path length from which Russian roulette may end a path."""
    light_sampler: str | None
    """Which lights next-event estimation chooses: bvh, power, uniform."""
    ao_distance: float | None
    """Reach of ambient occlusion; unlimited where not given."""
    light_groups: bool | None
    """Record the light of each named light and emitting shape apart, as `light.NAME.R/G/B` of EXR and film files."""
    mipmap: bool | None
    """Fit texture look-ups to the footprints of rays where a texture asks for it: less aliasing with few samples, slightly blurred."""
    camera: str | None
    """Name or number of the camera, where a file has several."""
