//! Names as numbers.

use std::collections::HashMap;

/// Gives each distinct name a number, from 0 in the order of their coming.
#[derive(Debug, Default)]
pub struct Names {
    numbers: HashMap<String, u32>,
    names: Vec<String>,
}

impl Names {
    /// The number of a name, new or known.
    pub fn intern(&mut self, name: &str) -> u32 {
        if let Some(&n) = self.numbers.get(name) {
            return n;
        }
        let n = self.names.len() as u32;
        self.numbers.insert(name.to_owned(), n);
        self.names.push(name.to_owned());
        n
    }

    /// All names by number.
    pub fn into_names(self) -> Vec<String> {
        self.names
    }
}
