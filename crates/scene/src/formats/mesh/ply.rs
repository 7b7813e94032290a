//! Stanford PLY: text and binary of either byte order, properties in any order and of any type, polygons, extra properties as attributes.

use glam::{Vec2, Vec3};

use super::{COUNT_LIMIT, MeshFault, ParsedMesh};
use crate::desc::MeshAttribute;

/// Most elements or properties that a header may declare.
const DECLARATION_LIMIT: usize = 256;
/// Longest header in bytes.
const HEADER_LIMIT: usize = 1 << 20;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Type {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Type {
    fn parse(word: &str) -> Option<Self> {
        Some(match word {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    fn is_float(self) -> bool {
        matches!(self, Self::F32 | Self::F64)
    }

    /// The number that begins at `bytes[at]`; the caller has checked the length.
    #[inline]
    fn read<const BIG: bool>(self, bytes: &[u8], at: usize) -> f64 {
        macro_rules! number {
            ($t:ty, $n:literal) => {{
                let mut b = [0u8; $n];
                b.copy_from_slice(&bytes[at..at + $n]);
                if BIG { <$t>::from_be_bytes(b) as f64 } else { <$t>::from_le_bytes(b) as f64 }
            }};
        }
        match self {
            Self::I8 => f64::from(bytes[at] as i8),
            Self::U8 => f64::from(bytes[at]),
            Self::I16 => number!(i16, 2),
            Self::U16 => number!(u16, 2),
            Self::I32 => number!(i32, 4),
            Self::U32 => number!(u32, 4),
            Self::F32 => number!(f32, 4),
            Self::F64 => number!(f64, 8),
        }
    }
}

#[derive(Clone, Debug)]
struct PlyProperty {
    name: String,
    kind: Type,
    /// The type of a list's length; `None` for a single number.
    list: Option<Type>,
}

#[derive(Clone, Debug)]
struct Element {
    name: String,
    count: usize,
    properties: Vec<PlyProperty>,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Encoding {
    Text,
    Little,
    Big,
}

struct Header {
    encoding: Encoding,
    elements: Vec<Element>,
    /// Where the data begin.
    length: usize,
    lines: u32,
}

fn header(bytes: &[u8]) -> Result<Header, MeshFault> {
    let mut at = 0;
    let mut line_number = 0;
    let mut encoding = None;
    let mut elements: Vec<Element> = Vec::new();
    loop {
        let rest = &bytes[at..];
        let Some(end) = rest.iter().take(HEADER_LIMIT).position(|b| *b == b'\n') else {
            return Err(MeshFault::at(line_number + 1, "the header does not end"));
        };
        let line = String::from_utf8_lossy(&rest[..end]);
        let line = line.trim();
        at += end + 1;
        line_number += 1;
        let fail = |message: String| Err(MeshFault::at(line_number, message));
        if line_number == 1 {
            if line != "ply" {
                return fail("not a PLY file: it must begin with `ply`".to_owned());
            }
            continue;
        }
        if at > HEADER_LIMIT {
            return fail("the header is too long".to_owned());
        }
        let words: Vec<&str> = line.split_whitespace().collect();
        match words[..] {
            [] | ["comment" | "obj_info", ..] => {}
            ["format", kind, version] => {
                encoding = Some(match kind {
                    "ascii" => Encoding::Text,
                    "binary_little_endian" => Encoding::Little,
                    "binary_big_endian" => Encoding::Big,
                    _ => return fail(format!("unknown format `{kind}`")),
                });
                if version != "1.0" {
                    return fail(format!("unknown version `{version}`"));
                }
            }
            ["element", name, count] => {
                let Some(count) = count.parse::<u64>().ok().filter(|c| *c <= COUNT_LIMIT) else {
                    return fail(format!("`{count}` is not a count below 2^32"));
                };
                if elements.len() >= DECLARATION_LIMIT {
                    return fail("too many elements".to_owned());
                }
                elements.push(Element { name: name.to_owned(), count: count as usize, properties: Vec::new() });
            }
            ["property", ref rest @ ..] => {
                let Some(element) = elements.last_mut() else { return fail("a property before any element".to_owned()) };
                let property = match *rest {
                    ["list", length, kind, name] => {
                        Type::parse(length).filter(|t| !t.is_float()).zip(Type::parse(kind)).map(|(l, k)| (name, k, Some(l)))
                    }
                    [kind, name] => Type::parse(kind).map(|k| (name, k, None)),
                    _ => None,
                };
                let Some((name, kind, list)) = property else { return fail(format!("not a property: `{line}`")) };
                if element.properties.len() >= DECLARATION_LIMIT {
                    return fail("too many properties".to_owned());
                }
                element.properties.push(PlyProperty { name: name.to_owned(), kind, list });
            }
            ["end_header"] => break,
            _ => return fail(format!("unknown line in the header: `{}`", line.chars().take(60).collect::<String>())),
        }
    }
    let Some(encoding) = encoding else { return Err(MeshFault::at(line_number, "the header does not say its format")) };
    Ok(Header { encoding, elements, length: at, lines: line_number })
}

/// Where numbers come from: text or binary data.
trait Source {
    /// Fails unless `count` records can possibly be there, so that memory can be reserved.
    fn expect(&self, element: &Element) -> Result<(), MeshFault>;
    /// Reads the numbers of one record without lists into `out`.
    fn record(&mut self, element: &Element, out: &mut [f64]) -> Result<(), MeshFault>;
    /// Reads one number.
    fn number(&mut self, kind: Type) -> Result<f64, MeshFault>;
    /// A fault at the present place.
    fn fault(&self, message: String) -> MeshFault;
}

struct Binary<'b, const BIG: bool> {
    bytes: &'b [u8],
    at: usize,
}

impl<const BIG: bool> Source for Binary<'_, BIG> {
    fn expect(&self, element: &Element) -> Result<(), MeshFault> {
        let least: usize = element.properties.iter().map(|p| p.list.unwrap_or(p.kind).size()).sum();
        if (element.count as u64).saturating_mul(least as u64) > (self.bytes.len() - self.at) as u64 {
            let message = format!("the file ends within element `{}`: {} of them cannot be there", element.name, element.count);
            return Err(self.fault(message));
        }
        Ok(())
    }

    #[inline]
    fn record(&mut self, element: &Element, out: &mut [f64]) -> Result<(), MeshFault> {
        let size: usize = element.properties.iter().map(|p| p.kind.size()).sum();
        if self.bytes.len() - self.at < size {
            return Err(self.fault(format!("the file ends within element `{}`", element.name)));
        }
        let mut at = self.at;
        for (property, out) in element.properties.iter().zip(out) {
            *out = property.kind.read::<BIG>(self.bytes, at);
            at += property.kind.size();
        }
        self.at = at;
        Ok(())
    }

    #[inline]
    fn number(&mut self, kind: Type) -> Result<f64, MeshFault> {
        if self.bytes.len() - self.at < kind.size() {
            return Err(self.fault("the file ends within an element".to_owned()));
        }
        let v = kind.read::<BIG>(self.bytes, self.at);
        self.at += kind.size();
        Ok(v)
    }

    fn fault(&self, message: String) -> MeshFault {
        MeshFault::binary(format!("{message} (byte {})", self.at))
    }
}

struct Text<'b> {
    bytes: &'b [u8],
    at: usize,
    line: u32,
}

impl<'b> Text<'b> {
    fn word(&mut self) -> Result<&'b str, MeshFault> {
        while let Some(b) = self.bytes.get(self.at).filter(|b| b.is_ascii_whitespace()) {
            self.line += u32::from(*b == b'\n');
            self.at += 1;
        }
        let rest = &self.bytes[self.at..];
        let length = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
        if length == 0 {
            return Err(self.fault("the file ends within an element".to_owned()));
        }
        self.at += length;
        std::str::from_utf8(&rest[..length]).map_err(|_| self.fault("not a number".to_owned()))
    }
}

impl Source for Text<'_> {
    fn expect(&self, element: &Element) -> Result<(), MeshFault> {
        // A number and the space after it take two bytes; the last may lack the space.
        let least = (element.count as u64).saturating_mul(2 * element.properties.len() as u64).saturating_sub(1);
        if least > (self.bytes.len() - self.at) as u64 {
            return Err(self.fault(format!("the file ends within element `{}`: {} of them cannot be there", element.name, element.count)));
        }
        Ok(())
    }

    fn record(&mut self, element: &Element, out: &mut [f64]) -> Result<(), MeshFault> {
        for (property, out) in element.properties.iter().zip(out) {
            *out = self.number(property.kind)?;
        }
        Ok(())
    }

    fn number(&mut self, _kind: Type) -> Result<f64, MeshFault> {
        let word = self.word()?;
        word.parse().map_err(|_| self.fault(format!("`{}` is not a number", word.chars().take(40).collect::<String>())))
    }

    fn fault(&self, message: String) -> MeshFault {
        MeshFault::at(self.line, message)
    }
}

