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
        /// How light is computed: path, direct, whitted, ao, normals.
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
        /// Which lights next-event estimation chooses: bvh, power, uniform.
        light_sampler: Option<String> = None, "name", "";
        /// Reach of ambient occlusion; unlimited where not given.
        ao_distance: Option<f32> = None, "number", "scene units";
        /// Record the light of each named light and emitting shape apart, as `light.NAME.R/G/B` of EXR and film files.
        light_groups: bool = false, "switch", "";
        /// Fit texture look-ups to the footprints of rays where a texture asks for it: less aliasing with few samples, slightly blurred.
        mipmap: bool = false, "switch", "";
        /// Name or number of the camera, where a file has several.
        camera: Option<String> = None, "name or number", "";
    }
}
