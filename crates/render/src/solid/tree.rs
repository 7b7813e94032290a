//! From objects to a tree of nodes: leaves with everything they inherit, constructive combinations above them.

use std::collections::HashMap;
use std::sync::Arc;

use etendue_procedural::{Images, Texture};
use etendue_scene::desc::classic::{Interior, MAX_LEAVES, Object, Solid};
use glam::{DAffine3, DMat4};

use super::bvh::Bvh;
use super::compile::{Compiler, Shape};
use super::{Bounds, Primitive};

/// Groups with more parts get a hierarchy of their own.
const GROUP: usize = 8;

/// Number of a node in [`Tree::nodes`].
pub(super) type NodeId = u32;

/// A primitive in its place.
pub(super) struct Leaf {
    pub shape: Shape,
    /// Its own space from world space; `None` where they are the same.
    pub solid_from_world: Option<Box<DAffine3>>,
    /// The normal turns: an odd number of inverses and differences above.
    pub flip: bool,
    /// Bits of [`super::RayKind`]s that do not see it.
    pub hidden: u8,
    /// The object with texture, interior and flags that it inherits.
    pub object: Arc<Object>,
    /// Number of the top-level object that it is of.
    pub whole: u32,
    /// Textures of the shape's parts, in world space.
    pub own_textures: Vec<Arc<Texture>>,
    /// The combination whose parts give the texture of cut faces.
    pub cutaway: Option<NodeId>,
    /// Its shape costs more than its box: the box is asked first.
    pub box_first: bool,
    /// No light passes it, wherever and from whichever side.
    pub opaque: bool,
    /// Its textures may look at surface coordinates.
    pub uses_uv: bool,
    /// Its textures may show light from behind.
    pub shows_light_behind: bool,
}

/// What a node is.
pub(super) enum Kind {
    /// Primitive, index into [`Tree::leaves`].
    Leaf(u32),
    /// All surfaces of all parts.
    Union(Group),
    /// Surfaces inside of all other parts.
    Intersection(Group),
    /// Surfaces outside of all other parts.
    Merge(Group),
}

/// A node of the tree.
pub(super) struct Node {
    pub kind: Kind,
    /// Holds the surface.
    pub bounds: Bounds,
    /// Holds the inside as it is before `inverse`.
    pub inside_bounds: Bounds,
    /// Inside and outside change places.
    pub inverse: bool,
    /// Only what is inside of all of these is there.
    pub clips: Vec<NodeId>,
    /// Lines that miss one of these miss the node.
    pub bounding: Vec<NodeId>,
}

/// Parts of a combination.
pub(super) struct Group {
    pub children: Vec<NodeId>,
    /// Over the boxes of surfaces, by index into `children`; with few children there is none.
    pub by_line: Option<Bvh>,
    /// Children that are not in `by_line`.
    pub unbounded: Vec<u32>,
    /// Over the boxes of insides (before inverse), by index into `children`.
    pub by_point: Option<Bvh>,
    /// Children that are not in `by_point`.
    pub unbounded_inside: Vec<u32>,
}

impl Group {
    fn new(children: Vec<NodeId>, nodes: &[Node]) -> Self {
        let index = |bounds: &dyn Fn(&Node) -> Bounds| {
            if children.len() <= GROUP {
                return (None, (0..children.len() as u32).collect());
            }
            let boxes: Vec<Bounds> = children.iter().map(|&c| bounds(&nodes[c as usize])).collect();
            let apart = (0..children.len() as u32).filter(|&i| !boxes[i as usize].is_finite() && !boxes[i as usize].is_empty()).collect();
            (Some(Bvh::new(boxes)), apart)
        };
        let (by_line, unbounded) = index(&|n| n.bounds);
        let (by_point, unbounded_inside) = index(&|n| n.inside_bounds);
        Self { children, by_line, unbounded, by_point, unbounded_inside }
    }
}

/// All objects of a scene, taken apart.
#[derive(Default)]
pub(super) struct Tree {
    pub nodes: Vec<Node>,
    pub leaves: Vec<Leaf>,
    /// Nodes that are tested on their own: top-level objects, unions split.
    pub roots: Vec<NodeId>,
}

