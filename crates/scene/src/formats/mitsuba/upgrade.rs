//! Files of Mitsuba 0.x: names become those of Mitsuba 3, as its own upgrade does, and plugins that it lacks become what they meant.

use glam::{DMat4, DVec3};

use super::tree::{Kind, Plugin, Property, Value};

/// `intIOR` → `int_ior`: a capital starts a word unless it goes on with a run of capitals.
pub fn snake_case(name: &str) -> String {
    let mut out = String::with_capacity(name.len() + 4);
    let mut previous_lower = false;
    for c in name.chars() {
        if c.is_uppercase() {
            if previous_lower {
                out.push('_');
            }
            out.extend(c.to_lowercase());
            previous_lower = false;
        } else {
            out.push(c);
            previous_lower = c.is_alphanumeric();
        }
    }
    out
}

/// Upgrades one plugin whose parameters already have new names; nested ones have been upgraded before.
pub fn plugin(plugin: &mut Plugin) {
    match plugin.kind {
        Kind::Texture => {
            rename_type(plugin, &[("ldrtexture", "bitmap"), ("vertexcolors", "mesh_attribute")]);
            uv_transform(plugin);
        }
        Kind::Bsdf => {
            let was_mirror = plugin.type_name == "mirror";
            rename_type(plugin, &[("bump", "bumpmap"), ("lambertian", "diffuse"), ("mirror", "conductor")]);
            if matches!(plugin.type_name.as_str(), "diffuse" | "roughdiffuse") {
                rename(plugin, "diffuse_reflectance", "reflectance");
            }
            // 0.x means copper where Mitsuba 3 means a mirror.
            if matches!(plugin.type_name.as_str(), "conductor" | "roughconductor")
                && !plugin.params.iter().any(|p| matches!(p.name.as_str(), "material" | "eta" | "k"))
            {
                let material = if was_mirror { "none" } else { "Cu" };
                add(plugin, "material", Value::Text(material.to_owned()));
            }
            if plugin.type_name == "bumpmap" || plugin.type_name == "normalmap" {
                name_texture(plugin, if plugin.type_name == "bumpmap" { "arbitrary" } else { "normalmap" });
            }
        }
        // Sky models of 0.x have +y to the zenith, those of Mitsuba 3 +z.
        Kind::Emitter if matches!(plugin.type_name.as_str(), "sky" | "sun" | "sunsky") => add(plugin, "y_up", Value::Bool(true)),
        Kind::Film => rename_type(plugin, &[("exrfilm", "hdrfilm"), ("pngfilm", "ldrfilm")]),
        _ => {}
    }
}

fn add(plugin: &mut Plugin, name: &str, value: Value) {
    plugin.params.push(Property { name: name.to_owned(), value, span: plugin.span });
}

fn rename_type(plugin: &mut Plugin, names: &[(&str, &str)]) {
    if let Some((_, new)) = names.iter().find(|(old, _)| *old == plugin.type_name) {
        plugin.type_name = (*new).to_owned();
    }
}

fn rename(plugin: &mut Plugin, old: &str, new: &str) {
    if !plugin.params.iter().any(|p| p.name == new)
        && let Some(p) = plugin.params.iter_mut().find(|p| p.name == old)
    {
        p.name = new.to_owned();
    }
}

/// The height or normal texture may have any name in 0.x.
fn name_texture(plugin: &mut Plugin, name: &str) {
    let is_texture = |p: &Property| matches!(&p.value, Value::Plugin(n) if n.kind == Kind::Texture);
    if let Some(p) = plugin.params.iter_mut().find(|p| is_texture(p)) {
        p.name = name.to_owned();
    }
}

/// `uoffset`, `voffset`, `uscale`, `vscale` and `uvscale` become `to_uv`.
fn uv_transform(plugin: &mut Plugin) {
    let mut take = |name: &str| {
        let i = plugin.params.iter().position(|p| p.name == name)?;
        match plugin.params[i].value {
            Value::Float(v) => {
                let span = plugin.params.remove(i).span;
                Some((v, span))
            }
            _ => None,
        }
    };
    let both = take("uvscale");
    let [scale_u, scale_v, offset_u, offset_v] = [take("uscale"), take("vscale"), take("uoffset"), take("voffset")];
    let Some((_, span)) = both.or(scale_u).or(scale_v).or(offset_u).or(offset_v) else { return };
    let scale = |own: Option<_>| own.or(both).map_or(1.0, |(v, _)| v);
    let offset = |own: Option<(f64, _)>| own.map_or(0.0, |(v, _)| v);
    let matrix = DMat4::from_translation(DVec3::new(offset(offset_u), offset(offset_v), 0.0))
        * DMat4::from_scale(DVec3::new(scale(scale_u), scale(scale_v), 1.0));
    plugin.params.push(Property { name: "to_uv".to_owned(), value: Value::Transform(matrix), span });
}

#[cfg(test)]
mod tests {
    use super::snake_case;

    #[test]
    fn names_become_snake_case() {
        for (old, new) in
            [("intIOR", "int_ior"), ("toWorld", "to_world"), ("reflectance", "reflectance"), ("alphaU", "alpha_u"), ("sigmaT", "sigma_t")]
        {
            assert_eq!(snake_case(old), new);
        }
    }
}
