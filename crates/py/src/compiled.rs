//! Compiled scenes that are kept from one rendering to the next: hierarchies and textures are made once for many views, seeds and sizes.

use std::sync::{Arc, Mutex, PoisonError};

use etendue_render::scene::{self, View};
use etendue_render::session::job::{self, JobError, Plan};
use etendue_render::session::{Aov, Session};
use etendue_scene::{RenderSettings, SceneDesc};

/// At most one compiled scene that no rendering uses at the moment, with the settings that it was compiled for.
#[derive(Default)]
pub struct Compiled(Mutex<Option<(String, scene::Scene)>>);

impl Compiled {
    fn take(&self, key: &str) -> Option<scene::Scene> {
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let (_, scene) = kept.take_if(|(k, _)| k == key)?;
        Some(scene)
    }

    /// Keeps a scene for the next rendering, if nothing else uses it any more.
    pub fn keep(&self, key: String, scene: Arc<scene::Scene>) {
        if let Some(scene) = Arc::into_inner(scene) {
            *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some((key, scene));
        }
    }
}

/// What a rendering starts from.
#[derive(Clone)]
pub struct Source {
    pub desc: Arc<SceneDesc>,
    /// Where to look from; `None`: the file's camera.
    pub view: Option<View>,
    pub compiled: Arc<Compiled>,
}

impl Source {
    /// A session, and the scene that it uses.
    pub fn prepare(&self, settings: &RenderSettings, plan: &Plan, aovs: &[Aov]) -> Result<(Session, Arc<scene::Scene>), JobError> {
        let size = [plan.width, plan.height];
        // A wrong name is told before any work is done.
        job::method(&self.desc, settings, plan)?;
        let mut scene = match self.compiled.take(&job::compile_key(settings)) {
            Some(scene) => scene,
            None => scene::compile(&self.desc, settings, size).map_err(JobError::Scene)?,
        };
        scene.look(&self.desc, settings, size, self.view).map_err(JobError::Scene)?;
        let scene = Arc::new(scene);
        Ok((job::prepare_compiled(&self.desc, settings, plan, aovs, Arc::clone(&scene))?, scene))
    }
}
