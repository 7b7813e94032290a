//! Shapes, groups and instances.

use glam::{Mat4, Vec3};

use super::Builder;
use super::props::{Props, describe};
use crate::desc::{
    AddNode, Color, EmissionDesc, GeometryDesc, GroupDesc, GroupId, InstanceDesc, MediumId, MeshDesc, MeshFormat, Node, ShapeDesc, ShapeId,
};
use crate::formats::mitsuba::tree::{Kind, Plugin};
use crate::formats::spectrum::Quantity;

impl<'t> Builder<'t> {
    /// Adds a shape to the world, or to a group's list.
    pub(super) fn shape(&mut self, plugin: &'t Plugin, group: Option<&mut Vec<ShapeId>>) {
        self.guarded(plugin, |b| {
            b.build_shape(plugin, group);
            Some(())
        });
    }

    fn build_shape(&mut self, plugin: &'t Plugin, group: Option<&mut Vec<ShapeId>>) {
        if !self.is_known(plugin) {
            return;
        }
        let mut p = Props::new(plugin);
        match plugin.type_name.as_str() {
            "shapegroup" => {
                p.ignore_all();
                self.group(plugin);
            }
            "instance" => self.instance(&mut p, group.is_some()),
            "merge" => {
                let mut group = group;
                while let Some(nested) = self.next_of(&mut p, Kind::Shape) {
                    self.shape(nested, group.as_deref_mut());
                }
            }
            "heightfield" | "hair" | "bsplinecurve" | "linearcurve" | "sdfgrid" | "ellipsoids" | "ellipsoidsmesh" | "blender" => {
                self.lose(plugin, "left out");
                p.ignore_all();
            }
            _ => {
                if let Some(desc) = self.solid(&mut p) {
                    let id = self.desc.add(Node::named(&plugin.id, plugin.span, desc));
                    if let Some(group) = group {
                        group.push(id);
                    }
                }
            }
        }
        self.finish(p);
    }

    fn solid(&mut self, p: &mut Props<'t>) -> Option<ShapeDesc> {
        let world_from_object = p.transform("to_world");
        let flip_normals = p.bool("flip_normals", false);
        let bsdf = self.next_of(p, Kind::Bsdf).and_then(|n| self.bsdf(n));
        let emission = self.next_of(p, Kind::Emitter).and_then(|n| self.emission(n));
        let interior = self.medium_at(p, "interior");
        let exterior = self.medium_at(p, "exterior");
        while let Some(sensor) = self.next_of(p, Kind::Sensor) {
            self.lose(sensor, "ignored");
        }
        p.ignore(&["silhouette_sampling_weight"]);
        let geometry = self.geometry(p)?;
        if matches!(geometry, GeometryDesc::Sphere { .. } | GeometryDesc::Cylinder { .. }) {
            self.warn_uneven(p, world_from_object);
        }
        Some(ShapeDesc { flip_normals, bsdf, emission, interior, exterior, ..ShapeDesc::new(geometry, world_from_object) })
    }

    /// Mitsuba itself takes one radius; we render what the transform says.
    fn warn_uneven(&mut self, p: &Props<'t>, m: Mat4) {
        let lengths = [m.x_axis.length(), m.y_axis.length(), m.z_axis.length()];
        let most = lengths.iter().fold(0.0f32, |a, b| a.max(*b));
        let uneven = lengths.iter().take(2).any(|l| (l - lengths[0]).abs() > 1e-3 * most);
        if uneven {
            let message = format!("{}: a non-uniform scale, which Mitsuba does not honor", describe(p.plugin));
            self.desc.report.warning(p.plugin.span, message);
        }
    }

    fn medium_at(&mut self, p: &mut Props<'t>, name: &'static str) -> Option<MediumId> {
        let property = p.get(name)?;
        let plugin = self.resolve(property)?;
        if plugin.kind != Kind::Medium {
            p.fault(property.span, format!("`{name}` takes a medium, not {}", describe(plugin)));
            return None;
        }
        self.medium(plugin)
    }

