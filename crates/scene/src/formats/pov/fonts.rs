//! Fonts of `text` objects: where they are found, what stands in for missing ones, and the outlines of their letters.

use std::path::{Path, PathBuf};

use glam::{DVec2, DVec3};
use ttf_parser::{Face, GlyphId, OutlineBuilder, Tag};

use crate::desc::classic::{Outline, OutlineSegment, TextShape};

/// Folders in which systems keep fonts.
const FOLDERS: &[&str] = &[
    "/usr/share/fonts",
    "/usr/local/share/fonts",
    "/usr/share/povray-3.7/include",
    "/usr/local/share/povray-3.7/include",
    "/System/Library/Fonts",
    "/Library/Fonts",
    "C:/Windows/Fonts",
];
/// Files and folders that a search looks at.
const ENTRIES: usize = 50_000;
/// Folders within folders that a search goes down.
const DEPTH: u32 = 6;
/// Most letters of a text.
const LETTERS: usize = 100_000;

/// Fonts of POV-Ray by the number of `internal`.
pub(super) const INTERNAL: [&str; 4] = ["povlogo.ttf", "timrom.ttf", "cyrvetic.ttf", "crystal.ttf"];

/// Free fonts with the measures of those that only one system has, or, failing these, of their kind. The four are regular, bold, italic
/// and both; letters before them are how names of their files begin.
const FAMILIES: &[(&[&str], [&str; 4], [&str; 4])] = &[
    (
        &["times", "tnr", "georgia", "cambria", "garamond", "palatino", "bookman", "serif", "timrom", "bodoni", "century"],
        ["liberationserif-regular", "liberationserif-bold", "liberationserif-italic", "liberationserif-bolditalic"],
        ["dejavuserif", "dejavuserif-bold", "dejavuserif-italic", "dejavuserif-bolditalic"],
    ),
    (
        &["cour", "consola", "lucon", "mono", "andale", "monaco", "fixed"],
        ["liberationmono-regular", "liberationmono-bold", "liberationmono-italic", "liberationmono-bolditalic"],
        ["dejavusansmono", "dejavusansmono-bold", "dejavusansmono-oblique", "dejavusansmono-boldoblique"],
    ),
    (
        &[""],
        ["liberationsans-regular", "liberationsans-bold", "liberationsans-italic", "liberationsans-bolditalic"],
        ["dejavusans", "dejavusans-bold", "dejavusans-oblique", "dejavusans-boldoblique"],
    ),
];

/// A font file of the system: the one of that name, or else one that can stand in for it.
pub(super) fn installed(name: &str) -> Option<PathBuf> {
    let file = name.replace('\\', "/").rsplit('/').next().unwrap_or_default().to_lowercase();
    let stem = file.strip_suffix(".ttf").or(file.strip_suffix(".ttc")).or(file.strip_suffix(".otf")).unwrap_or(&file).to_owned();
    let fonts = list();
    let find = |stem: &str| {
        let of = |(s, p): &(String, PathBuf)| (s == stem).then(|| p.clone());
        fonts.iter().find_map(of)
    };
    if let Some(path) = find(&stem) {
        return Some(path);
    }
    // arialbd, arialbi, timesi, courbd … and names that say it in full.
    let both = stem.ends_with("bi") || stem.ends_with('z');
    let bold = both || stem.ends_with("bd") || stem.ends_with('b') || stem.contains("bold") || stem.contains("black");
    let italic = both || stem.ends_with('i') || stem.contains("italic") || stem.contains("oblique");
    let style = usize::from(bold) + 2 * usize::from(italic);
    let (_, first, second) = FAMILIES.iter().find(|(starts, ..)| starts.iter().any(|s| stem.contains(s)))?;
    let kin = [first[style], second[style], first[0], second[0], "cyrvetic"];
    kin.iter().find_map(|s| find(s)).or_else(|| fonts.first().map(|(_, p)| p.clone()))
}

/// All font files: lower-case stems and paths, in the order of paths.
fn list() -> Vec<(String, PathBuf)> {
    let mut found = Vec::new();
    let mut left = ENTRIES;
    for folder in FOLDERS {
        walk(Path::new(folder), DEPTH, &mut left, &mut found);
    }
    found
}

