//! The baked scene as GLB: the writer of descriptions, then what a description cannot say.

use serde_json::{Value, json};

use super::BakeError;
use super::output::BakedScene;

impl BakedScene {
    /// The file's bytes, and sentences about what was lost. `extras` is added to the scene under the name `etendue`.
    ///
    /// # Errors
    /// [`BakeError::Scene`] where the data exceed the 4 GiB of a GLB.
    pub fn glb(&self, extras: Value) -> Result<(Vec<u8>, Vec<String>), BakeError> {
        let fail = |what: String| BakeError::Scene(format!("the baked scene could not be written: {what}"));
        let (bytes, losses) = etendue_scene::formats::gltf::write_glb(&self.desc).map_err(|e| fail(e.to_string()))?;
        let (json, rest) = split(&bytes).ok_or_else(|| fail("no JSON".into()))?;
        let mut root: Value = serde_json::from_slice(json).map_err(|e| fail(e.to_string()))?;
        self.patch(&mut root);
        root["scenes"][0]["extras"] = json!({ "etendue": extras });
        let losses = losses.iter().map(|l| format!("{}: {}", l.feature, l.effect)).collect();
        Ok((join(root.to_string().into_bytes(), rest).ok_or_else(|| fail("more than 4 GiB".into()))?, losses))
    }

    fn patch(&self, root: &mut Value) {
        let mut used: Vec<&str> = Vec::new();
        for material in root.get_mut("materials").and_then(Value::as_array_mut).into_iter().flatten() {
            let patch = material.get("name").and_then(Value::as_str).and_then(|n| self.patches.get(n)).copied();
            let Some(patch) = patch else { continue };
            if patch.single_sided {
                material["doubleSided"] = json!(false);
            }
            if patch.unlit {
                material["extensions"] = json!({"KHR_materials_unlit": {}});
                used.push("KHR_materials_unlit");
            }
            if let (Some(intensity), Some(object)) = (patch.lightmap, material.as_object_mut()) {
                let info = object.remove("emissiveTexture");
                object.remove("emissiveFactor");
                if let Some(extensions) = object.get_mut("extensions").and_then(Value::as_object_mut) {
                    extensions.remove("KHR_materials_emissive_strength");
                }
                if let Some(mut lightmap) = info {
                    lightmap["intensity"] = json!(intensity);
                    material["extensions"]["MOZ_lightmap"] = lightmap;
                    used.push("MOZ_lightmap");
                }
            }
        }
        let listed = root.get("extensionsUsed").and_then(Value::as_array).cloned().unwrap_or_default();
        let mut names: Vec<String> = listed.iter().filter_map(Value::as_str).map(str::to_owned).collect();
        names.extend(used.iter().map(|n| (*n).to_owned()));
        names.sort();
        names.dedup();
        let in_use = |name: &String| any_key(root, name);
        let names: Vec<String> = names.iter().filter(|n| in_use(n)).cloned().collect();
        if names.is_empty() {
            root.as_object_mut().map(|o| o.remove("extensionsUsed"));
        } else {
            root["extensionsUsed"] = json!(names);
        }
    }
}

/// Whether an object somewhere within has a member of that name.
fn any_key(value: &Value, name: &str) -> bool {
    match value {
        Value::Object(o) => o.contains_key(name) || o.values().any(|v| any_key(v, name)),
        Value::Array(a) => a.iter().any(|v| any_key(v, name)),
        _ => false,
    }
}

/// The JSON and the chunks behind it of a GLB that the writer has made.
fn split(glb: &[u8]) -> Option<(&[u8], &[u8])> {
    let size = u32::from_le_bytes(*glb.get(12..16)?.first_chunk()?) as usize;
    glb.get(20..)?.split_at_checked(size)
}

fn join(mut json: Vec<u8>, rest: &[u8]) -> Option<Vec<u8>> {
    json.resize(json.len().next_multiple_of(4), b' ');
    let total = u32::try_from(20 + json.len() + rest.len()).ok()?;
    let mut out = b"glTF\x02\0\0\0".to_vec();
    out.extend(total.to_le_bytes());
    out.extend((json.len() as u32).to_le_bytes());
    out.extend(b"JSON");
    out.extend(json);
    out.extend(rest);
    Some(out)
}
