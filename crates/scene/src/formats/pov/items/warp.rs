//! Warps of patterns (documentation, "Warp").

use etendue_procedural::pattern::Turbulent;
use etendue_procedural::warp::{BlackHole, Warp, Wrap};
use glam::DVec3;

use super::super::{Parse, Parser};

impl Parser {
    /// `warp { … }`; `None` for one without effect.
    pub(super) fn warp(&mut self) -> Parse<Option<Warp>> {
        self.expect("warp")?;
        self.expect("{")?;
        let Some(word) =
            self.accept_any(&["repeat", "black_hole", "turbulence", "cylindrical", "spherical", "toroidal", "planar", "cubic"])?
        else {
            return Err(self.unexpected("a warp"));
        };
        let warp = match word {
            "repeat" => self.repeat_warp()?,
            "black_hole" => Some(Warp::BlackHole(Box::new(self.black_hole()?))),
            "turbulence" => {
                let mut turbulent = Turbulent { amount: self.vector3()?, ..Turbulent::default() };
                while let Some(word) = self.accept_any(&["octaves", "omega", "lambda"])? {
                    self.walk_item(word, &mut turbulent.walk)?;
                }
                Some(Warp::Turbulence(turbulent))
            }
            "cylindrical" => Some(Warp::Cylindrical(self.wrap()?.0)),
            "spherical" => Some(Warp::Spherical(self.wrap()?.0)),
            "toroidal" => {
                let (wrap, major_radius) = self.wrap()?;
                Some(Warp::Toroidal { wrap, major_radius })
            }
            "planar" => {
                let mut normal = DVec3::Z;
                let mut distance = 0.0;
                if !self.at_end_of_body()? {
                    normal = self.vector3()?;
                    self.comma()?;
                    distance = self.float()?;
                }
                Some(Warp::Planar { normal, distance })
            }
            _ => Some(Warp::Cubic),
        };
        self.expect("}")?;
        Ok(warp)
    }

    fn repeat_warp(&mut self) -> Parse<Option<Warp>> {
        let span = self.span();
        let direction = self.vector3()?;
        let (mut offset, mut flip) = (DVec3::ZERO, [false; 3]);
        while let Some(word) = self.accept_any(&["offset", "flip"])? {
            let v = self.vector3()?;
            match word {
                "offset" => offset = v,
                _ => flip = v.to_array().map(|c| c != 0.0),
            }
        }
        let mut axes = (0..3_u8).filter(|i| direction[usize::from(*i)] != 0.0);
        match (axes.next(), axes.next()) {
            (Some(axis), None) => Ok(Some(Warp::Repeat { axis, width: direction[usize::from(axis)], offset, flip })),
            (None, _) => Ok(None),
            _ => Err(self.error(span, "the vector of `repeat` must lie along an axis")),
        }
    }

    fn black_hole(&mut self) -> Parse<BlackHole> {
        let center = self.vector3()?;
        self.comma()?;
        let mut hole = BlackHole {
            center,
            radius: self.float()?,
            strength: 1.0,
            falloff: 2.0,
            inverse: false,
            repeat: DVec3::ZERO,
            turbulence: DVec3::ZERO,
        };
        while let Some(word) = self.accept_any(&["strength", "falloff", "inverse", "repeat", "turbulence", "type"])? {
            match word {
                "strength" => hole.strength = self.float()?,
                "falloff" => hole.falloff = self.float()?,
                "inverse" => hole.inverse = self.flag()?,
                "repeat" => hole.repeat = self.vector3()?,
                "turbulence" => hole.turbulence = self.vector3()?,
                _ => {
                    self.float()?;
                }
            }
        }
        Ok(hole)
    }

    /// Items of the mapping warps: how they are turned, and the major radius.
    fn wrap(&mut self) -> Parse<(Wrap, f64)> {
        let (mut wrap, mut major_radius) = (Wrap::default(), 1.0);
        while let Some(word) = self.accept_any(&["orientation", "dist_exp", "major_radius"])? {
            match word {
                "orientation" => wrap.orientation = self.vector3()?,
                "dist_exp" => wrap.dist_exp = self.float()?,
                _ => major_radius = self.float()?,
            }
        }
        Ok((wrap, major_radius))
    }
}