/// Reads a PLY file.
///
/// # Errors
/// [`MeshFault`] at a line of the header or of a text file, or at a byte of binary data.
pub fn parse(bytes: &[u8]) -> Result<ParsedMesh, MeshFault> {
    let header = header(bytes)?;
    let data = &bytes[header.length..];
    match header.encoding {
        Encoding::Text => body(&header, Text { bytes: data, at: 0, line: header.lines + 1 }),
        Encoding::Little => body(&header, Binary::<false> { bytes: data, at: 0 }),
        Encoding::Big => body(&header, Binary::<true> { bytes: data, at: 0 }),
    }
}

fn body(header: &Header, mut source: impl Source) -> Result<ParsedMesh, MeshFault> {
    let mut mesh = ParsedMesh::default();
    let mut have_vertices = false;
    let mut have_faces = false;
    for element in &header.elements {
        source.expect(element)?;
        match element.name.as_str() {
            "vertex" if !have_vertices => {
                vertices(element, &mut source, &mut mesh)?;
                have_vertices = true;
            }
            "face" if !have_faces && have_vertices => {
                faces(element, &mut source, &mut mesh)?;
                have_faces = true;
            }
            "face" | "vertex" => return Err(source.fault(format!("element `{}` out of order", element.name))),
            name => {
                if element.count > 0 {
                    mesh.warnings.push(format!("element `{name}` is ignored"));
                }
                skip(element, &mut source)?;
            }
        }
    }
    if !have_vertices {
        return Err(MeshFault::at(header.lines, "the file has no element `vertex`"));
    }
    if !have_faces {
        mesh.warnings.push("the file has no faces".to_owned());
    }
    Ok(mesh)
}