/// What parts inherit.
#[derive(Clone)]
struct Above {
    world_from_parent: DMat4,
    flip: bool,
    texture: Option<Arc<Texture>>,
    interior_texture: Option<Arc<Texture>>,
    interior: Option<Arc<Interior>>,
    hollow: bool,
    uv_mapping: bool,
    no_shadow: bool,
    no_image: bool,
    no_reflection: bool,
    no_radiosity: bool,
    double_illuminate: bool,
    light_group: u32,
    whole: u32,
    photons: etendue_scene::desc::classic::PhotonSettings,
    radiosity_importance: Option<f64>,
    /// Number of the combination that gives cut faces their textures, known when it is done.
    cutaway: Option<usize>,
}

/// Originals and moved copies, by the original's address and the matrix.
type Moved<T> = HashMap<(usize, [u64; 16]), (Arc<T>, Arc<T>)>;

/// Builds a [`Tree`].
pub(super) struct Builder<'a> {
    tree: Tree,
    /// Top-level objects so far.
    wholes: u32,
    compiler: Compiler<'a>,
    textures: Moved<Texture>,
    /// Leaves that wait for the number of a combination, and those numbers.
    cutaways: Vec<Option<NodeId>>,
}

impl<'a> Builder<'a> {
    pub(super) fn new(images: Option<&'a dyn Images>) -> Self {
        Self { tree: Tree::default(), wholes: 0, compiler: Compiler::new(images), textures: HashMap::new(), cutaways: Vec::new() }
    }

    /// Adds a top-level object.
    pub(super) fn add(&mut self, object: &Arc<Object>) {
        self.wholes += 1;
        let above = Above {
            world_from_parent: DMat4::IDENTITY,
            flip: false,
            texture: None,
            interior_texture: None,
            interior: None,
            hollow: false,
            uv_mapping: false,
            no_shadow: false,
            no_image: false,
            no_reflection: false,
            no_radiosity: false,
            double_illuminate: false,
            light_group: 0,
            whole: self.wholes,
            photons: Default::default(),
            radiosity_importance: None,
            cutaway: None,
        };
        self.add_root(object, &above);
    }

    pub(super) fn finish(self) -> Tree {
        self.tree
    }

    /// Unions without clips are only glue: their parts become roots.
    fn add_root(&mut self, object: &Arc<Object>, above: &Above) {
        match &object.solid {
            Solid::Union(parts) if !object.inverse && object.clipped_by.is_empty() => {
                let below = self.inherit(object, above);
                for part in parts {
                    self.add_root(part, &below);
                }
            }
            _ => {
                if let Some(node) = self.node(object, above, false) {
                    self.tree.roots.push(node);
                }
            }
        }
    }

    /// What the parts of an object inherit.
    fn inherit(&mut self, object: &Object, above: &Above) -> Above {
        let m = above.world_from_parent;
        Above {
            world_from_parent: m * object.world_from_solid,
            flip: above.flip ^ object.inverse,
            texture: object.texture.as_ref().map(|t| self.texture(t, &m)).or_else(|| above.texture.clone()),
            interior_texture: object.interior_texture.as_ref().map(|t| self.texture(t, &m)).or_else(|| above.interior_texture.clone()),
            interior: own_interior(object, &m).or_else(|| above.interior.clone()),
            hollow: if object.hollow_stated { object.hollow } else { above.hollow },
            uv_mapping: object.uv_mapping || (object.texture.is_none() && above.uv_mapping),
            no_shadow: object.no_shadow || above.no_shadow,
            no_image: object.no_image || above.no_image,
            no_reflection: object.no_reflection || above.no_reflection,
            no_radiosity: object.no_radiosity || above.no_radiosity,
            double_illuminate: object.double_illuminate || above.double_illuminate,
            light_group: if object.light_group != 0 { object.light_group } else { above.light_group },
            whole: above.whole,
            photons: etendue_scene::desc::classic::PhotonSettings {
                target: object.photons.target.or(above.photons.target),
                refraction: object.photons.refraction.or(above.photons.refraction),
                reflection: object.photons.reflection.or(above.photons.reflection),
                no_collect: object.photons.no_collect || above.photons.no_collect,
                pass_through: object.photons.pass_through || above.photons.pass_through,
            },
            radiosity_importance: object.radiosity_importance.or(above.radiosity_importance),
            cutaway: if object.texture.is_some() && !object.texture_is_default { None } else { above.cutaway },
        }
    }

    /// A texture moved to world space; the same for all that share it.
    fn texture(&mut self, texture: &Arc<Texture>, m: &DMat4) -> Arc<Texture> {
        if *m == DMat4::IDENTITY {
            return texture.clone();
        }
        let key = (Arc::as_ptr(texture) as usize, m.to_cols_array().map(f64::to_bits));
        let (_, moved) = self.textures.entry(key).or_insert_with(|| {
            let mut moved = (**texture).clone();
            moved.move_with_object(m);
            // The original is kept so that its address is not used again.
            (texture.clone(), Arc::new(moved))
        });
        moved.clone()
    }

