//! Buffers and views of them, and decoding of compressed views.

use std::ops::{Deref, Range};
use std::sync::Arc;

use super::Reader;
use crate::formats::Resolver;
use crate::formats::gltf::container::{data_uri, file_name};
use crate::formats::gltf::json::Value;
use crate::formats::gltf::meshopt::{self, Filter, Mode};

/// Bytes of the file itself, or others that several may share.
#[derive(Clone, Debug)]
pub(super) enum Bytes<'a> {
    /// Of the file.
    Own(&'a [u8]),
    /// Read or decoded.
    Shared(Arc<Vec<u8>>),
}

impl Deref for Bytes<'_> {
    type Target = [u8];
    fn deref(&self) -> &[u8] {
        match self {
            Self::Own(b) => b,
            Self::Shared(b) => b,
        }
    }
}

/// A part of a buffer.
#[derive(Clone, Debug)]
pub(super) struct View<'a> {
    bytes: Bytes<'a>,
    range: Range<usize>,
    /// Distance of elements where the view gives it.
    pub stride: Option<usize>,
}

impl Deref for View<'_> {
    type Target = [u8];
    fn deref(&self) -> &[u8] {
        &self.bytes[self.range.clone()]
    }
}

const MESHOPT_NAMES: [&str; 2] = ["KHR_meshopt_compression", "EXT_meshopt_compression"];

impl<'a> Reader<'a> {
    /// The bytes of a buffer, read at its first use.
    fn buffer(&mut self, i: usize, at: &'a Value<'a>) -> Option<Bytes<'a>> {
        if let Some(b) = self.buffers.get(&i) {
            return b.clone();
        }
        let bytes = self.load_buffer(i, at);
        self.buffers.insert(i, bytes.clone());
        bytes
    }

    fn load_buffer(&mut self, i: usize, at: &'a Value<'a>) -> Option<Bytes<'a>> {
        self.required(at, "byteLength")?;
        let length = self.integer(at, "byteLength")?;
        let bytes = match (self.string(at, "uri"), self.binary) {
            (Some(uri), _) => self.uri_bytes(at, uri)?,
            (None, Some(binary)) if i == 0 => Bytes::Own(binary),
            _ => {
                self.error(at, "a buffer without `uri` that is not the binary chunk of a GLB");
                return None;
            }
        };
        if (bytes.len() as u64) < length {
            self.error(at, format!("byteLength is {length}, but there are only {} bytes", bytes.len()));
            return None;
        }
        Some(bytes)
    }

    /// What a `data:` or relative address stands for.
    pub(super) fn uri_bytes(&mut self, at: &'a Value<'a>, uri: &str) -> Option<Bytes<'a>> {
        match data_uri(uri) {
            Some(Ok(bytes)) => return Some(Bytes::Shared(Arc::new(bytes))),
            Some(Err(reason)) => {
                self.error(at, reason);
                return None;
            }
            None => {}
        }
        let path = match self.resolver.resolve(&self.folder, &file_name(uri)) {
            Ok(path) => path,
            Err(e) => {
                self.error(at, e.to_string());
                return None;
            }
        };
        if let Some(bytes) = self.files.get(&path) {
            return Some(bytes.clone());
        }
        match Resolver::read(&path) {
            Ok(bytes) => {
                // Data of other files backs more decoded data.
                self.budget = self.budget.saturating_add(64 * bytes.len() as u64);
                self.desc.add_file(&path);
                let bytes = Bytes::Shared(Arc::new(bytes));
                self.files.insert(path, bytes.clone());
                Some(bytes)
            }
            Err(e) => {
                self.error(at, e.to_string());
                None
            }
        }
    }

    /// `byteOffset` and `byteLength` of an object within a buffer's bytes.
    fn range(&mut self, object: &'a Value<'a>, bytes: &[u8]) -> Option<Range<usize>> {
        let offset = if object.get("byteOffset").is_some() { self.integer(object, "byteOffset")? } else { 0 };
        self.required(object, "byteLength")?;
        let length = self.integer(object, "byteLength")?;
        match offset.checked_add(length) {
            Some(end) if end <= bytes.len() as u64 => Some(offset as usize..end as usize),
            _ => {
                self.error(object, format!("{length} bytes from {offset} on do not fit into the buffer's {} bytes", bytes.len()));
                None
            }
        }
    }

    /// A view, decompressed where it is compressed.
    pub(super) fn view(&mut self, i: usize, view: &'a Value<'a>) -> Option<View<'a>> {
        let stride = match view.get("byteStride") {
            None => None,
            Some(v) => match self.integer_of(v)? {
                s @ 1..=65536 => Some(s as usize),
                _ => {
                    self.error(v, "byteStride must be in [4, 252]");
                    return None;
                }
            },
        };
        for name in MESHOPT_NAMES {
            if let Some(extension) = self.extension(view, name) {
                let bytes = match self.views.get(&i) {
                    Some(known) => known.clone(),
                    None => {
                        let decoded = self.decode_view(extension).map(|b| Bytes::Shared(Arc::new(b)));
                        self.views.insert(i, decoded.clone());
                        decoded
                    }
                }?;
                let range = 0..bytes.len();
                return Some(View { bytes, range, stride });
            }
        }
        self.required(view, "buffer")?;
        let (b, buffer) = self.reference(view, "buffer", "buffers")?;
        let bytes = self.buffer(b, buffer)?;
        let range = self.range(view, &bytes)?;
        Some(View { bytes, range, stride })
    }

    fn decode_view(&mut self, extension: &'a Value<'a>) -> Option<Vec<u8>> {
        for key in ["buffer", "byteStride", "count", "mode"] {
            self.required(extension, key)?;
        }
        let (b, buffer) = self.reference(extension, "buffer", "buffers")?;
        let count = self.integer(extension, "count")?;
        let stride = self.integer(extension, "byteStride")?;
        let mode = match self.string(extension, "mode")? {
            "ATTRIBUTES" => Mode::Attributes,
            "TRIANGLES" => Mode::Triangles,
            "INDICES" => Mode::Indices,
            other => {
                self.error(extension, format!("unknown mode `{other}`"));
                return None;
            }
        };
        let filter = match self.string(extension, "filter").unwrap_or("NONE") {
            "NONE" => Filter::None,
            "OCTAHEDRAL" => Filter::Octahedral,
            "QUATERNION" => Filter::Quaternion,
            "EXPONENTIAL" => Filter::Exponential,
            "COLOR" => Filter::Color,
            other => {
                self.error(extension, format!("unknown filter `{other}`"));
                return None;
            }
        };
        let bytes = self.buffer(b, buffer)?;
        let range = self.range(extension, &bytes)?;
        let size = count.saturating_mul(stride);
        if stride > 256 || !self.spend(extension, size) {
            if stride > 256 {
                self.error(extension, "byteStride must be at most 256");
            }
            return None;
        }
        match meshopt::decode(&bytes[range], count as usize, stride as usize, mode, filter) {
            Ok(decoded) => Some(decoded),
            Err(reason) => {
                self.error(extension, reason);
                None
            }
        }
    }
}