fn skip(element: &Element, source: &mut impl Source) -> Result<(), MeshFault> {
    // Records without a byte would be counted for nothing.
    if element.properties.is_empty() {
        return Ok(());
    }
    for _ in 0..element.count {
        for property in &element.properties {
            let n = match property.list {
                Some(length) => list_length(source, length)?,
                None => 1,
            };
            for _ in 0..n {
                source.number(property.kind)?;
            }
        }
    }
    Ok(())
}

fn list_length(source: &mut impl Source, kind: Type) -> Result<u64, MeshFault> {
    let n = source.number(kind)?;
    if n >= 0.0 && n <= f64::from(u32::MAX) && n.fract() == 0.0 {
        Ok(n as u64)
    } else {
        Err(source.fault(format!("{n} is not the length of a list")))
    }
}

/// Columns of a record for each of several names, where all are there.
fn columns<const N: usize>(element: &Element, names: [[&str; N]; 5]) -> Option<[usize; N]> {
    names.iter().find_map(|names| {
        let mut columns = [0; N];
        for (column, name) in columns.iter_mut().zip(names) {
            *column = element.properties.iter().position(|p| p.name == *name && p.list.is_none())?;
        }
        Some(columns)
    })
}

/// Properties that make an attribute: its name, the columns and a factor.
struct AttributePlan {
    name: String,
    columns: Vec<usize>,
    factor: f64,
}

fn attribute_plans(element: &Element, taken: &[usize]) -> Vec<AttributePlan> {
    let mut plans: Vec<AttributePlan> = Vec::new();
    let mut taken = taken.to_vec();
    for names in [["r", "g", "b"], ["red", "green", "blue"]] {
        let found: Vec<usize> =
            names.iter().filter_map(|n| element.properties.iter().position(|p| p.name == *n && p.list.is_none())).collect();
        if found.len() == 3 {
            // Whole numbers are shares of the largest.
            let factor = match element.properties[found[0]].kind {
                Type::U8 => 1.0 / 255.0,
                Type::U16 => 1.0 / 65535.0,
                _ => 1.0,
            };
            taken.extend(&found);
            plans.push(AttributePlan { name: "color".to_owned(), columns: found, factor });
            break;
        }
    }
    for (i, property) in element.properties.iter().enumerate() {
        if taken.contains(&i) || property.list.is_some() {
            continue;
        }
        // `vertex_heat_x`, `vertex_heat_y`, … or a lone number.
        let name = property.name.strip_prefix("vertex_").or(property.name.strip_prefix("face_")).unwrap_or(&property.name);
        let base = match name.rsplit_once('_') {
            Some((base, suffix))
                if !base.is_empty() && matches!(suffix, "x" | "y" | "z" | "w" | "r" | "g" | "b" | "a" | "0" | "1" | "2" | "3" | "4") =>
            {
                base
            }
            _ => name,
        };
        let known = plans.iter().any(|p| p.name == base);
        match plans.last_mut() {
            Some(plan) if plan.name == base && plan.columns.last() == Some(&(i.wrapping_sub(1))) && plan.columns.len() < 4 => {
                plan.columns.push(i);
            }
            _ if known => {}
            _ => plans.push(AttributePlan { name: base.to_owned(), columns: vec![i], factor: 1.0 }),
        }
    }
    plans
}