    /// The node of an object; `None` where nothing of it can be seen or be inside of. `turn`: it is subtracted.
    fn node(&mut self, object: &Arc<Object>, above: &Above, turn: bool) -> Option<NodeId> {
        if self.tree.leaves.len() as u64 >= MAX_LEAVES {
            return None;
        }
        let mut below = self.inherit(object, above);
        below.flip ^= turn;
        let inverse = object.inverse ^ turn;
        let clips = self.shapes(&object.clipped_by, above);
        let bounding = self.shapes(&object.bounded_by, above);
        let cutaway = match &object.solid {
            Solid::Intersection(_) | Solid::Difference(_)
                if object.cutaway_textures && (object.texture.is_none() || object.texture_is_default) =>
            {
                self.cutaways.push(None);
                below.cutaway = Some(self.cutaways.len() - 1);
                below.cutaway
            }
            _ => None,
        };
        let first_leaf = self.tree.leaves.len();
        let (kind, bounds, inside_bounds) = match &object.solid {
            Solid::Light(_) => return None,
            Solid::Union(parts) => {
                let children: Vec<NodeId> = parts.iter().filter_map(|p| self.node(p, &below, false)).collect();
                let (bounds, inside) = self.hull(&children);
                let group = Group::new(children, &self.tree.nodes);
                // Turned inside out, a union has no inner surfaces: it is the intersection of its parts' outsides.
                (if inverse { Kind::Merge(group) } else { Kind::Union(group) }, bounds, inside)
            }
            Solid::Merge(parts) => {
                let children: Vec<NodeId> = parts.iter().filter_map(|p| self.node(p, &below, false)).collect();
                let (bounds, inside) = self.hull(&children);
                (Kind::Merge(Group::new(children, &self.tree.nodes)), bounds, inside)
            }
            Solid::Intersection(parts) | Solid::Difference(parts) => {
                let difference = matches!(object.solid, Solid::Difference(_));
                let mut children = Vec::with_capacity(parts.len());
                for (i, part) in parts.iter().enumerate() {
                    let subtracted = difference && i > 0;
                    match self.node(part, &below, subtracted) {
                        Some(node) => children.push(node),
                        // What is left out is nowhere inside: an intersection with it is empty, a difference does not change.
                        None if subtracted || matches!(part.solid, Solid::Light(_)) => {}
                        None => return None,
                    }
                }
                if children.is_empty() {
                    return None;
                }
                let bounds = children.iter().fold(Bounds::INFINITE, |b, &c| {
                    let n = &self.tree.nodes[c as usize];
                    if n.inverse { b } else { b.intersection(n.inside_bounds.union(n.bounds)) }
                });
                let surface = self.hull(&children).0.intersection(bounds);
                (Kind::Intersection(Group::new(children, &self.tree.nodes)), surface, bounds)
            }
            solid => {
                let shape = self.compiler.shape(solid)?;
                self.leaf(shape, object, below, inverse)?
            }
        };
        let mut node = Node { kind, bounds: bounds.padded(), inside_bounds: inside_bounds.padded(), inverse, clips, bounding };
        for &c in &node.clips {
            let clip = &self.tree.nodes[c as usize];
            if !clip.inverse {
                node.bounds = node.bounds.intersection(clip.inside_bounds);
                node.inside_bounds = node.inside_bounds.intersection(clip.inside_bounds);
            }
        }
        for &b in &node.bounding {
            let bound = &self.tree.nodes[b as usize];
            if !bound.inverse {
                node.bounds = node.bounds.intersection(bound.inside_bounds);
            }
        }
        let id = self.tree.nodes.len() as NodeId;
        self.tree.nodes.push(node);
        if let Some(c) = cutaway {
            self.cutaways[c] = Some(id);
            // Leaves hold the slot's number until the combination has its own.
            for leaf in &mut self.tree.leaves[first_leaf..] {
                if leaf.cutaway == Some(pending(c)) {
                    leaf.cutaway = Some(id);
                }
            }
        }
        Some(id)
    }

    /// Boxes of surfaces and of insides of several nodes.
    fn hull(&self, nodes: &[NodeId]) -> (Bounds, Bounds) {
        nodes.iter().fold((Bounds::EMPTY, Bounds::EMPTY), |(surface, inside), &c| {
            let n = &self.tree.nodes[c as usize];
            (surface.union(n.bounds), inside.union(if n.inverse { Bounds::INFINITE } else { n.inside_bounds }))
        })
    }

