//! `mesh` and `mesh2`.

use std::collections::HashMap;
use std::sync::Arc;

use etendue_procedural::Texture;
use glam::DVec3;

use super::super::{Parse, Parser, Token, Value};
use super::pattern::pick;
use crate::desc::classic::{Mesh, Solid};

/// Textures of triangles: each once.
#[derive(Default)]
struct TextureList {
    index: HashMap<usize, u32>,
}

impl TextureList {
    fn add(&mut self, mesh: &mut Mesh, texture: Arc<Texture>) -> u32 {
        // The list keeps the textures alive, so that their addresses stay theirs.
        *self.index.entry(Arc::as_ptr(&texture) as usize).or_insert_with(|| {
            mesh.textures.push(texture);
            mesh.textures.len() as u32 - 1
        })
    }
}

impl Parser {
    pub(super) fn mesh(&mut self) -> Parse<Solid> {
        let mut mesh = Mesh::default();
        let mut textures = TextureList::default();
        while let Some(word) = self.accept_any(&["triangle", "smooth_triangle"])? {
            let smooth = word == "smooth_triangle";
            self.expect("{")?;
            let corners: [DVec3; 3] = if smooth {
                let [a, na, b, nb, c, nc] = self.vectors3()?;
                let first = mesh.normals.len() as u32;
                mesh.normals.extend([na, nb, nc]);
                mesh.normal_faces.resize(mesh.faces.len(), Mesh::NONE);
                mesh.normal_faces.push([first, first + 1, first + 2]);
                [a, b, c]
            } else {
                self.vectors3()?
            };
            let face = mesh.faces.len();
            let first = mesh.vertices.len() as u32;
            mesh.vertices.extend(corners);
            mesh.faces.push([first, first + 1, first + 2]);
            if self.accept("uv_vectors")? {
                let first = mesh.uvs.len() as u32;
                for _ in 0..3 {
                    let uv = self.vector2()?;
                    mesh.uvs.push(uv);
                    self.comma()?;
                }
                mesh.uv_faces.resize(face, Mesh::NONE);
                mesh.uv_faces.push([first, first + 1, first + 2]);
            }
            let mut own = Mesh::NONE;
            if self.peek_word()? == Some("texture") {
                let texture = self.shared_texture()?;
                own = [textures.add(&mut mesh, texture); 3];
            } else if self.accept("texture_list")? {
                self.expect("{")?;
                for i in &mut own {
                    let texture = match self.accept_value(pick!(Texture))? {
                        Some(t) => t,
                        None => self.shared_texture()?,
                    };
                    *i = textures.add(&mut mesh, texture);
                    self.comma()?;
                }
                self.expect("}")?;
            }
            if own != Mesh::NONE {
                mesh.texture_faces.resize(face, Mesh::NONE);
                mesh.texture_faces.push(own);
            }
            self.expect("}")?;
        }
        self.inside_vector(&mut mesh)?;
        Ok(Solid::Mesh(Arc::new(mesh)))
    }

    pub(super) fn mesh2(&mut self) -> Parse<Solid> {
        let mut mesh = Mesh::default();
        let (mut has_normals, mut has_uvs) = (false, false);
        loop {
            let words = ["vertex_vectors", "normal_vectors", "uv_vectors", "texture_list", "face_indices", "normal_indices", "uv_indices"];
            let Some(word) = self.accept_any(&words)? else { break };
            self.expect("{")?;
            let count = self.count("entries")?;
            self.comma()?;
            match word {
                "texture_list" => {
                    for _ in 0..count {
                        let texture = match self.accept_value(pick!(Texture))? {
                            Some(t) => t,
                            None => Arc::new(self.texture_block()?),
                        };
                        mesh.textures.push(texture);
                        self.comma()?;
                    }
                }
                "vertex_vectors" | "normal_vectors" => {
                    for _ in 0..count {
                        let v = self.vector3()?;
                        (if word == "vertex_vectors" { &mut mesh.vertices } else { &mut mesh.normals }).push(v);
                        self.comma()?;
                    }
                }
                "uv_vectors" => {
                    for _ in 0..count {
                        let v = self.vector2()?;
                        mesh.uvs.push(v);
                        self.comma()?;
                    }
                }
                "face_indices" => {
                    for face in 0..count {
                        let corners = self.triple(mesh.vertices.len(), "vertices")?;
                        mesh.faces.push(corners);
                        self.comma()?;
                        self.face_textures(&mut mesh, face)?;
                    }
                }
                "normal_indices" => {
                    has_normals = true;
                    for _ in 0..count {
                        let indices = self.triple(mesh.normals.len(), "normals")?;
                        mesh.normal_faces.push(indices);
                        self.comma()?;
                    }
                }
                _ => {
                    has_uvs = true;
                    for _ in 0..count {
                        let indices = self.triple(mesh.uvs.len(), "uv_vectors")?;
                        mesh.uv_faces.push(indices);
                        self.comma()?;
                    }
                }
            }
            self.expect("}")?;
        }
        // Without indices of their own, as many normals or coordinates as vertices go with the vertices.
        if !has_normals && !mesh.normals.is_empty() && mesh.normals.len() == mesh.vertices.len() {
            mesh.normal_faces = mesh.faces.clone();
        }
        if !has_uvs && !mesh.uvs.is_empty() && mesh.uvs.len() == mesh.vertices.len() {
            mesh.uv_faces = mesh.faces.clone();
        }
        self.inside_vector(&mut mesh)?;
        Ok(Solid::Mesh(Arc::new(mesh)))
    }

    /// One or three texture numbers behind a face.
    fn face_textures(&mut self, mesh: &mut Mesh, face: usize) -> Parse<()> {
        if !self.at_scalar()? {
            return Ok(());
        }
        let span = self.span();
        let mut own = [0.0; 3];
        let mut n = 0;
        while n < 3 && self.at_scalar()? {
            own[n] = self.float()?;
            n += 1;
            self.comma()?;
        }
        if n == 1 {
            own = [own[0]; 3];
        } else if n == 2 {
            return Err(self.error(span, "a face has one texture or three"));
        }
        let limit = mesh.textures.len();
        if !own.iter().all(|i| *i >= 0.0 && (*i as usize) < limit) {
            return Err(self.error(span, format!("there is no such texture: the list has {limit}")));
        }
        mesh.texture_faces.resize(face, Mesh::NONE);
        mesh.texture_faces.push(own.map(|i| i as u32));
        Ok(())
    }

    /// Whether a number that is no vector literal follows.
    fn at_scalar(&mut self) -> Parse<bool> {
        // The next face may stand in a variable as well.
        let vector = matches!(self.peek()?, Token::Identifier(_, Value::Vector(_)));
        Ok(!vector && !self.at("<")? && self.at_float()?)
    }

    /// Three indices in angle brackets.
    fn triple(&mut self, limit: usize, what: &str) -> Parse<[u32; 3]> {
        let span = self.span();
        let v = self.vector3()?;
        if !(v.min_element() >= 0.0 && v.max_element() < limit as f64) {
            return Err(self.error(span, format!("an index is beyond the {limit} {what}")));
        }
        Ok([v.x as u32, v.y as u32, v.z as u32])
    }

    fn inside_vector(&mut self, mesh: &mut Mesh) -> Parse<()> {
        if self.accept("inside_vector")? {
            let v = self.vector3()?;
            // A vector of length zero asks for no inside.
            mesh.inside_vector = (v != DVec3::ZERO).then_some(v);
        }
        Ok(())
    }
}
