//! What scenes of the classic model say and this renderer does not do.

use etendue_procedural::Texture;
use etendue_scene::desc::classic::{ClassicScene, Object};
use etendue_scene::{Loss, Span};

/// Features that are read but not rendered, each named once, with its first place.
pub fn losses(scene: &ClassicScene) -> Vec<Loss> {
    let mut losses = Vec::new();
    let mut add =
        |span: Span, feature: &str, effect: &str| losses.push(Loss { span, feature: feature.to_owned(), effect: effect.to_owned() });
    if scene.settings.subsurface.is_some()
        && let Some(object) = find(&scene.objects, &|o| o.texture.as_deref().is_some_and(translucent))
    {
        add(object.span, "subsurface scattering", "the surface scatters as without it");
    }
    losses
}

fn translucent(texture: &Texture) -> bool {
    texture.layers().is_some_and(|layers| layers.iter().any(|l| l.finish.translucency.is_some()))
}

/// The first object, or part of one, that a test accepts.
fn find<'o>(objects: &'o [std::sync::Arc<Object>], accept: &dyn Fn(&Object) -> bool) -> Option<&'o Object> {
    let mut pending: Vec<&'o Object> = objects.iter().rev().map(|o| &**o).collect();
    // Parts may be shared by many objects; a bounded search is enough for a report.
    for _ in 0..1_000_000 {
        let object = pending.pop()?;
        if accept(object) {
            return Some(object);
        }
        if let Some(parts) = object.solid.parts() {
            pending.extend(parts.iter().rev().map(|p| &**p));
        }
    }
    None
}