fn walk(folder: &Path, depth: u32, left: &mut usize, found: &mut Vec<(String, PathBuf)>) {
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    let mut paths: Vec<PathBuf> = entries.take(*left).filter_map(|e| Some(e.ok()?.path())).collect();
    *left -= paths.len();
    paths.sort();
    for path in paths {
        if path.is_dir() {
            if depth > 0 {
                walk(&path, depth - 1, left, found);
            }
        } else if path.extension().and_then(|e| e.to_str()).is_some_and(|e| ["ttf", "ttc", "otf"].contains(&&*e.to_lowercase()))
            && let Some(stem) = path.file_stem().and_then(|s| s.to_str())
        {
            found.push((stem.to_lowercase(), path));
        }
    }
}

/// The letters of a text in a font, from left to right on the x axis, with kerning. `offset` is added from letter to letter; its z
/// component has no effect, as in POV-Ray.
///
/// # Errors
/// What is wrong with the font or text.
pub(super) fn lay_out(font: &[u8], text: &str, thickness: f64, offset: DVec3) -> Result<TextShape, String> {
    let face = Face::parse(font, 0).map_err(|e| format!("the font cannot be read: {e}"))?;
    if text.chars().count() > LETTERS {
        return Err(format!("a text of more than {LETTERS} letters"));
    }
    let em = f64::from(face.units_per_em());
    let mut shape = TextShape { thickness, ..TextShape::default() };
    let mut known: Vec<(GlyphId, u32)> = Vec::new();
    let mut pen = DVec3::ZERO;
    let mut last: Option<GlyphId> = None;
    for c in text.chars() {
        let glyph = find_glyph(&face, c);
        if last.is_none() {
            // The text begins where the first letter's ink does.
            pen.x = -f64::from(face.glyph_hor_side_bearing(glyph).unwrap_or(0)) / em;
        }
        if let Some(last) = last {
            pen.x += f64::from(kerning(&face, last, glyph)) / em;
        }
        let index = match known.iter().find(|(g, _)| *g == glyph) {
            Some((_, i)) => *i,
            None => {
                let mut builder = Builder { scale: 1.0 / em, ..Builder::default() };
                face.outline_glyph(glyph, &mut builder);
                builder.finish();
                shape.outlines.push(builder.outline);
                known.push((glyph, shape.outlines.len() as u32 - 1));
                shape.outlines.len() as u32 - 1
            }
        };
        if shape.outlines.get(index as usize).is_some_and(|o| !o.contours.is_empty()) {
            shape.glyphs.push((index, pen));
        }
        pen.x += f64::from(face.glyph_hor_advance(glyph).unwrap_or(0)) / em + offset.x;
        pen.y += offset.y;
        last = Some(glyph);
    }
    Ok(shape)
}

/// The glyph of a character; fonts with symbols have theirs in a private range.
fn find_glyph(face: &Face, c: char) -> GlyphId {
    let code = u32::from(c);
    let symbol = || {
        face.tables().cmap.and_then(|t| t.subtables.into_iter().find_map(|s| s.glyph_index(code).or_else(|| s.glyph_index(0xF000 + code))))
    };
    face.glyph_index(c).or_else(symbol).unwrap_or(GlyphId(0))
}

/// Horizontal kerning between two glyphs in font units. Tables of fonts are not always sorted as they should be, so that all pairs are
/// looked at.
fn kerning(face: &Face, left: GlyphId, right: GlyphId) -> i32 {
    let table = face.raw_face().table(Tag::from_bytes(b"kern")).unwrap_or_default();
    let word = |at: usize| table.get(at..at + 2).map(|b| u16::from_be_bytes([b[0], b[1]]));
    // Version 0, a first table of horizontal pairs (format 0); others are Apple's.
    let plain = word(0) == Some(0) && word(8).is_some_and(|coverage| coverage & 0xFF07 == 1);
    if !plain {
        let Some(kern) = face.tables().kern else { return 0 };
        let is_plain = |t: &ttf_parser::kern::Subtable| t.horizontal && !t.variable && !t.has_cross_stream && !t.has_state_machine;
        return kern.subtables.into_iter().filter(is_plain).filter_map(|t| t.glyphs_kerning(left, right)).map(i32::from).sum();
    }
    let count = usize::from(word(10).unwrap_or(0));
    let pairs = table.get(18..).unwrap_or_default().chunks_exact(6).take(count);
    let wanted = [left.0.to_be_bytes(), right.0.to_be_bytes()].concat();
    pairs.filter(|p| p[..4] == wanted[..]).map(|p| i32::from(i16::from_be_bytes([p[4], p[5]]))).next().unwrap_or(0)
}

