//! Small bakes.

use etendue_render::lightmap::{Bake, BakeOptions, Baked, Content, Layout, Solution, Watcher};
use etendue_render::session::{Cancel, Observer, Stop};
use etendue_scene::desc::*;
use etendue_scene::{RenderSettings, SceneDesc};
use glam::Vec3;

use super::perspective;

/// Says nothing.
pub struct Quiet;
impl Observer for Quiet {}
impl Watcher for Quiet {}

/// Options of a small atlas.
pub fn small() -> BakeOptions {
    BakeOptions { resolution: 64, ..BakeOptions::default() }
}

/// Settings of so long paths.
pub fn depth(max_depth: u32) -> RenderSettings {
    RenderSettings { max_depth: Some(max_depth), ..RenderSettings::default() }
}

/// Bakes by path tracing.
pub fn bake(desc: &SceneDesc, settings: &RenderSettings, options: &BakeOptions, spp: u32) -> (Bake, Solution, Baked) {
    let bake = Bake::new(desc, settings, options, "path").unwrap();
    let mut solution = Solution::new(bake.point_count());
    let stop = Stop { spp: Some(spp), ..Stop::default() };
    assert!(bake.solve(&bake.path(), stop, &mut solution, &Cancel::default(), &Quiet));
    let baked = bake.finish(&solution, None).unwrap();
    (bake, solution, baked)
}

/// The layout of a bake's texels.
pub fn layout(bake: &Bake) -> &Layout {
    match &bake.content {
        Content::Texels(layout, _) => layout,
        Content::Vertices(_) => panic!("texels were asked for"),
    }
}

/// A camera; baking needs none, compiling does.
pub fn view(desc: &mut SceneDesc) {
    perspective(desc, Vec3::new(0.0, 0.0, 9.0), Vec3::ZERO, 40.0);
}

/// The cube [−1, 1]³ in squares.
pub fn fine_cube(n: u32) -> MeshData {
    let mut mesh = MeshData::default();
    for axis in 0..3 {
        for sign in [-1.0f32, 1.0] {
            let mut normal = Vec3::ZERO;
            normal[axis] = sign;
            let s = Vec3::from_array(std::array::from_fn(|i| if i == (axis + 1) % 3 { 1.0 } else { 0.0 }));
            let t = normal.cross(s);
            let base = mesh.positions.len() as u32;
            for j in 0..=n {
                for i in 0..=n {
                    let at = |k: u32| 2.0 * k as f32 / n as f32 - 1.0;
                    mesh.positions.push(normal + s * at(i) + t * at(j));
                    mesh.normals.push(normal);
                }
            }
            for j in 0..n {
                for i in 0..n {
                    let a = base + j * (n + 1) + i;
                    let b = a + n + 1;
                    mesh.triangles.extend([[a, a + 1, b + 1], [a, b + 1, b]]);
                }
            }
        }
    }
    mesh
}
