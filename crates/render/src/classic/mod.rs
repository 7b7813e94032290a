//! The classic shading model: Whitted's I = Ic + ks·Is + kt·It with the finishes, interiors, fogs, media and skies of POV-Ray's
//! documentation, over exact [`crate::solid`]s.
