//! Members of JSON objects with their types checked, and faults with their places.

use super::Reader;
use crate::formats::gltf::json::{Kind, Value, path_of};
use crate::report::REPORT_LIMIT;
use crate::span::Span;

impl<'a> Reader<'a> {
    pub(super) fn span(&self, value: &Value<'_>) -> Span {
        self.places.span_of(value)
    }

    fn message(&self, value: &Value<'_>, text: impl AsRef<str>) -> String {
        let path = path_of(self.root, value);
        format!("{}: {}", if path.is_empty() { "/" } else { &path }, text.as_ref())
    }

    pub(super) fn error(&mut self, value: &Value<'_>, text: impl AsRef<str>) {
        let message = self.message(value, text);
        // What several places refer to is told once.
        if self.told.len() < REPORT_LIMIT && self.told.insert(message.clone()) {
            self.desc.report.error(self.span(value), message);
        }
    }

    pub(super) fn warning(&mut self, value: &Value<'_>, text: impl AsRef<str>) {
        let message = self.message(value, text);
        self.desc.report.warning(self.span(value), message);
    }

    pub(super) fn loss(&mut self, value: &Value<'_>, feature: impl Into<String>, effect: impl Into<String>) {
        self.desc.report.loss(self.places.span_of(value), feature, effect);
    }

    /// The array of the root of that name, such as `meshes`.
    pub(super) fn list(&mut self, key: &str) -> &'a [Value<'a>] {
        self.array(self.root, key)
    }

    /// A member that must be an array; nothing where it is missing.
    pub(super) fn array(&mut self, object: &'a Value<'a>, key: &str) -> &'a [Value<'a>] {
        match object.get(key) {
            None => &[],
            Some(v) if matches!(v.kind, Kind::Array(_)) => v.items(),
            Some(v) => {
                self.error(v, "expected an array");
                &[]
            }
        }
    }

    /// A member that must be an object.
    pub(super) fn object(&mut self, object: &'a Value<'a>, key: &str) -> Option<&'a Value<'a>> {
        let v = object.get(key)?;
        if matches!(v.kind, Kind::Object(_)) {
            return Some(v);
        }
        self.error(v, "expected an object");
        None
    }

    /// The object of an extension.
    pub(super) fn extension(&mut self, object: &'a Value<'a>, name: &str) -> Option<&'a Value<'a>> {
        let extensions = object.get("extensions")?;
        self.object(extensions, name)
    }

    pub(super) fn string(&mut self, object: &'a Value<'a>, key: &str) -> Option<&'a str> {
        let v = object.get(key)?;
        if v.as_str().is_none() {
            self.error(v, "expected a string");
        }
        v.as_str()
    }

    pub(super) fn name(&mut self, object: &'a Value<'a>) -> String {
        self.string(object, "name").unwrap_or_default().to_owned()
    }

    pub(super) fn bool(&mut self, object: &'a Value<'a>, key: &str, default: bool) -> bool {
        match object.get(key).map(|v| (v, &v.kind)) {
            None => default,
            Some((_, &Kind::Bool(b))) => b,
            Some((v, _)) => {
                self.error(v, "expected true or false");
                default
            }
        }
    }

    /// A number as it stands; an error where it does not fit a float.
    fn float_of(&mut self, v: &Value<'_>) -> Option<f32> {
        match v.as_f64().map(|n| n as f32).filter(|n| n.is_finite()) {
            Some(n) => Some(n),
            None => {
                self.error(v, "expected a number within the range of a float");
                None
            }
        }
    }

    pub(super) fn float_opt(&mut self, object: &'a Value<'a>, key: &str) -> Option<f32> {
        let v = object.get(key)?;
        self.float_of(v)
    }

    pub(super) fn float(&mut self, object: &'a Value<'a>, key: &str, default: f32) -> f32 {
        self.float_opt(object, key).unwrap_or(default)
    }

    /// A number that is clamped into a range, with a warning.
    pub(super) fn float_in(&mut self, object: &'a Value<'a>, key: &str, default: f32, range: [f32; 2]) -> f32 {
        let value = self.float(object, key, default);
        let clamped = value.clamp(range[0], range[1]);
        if let (true, Some(v)) = (clamped != value, object.get(key)) {
            self.warning(v, format!("{value} is outside [{}, {}]; taken as {clamped}", range[0], range[1]));
        }
        clamped
    }

    /// An array of exactly N numbers.
    pub(super) fn floats<const N: usize>(&mut self, object: &'a Value<'a>, key: &str) -> Option<[f32; N]> {
        let v = object.get(key)?;
        if v.items().len() != N {
            self.error(v, format!("expected {N} numbers"));
            return None;
        }
        let mut out = [0.0; N];
        for (o, item) in out.iter_mut().zip(v.items()) {
            *o = self.float_of(item)?;
        }
        Some(out)
    }

    /// A color or factors that must not be negative.
    pub(super) fn color(&mut self, object: &'a Value<'a>, key: &str, default: [f32; 3]) -> [f32; 3] {
        let Some(c) = self.floats::<3>(object, key) else { return default };
        if let (true, Some(v)) = (c.iter().any(|&x| x < 0.0), object.get(key)) {
            self.warning(v, "a negative color; taken as 0");
        }
        c.map(|x| x.max(0.0))
    }

    /// A whole number, 0 or more.
    pub(super) fn integer(&mut self, object: &'a Value<'a>, key: &str) -> Option<u64> {
        let v = object.get(key)?;
        self.integer_of(v)
    }

    pub(super) fn integer_of(&mut self, v: &Value<'_>) -> Option<u64> {
        match v.as_f64() {
            // 2⁵³: beyond it JSON numbers are not exact.
            Some(n) if (0.0..=9_007_199_254_740_992.0).contains(&n) && n.fract() == 0.0 => Some(n as u64),
            _ => {
                self.error(v, "expected a whole number, 0 or more");
                None
            }
        }
    }

    /// A member that must be there.
    pub(super) fn required(&mut self, object: &'a Value<'a>, key: &str) -> Option<&'a Value<'a>> {
        let v = object.get(key);
        if v.is_none() {
            self.error(object, format!("`{key}` is missing"));
        }
        v
    }

    /// A reference into an array of the root, checked to exist.
    pub(super) fn reference(&mut self, object: &'a Value<'a>, key: &str, list: &str) -> Option<(usize, &'a Value<'a>)> {
        let v = object.get(key)?;
        self.reference_of(v, list)
    }

    pub(super) fn reference_of(&mut self, v: &'a Value<'a>, list: &str) -> Option<(usize, &'a Value<'a>)> {
        let i = self.integer_of(v)?;
        let items = self.list(list);
        match usize::try_from(i).ok().and_then(|i| Some((i, items.get(i)?))) {
            Some(found) => Some(found),
            None => {
                self.error(v, format!("{i} is out of range: there are {} {list}", items.len()));
                None
            }
        }
    }
}
