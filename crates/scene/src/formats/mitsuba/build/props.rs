//! Parameters of one plugin while it is being interpreted: remembers which were asked for, so that the rest can be reported.

use glam::{DMat3, DMat4, DVec2, DVec3, Mat3, Mat4, Vec3};

use crate::formats::mitsuba::tree::{Kind, Plugin, Property, Value, suggestion};
use crate::report::Report;
use crate::span::Span;

/// Which walk over the nested plugins goes on.
pub struct Cursor(usize);

impl Cursor {
    /// Over the undefined references.
    pub const UNDEFINED: Self = Self(13);

    /// Over the plugins of a kind.
    pub fn of(kind: Kind) -> Self {
        Self(kind as usize)
    }
}

/// Parameters of a plugin.
pub struct Props<'t> {
    /// The plugin.
    pub plugin: &'t Plugin,
    used: Vec<bool>,
    cursors: [usize; 14],
    asked: Vec<&'static str>,
    faults: Vec<(Span, String)>,
    losses: Vec<(Span, String)>,
}

impl<'t> Props<'t> {
    /// Nothing asked for yet.
    pub fn new(plugin: &'t Plugin) -> Self {
        Self { plugin, used: vec![false; plugin.params.len()], cursors: [0; 14], asked: Vec::new(), faults: Vec::new(), losses: Vec::new() }
    }

    /// The parameter of a name, if the plugin has it.
    pub fn get(&mut self, name: &'static str) -> Option<&'t Property> {
        self.asked.push(name);
        let i = self.plugin.params.iter().position(|p| p.name == name)?;
        self.used[i] = true;
        Some(&self.plugin.params[i])
    }

    /// True where the plugin has the parameter; does not count as asking for it.
    pub fn has(&self, name: &str) -> bool {
        self.plugin.params.iter().any(|p| p.name == name)
    }

    /// The first nested plugin or reference that `want` accepts and nobody has asked for. `cursor` says where to go on looking: what lies
    /// before it is known not to be wanted, so that a long list is walked once.
    pub fn next_object(&mut self, cursor: Cursor, mut want: impl FnMut(&Property) -> bool) -> Option<&'t Property> {
        let cursor = cursor.0;
        while self.cursors[cursor] < self.plugin.params.len() {
            let i = self.cursors[cursor];
            self.cursors[cursor] += 1;
            let p = &self.plugin.params[i];
            if !self.used[i] && matches!(p.value, Value::Plugin(_) | Value::Reference(_)) && want(p) {
                self.used[i] = true;
                return Some(p);
            }
        }
        None
    }

    /// Reports a fault at a parameter.
    pub fn fault(&mut self, span: Span, message: impl Into<String>) {
        self.faults.push((span, message.into()));
    }

    fn mismatch(&mut self, property: &Property, expected: &str) {
        let message = format!("`{}` takes {expected}, not {}", property.name, property.value.kind_name());
        self.faults.push((property.span, message));
    }

    /// A number that may be missing.
    pub fn opt_float(&mut self, name: &'static str) -> Option<f32> {
        let property = self.get(name)?;
        match property.value {
            Value::Float(v) | Value::Uniform(v) => Some(v as f32),
            Value::Int(v) => Some(v as f32),
            _ => {
                self.mismatch(property, "a number");
                None
            }
        }
    }

    /// A number.
    pub fn float(&mut self, name: &'static str, default: f32) -> f32 {
        self.opt_float(name).unwrap_or(default)
    }

    /// A number greater than 0.
    pub fn positive(&mut self, name: &'static str, default: f32) -> f32 {
        match self.opt_float(name) {
            Some(v) if v > 0.0 => v,
            Some(v) => {
                self.fault_at(name, format!("`{name}` must be positive, not {v}"));
                default
            }
            None => default,
        }
    }

    /// Reports a fault at the parameter of a name.
    pub fn fault_at(&mut self, name: &str, message: impl Into<String>) {
        let span = self.plugin.params.iter().find(|p| p.name == name).map_or(self.plugin.span, |p| p.span);
        self.faults.push((span, message.into()));
    }

    /// A whole number that may be missing.
    pub fn opt_int(&mut self, name: &'static str) -> Option<i64> {
        let property = self.get(name)?;
        match property.value {
            Value::Int(v) => Some(v),
            // Dictionaries of Python give 16.0 as readily as 16.
            Value::Float(v) if v.fract() == 0.0 && v.abs() < 1e15 => Some(v as i64),
            _ => {
                self.mismatch(property, "an integer");
                None
            }
        }
    }

    /// A whole number of 32 bits that must be at least `least`.
    pub fn opt_count(&mut self, name: &'static str, least: u32) -> Option<u32> {
        let v = self.opt_int(name)?;
        match u32::try_from(v) {
            Ok(v) if v >= least && v <= i32::MAX as u32 => Some(v),
            _ => {
                self.fault_at(name, format!("`{name}` must be {least} or more, and no more than {}, not {v}", i32::MAX));
                None
            }
        }
    }

    /// A switch.
    pub fn bool(&mut self, name: &'static str, default: bool) -> bool {
        let Some(property) = self.get(name) else { return default };
        match property.value {
            Value::Bool(v) => v,
            _ => {
                self.mismatch(property, "a boolean");
                default
            }
        }
    }