    /// Nodes of clips or bounds. One that cannot be made is left out.
    fn shapes(&mut self, objects: &[Arc<Object>], above: &Above) -> Vec<NodeId> {
        if objects.is_empty() {
            return Vec::new();
        }
        let mut plain = above.clone();
        plain.flip = false;
        objects.iter().filter_map(|o| self.node(o, &plain, false)).collect()
    }

    fn leaf(&mut self, shape: Shape, object: &Arc<Object>, state: Above, inverse: bool) -> Option<(Kind, Bounds, Bounds)> {
        let world_from_solid = DAffine3::from_mat4(state.world_from_parent);
        if !world_from_solid.is_finite() {
            return None;
        }
        let (shape, placed) = shape.placed(&world_from_solid);
        let (solid_from_world, bounds, inside) = if placed {
            (None, shape.bounds(), shape.inside_bounds())
        } else {
            let inverse = world_from_solid.inverse();
            if !inverse.is_finite() {
                return None;
            }
            let inside = if shape.inside_bounds() == shape.bounds() {
                shape.extent(&world_from_solid)
            } else {
                shape.inside_bounds().transformed(&world_from_solid)
            };
            (Some(Box::new(inverse)), shape.extent(&world_from_solid), inside)
        };
        let m = state.world_from_parent;
        let own_textures: Vec<Arc<Texture>> = shape.own_textures().iter().map(|t| self.texture(t, &m)).collect();
        let textures = || state.texture.iter().chain(&state.interior_texture).chain(&own_textures);
        // Cut faces show textures of other leaves.
        let box_first = !placed || matches!(shape, Shape::Other(_));
        let opaque = state.cutaway.is_none() && textures().all(|t| t.is_opaque());
        let uses_uv = state.uv_mapping || object.uv_mapping || state.cutaway.is_some() || textures().any(|t| t.uses_uv());
        let shows_light_behind = state.cutaway.is_some() || textures().any(|t| t.shows_light_behind());
        let hidden = [state.no_image, state.no_reflection, state.no_shadow, state.no_radiosity];
        let resolved = Object {
            world_from_solid: state.world_from_parent,
            inverse,
            texture: state.texture,
            interior_texture: state.interior_texture,
            interior: state.interior,
            clipped_by: Vec::new(),
            bounded_by: Vec::new(),
            no_shadow: state.no_shadow,
            no_image: state.no_image,
            no_reflection: state.no_reflection,
            no_radiosity: state.no_radiosity,
            hollow: state.hollow,
            double_illuminate: state.double_illuminate,
            uv_mapping: state.uv_mapping,
            photons: state.photons,
            radiosity_importance: state.radiosity_importance,
            light_group: state.light_group,
            ..(**object).clone()
        };
        self.tree.leaves.push(Leaf {
            shape,
            solid_from_world,
            flip: state.flip,
            hidden: hidden.iter().enumerate().fold(0, |bits, (i, &h)| bits | u8::from(h) << i),
            object: Arc::new(resolved),
            own_textures,
            whole: state.whole,
            cutaway: state.cutaway.map(pending),
            box_first,
            opaque,
            uses_uv,
            shows_light_behind,
        });
        Some((Kind::Leaf(self.tree.leaves.len() as u32 - 1), bounds, inside))
    }
}

/// The interior that an object itself states, moved to world space; of old scenes that of its texture. Each time another one: rays tell by
/// it what they are inside of, and the parts of one object share it.
fn own_interior(object: &Object, m: &DMat4) -> Option<Arc<Interior>> {
    let mut interior = match &object.interior {
        Some(interior) => (**interior).clone(),
        None => {
            let layers = object.texture.as_ref()?.layers()?;
            let old = layers.iter().rev().map(|l| &l.finish.old_interior).find(|old| old.ior.is_some())?;
            let plain = Interior::default();
            Interior {
                ior: old.ior.unwrap_or(plain.ior),
                caustics: old.caustics.unwrap_or(plain.caustics),
                fade_distance: old.fade_distance.unwrap_or(plain.fade_distance),
                fade_power: old.fade_power.unwrap_or(plain.fade_power),
                ..plain
            }
        }
    };
    interior.transform(m);
    Some(Arc::new(interior))
}

/// What a leaf holds in place of the number of a combination that is not done yet.
fn pending(slot: usize) -> NodeId {
    NodeId::MAX - slot as NodeId
}
