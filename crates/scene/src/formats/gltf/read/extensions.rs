//! What the file asks of its reader: version and extensions.

use super::Reader;

/// Extensions that are honored.
const HONORED: &[&str] = &[
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    "EXT_texture_webp",
    "KHR_lights_punctual",
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_dispersion",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_iridescence",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_variants",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_meshopt_compression",
    "KHR_node_visibility",
    "KHR_texture_basisu",
    "KHR_texture_transform",
];

/// Extensions that report a loss or an error where they matter, or that have nothing to show in a picture.
const HANDLED_ELSEWHERE: &[&str] = &[
    "KHR_draco_mesh_compression",
    "KHR_materials_pbrSpecularGlossiness",
    "EXT_texture_avif",
    "MSFT_texture_dds",
    "KHR_xmp",
    "KHR_xmp_json_ld",
];

/// Extensions that are known and lost, and what is drawn instead.
const LOST: &[(&str, &str)] = &[
    ("KHR_materials_diffuse_transmission", "ignored: the surface lets no diffuse light through"),
    ("KHR_materials_volume_scatter", "ignored: the volume only absorbs"),
    ("EXT_lights_image_based", "ignored: no environment light"),
    ("EXT_lights_ies", "ignored: the light profile is not used"),
    ("KHR_animation_pointer", "static pose"),
    ("KHR_physics_rigid_bodies", "static pose"),
];

impl Reader<'_> {
    /// Checks version and extensions, and finds the material variant.
    ///
    /// # Errors
    /// The sentence that says why no file like this is read.
    pub(super) fn check_head(&mut self) -> Result<(), String> {
        let asset = self.required(self.root, "asset").and_then(|_| self.object(self.root, "asset"));
        if let Some(asset) = asset {
            let version = self.required(asset, "version").and_then(|_| self.string(asset, "version")).unwrap_or("2.0");
            let needed = self.string(asset, "minVersion").unwrap_or(version);
            if !version.starts_with("2.") || needed != version && needed != "2.0" {
                return Err(format!("glTF version {needed}; version 2.0 is read"));
            }
        }
        let used = self.array(self.root, "extensionsUsed");
        let required = self.array(self.root, "extensionsRequired");
        for v in required {
            let Some(name) = v.as_str() else {
                self.error(v, "expected a string");
                continue;
            };
            let known = HONORED.iter().chain(HANDLED_ELSEWHERE).any(|k| *k == name) || LOST.iter().any(|(k, _)| *k == name);
            if !known {
                self.error(v, format!("the file requires the extension {name}, which is not supported"));
            }
        }
        for v in used {
            let Some(name) = v.as_str() else {
                self.error(v, "expected a string");
                continue;
            };
            if let Some((_, effect)) = LOST.iter().find(|(k, _)| *k == name) {
                self.loss(v, name, *effect);
            } else if !HONORED.iter().chain(HANDLED_ELSEWHERE).any(|k| *k == name) {
                self.loss(v, name, "ignored: unknown extension");
            }
        }
        self.find_variant();
        Ok(())
    }

    fn find_variant(&mut self) {
        let Some(wanted) = self.options.variant.as_deref() else { return };
        let variants = match self.extension(self.root, "KHR_materials_variants") {
            Some(e) => self.array(e, "variants"),
            None => &[],
        };
        let names: Vec<String> = variants.iter().map(|v| self.name(v)).collect();
        let by_number = wanted.parse().ok().filter(|&i: &usize| i < names.len());
        self.variant = names.iter().position(|n| n == wanted).or(by_number);
        if self.variant.is_none() {
            let known = if names.is_empty() { "none".to_owned() } else { names.join(", ") };
            self.error(self.root, format!("no material variant `{wanted}`; there are: {known}"));
        }
    }
}
