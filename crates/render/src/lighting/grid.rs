//! Grids of sensors: rows and columns of points with a normal.

use crate::math::{Frame, Vec3};

/// A plane rectangle of sensors.
#[derive(Clone, Debug, PartialEq)]
pub struct SensorGrid {
    /// Name in reports.
    pub name: String,
    /// The grid's center.
    pub position: Vec3,
    /// Where the sensors face; any length.
    pub normal: Vec3,
    /// Along the columns (any length, made perpendicular to the normal); zero chooses: horizontal where that means something.
    pub along: Vec3,
    /// Distance between neighbors along columns and rows, scene units.
    pub spacing: [f32; 2],
    /// Points in a row.
    pub columns: u32,
    /// Rows.
    pub rows: u32,
}

/// Why a grid is none.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct GridError(pub String);

/// More sensors than this are refused: a typing error rather than a wish.
const MAX_SENSORS: u64 = 1 << 24;

impl SensorGrid {
    /// From `key=value` pairs separated by commas: `name=desk,position=0 0.8 0,normal=0 1 0,columns=5,rows=4,spacing=0.5`. Vectors are
    /// three numbers separated by spaces or colons; `spacing` is one number or two; `along` is optional; a single sensor needs position and
    /// normal alone.
    ///
    /// # Errors
    /// [`GridError`] with a sentence.
    pub fn parse(text: &str) -> Result<Self, GridError> {
        let mut grid = Self {
            name: "grid".into(),
            position: Vec3::NAN,
            normal: Vec3::ZERO,
            along: Vec3::ZERO,
            spacing: [1.0; 2],
            columns: 1,
            rows: 1,
        };
        let fault = |m: String| GridError(m);
        for pair in text.split(',').filter(|p| !p.trim().is_empty()) {
            let (key, value) = pair.split_once('=').ok_or_else(|| fault(format!("`{pair}` is not of the form KEY=VALUE")))?;
            let value = value.trim();
            let numbers = || -> Result<Vec<f32>, GridError> {
                let parts = value.split([' ', ':', ';']).filter(|v| !v.is_empty());
                parts.map(|v| v.parse().map_err(|_| fault(format!("`{v}` of `{key}` is not a number")))).collect()
            };
            let vector = || match numbers()?[..] {
                [x, y, z] => Ok(Vec3::new(x, y, z)),
                _ => Err(fault(format!("`{key}` takes three numbers, as in {key}=0 1 0"))),
            };
            let count = || value.parse().map_err(|_| fault(format!("`{key}` takes a whole number, not `{value}`")));
            match key.trim() {
                "name" => grid.name = value.to_owned(),
                "position" => grid.position = vector()?,
                "normal" => grid.normal = vector()?,
                "along" => grid.along = vector()?,
                "columns" => grid.columns = count()?,
                "rows" => grid.rows = count()?,
                "spacing" => {
                    grid.spacing = match numbers()?[..] {
                        [s] => [s, s],
                        [a, b] => [a, b],
                        _ => return Err(fault("`spacing` takes one number or two".into())),
                    }
                }
                other => {
                    let keys = "name, position, normal, along, columns, rows, spacing";
                    return Err(fault(format!("a grid has no `{other}`; it has {keys}")));
                }
            }
        }
        grid.check()?;
        Ok(grid)
    }

    /// # Errors
    /// [`GridError`] for numbers that make no grid.
    pub fn check(&self) -> Result<(), GridError> {
        let fault = |m: &str| Err(GridError(format!("grid `{}`: {m}", self.name)));
        if !self.position.is_finite() {
            return fault("give a position, as in position=0 0.8 0");
        }
        if self.normal.try_normalize().is_none() {
            return fault("give a normal, as in normal=0 1 0");
        }
        if !self.spacing.iter().all(|s| *s > 0.0 && s.is_finite()) || !self.along.is_finite() {
            return fault("spacing must be above 0 and all numbers finite");
        }
        let count = u64::from(self.columns) * u64::from(self.rows);
        if count == 0 || count > MAX_SENSORS {
            return fault("rows and columns must be 1 or more, and not make more than 16 million sensors");
        }
        Ok(())
    }

    /// Unit normal, and unit axes along columns and rows.
    pub fn axes(&self) -> [Vec3; 3] {
        let n = self.normal.normalize_or(Vec3::Z);
        // Rows of horizontal grids run along x, those of upright ones level in a world with y up.
        let along = [self.along, Vec3::Y.cross(n), Vec3::X].into_iter().find(|a| a.cross(n).length() > 1e-4 * a.length().max(1e-20));
        let frame = Frame::from_normal_tangent(n, along.unwrap_or(Vec3::Z));
        [frame.n, frame.s, frame.t]
    }

    /// The sensors' places, row by row.
    pub fn points(&self) -> Vec<Vec3> {
        let [_, s, t] = self.axes();
        let middle = |i: u32, n: u32| i as f32 - 0.5 * (n - 1) as f32;
        let at =
            |c: u32, r: u32| self.position + s * (middle(c, self.columns) * self.spacing[0]) + t * (middle(r, self.rows) * self.spacing[1]);
        (0..self.rows).flat_map(|r| (0..self.columns).map(move |c| (c, r))).map(|(c, r)| at(c, r)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grids_are_centered_and_face_their_normal() {
        let g = SensorGrid::parse("name=desk,position=1 0.8 2,normal=0:2:0,columns=3,rows=2,spacing=0.5 0.25").unwrap();
        let points = g.points();
        assert_eq!(points.len(), 6);
        let mean: Vec3 = points.iter().sum::<Vec3>() / 6.0;
        assert!((mean - Vec3::new(1.0, 0.8, 2.0)).length() < 1e-6);
        assert!((points[1] - points[0]).length() - 0.5 < 1e-6 && (points[3] - points[0]).length() - 0.25 < 1e-6);
        let [n, s, t] = g.axes();
        assert!((s.cross(t) - n).length() < 1e-6 && n == Vec3::Y);
        let wall = SensorGrid::parse("position=0 0 0,normal=1 0 0,columns=2").unwrap();
        assert_eq!(wall.axes()[1].y, 0.0, "columns of upright grids are level");
    }

    #[test]
    fn faults_are_told() {
        for (text, part) in [
            ("normal=0 1 0", "position"),
            ("position=0 0 0", "normal"),
            ("position=0 0,normal=0 1 0", "three numbers"),
            ("position=0 0 x,normal=0 1 0", "not a number"),
            ("position=0 0 0,normal=0 1 0,size=3", "no `size`"),
            ("position=0 0 0,normal=0 1 0,rows=0", "rows"),
            ("position=0 0 0,normal=0 1 0,rows=99999,columns=99999", "16 million"),
            ("position=0 0 0,normal=0 1 0,spacing=-1", "spacing"),
            ("hello", "KEY=VALUE"),
            ("position=nan 0 0,normal=0 1 0", "position"),
        ] {
            let e = SensorGrid::parse(text).unwrap_err().to_string();
            assert!(e.contains(part), "{text}: {e}");
        }
    }
}
