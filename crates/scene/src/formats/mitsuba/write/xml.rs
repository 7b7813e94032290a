//! Elements of an XML text.

use std::fmt::{Display, Write};

use glam::Mat4;

/// XML being written.
pub struct Xml {
    text: String,
    open: Vec<&'static str>,
}

impl Xml {
    /// The head of a Mitsuba scene.
    pub fn new() -> Self {
        let text = "<?xml version=\"1.0\" encoding=\"utf-8\"?>\n<scene version=\"3.0.0\">\n".to_owned();
        Self { text, open: vec!["scene"] }
    }

    /// The finished text.
    pub fn finish(mut self) -> String {
        while !self.open.is_empty() {
            self.close();
        }
        self.text
    }

    fn element(&mut self, tag: &str, attributes: &[(&str, &str)], end: &str) {
        let indent = "  ".repeat(self.open.len());
        // Writing to a string cannot fail.
        let _ = write!(self.text, "{indent}<{tag}");
        for (name, value) in attributes.iter().filter(|(_, v)| !v.is_empty()) {
            let _ = write!(self.text, " {name}=\"{}\"", escape(value));
        }
        self.text.push_str(end);
    }

    /// Begins a plugin.
    pub fn open(&mut self, tag: &'static str, kind: &str, id: &str) {
        self.element(tag, &[("type", kind), ("id", id)], ">\n");
        self.open.push(tag);
    }

    /// Begins a plugin that is a parameter of another.
    pub fn open_named(&mut self, tag: &'static str, kind: &str, name: &str) {
        self.element(tag, &[("type", kind), ("name", name)], ">\n");
        self.open.push(tag);
    }

    /// Ends the plugin begun last.
    pub fn close(&mut self) {
        if let Some(tag) = self.open.pop() {
            let _ = writeln!(self.text, "{}</{tag}>", "  ".repeat(self.open.len()));
        }
    }

    /// A parameter.
    pub fn value(&mut self, tag: &str, name: &str, value: impl Display) {
        self.element(tag, &[("name", name), ("value", &value.to_string())], "/>\n");
    }

    /// A number.
    pub fn float(&mut self, name: &str, value: f32) {
        self.value("float", name, value);
    }

    /// A color, point or vector.
    pub fn triple(&mut self, tag: &str, name: &str, v: [f32; 3]) {
        self.value(tag, name, format!("{}, {}, {}", v[0], v[1], v[2]));
    }

    /// A reference, with a name or without.
    pub fn reference(&mut self, name: &str, id: &str) {
        self.element("ref", &[("name", name), ("id", id)], "/>\n");
    }

    /// A transform; nothing for the identity.
    pub fn transform(&mut self, name: &'static str, m: Mat4) {
        if m == Mat4::IDENTITY {
            return;
        }
        self.element("transform", &[("name", name)], ">");
        // Adding 0 turns −0 into 0.
        let values: Vec<String> = m.transpose().to_cols_array().iter().map(|v| (v + 0.0).to_string()).collect();
        let _ = writeln!(self.text, "<matrix value=\"{}\"/></transform>", values.join(" "));
    }
}

fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            // XML 1.0 knows no other control characters.
            c if c.is_control() => out.push(' '),
            c => out.push(c),
        }
    }
    out
}