    /// A text that may be missing.
    pub fn opt_text(&mut self, name: &'static str) -> Option<&'t str> {
        let property = self.get(name)?;
        match &property.value {
            Value::Text(v) => Some(v),
            _ => {
                self.mismatch(property, "a string");
                None
            }
        }
    }

    /// One of several words.
    pub fn choice<T: Copy>(&mut self, name: &'static str, choices: &[(&'static str, T)], default: T) -> T {
        let Some(text) = self.opt_text(name) else { return default };
        match choices.iter().find(|(word, _)| word.eq_ignore_ascii_case(text)) {
            Some((_, v)) => *v,
            None => {
                let words: Vec<&str> = choices.iter().map(|(word, _)| *word).collect();
                let hint = suggestion(text, words.iter().copied());
                self.fault_at(name, format!("`{name}` must be one of {}, not `{text}`{hint}", words.join(", ")));
                default
            }
        }
    }

    /// A point or vector that may be missing.
    pub fn opt_vector(&mut self, name: &'static str) -> Option<Vec3> {
        let property = self.get(name)?;
        match property.value {
            Value::Vector(v) | Value::Rgb(v) => Some(v.as_vec3()),
            _ => {
                self.mismatch(property, "a point or vector");
                None
            }
        }
    }

    /// A transform in double precision; the identity where it is missing.
    pub fn transform64(&mut self, name: &'static str) -> DMat4 {
        let Some(property) = self.get(name) else { return DMat4::IDENTITY };
        match property.value {
            Value::Transform(m) if m.is_finite() => m,
            Value::Transform(_) => {
                self.fault(property.span, format!("`{name}` overflows"));
                DMat4::IDENTITY
            }
            _ => {
                self.mismatch(property, "a transform");
                DMat4::IDENTITY
            }
        }
    }

    /// A transform; the identity where it is missing. One that cannot be inverted is a fault.
    pub fn transform(&mut self, name: &'static str) -> Mat4 {
        let matrix = self.transform64(name);
        // The determinant of a tiny but sound scene is tiny: compare with what the columns could span.
        let m3 = DMat3::from_mat4(matrix);
        let span = m3.x_axis.length() * m3.y_axis.length() * m3.z_axis.length();
        let single = matrix.as_mat4();
        let invertible = m3.determinant().abs() > 1e-10 * span;
        if !single.is_finite() || !invertible {
            self.fault_at(name, format!("`{name}` cannot be inverted"));
            return Mat4::IDENTITY;
        }
        if matrix.row(3) != glam::DVec4::W {
            self.fault_at(name, format!("`{name}` must be affine: its last row must be 0 0 0 1"));
            return Mat4::IDENTITY;
        }
        single
    }

    /// A transform of texture coordinates: the x and y of a 4×4 matrix.
    pub fn uv_transform(&mut self, name: &'static str) -> Mat3 {
        let m = self.transform64(name);
        let column = |c: glam::DVec4| DVec2::new(c.x, c.y);
        let (x, y, t) = (column(m.x_axis), column(m.y_axis), column(m.w_axis));
        DMat3::from_cols(x.extend(0.0), y.extend(0.0), t.extend(1.0)).as_mat3()
    }

    /// Marks parameters as known without reading them: they change nothing here.
    pub fn ignore(&mut self, names: &[&'static str]) {
        for name in names {
            self.get(name);
        }
    }

    /// Marks parameters as known and, where they are given, lists them as lost.
    pub fn lose(&mut self, names: &[&'static str]) {
        for name in names {
            if let Some(p) = self.get(name) {
                self.losses.push((p.span, (*name).to_owned()));
            }
        }
    }

    /// Marks everything as known: the plugin as a whole has been reported as lost.
    pub fn ignore_all(&mut self) {
        self.used.fill(true);
    }

    /// Hands over the faults, and one for each parameter that nobody asked for.
    pub fn finish(mut self, report: &mut Report) {
        let what = describe(self.plugin);
        for (span, message) in self.faults.drain(..) {
            report.error(span, format!("{what}: {message}"));
        }
        for (span, name) in self.losses.drain(..) {
            report.loss(span, format!("`{name}` of {what}"), "ignored");
        }
        for (property, used) in self.plugin.params.iter().zip(&self.used) {
            if *used {
                continue;
            }
            let nested = matches!(property.value, Value::Plugin(_) | Value::Reference(_));
            if nested {
                let kind = match &property.value {
                    Value::Plugin(p) => describe(p),
                    Value::Reference(id) => format!("reference to `{id}`"),
                    _ => String::new(),
                };
                let name = if property.name.is_empty() { String::new() } else { format!(" as `{}`", property.name) };
                let hint = suggestion(&property.name, self.asked.iter().copied());
                report.error(property.span, format!("{what} takes no {kind}{name}{}", if name.is_empty() { "" } else { &hint }));
            } else {
                let hint = suggestion(&property.name, self.asked.iter().copied());
                report.error(property.span, format!("unknown parameter `{}` of {what}{hint}", property.name));
            }
        }
    }
}

/// `bsdf "diffuse"`, with the id where there is one.
pub fn describe(plugin: &Plugin) -> String {
    if plugin.kind == Kind::Scene {
        return "the scene".to_owned();
    }
    let id = if plugin.id.is_empty() { String::new() } else { format!(" `{}`", plugin.id) };
    format!("{} \"{}\"{id}", plugin.kind.tag(), plugin.type_name)
}

/// A double vector as an array of floats.
pub fn rgb(v: DVec3) -> [f32; 3] {
    v.as_vec3().to_array()
}