    fn geometry(&mut self, p: &mut Props<'t>) -> Option<GeometryDesc> {
        Some(match p.plugin.type_name.as_str() {
            "sphere" => GeometryDesc::Sphere { center: p.opt_vector("center").unwrap_or(Vec3::ZERO), radius: p.positive("radius", 1.0) },
            "cylinder" => GeometryDesc::Cylinder {
                p0: p.opt_vector("p0").unwrap_or(Vec3::ZERO),
                p1: p.opt_vector("p1").unwrap_or(Vec3::Z),
                radius: p.positive("radius", 1.0),
            },
            "disk" => GeometryDesc::Disk,
            "rectangle" => GeometryDesc::Rectangle,
            "cube" => GeometryDesc::Cube,
            "obj" => self.mesh(p, MeshFormat::Obj)?,
            "ply" => self.mesh(p, MeshFormat::Ply)?,
            "stl" => self.mesh(p, MeshFormat::Stl)?,
            _ => self.mesh(p, MeshFormat::MitsubaSerialized)?,
        })
    }

    fn mesh(&mut self, p: &mut Props<'t>, format: MeshFormat) -> Option<GeometryDesc> {
        let face_normals = p.bool("face_normals", false);
        let flip_v = p.bool("flip_tex_coords", format == MeshFormat::Obj);
        let index = if format == MeshFormat::MitsubaSerialized { p.opt_count("shape_index", 0).unwrap_or(0) } else { 0 };
        p.lose(&["max_smooth_angle", "recenter"]);
        p.ignore(&["srgb", "collapse"]);
        let path = self.filename(p)?;
        let key = (path.clone(), format, index, flip_v);
        let mesh = match self.meshes.get(&key) {
            Some(mesh) => *mesh,
            None => {
                let desc = MeshDesc { file: Some((path, format, index)), flip_v, data: None };
                let mesh = self.desc.add(Node::named(&p.plugin.id, p.plugin.span, desc));
                self.meshes.insert(key, mesh);
                mesh
            }
        };
        Some(GeometryDesc::Mesh { mesh, face_normals, smooth: !face_normals })
    }

    /// What a shape emits.
    fn emission(&mut self, plugin: &'t Plugin) -> Option<EmissionDesc> {
        let key: *const Plugin = plugin;
        if let Some(built) = self.emissions.get(&key) {
            return built.clone();
        }
        let built = self.build_emission(plugin);
        self.emissions.insert(key, built.clone());
        built
    }

    fn build_emission(&mut self, plugin: &'t Plugin) -> Option<EmissionDesc> {
        if plugin.type_name != "area" {
            if self.is_known(plugin) {
                self.lose(plugin, "ignored (not a light of a surface)");
            }
            return None;
        }
        let mut p = Props::new(plugin);
        let radiance = self.opt_color(&mut p, "radiance", Quantity::Emission).unwrap_or(Color::gray(1.0));
        p.ignore(&["sampling_weight", "to_world"]);
        self.finish(p);
        Some(EmissionDesc { radiance, two_sided: false, group: String::new() })
    }

    fn group(&mut self, plugin: &'t Plugin) -> Option<GroupId> {
        let key: *const Plugin = plugin;
        if let Some(built) = self.groups.get(&key) {
            return *built;
        }
        // Nothing can nest in itself here: a group that holds an instance of itself is found by `guarded`.
        self.groups.insert(key, None);
        let mut p = Props::new(plugin);
        let mut shapes = Vec::new();
        p.ignore(&["to_world"]);
        while let Some(nested) = self.next_of(&mut p, Kind::Shape) {
            self.shape(nested, Some(&mut shapes));
        }
        self.finish(p);
        let id = self.desc.add(Node::named(&plugin.id, plugin.span, GroupDesc { shapes }));
        self.groups.insert(key, Some(id));
        Some(id)
    }

    fn instance(&mut self, p: &mut Props<'t>, in_group: bool) {
        let world_from_object = p.transform("to_world");
        let Some(nested) = self.next_of(p, Kind::Shape) else {
            p.fault(p.plugin.span, "a nested shapegroup is missing");
            return;
        };
        if nested.type_name != "shapegroup" {
            p.fault(p.plugin.span, format!("takes a shapegroup, not {}", describe(nested)));
            return;
        }
        if in_group {
            p.fault(p.plugin.span, "an instance within a shapegroup");
            return;
        }
        if let Some(group) = self.group(nested) {
            self.desc.add(Node::named(&p.plugin.id, p.plugin.span, InstanceDesc { group, world_from_object }));
        }
    }
}