/// Collects an outline.
#[derive(Default)]
struct Builder {
    outline: Outline,
    contour: Vec<OutlineSegment>,
    start: DVec2,
    at: DVec2,
    scale: f64,
}

impl Builder {
    fn point(&self, x: f32, y: f32) -> DVec2 {
        DVec2::new(f64::from(x), f64::from(y)) * self.scale
    }

    fn line(&mut self, to: DVec2) {
        if to != self.at {
            self.contour.push(OutlineSegment::Line([self.at, to]));
        }
        self.at = to;
    }

    fn finish(&mut self) {
        if self.contour.is_empty() {
            return;
        }
        let start = self.start;
        self.line(start);
        let contour = std::mem::take(&mut self.contour);
        self.outline.contours.push(contour);
    }
}

impl OutlineBuilder for Builder {
    fn move_to(&mut self, x: f32, y: f32) {
        self.finish();
        self.start = self.point(x, y);
        self.at = self.start;
    }

    fn line_to(&mut self, x: f32, y: f32) {
        let to = self.point(x, y);
        self.line(to);
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        let (control, to) = (self.point(x1, y1), self.point(x, y));
        self.contour.push(OutlineSegment::Quadratic([self.at, control, to]));
        self.at = to;
    }

    /// A cubic as four quadratics that meet its points and tangents at the ends.
    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        const PIECES: u32 = 4;
        let p = [self.at, self.point(x1, y1), self.point(x2, y2), self.point(x, y)];
        let at = |t: f64| {
            let r = 1.0 - t;
            p[0] * (r * r * r) + p[1] * (3.0 * r * r * t) + p[2] * (3.0 * r * t * t) + p[3] * (t * t * t)
        };
        let slope = |t: f64| {
            let r = 1.0 - t;
            ((p[1] - p[0]) * (r * r) + (p[2] - p[1]) * (2.0 * r * t) + (p[3] - p[2]) * (t * t)) * 3.0
        };
        for i in 0..PIECES {
            let (t0, t1) = (f64::from(i) / f64::from(PIECES), f64::from(i + 1) / f64::from(PIECES));
            let (a, b) = (at(t0), at(t1));
            // The control point that agrees best with the tangents on both ends.
            let half = 0.5 * (t1 - t0);
            let control = (a + slope(t0) * half + b - slope(t1) * half) * 0.5;
            self.contour.push(OutlineSegment::Quadratic([a, control, b]));
        }
        self.at = p[3];
    }

    fn close(&mut self) {
        self.finish();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Right ends of texts as POV-Ray 3.7.0.10 gives them by max_extent.
    #[test]
    fn advances_as_measured() {
        let Ok(font) = std::fs::read("/usr/share/fonts/truetype/povray/timrom.ttf") else { return };
        let right = |text: &str, offset: f64| {
            let shape = lay_out(&font, text, 1.0, DVec3::X * offset).unwrap();
            let (last, at) = shape.glyphs.last().unwrap();
            let ends = shape.outlines[*last as usize].contours.iter().flatten().map(|s| match s {
                OutlineSegment::Line([_, b]) | OutlineSegment::Quadratic([_, _, b]) => b.x,
            });
            ends.fold(0.0, f64::max) + at.x
        };
        for (text, offset, expected) in [
            ("A", 0.0, 0.736),
            ("AA", 0.0, 1.486),
            ("AV", 0.0, 1.278),
            ("VA", 0.0, 1.316),
            ("To", 0.0, 1.012),
            (" A", 0.0, 0.996),
            ("A A", 0.0, 1.740),
            ("AV", 0.1, 1.378),
        ] {
            assert!((right(text, offset) - expected).abs() < 1e-4, "{text}: {}, not {expected}", right(text, offset));
        }
    }

    #[test]
    fn bad_fonts() {
        assert!(lay_out(b"", "a", 1.0, DVec3::ZERO).is_err());
        assert!(lay_out(&[0; 4096], "a", 1.0, DVec3::ZERO).is_err());
    }
}