fn vertices(element: &Element, source: &mut impl Source, mesh: &mut ParsedMesh) -> Result<(), MeshFault> {
    if element.properties.iter().any(|p| p.list.is_some()) {
        return Err(source.fault("a list among the properties of `vertex`".to_owned()));
    }
    let Some(position) = columns(element, [["x", "y", "z"]; 5]) else {
        return Err(source.fault("element `vertex` lacks x, y or z".to_owned()));
    };
    let normal = columns(element, [["nx", "ny", "nz"]; 5]);
    let uv = columns(element, [["u", "v"], ["s", "t"], ["texture_u", "texture_v"], ["texture_s", "texture_t"], ["s0", "t0"]]);
    let taken: Vec<usize> = position.into_iter().chain(normal.into_iter().flatten()).chain(uv.into_iter().flatten()).collect();
    let plans = attribute_plans(element, &taken);
    let n = element.count;
    let data = &mut mesh.data;
    data.positions.reserve_exact(n);
    data.normals.reserve_exact(if normal.is_some() { n } else { 0 });
    data.uvs.reserve_exact(if uv.is_some() { n } else { 0 });
    let mut attributes: Vec<Vec<f32>> = plans.iter().map(|p| Vec::with_capacity(n * p.columns.len())).collect();
    let mut record = vec![0.0; element.properties.len()];
    for _ in 0..n {
        source.record(element, &mut record)?;
        let vec3 = |c: [usize; 3]| Vec3::new(record[c[0]] as f32, record[c[1]] as f32, record[c[2]] as f32);
        data.positions.push(vec3(position));
        if let Some(normal) = normal {
            let v = vec3(normal);
            data.normals.push(if v.is_finite() { v.normalize_or_zero() } else { v });
        }
        if let Some([u, v]) = uv {
            data.uvs.push(Vec2::new(record[u] as f32, record[v] as f32));
        }
        for (plan, out) in plans.iter().zip(&mut attributes) {
            out.extend(plan.columns.iter().map(|c| (record[*c] * plan.factor) as f32));
        }
    }
    for (plan, values) in plans.into_iter().zip(attributes) {
        let attribute = MeshAttribute { name: plan.name, per_face: false, width: plan.columns.len() as u32, data: values };
        data.attributes.push(attribute);
    }
    Ok(())
}

fn faces(element: &Element, source: &mut impl Source, mesh: &mut ParsedMesh) -> Result<(), MeshFault> {
    let is_indices = |p: &PlyProperty| p.list.is_some() && (p.name == "vertex_indices" || p.name == "vertex_index");
    let Some(indices) = element.properties.iter().position(is_indices) else {
        return Err(source.fault("element `face` lacks the list vertex_indices".to_owned()));
    };
    let length_kind = element.properties[indices].list.unwrap_or(Type::U8);
    let index_kind = element.properties[indices].kind;
    if index_kind.is_float() {
        return Err(source.fault("the list vertex_indices must hold whole numbers".to_owned()));
    }
    let plans = attribute_plans(element, &[]);
    let mut attributes: Vec<Vec<f32>> = vec![Vec::new(); plans.len()];
    let vertex_count = mesh.data.positions.len() as f64;
    let mut record = vec![0.0; element.properties.len()];
    let mut degenerate = 0usize;
    mesh.data.triangles.reserve_exact(element.count);
    for face in 0..element.count {
        let before = mesh.data.triangles.len();
        for (i, property) in element.properties.iter().enumerate() {
            if i != indices {
                match property.list {
                    None => record[i] = source.number(property.kind)?,
                    Some(length) => {
                        for _ in 0..list_length(source, length)? {
                            source.number(property.kind)?;
                        }
                    }
                }
                continue;
            }
            let n = list_length(source, length_kind)?;
            let mut corner = [0u32; 3];
            for j in 0..n {
                let v = source.number(index_kind)?;
                if !(v >= 0.0 && v < vertex_count) {
                    return Err(source.fault(format!("face {face}: there is no vertex {v}, only {vertex_count}")));
                }
                // A polygon becomes a fan about its first corner.
                if j < 3 {
                    corner[j as usize] = v as u32;
                } else {
                    corner = [corner[0], corner[2], v as u32];
                }
                if j >= 2 {
                    mesh.data.triangles.push(corner);
                }
            }
            degenerate += usize::from(n < 3);
        }
        let added = mesh.data.triangles.len() - before;
        for (plan, out) in plans.iter().zip(&mut attributes) {
            for _ in 0..added {
                out.extend(plan.columns.iter().map(|c| (record[*c] * plan.factor) as f32));
            }
        }
    }
    for (plan, values) in plans.into_iter().zip(attributes) {
        let attribute = MeshAttribute { name: plan.name, per_face: true, width: plan.columns.len() as u32, data: values };
        mesh.data.attributes.push(attribute);
    }
    if degenerate > 0 {
        mesh.warnings.push(format!("{degenerate} faces with fewer than three corners are left out"));
    }
    Ok(())
}
