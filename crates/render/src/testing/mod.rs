//! Statistics for tests: no part of the renderer, public only so that integration tests can use them.

pub mod bsdf;
pub mod chi2;
