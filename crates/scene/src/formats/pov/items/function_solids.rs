//! Surfaces of functions: `isosurface`, `parametric` (sections 3.4.5.1.6 and 3.4.5.1.10 of the reference).

use std::sync::Arc;

use etendue_procedural::Function;

use super::super::{Parse, Parser, Value};
use crate::desc::classic::{Container, Isosurface, Parametric, Solid};

impl Parser {
    /// `function { … }`, or an identifier of one.
    fn function_item(&mut self) -> Parse<Arc<Function>> {
        if let Some(f) = self.accept_value(|v| if let Value::Function(f) = v { Some(f.clone()) } else { None })? {
            return Ok(f);
        }
        Ok(Arc::new(self.function()?))
    }

    /// The braces of `contained_by`.
    fn container(&mut self) -> Parse<Container> {
        self.expect("{")?;
        let container = if self.accept("sphere")? {
            self.expect("{")?;
            let center = self.vector3()?;
            self.comma()?;
            Container::Sphere { center, radius: self.float()? }
        } else {
            self.expect("box")?;
            self.expect("{")?;
            let a = self.vector3()?;
            self.comma()?;
            Container::Box([a, self.vector3()?])
        };
        self.expect("}")?;
        self.expect("}")?;
        Ok(container)
    }

    /// What stands in the braces of `isosurface` before the modifiers.
    pub(super) fn isosurface(&mut self) -> Parse<Solid> {
        let mut iso = Isosurface {
            function: self.function_item()?,
            container: Container::default(),
            threshold: 0.0,
            accuracy: 0.001,
            max_gradient: 1.1,
            evaluate: None,
            open: false,
            noise_generator: self.scene.settings.noise_generator,
        };
        const WORDS: &[&str] =
            &["contained_by", "threshold", "accuracy", "max_gradient", "evaluate", "open", "max_trace", "all_intersections"];
        self.comma()?;
        while let Some(word) = self.accept_any(WORDS)? {
            match word {
                "contained_by" => iso.container = self.container()?,
                "threshold" => iso.threshold = self.float()?,
                "accuracy" => iso.accuracy = self.float()?,
                "max_gradient" => iso.max_gradient = self.float()?,
                "evaluate" => {
                    let mut values = [0.0; 3];
                    for v in &mut values {
                        *v = self.float()?;
                        self.comma()?;
                    }
                    iso.evaluate = Some(values);
                }
                "open" => iso.open = true,
                // All crossings are found where they matter.
                "max_trace" => {
                    self.float()?;
                }
                _ => {}
            }
            self.comma()?;
        }
        Ok(Solid::Isosurface(Box::new(iso)))
    }

    /// What stands in the braces of `parametric` before the modifiers.
    pub(super) fn parametric(&mut self) -> Parse<Solid> {
        let function = |p: &mut Self| {
            let f = p.function_item();
            p.comma()?;
            f
        };
        let functions = [function(self)?, function(self)?, function(self)?];
        let first = self.vector2()?;
        self.comma()?;
        let last = self.vector2()?;
        let mut surface = Parametric {
            functions,
            range: [first.min(last), first.max(last)],
            container: Container::default(),
            accuracy: 0.001,
            noise_generator: self.scene.settings.noise_generator,
        };
        self.comma()?;
        while let Some(word) = self.accept_any(&["contained_by", "accuracy", "max_gradient", "precompute"])? {
            match word {
                "contained_by" => surface.container = self.container()?,
                "accuracy" => surface.accuracy = self.float()?,
                // The surface is searched with bounds that are measured, not with this one.
                "max_gradient" => {
                    self.float()?;
                }
                _ => {
                    self.float()?;
                    self.comma()?;
                    while self.accept_any(&["x", "y", "z"])?.is_some() {
                        self.comma()?;
                    }
                }
            }
            self.comma()?;
        }
        Ok(Solid::Parametric(Arc::new(surface)))
    }
}
