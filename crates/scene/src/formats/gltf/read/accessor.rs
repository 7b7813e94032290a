//! Accessors: typed numbers out of views, sparse ones included.

use super::Reader;
use super::buffer::View;
use crate::formats::gltf::json::Value;

/// The number types of glTF.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }
}

/// A number that components become.
pub(super) trait FromComponent: Copy + Default {
    /// From the first bytes of `b`, of which there are enough.
    fn from_bytes(b: &[u8], component: Component, normalized: bool) -> Self;
}

impl FromComponent for f32 {
    fn from_bytes(b: &[u8], component: Component, normalized: bool) -> Self {
        let (value, max) = match component {
            Component::I8 => (Self::from(b[0] as i8), 127.0),
            Component::U8 => (Self::from(b[0]), 255.0),
            Component::I16 => (Self::from(i16::from_le_bytes([b[0], b[1]])), 32767.0),
            Component::U16 => (Self::from(u16::from_le_bytes([b[0], b[1]])), 65535.0),
            Component::U32 => (u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as Self, u32::MAX as Self),
            Component::F32 => return Self::from_le_bytes([b[0], b[1], b[2], b[3]]),
        };
        // glTF 2.0, 3.6.2.2: c / max, and −1 for the smallest signed number.
        if normalized { (value / max).max(-1.0) } else { value }
    }
}

impl FromComponent for u32 {
    fn from_bytes(b: &[u8], component: Component, _normalized: bool) -> Self {
        match component {
            Component::U8 | Component::I8 => Self::from(b[0]),
            Component::U16 | Component::I16 => Self::from(u16::from_le_bytes([b[0], b[1]])),
            Component::U32 | Component::F32 => Self::from_le_bytes([b[0], b[1], b[2], b[3]]),
        }
    }
}

/// Decoded elements: `width` numbers each.
#[derive(Clone, Debug)]
pub(super) struct Elements<T> {
    pub width: usize,
    pub data: Vec<T>,
}

impl<T: Copy> Elements<T> {
    /// Number of elements.
    pub fn len(&self) -> usize {
        self.data.len() / self.width
    }

    /// The elements as arrays of their width.
    pub fn arrays<const N: usize>(&self) -> impl Iterator<Item = [T; N]> + '_ {
        self.data.chunks_exact(N).map(|c| std::array::from_fn(|i| c[i]))
    }
}

/// Where elements lie.
struct Layout {
    offset: usize,
    stride: usize,
    component: Component,
    width: usize,
}

impl<'a> Reader<'a> {
    fn component(&mut self, object: &'a Value<'a>) -> Option<Component> {
        let v = self.required(object, "componentType")?;
        Some(match self.integer_of(v)? {
            5120 => Component::I8,
            5121 => Component::U8,
            5122 => Component::I16,
            5123 => Component::U16,
            5125 => Component::U32,
            5126 => Component::F32,
            other => {
                self.error(v, format!("unknown component type {other}"));
                return None;
            }
        })
    }

    /// The numbers of an accessor that must have one of the widths and, where `components` is not empty, one of those types.
    pub(super) fn elements<T: FromComponent>(
        &mut self,
        reference: &'a Value<'a>,
        widths: &[usize],
        components: &[Component],
    ) -> Option<Elements<T>> {
        let (_, accessor) = self.reference_of(reference, "accessors")?;
        let component = self.component(accessor)?;
        let width = match self.string(accessor, "type") {
            Some("SCALAR") => 1,
            Some("VEC2") => 2,
            Some("VEC3") => 3,
            Some("VEC4") => 4,
            // Matrices of bytes and shorts have padding, but nothing here takes them; floats have none.
            Some("MAT4") if component == Component::F32 => 16,
            _ => {
                self.error(accessor, "unknown or missing `type`");
                return None;
            }
        };
        if !widths.contains(&width) || !(components.is_empty() || components.contains(&component)) {
            self.error(reference, "the accessor has a type that is not allowed here");
            return None;
        }
        let normalized = self.bool(accessor, "normalized", false);
        self.required(accessor, "count")?;
        let count = self.integer(accessor, "count")?;
        if !self.spend(accessor, count.saturating_mul(width as u64 * 4)) {
            return None;
        }
        let count = count as usize;
        let mut data = match accessor.get("bufferView") {
            None => vec![T::default(); count * width],
            Some(_) => {
                let (i, view) = self.reference(accessor, "bufferView", "bufferViews")?;
                let view = self.view(i, view)?;
                let layout = self.layout(accessor, view.stride, component, width)?;
                self.decode(accessor, &view, &layout, count, normalized)?
            }
        };
        if let Some(sparse) = self.object(accessor, "sparse") {
            self.apply_sparse(sparse, &mut data, component, width, normalized)?;
        }
        Some(Elements { width, data })
    }

