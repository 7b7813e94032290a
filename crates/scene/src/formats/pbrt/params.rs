//! Parameter lists: `"type name" value`, `"type name" [values]`.

use std::cell::Cell;

use glam::{Vec2, Vec3};

use crate::report::Report;
use crate::span::Span;

/// Values of a parameter.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Values {
    /// Numbers.
    Numbers(Vec<f64>),
    /// Strings.
    Texts(Vec<String>),
    /// Truth values.
    Bools(Vec<bool>),
}

/// One parameter.
#[derive(Clone, Debug)]
pub(super) struct Parameter {
    /// Where its declaration stands.
    pub span: Span,
    /// `float`, `rgb`, `texture` …
    pub kind: String,
    /// Name.
    pub name: String,
    /// Values.
    pub values: Values,
    used: Cell<bool>,
}

impl Parameter {
    /// A parameter that nobody has read yet.
    pub fn new(span: Span, kind: &str, name: &str, values: Values) -> Self {
        Self { span, kind: kind.to_owned(), name: name.to_owned(), values, used: Cell::new(false) }
    }

    /// The numbers; empty where the values are none.
    pub fn numbers(&self) -> &[f64] {
        if let Values::Numbers(v) = &self.values { v } else { &[] }
    }

    /// The first string.
    pub fn text(&self) -> Option<&str> {
        if let Values::Texts(v) = &self.values { v.first().map(String::as_str) } else { None }
    }
}

/// The parameters of a directive, with defaults of `Attribute` directives behind them.
#[derive(Clone, Debug)]
pub(super) struct Params {
    /// Where the directive stands.
    pub span: Span,
    list: Vec<Parameter>,
}

impl Params {
    /// Parameters of a directive; `defaults` count where the list lacks a name.
    pub fn new(span: Span, mut list: Vec<Parameter>, defaults: &[Parameter]) -> Self {
        for d in defaults {
            if !list.iter().any(|p| p.name == d.name) {
                let copy = d.clone();
                // Attributes need not fit every shape they stand before.
                copy.used.set(true);
                list.push(copy);
            }
        }
        Self { span, list }
    }

    /// The parameter of a name, whatever its kind.
    pub fn get(&self, name: &str) -> Option<&Parameter> {
        let found = self.list.iter().find(|p| p.name == name)?;
        found.used.set(true);
        Some(found)
    }

    /// Whether there is a parameter of this name.
    pub fn has(&self, name: &str) -> bool {
        self.list.iter().any(|p| p.name == name)
    }

    /// Marks parameters as read that mean nothing to us.
    pub fn ignore(&self, names: &[&str]) {
        for name in names {
            self.get(name);
        }
    }

    /// Tells of parameters that nobody has read.
    pub fn finish(&self, report: &mut Report) {
        for p in self.list.iter().filter(|p| !p.used.get()) {
            report.warning(p.span, format!("the parameter `{} {}` means nothing here", p.kind, p.name));
        }
    }

    fn typed(&self, name: &str, kinds: &[&str], report: &mut Report) -> Option<&Parameter> {
        let found = self.get(name)?;
        if kinds.contains(&found.kind.as_str()) {
            return Some(found);
        }
        report.error(found.span, format!("`{name}` must be {}, not {}", kinds.join(" or "), found.kind));
        None
    }

    /// A number.
    pub fn opt_float(&self, name: &str, report: &mut Report) -> Option<f32> {
        let p = self.typed(name, &["float", "integer"], report)?;
        match p.numbers() {
            [v] => Some(*v as f32),
            v => {
                report.error(p.span, format!("`{name}` must be one number, not {}", v.len()));
                None
            }
        }
    }

    /// A number, or its default.
    pub fn float(&self, name: &str, default: f32, report: &mut Report) -> f32 {
        self.opt_float(name, report).unwrap_or(default)
    }

    /// A whole number.
    pub fn opt_integer(&self, name: &str, report: &mut Report) -> Option<i64> {
        let p = self.typed(name, &["integer", "float"], report)?;
        match p.numbers() {
            [v] => Some(*v as i64),
            v => {
                report.error(p.span, format!("`{name}` must be one whole number, not {}", v.len()));
                None
            }
        }
    }

    /// A truth value, or its default.
    pub fn boolean(&self, name: &str, default: bool, report: &mut Report) -> bool {
        let Some(p) = self.typed(name, &["bool"], report) else { return default };
        match &p.values {
            Values::Bools(v) if v.len() == 1 => v[0],
            _ => {
                report.error(p.span, format!("`{name}` must be true or false"));
                default
            }
        }
    }

    /// A string.
    pub fn opt_text(&self, name: &str, report: &mut Report) -> Option<&str> {
        let p = self.typed(name, &["string"], report)?;
        let text = p.text();
        if text.is_none() {
            report.error(p.span, format!("`{name}` must be a string"));
        }
        text
    }

    /// Numbers; empty where there are none.
    pub fn floats(&self, name: &str, report: &mut Report) -> &[f64] {
        self.typed(name, &["float", "integer"], report).map_or(&[], Parameter::numbers)
    }

    /// Whole numbers as indices below `count`; `None` with a fault where one is not.
    pub fn indices(&self, name: &str, count: usize, report: &mut Report) -> Option<Vec<u32>> {
        let Some(p) = self.typed(name, &["integer"], report) else { return Some(Vec::new()) };
        if let Some(bad) = p.numbers().iter().find(|v| !(**v >= 0.0 && **v < count as f64)) {
            report.error(p.span, format!("the index {bad} in `{name}` is not below {count}, the number of points"));
            return None;
        }
        Some(p.numbers().iter().map(|v| *v as u32).collect())
    }

    fn tuples<const N: usize>(&self, name: &str, kinds: &[&str], report: &mut Report) -> Vec<[f32; N]> {
        let Some(p) = self.typed(name, kinds, report) else { return Vec::new() };
        if p.numbers().len() % N != 0 {
            report.error(p.span, format!("`{name}` has {} numbers, which is no multiple of {N}", p.numbers().len()));
        }
        p.numbers().chunks_exact(N).map(|c| std::array::from_fn(|i| c[i] as f32)).collect()
    }

    /// Points, vectors or normals of three numbers.
    pub fn vectors(&self, name: &str, report: &mut Report) -> Vec<Vec3> {
        let kinds = ["point3", "vector3", "normal", "normal3", "point", "vector"];
        self.tuples::<3>(name, &kinds, report).into_iter().map(Vec3::from).collect()
    }

    /// One point, vector or normal.
    pub fn vector(&self, name: &str, default: Vec3, report: &mut Report) -> Vec3 {
        self.vectors(name, report).first().copied().unwrap_or(default)
    }

    /// Points or vectors of two numbers.
    pub fn vectors2(&self, name: &str, report: &mut Report) -> Vec<Vec2> {
        self.tuples::<2>(name, &["point2", "vector2"], report).into_iter().map(Vec2::from).collect()
    }
}
