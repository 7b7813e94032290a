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
    adaptive: float | None
    """Relative error, such as 0.02, at which pixels take no more samples (spp: at most; 1024); 0 for as many samples in each pixel."""
    integrator: str | None
    """Method: auto, path, pathmap, mnee, bdpt, vcm, mlt, light, sppm, photon, particles, radiosity, raster, whitted, direct, ao, normals"""
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
    max_splits: int | None
    """Most paths that go on from where a camera ray is scattered first, as a pilot decides by place; 16 where not given, 1: no pilot."""
    guiding: str | None
    """Whether paths are guided to where light was found to come from: auto (where a trial says that it pays), on, off."""
    light_sampler: str | None
    """Which lights next-event estimation chooses: bvh, power, uniform."""
    ao_distance: float | None
    """Reach of ambient occlusion; unlimited where not given."""
    tessellation: int | None
    """Segments of a full circle where POV-Ray's solids become triangles (raster, radiosity, bake); 64 where not given."""
    shadow_filter: str | None
    """How the raster integrator looks shadow maps up: hard, pcf (filtered edges), pcss (penumbras as wide as the light makes them)."""
    shadow_resolution: int | None
    """Edge of a shadow map; 1024 where not given."""
    shadow_bias: float | None
    """Factor on the biases of shadow maps: 0 shows acne, much more than 1 moves shadows away from their casters."""
    shadow_maps: str | None
    """Where shadow maps are drawn from: center (of each light), sampled (a new place of each light and the sky for every sample)."""
    envmap: str | None
    """What mirrors show with the raster integrator: none, sky, object (maps captured from the middle of each reflecting object)."""
    envmap_correction: str | None
    """How captured environment maps mend that all their rays start in one point: none, box."""
    radiosity_method: str | None
    """How radiosity is solved: hierarchical, progressive, matrix."""
    radiosity_error: float | None
    """Error of a link of hierarchical radiosity, relative to the mean irradiance; smaller makes more elements. 0.002 where not given."""
    radiosity_elements: int | None
    """Most elements of radiosity; 2000000 (hierarchical), 6000 (progressive), 3000 (matrix) where not given."""
    radiosity_links: int | None
    """Most links of hierarchical radiosity, 24 bytes each; 60000000 where not given."""
    radiosity_form_factors: str | None
    """How progressive and matrix radiosity find form factors: rays, hemicube."""
    radiosity_solver: str | None
    """How matrix radiosity solves its system: gauss-seidel, jacobi, direct."""
    radiosity_rays: int | None
    """Rays by which an element of mean area looks around once radiosity is solved; 0 for none, 8 million for all where not given."""
    radiosity_gather: int | None
    """Rays of a final gather from each sample; 0 shows the radiosity solution itself."""
    radiosity_display: str | None
    """How the radiosity solution is drawn without gathering: smooth, elements, mesh."""
    light_groups: bool | None
    """Record the light of each named light and emitting shape apart, as `light.NAME.R/G/B` of EXR and film files."""
    mipmap: bool | None
    """Fit texture look-ups to the footprints of rays where a texture asks for it: less aliasing with few samples, slightly blurred."""
    photons: int | None
    """Photons of a photon map (1 000 000 where not given), or of each pass of sppm (one for each pixel)."""
    photon_neighbors: int | None
    """Photons that an estimate of density looks at, up to 256; 64 for maps and 16 for sppm where not given."""
    photon_radius: float | None
    """Farthest reach of estimates of density, for sppm and vcm the first radius; found from the scene where not given."""
    photon_memory: int | None
    """Most memory for photons; where they are more, they are thinned, with a message."""
    photon_beams: bool | None
    """In homogeneous media the ways of photons (beams) send light to the camera, not the points where they are scattered."""
    photon_map: str | None
    """Photon map to use, made before by `etendue photons trace`: for particles and photon."""
    camera: str | None
    """Name or number of the camera, where a file has several."""