    fn layout(&mut self, object: &'a Value<'a>, stride: Option<usize>, component: Component, width: usize) -> Option<Layout> {
        let offset = if object.get("byteOffset").is_some() { self.integer(object, "byteOffset")? } else { 0 };
        let stride = stride.unwrap_or(component.size() * width);
        Some(Layout { offset: usize::try_from(offset).ok()?, stride, component, width })
    }

    fn decode<T: FromComponent>(
        &mut self,
        at: &Value<'_>,
        view: &View<'_>,
        layout: &Layout,
        count: usize,
        normalized: bool,
    ) -> Option<Vec<T>> {
        let size = layout.component.size();
        let element = size * layout.width;
        if layout.stride < element {
            self.error(at, format!("elements of {element} bytes do not fit into a byteStride of {}", layout.stride));
            return None;
        }
        let needed = match count.checked_sub(1) {
            None => Some(0),
            Some(last) => last.checked_mul(layout.stride).and_then(|n| n.checked_add(element)?.checked_add(layout.offset)),
        };
        if needed.is_none_or(|n| n > view.len()) {
            self.error(at, format!("{count} elements do not fit into the {} bytes of the buffer view", view.len()));
            return None;
        }
        let mut data = Vec::with_capacity(count * layout.width);
        for i in 0..count {
            let element = &view[layout.offset + i * layout.stride..];
            for k in 0..layout.width {
                data.push(T::from_bytes(&element[k * size..], layout.component, normalized));
            }
        }
        Some(data)
    }

    fn apply_sparse<T: FromComponent>(
        &mut self,
        sparse: &'a Value<'a>,
        data: &mut [T],
        component: Component,
        width: usize,
        normalized: bool,
    ) -> Option<()> {
        self.required(sparse, "count")?;
        let count = self.integer(sparse, "count")?;
        if !self.spend(sparse, count.saturating_mul(width as u64 * 4 + 4)) {
            return None;
        }
        let count = count as usize;
        let mut part = |key: &str| {
            self.required(sparse, key)?;
            let part = self.object(sparse, key)?;
            self.required(part, "bufferView")?;
            let (i, view) = self.reference(part, "bufferView", "bufferViews")?;
            Some((part, self.view(i, view)?))
        };
        let (indices, index_view) = part("indices")?;
        let (values, value_view) = part("values")?;
        let index_component = self.component(indices)?;
        if matches!(index_component, Component::F32 | Component::I8 | Component::I16) {
            self.error(indices, "indices must be unsigned whole numbers");
            return None;
        }
        let layout = self.layout(indices, None, index_component, 1)?;
        let places: Vec<u32> = self.decode(indices, &index_view, &layout, count, false)?;
        let layout = self.layout(values, None, component, width)?;
        let new: Vec<T> = self.decode(values, &value_view, &layout, count, normalized)?;
        for (&place, value) in places.iter().zip(new.chunks_exact(width)) {
            let start = place as usize * width;
            match data.get_mut(start..start + width) {
                Some(old) => old.copy_from_slice(value),
                None => {
                    self.error(indices, format!("index {place} is beyond the accessor's elements"));
                    return None;
                }
            }
        }
        Some(())
    }
}
