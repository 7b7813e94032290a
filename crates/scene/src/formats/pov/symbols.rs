//! Which identifiers are declared, in which scope.
//!
//! Scopes are numbered by depth: 0 is the scene's own, and each macro call and include file opens one above it. All bindings of a name
//! stand in one list, innermost last, so that a look-up takes the same time at any depth of recursion.

use std::sync::Arc;

use arrayvec::ArrayVec;

use super::lexer::Sym;
use super::value::{Array, Value};

/// A variable, or an element of an array variable.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Place {
    pub(super) name: Sym,
    /// Scope of the binding.
    pub(super) level: u32,
    /// Index of the element in each array on the way (arrays of arrays).
    pub(super) path: ArrayVec<u32, 4>,
}

#[derive(Debug)]
enum Slot {
    Value(Value),
    /// A macro's parameter that stands for a variable of its caller.
    Alias(Place),
}

#[derive(Debug)]
struct Binding {
    level: u32,
    slot: Slot,
    size: Size,
    deprecated: Option<Arc<Deprecation>>,
}

/// How large a value is, as far as the identifiers that it was made of tell: what is made in loops of itself could otherwise become too
/// deep or too large for anything that goes through it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Size {
    /// Values inside of one another.
    pub(super) depth: u32,
    /// Tokens of it and of all that it holds.
    pub(super) weight: u64,
}

/// What to say when a deprecated identifier is used.
#[derive(Debug)]
pub(super) struct Deprecation {
    pub(super) once: bool,
    pub(super) told: std::sync::atomic::AtomicBool,
    pub(super) message: Arc<str>,
}

/// All bindings.
#[derive(Default)]
pub(super) struct Symbols {
    bindings: Vec<Vec<Binding>>,
    /// Names that each scope above 0 binds.
    scopes: Vec<Vec<Sym>>,
}

fn element<'a>(mut value: &'a Value, path: &[u32]) -> Option<&'a Value> {
    for &i in path {
        let Value::Array(a) = value else { return None };
        value = a.items.get(i as usize)?.as_ref()?;
    }
    Some(value)
}

impl Symbols {
    /// Depth of the innermost scope.
    pub(super) fn level(&self) -> u32 {
        self.scopes.len() as u32
    }

    /// Opens a scope.
    pub(super) fn enter(&mut self) {
        self.scopes.push(Vec::new());
    }

    /// Closes the innermost scope with its bindings.
    pub(super) fn leave(&mut self) {
        let level = self.level();
        for name in self.scopes.pop().unwrap_or_default() {
            if let Some(list) = self.bindings.get_mut(name as usize)
                && list.last().is_some_and(|b| b.level == level)
            {
                list.pop();
            }
        }
    }

    fn list(&mut self, name: Sym) -> &mut Vec<Binding> {
        let i = name as usize;
        if self.bindings.len() <= i {
            self.bindings.resize_with(i + 1, Vec::new);
        }
        &mut self.bindings[i]
    }

    fn binding(&self, name: Sym, level: u32) -> Option<&Binding> {
        self.bindings.get(name as usize)?.iter().rev().find(|b| b.level == level)
    }

    /// The value of a name.
    pub(super) fn get(&self, name: Sym) -> Option<&Value> {
        match &self.bindings.get(name as usize)?.last()?.slot {
            Slot::Value(v) => Some(v),
            Slot::Alias(place) => match &self.binding(place.name, place.level)?.slot {
                Slot::Value(v) => element(v, &place.path),
                Slot::Alias(_) => None,
            },
        }
    }

    /// The size of a name's value.
    pub(super) fn size(&self, name: Sym) -> Size {
        let Some(binding) = self.bindings.get(name as usize).and_then(|l| l.last()) else { return Size::default() };
        match &binding.slot {
            Slot::Value(_) => binding.size,
            Slot::Alias(place) => self.binding(place.name, place.level).map_or_else(Size::default, |b| b.size),
        }
    }

    /// States the size of the value that a place now has; an array is as large as its largest elements together.
    pub(super) fn set_size(&mut self, place: &Place, size: Size) {
        let level = place.level;
        if let Some(b) = self.list(place.name).iter_mut().rev().find(|b| b.level == level) {
            b.size = if place.path.is_empty() {
                size
            } else {
                let depth = (size.depth + place.path.len() as u32).max(b.size.depth);
                Size { depth, weight: size.weight.max(b.size.weight) }
            };
        }
    }

