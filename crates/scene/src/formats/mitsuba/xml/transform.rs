//! Transforms: steps that apply one after the other.

use glam::{DMat3, DMat4, DVec3, DVec4};
use roxmltree::Node;

use super::values::shorten;
use super::{Context, XmlReader};
use crate::formats::mitsuba::tree::suggestion;
use crate::span::Span;

impl XmlReader<'_> {
    /// The product of a transform's steps; the first step acts first.
    pub(super) fn transform(&mut self, cx: &mut Context, node: Node) -> Option<DMat4> {
        let mut matrix = DMat4::IDENTITY;
        let mut good = true;
        for step in node.children().filter(Node::is_element) {
            let span = cx.cursor.at(step.range().start, cx.file);
            match self.step(step, span, cx.old) {
                Some(m) => matrix = m * matrix,
                None => good = false,
            }
        }
        good.then_some(matrix)
    }

    fn step(&mut self, node: Node, span: Span, old: bool) -> Option<DMat4> {
        let tag = node.tag_name().name();
        match tag {
            "translate" => {
                self.check_attributes(node, span, &["x", "y", "z", "value"]);
                Some(DMat4::from_translation(self.xyz(node, span, DVec3::ZERO)?))
            }
            "scale" => {
                self.check_attributes(node, span, &["x", "y", "z", "value"]);
                Some(DMat4::from_scale(self.xyz(node, span, DVec3::ONE)?))
            }
            "rotate" => {
                self.check_attributes(node, span, &["x", "y", "z", "value", "angle"]);
                let axis = self.xyz(node, span, DVec3::ZERO)?;
                let angle = self.required(node, "angle", span)?;
                let angle = self.number(&angle, span)?;
                match axis.try_normalize() {
                    Some(axis) => Some(DMat4::from_axis_angle(axis, angle.to_radians())),
                    None => {
                        self.report.error(span, "<rotate> needs an axis");
                        None
                    }
                }
            }
            "matrix" => {
                self.check_attributes(node, span, &["value"]);
                let text = self.required(node, "value", span)?;
                let v = self.numbers(&text, span)?;
                match v.len() {
                    16 => Some(DMat4::from_cols_slice(&v).transpose()),
                    9 => Some(DMat4::from_mat3(DMat3::from_cols_slice(&v).transpose())),
                    n => {
                        self.report.error(span, format!("<matrix> takes 9 or 16 numbers, not {n}"));
                        None
                    }
                }
            }
            "lookat" | "lookAt" => {
                if tag == "lookAt" && !old {
                    self.report.error(span, "unknown transform <lookAt> (did you mean `lookat`?)");
                    return None;
                }
                self.check_attributes(node, span, &["origin", "target", "up"]);
                let mut point = |name: &str| -> Option<DVec3> {
                    let text = self.required(node, name, span)?;
                    match self.numbers(&text, span)?[..] {
                        [x, y, z] => Some(DVec3::new(x, y, z)),
                        _ => {
                            self.report.error(span, format!("`{}` is not a point of three numbers", shorten(&text)));
                            None
                        }
                    }
                };
                let origin = point("origin")?;
                let target = point("target")?;
                let up = if node.has_attribute("up") { point("up")? } else { DVec3::ZERO };
                let matrix = look_at(origin, target, up);
                if matrix.is_none() {
                    self.report.error(span, "<lookat> needs a target away from its origin and an up vector across the line to it");
                }
                matrix
            }
            _ => {
                let hint = suggestion(tag, ["translate", "scale", "rotate", "matrix", "lookat"]);
                self.report.error(span, format!("unknown transform <{tag}>{hint}"));
                None
            }
        }
    }
}

/// Mitsuba's camera frame: +z to the target, +x to the left, +y up. `None` where the vectors span no frame.
pub fn look_at(origin: DVec3, target: DVec3, up: DVec3) -> Option<DMat4> {
    let forward = (target - origin).try_normalize()?;
    // Without an up vector Mitsuba takes any that fits.
    let up = if up == DVec3::ZERO { forward.any_orthonormal_vector() } else { up };
    let left = up.cross(forward).try_normalize()?;
    let up = forward.cross(left);
    let column = |v: DVec3| DVec4::new(v.x, v.y, v.z, 0.0);
    Some(DMat4::from_cols(column(left), column(up), column(forward), DVec4::new(origin.x, origin.y, origin.z, 1.0)))
}
