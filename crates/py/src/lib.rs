//! The Python module `etendue._etendue`.