    /// What to say when the name is used, if it is deprecated.
    pub(super) fn deprecation(&self, name: Sym) -> Option<&Arc<Deprecation>> {
        self.bindings.get(name as usize)?.last()?.deprecated.as_ref()
    }

    /// Marks the innermost binding of a name as deprecated.
    pub(super) fn deprecate(&mut self, name: Sym, what: Deprecation) {
        if let Some(b) = self.list(name).last_mut() {
            b.deprecated = Some(Arc::new(what));
        }
    }

    /// Where `#declare` puts a name's value: in the innermost binding, else in the scene's scope.
    pub(super) fn place(&self, name: Sym) -> Place {
        match self.bindings.get(name as usize).and_then(|l| l.last()) {
            Some(Binding { slot: Slot::Alias(place), .. }) => place.clone(),
            Some(b) => Place { name, level: b.level, path: ArrayVec::new() },
            None => Place { name, level: 0, path: ArrayVec::new() },
        }
    }

    /// Where `#local` puts a name's value.
    ///
    /// A parameter that stands for a variable of the caller stays one: `#local` changes the variable (measured).
    pub(super) fn local_place(&self, name: Sym, level: u32) -> Place {
        match self.binding(name, level) {
            Some(Binding { slot: Slot::Alias(place), .. }) => place.clone(),
            _ => Place { name, level, path: ArrayVec::new() },
        }
    }

    /// Binds a name in a scope to another variable.
    pub(super) fn bind_alias(&mut self, name: Sym, level: u32, place: Place) {
        self.bind(name, level, Slot::Alias(place));
    }

    fn bind(&mut self, name: Sym, level: u32, slot: Slot) {
        if level > self.level() {
            // The scope has ended while its last value was read.
            return;
        }
        let list = self.list(name);
        let at = list.iter().rposition(|b| b.level <= level);
        match at {
            Some(i) if list[i].level == level => {
                list[i].slot = slot;
                list[i].size = Size::default();
            }
            _ => {
                list.insert(at.map_or(0, |i| i + 1), Binding { level, slot, size: Size::default(), deprecated: None });
                if level > 0 {
                    self.scopes[level as usize - 1].push(name);
                }
            }
        }
    }

    /// Sets a variable or an element. `false` where the element is not there.
    pub(super) fn set(&mut self, place: &Place, value: Value) -> bool {
        if place.path.is_empty() {
            self.bind(place.name, place.level, Slot::Value(value));
            return true;
        }
        match self.slot_mut(place) {
            Some(slot) => {
                *slot = Some(value);
                true
            }
            None => false,
        }
    }

    /// The element that a place with a path stands for.
    fn slot_mut(&mut self, place: &Place) -> Option<&mut Option<Value>> {
        let level = place.level;
        let binding = self.list(place.name).iter_mut().rev().find(|b| b.level == level)?;
        let Slot::Value(mut_value) = &mut binding.slot else { return None };
        let (last, way) = place.path.split_last()?;
        let mut value = mut_value;
        for &i in way {
            let Value::Array(a) = value else { return None };
            value = Arc::make_mut(a).items.get_mut(i as usize)?.as_mut()?;
        }
        let Value::Array(a) = value else { return None };
        Arc::make_mut(a).items.get_mut(*last as usize)
    }

    /// The value at a place.
    pub(super) fn at(&self, place: &Place) -> Option<&Value> {
        match &self.binding(place.name, place.level)?.slot {
            Slot::Value(v) => element(v, &place.path),
            Slot::Alias(_) => None,
        }
    }

    /// The array at a place.
    pub(super) fn array(&self, place: &Place) -> Option<&Arc<Array>> {
        match self.at(place) {
            Some(Value::Array(a)) => Some(a),
            _ => None,
        }
    }

    /// Removes the innermost binding of a name.
    pub(super) fn undef(&mut self, name: Sym) {
        let place = self.place(name);
        if !place.path.is_empty() {
            if let Some(slot) = self.slot_mut(&place) {
                *slot = None;
            }
            return;
        }
        let level = place.level;
        let list = self.list(place.name);
        if let Some(i) = list.iter().rposition(|b| b.level == level) {
            list.remove(i);
            if level > 0 {
                let scope = &mut self.scopes[level as usize - 1];
                if let Some(k) = scope.iter().rposition(|n| *n == place.name) {
                    scope.swap_remove(k);
                }
            }
        }
    }
}
