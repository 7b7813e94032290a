//! The Python module `etendue._etendue`: a thin layer over the same sessions that the command line drives.
//!
//! The package `etendue` (python/etendue) wraps it with typed signatures and documentation; nothing else should import it.
//! All long work runs on threads without Python's lock, see [`background`].

mod background;
mod bake;
mod command;
mod compiled;
mod dict;
mod errors;
mod films;
mod images;
mod info;
mod layers;
mod parts;
mod photons;
mod pieces;
mod places;
mod render;
mod scene;
mod settings;

use pyo3::prelude::*;

#[pymodule]
mod _etendue {
    #[pymodule_export]
    use super::bake::PreparedBake;
    #[pymodule_export]
    use super::command::cli_main;
    #[pymodule_export]
    use super::films::{film_info, film_layers, film_picture};
    #[pymodule_export]
    use super::images::{compare, flip_map, read_layers, tonemap, write_layers};
    #[pymodule_export]
    use super::parts::{Parts, Prepared};
    #[pymodule_export]
    use super::photons::PreparedPhotons;
    #[pymodule_export]
    use super::pieces::{part_info, part_merge};
    #[pymodule_export]
    use super::render::Status;
    #[pymodule_export]
    use super::scene::{Scene, load, load_dict, load_string};
    #[pymodule_export]
    use super::settings::{integrators, parameters};

    use super::{Bound, PyModule, PyModuleMethods, PyResult};

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
