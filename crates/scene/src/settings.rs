//! How to render: what a file, the command line or Python may set.

use crate::params;

params! {
    /// How to render a scene. `None` leaves the choice to the scene file, then to the renderer.
    pub struct RenderSettings {
        /// Width of the picture.
        width: Option<u32> = None, "integer", "pixels";
        /// Height of the picture.
        height: Option<u32> = None, "integer", "pixels";
        /// Samples per pixel.
        spp: Option<u32> = None, "integer", "samples";
        /// Smooth only pixels that differ from a neighbor by more than this, 0 to 3; 0 is off. POV-Ray scenes take 0.3 unless spp is given.
        antialias: Option<f32> = None, "number", "";
        /// Rows and columns of samples that antialiasing adds; 3 where not given.
        antialias_depth: Option<u32> = None, "integer", "";
        /// Relative error, such as 0.02, at which pixels take no more samples (spp: at most; 1024); 0 for as many samples in each pixel.
        adaptive: Option<f32> = None, "number", "";
        /// Method: auto, path, pathmap, mnee, bdpt, vcm, mlt, light, sppm, photon, particles, radiosity, raster, whitted, direct, ao, normals
        integrator: Option<String> = None, "name", "";
        /// Where samples come from: sobol (Owen-scrambled), independent, stratified, halton.
        sampler: Option<String> = None, "name", "";
        /// Reconstruction filter: box, tent, gaussian, mitchell, blackman-harris, lanczos.
        filter: Option<String> = None, "name", "";
        /// Selects the random numbers: the same seed gives the same picture, bit for bit.
        seed: u64 = 0, "integer", "";
        /// Longest path in edges from the camera; 0 shows lights only, 1 direct light.
        max_depth: Option<u32> = None, "integer", "edges";
        /// Path length from which Russian roulette may end a path.
        rr_depth: Option<u32> = None, "integer", "edges";
        /// Most paths that go on from where a camera ray is scattered first, as a pilot decides by place; 16 where not given, 1: no pilot.
        max_splits: Option<u32> = None, "integer", "paths";
        /// Whether paths are guided to where light was found to come from: auto (where a trial says that it pays), on, off.
        guiding: Option<String> = None, "name", "";
        /// Which lights next-event estimation chooses: bvh, power, uniform.
        light_sampler: Option<String> = None, "name", "";
        /// Reach of ambient occlusion; unlimited where not given.
        ao_distance: Option<f32> = None, "number", "scene units";
        /// Segments of a full circle where POV-Ray's solids become triangles (raster, radiosity, bake); 64 where not given.
        tessellation: Option<u32> = None, "integer", "segments";
        /// How the raster integrator looks shadow maps up: hard, pcf (filtered edges), pcss (penumbras as wide as the light makes them).
        shadow_filter: Option<String> = None, "name", "";
        /// Edge of a shadow map; 1024 where not given.
        shadow_resolution: Option<u32> = None, "integer", "texels";
        /// Factor on the biases of shadow maps: 0 shows acne, much more than 1 moves shadows away from their casters.
        shadow_bias: Option<f32> = None, "number", "";
        /// Where shadow maps are drawn from: center (of each light), sampled (a new place of each light and the sky for every sample).
        shadow_maps: Option<String> = None, "name", "";
        /// What mirrors show with the raster integrator: none, sky, object (maps captured from the middle of each reflecting object).
        envmap: Option<String> = None, "name", "";
        /// How captured environment maps mend that all their rays start in one point: none, box.
        envmap_correction: Option<String> = None, "name", "";
        /// How radiosity is solved: hierarchical, progressive, matrix.
        radiosity_method: Option<String> = None, "name", "";
        /// Error of a link of hierarchical radiosity, relative to the mean irradiance; smaller makes more elements. 0.002 where not given.
        radiosity_error: Option<f32> = None, "number", "";
        /// Most elements of radiosity; 2000000 (hierarchical), 6000 (progressive), 3000 (matrix) where not given.
        radiosity_elements: Option<u32> = None, "integer", "elements";
        /// Most links of hierarchical radiosity, 24 bytes each; 60000000 where not given.
        radiosity_links: Option<u32> = None, "integer", "links";
        /// How progressive and matrix radiosity find form factors: rays, hemicube.
        radiosity_form_factors: Option<String> = None, "name", "";
        /// How matrix radiosity solves its system: gauss-seidel, jacobi, direct.
        radiosity_solver: Option<String> = None, "name", "";
        /// Rays by which an element of mean area looks around once radiosity is solved; 0 for none, 8 million for all where not given.
        radiosity_rays: Option<u32> = None, "integer", "rays";
        /// Rays of a final gather from each sample; 0 shows the radiosity solution itself.
        radiosity_gather: Option<u32> = None, "integer", "rays";
        /// How the radiosity solution is drawn without gathering: smooth, elements, mesh.
        radiosity_display: Option<String> = None, "name", "";
        /// Record the light of each named light and emitting shape apart, as `light.NAME.R/G/B` of EXR and film files.
        light_groups: bool = false, "switch", "";
        /// Fit texture look-ups to the footprints of rays where a texture asks for it: less aliasing with few samples, slightly blurred.
        mipmap: bool = false, "switch", "";
        /// Photons of a photon map (1 000 000 where not given), or of each pass of sppm (one for each pixel).
        photons: Option<u32> = None, "integer", "photons";
        /// Photons that an estimate of density looks at, up to 256; 64 for maps and 16 for sppm where not given.
        photon_neighbors: Option<u32> = None, "integer", "photons";
        /// Farthest reach of estimates of density, for sppm and vcm the first radius; found from the scene where not given.
        photon_radius: Option<f32> = None, "number", "scene units";
        /// Most memory for photons; where they are more, they are thinned, with a message.
        photon_memory: u32 = 1024, "integer", "MiB";
        /// In homogeneous media the ways of photons (beams) send light to the camera, not the points where they are scattered.
        photon_beams: bool = false, "switch", "";
        /// Photon map to use, made before by `etendue photons trace`: for particles and photon.
        photon_map: Option<String> = None, "file", "";
        /// Name or number of the camera, where a file has several.
        camera: Option<String> = None, "name or number", "";
    }
}
