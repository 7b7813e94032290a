//! A name for the content of a description.

use std::io::Write;

use super::{ImageSource, MeshData, SceneDesc};

/// Feeds bytes to the hash.
struct Sink(blake3::Hasher);

impl Write for Sink {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.update(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

impl Sink {
    /// Anything serialisable, as JSON with its length in front of the next.
    fn node(&mut self, value: &impl serde::Serialize) {
        // Values that JSON lacks (infinities) become null there, on every machine alike.
        let _ = serde_json::to_writer(&mut *self, value);
        self.0.update(b"\n");
    }

    fn mesh(&mut self, m: &MeshData) {
        let lengths = [m.positions.len(), m.triangles.len(), m.normals.len(), m.uvs.len(), m.tangents.len()];
        self.node(&lengths);
        self.0.update(bytemuck::cast_slice(&m.positions));
        self.0.update(bytemuck::cast_slice(&m.triangles));
        self.0.update(bytemuck::cast_slice(&m.normals));
        self.0.update(bytemuck::cast_slice(&m.uvs));
        self.0.update(bytemuck::cast_slice(&m.tangents));
        for a in &m.attributes {
            self.node(&(&a.name, a.per_face, a.width, a.data.len()));
            self.0.update(bytemuck::cast_slice(&a.data));
        }
    }
}

impl SceneDesc {
    /// A hash of everything that a picture of this description depends on: nodes, loaded meshes, the bytes of picture files. It
    /// does not depend on where the files lie. Reads the picture files; one that cannot be read counts by its name.
    pub fn content_hash(&self) -> String {
        self.hash(true)
    }

    /// The same for what light depends on: everything but cameras, film and integrator. Photon maps are told apart by it.
    pub fn light_hash(&self) -> String {
        self.hash(false)
    }

    fn hash(&self, with_view: bool) -> String {
        let mut sink = Sink(blake3::Hasher::new());
        for image in &self.images {
            match &image.value.source {
                ImageSource::File(path) => match std::fs::read(path) {
                    Ok(bytes) => {
                        sink.0.update(&bytes);
                    }
                    Err(_) => sink.node(path),
                },
                ImageSource::Embedded(bytes) => {
                    sink.0.update(bytes);
                }
                ImageSource::Pixels { width, height, channels, data } => {
                    sink.node(&(width, height, channels));
                    sink.0.update(bytemuck::cast_slice(data));
                }
            }
        }
        for mesh in &self.meshes {
            if let Some(data) = &mesh.value.data {
                sink.mesh(data);
            }
        }
        for volume in &self.volumes {
            let v = &volume.value;
            sink.node(&(v.size, v.channels, v.world_from_volume, v.filter, v.wrap, v.data.len()));
            sink.0.update(bytemuck::cast_slice(&v.data));
        }
        // Without spans and names: moving a line does not change the picture.
        fn values<T: serde::Serialize>(sink: &mut Sink, nodes: &[super::Node<T>]) {
            for node in nodes {
                sink.node(&node.value);
            }
            sink.node(&nodes.len());
        }
        values(&mut sink, &self.textures);
        values(&mut sink, &self.bsdfs);
        values(&mut sink, &self.media);
        values(&mut sink, &self.shapes);
        values(&mut sink, &self.groups);
        values(&mut sink, &self.instances);
        values(&mut sink, &self.lights);
        if with_view {
            values(&mut sink, &self.cameras);
        }
        sink.node(&self.classic);
        if with_view {
            sink.node(&self.film);
            sink.node(&self.integrator);
        }
        sink.0.finalize().to_hex().to_string()
    }
}
