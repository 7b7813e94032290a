//! What each method cannot do, in plain words.

/// Strengths and limits of a method; empty for one that is not known here.
pub(super) fn limits(method: &str) -> &'static str {
    match method {
        "path" => {
            "Unbiased: noise is all that is between it and the truth. Slow where light reaches diffuse surfaces through small mirrors or glass \
             (caustics of small lights), and it never finds a point light behind glass."
        }
        "direct" => "Light that comes straight from the lights. No color bleeding, no light through or off other surfaces, black shadows.",
        "whitted" => {
            "Mirrors, refraction and hard or soft shadows, followed exactly. No color bleeding, no caustics: light between diffuse surfaces is \
             missing or replaced by a constant ambient term."
        }
        "radiosity" => {
            "Light between diffuse surfaces, solved once for all views. No mirrors, no glass, no gloss; detail is limited by the size of the \
             elements."
        }
        "raster" => {
            "A z-buffer with shadow maps and environment maps: fast, and an imitation. No light between surfaces; shadows are limited by the \
             map's resolution and bias; reflections come from one point of view."
        }
        "light" => {
            "Paths from the lights, joined to the camera. Very good at caustics on diffuse surfaces; cannot see anything in a mirror or \
             through glass, and wastes work on what the camera does not see."
        }
        "bdpt" => {
            "Paths from both ends, all connections weighted. Good indoors and at caustics seen directly; caustics seen in a mirror or through \
             glass remain out of its reach."
        }
        "vcm" => {
            "Bidirectional paths with photon merging. Finds nearly everything, caustics in mirrors as well; merging blurs over a radius that \
             shrinks with the passes, so the bias vanishes in the limit."
        }
        "mlt" => {
            "Follows up the paths that carry light. Good at light that is hard to find; noise comes in blotches, and an important region may \
             be found late."
        }
        "mnee" => {
            "Path tracing that solves for the ways through smooth glass and mirrors to small lights. Caustics without blur, of points and \
             the sun too; costs more than path, no help with large lights and rough glass, noisy at the focus of a caustic."
        }
        "pathmap" => {
            "Path tracing whose caustics, and what they light, come from photons, collected over radii that shrink with the passes. Finds \
             caustics in mirrors and behind glass; these are blurred while the radii are large, all other light is unbiased."
        }
        "sppm" => {
            "Photons, collected over radii that shrink with the passes. Very good at caustics, in mirrors too; blurred while the radii are \
             large, weak where few photons come."
        }
        "photon" => {
            "Direct light by rays, caustics and the rest from photon maps. Smooth quickly; a fixed amount of photons leaves a blur that more \
             samples do not remove."
        }
        "particles" => {
            "The photon map itself: light as particles found it, stored once for all views. Blurred over the radius of collection, dark at \
             edges, mottled where few particles fell."
        }
        "auto" => "Chooses among the other methods after a short trial.",
        _ => "",
    }
}
