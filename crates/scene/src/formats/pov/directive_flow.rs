//! Blocks (`#if`, `#switch`, `#while`, `#for`), macros and include files.

use arrayvec::ArrayVec;
use std::sync::Arc;

use super::lexer::{Directive, Raw, SIGNS, Sym};
use super::parser::{Parse, Parser};
use super::stream::{Block, BlockKind, FrameKind};
use super::symbols::{Place, Size};
use super::value::{Macro, Value};
use crate::span::Span;

/// Floats closer than this are equal, and closer than this to 0 are false (Numeric Expressions).
pub(super) const EPSILON: f64 = 1e-10;

/// Most include files inside of one another.
const INCLUDE_LIMIT: usize = 64;

/// Most parameters of a macro.
const PARAMETER_LIMIT: usize = 256;

enum Argument {
    Place(Place),
    Value(Value, Size),
    Missing,
}

impl Parser {
    /// `( condition )`.
    fn condition(&mut self) -> Parse<bool> {
        self.expect("(")?;
        let value = self.full_float()?;
        self.expect(")")?;
        Ok(!(value.abs() < EPSILON))
    }

    fn jump(&mut self, to: u32, span: Span) -> Parse<()> {
        if to == u32::MAX {
            return Err(self.error(span, "this directive has no #end"));
        }
        if let Some(f) = self.frames.last_mut() {
            f.at = to as usize;
        }
        Ok(())
    }

    fn push_block(&mut self, kind: BlockKind, span: Span, end: u32) -> Parse<()> {
        if end == u32::MAX {
            return Err(self.error(span, "this directive has no #end"));
        }
        self.blocks.push(Block { kind, span, end });
        Ok(())
    }

    pub(super) fn if_directive(&mut self, next: u32, end: u32, span: Span) -> Parse<()> {
        if self.condition()? {
            return self.push_block(BlockKind::If, span, end);
        }
        self.seek_branch(next, end, span)
    }

    /// Goes from branch to branch of an `#if` until one holds.
    fn seek_branch(&mut self, mut to: u32, end: u32, span: Span) -> Parse<()> {
        loop {
            self.jump(to, span)?;
            let Some(Raw::Directive { kind, next, .. }) = self.raw() else {
                return Err(self.error(span, "this directive has no #end"));
            };
            self.take_raw()?;
            match kind {
                Directive::Else => return self.push_block(BlockKind::If, span, end),
                Directive::Elseif => {
                    if self.condition()? {
                        return self.push_block(BlockKind::If, span, end);
                    }
                }
                Directive::End => return Ok(()),
                _ => {
                    let span = self.here();
                    return Err(self.stray(kind, span));
                }
            }
            to = next;
        }
    }

    pub(super) fn ifdef(&mut self, wanted: bool, next: u32, end: u32, span: Span) -> Parse<()> {
        self.expect("(")?;
        let is_defined = self.defined()?;
        self.expect(")")?;
        if is_defined == wanted {
            return self.push_block(BlockKind::If, span, end);
        }
        self.seek_branch(next, end, span)
    }

    /// Whether the identifier that follows, or the element of an array, has a value.
    pub(super) fn defined(&mut self) -> Parse<bool> {
        let span = self.raw_span();
        match self.raw() {
            Some(Raw::Name(name)) => {
                self.take_raw()?;
                let mut place = self.symbols.place(name);
                if self.at_bracket() && self.symbols.array(&place).is_some() {
                    place = self.indices(place, span)?;
                } else if self.at_bracket() {
                    return Err(self.error(span, "this is no array"));
                }
                Ok(self.symbols.at(&place).is_some())
            }
            Some(Raw::Word(_)) => {
                // Reserved words count as undefined.
                self.take_raw()?;
                Ok(false)
            }
            _ => Err(self.error(span, "an identifier is expected")),
        }
    }

    /// The innermost block of the current frame.
    fn block(&self) -> Option<&Block> {
        let base = self.frames.last().map_or(0, |f| f.blocks);
        if self.blocks.len() > base { self.blocks.last() } else { None }
    }

    /// `#else` or `#elseif` after a branch that was read.
    pub(super) fn branch_ends(&mut self, kind: Directive, span: Span) -> Parse<()> {
        match self.block() {
            Some(Block { kind: BlockKind::If, end, .. }) => {
                let end = *end;
                self.blocks.pop();
                self.jump(end, span)?;
                self.take_raw()
            }
            // Without `#break` a clause of `#switch` goes on into `#else`.
            Some(Block { kind: BlockKind::Switch(_), .. }) if kind == Directive::Else => Ok(()),
            _ => Err(self.stray(kind, span)),
        }
    }

    /// `#switch (value)`. What stands before the first clause is read (measured).
    pub(super) fn switch_directive(&mut self, end: u32, span: Span) -> Parse<()> {
        self.expect("(")?;
        let value = self.full_float()?;
        self.expect(")")?;
        self.push_block(BlockKind::Switch(value), span, end)
    }

    fn seek_case(&mut self, mut to: u32, value: f64, span: Span) -> Parse<()> {
        loop {
            self.jump(to, span)?;
            let Some(Raw::Directive { kind, next, .. }) = self.raw() else {
                return Err(self.error(span, "this directive has no #end"));
            };
            match kind {
                Directive::Case | Directive::Range => {
                    self.take_raw()?;
                    if self.case_holds(kind, value)? {
                        return Ok(());
                    }
                }
                Directive::Else => return self.take_raw(),
                Directive::End => return Ok(()),
                _ => return Err(self.stray(kind, span)),
            }
            to = next;
        }
    }

    fn case_holds(&mut self, kind: Directive, value: f64) -> Parse<bool> {
        self.expect("(")?;
        let low = self.full_float()?;
        let holds = if kind == Directive::Range {
            self.expect(",")?;
            let high = self.full_float()?;
            low <= value && value <= high
        } else {
            (low - value).abs() < EPSILON
        };
        self.expect(")")?;
        Ok(holds)
    }

    /// `#case` or `#range` met while reading: the clause before it had no `#break`.
    pub(super) fn case_directive(&mut self, kind: Directive, next: u32, span: Span) -> Parse<()> {
        let value = match self.block() {
            Some(Block { kind: BlockKind::Switch(value), .. }) => *value,
            _ => return Err(self.stray(kind, span)),
        };
        if self.case_holds(kind, value)? { Ok(()) } else { self.seek_case(next, value, span) }
    }

    pub(super) fn while_directive(&mut self, end: u32, span: Span) -> Parse<()> {
        let start = self.frames.last().map_or(0, |f| f.at);
        self.push_block(BlockKind::While(start), span, end)?;
        self.while_condition(span)
    }

    /// The condition of the innermost block, a `#while`; leaves the loop where it does not hold.
    fn while_condition(&mut self, span: Span) -> Parse<()> {
        if !self.condition()? {
            self.leave_block(span)?;
        }
        Ok(())
    }

    /// Goes behind the `#end` of the innermost block.
    fn leave_block(&mut self, span: Span) -> Parse<()> {
        if let Some(block) = self.blocks.pop() {
            self.jump(block.end, span)?;
            self.take_raw()?;
        }
        Ok(())
    }

    /// `#for (Name, first, last [, step])`.
    pub(super) fn for_directive(&mut self, end: u32, span: Span) -> Parse<()> {
        let level = self.frame_level();
        self.expect("(")?;
        let name = self.raw_name("#for")?;
        self.expect(",")?;
        let first = self.full_float()?;
        self.expect(",")?;
        let last = self.full_float()?;
        let step = if self.accept(",")? { self.full_float()? } else { 1.0 };
        self.expect(")")?;
        if step.abs() < EPSILON {
            return Err(self.error(span, "the step of #for is 0"));
        }
        self.symbols.set(&self.symbols.local_place(name, level), Value::Float(first));
        let body = self.frames.last().map_or(0, |f| f.at);
        self.push_block(BlockKind::For { name, level, last, step, body }, span, end)?;
        self.for_goes_on(first, span)
    }

    fn for_goes_on(&mut self, value: f64, span: Span) -> Parse<()> {
        let Some(Block { kind: BlockKind::For { last, step, .. }, .. }) = self.blocks.last() else { return Ok(()) };
        let goes_on = if *step > 0.0 { value < *last + EPSILON } else { value > *last - EPSILON };
        if goes_on { Ok(()) } else { self.leave_block(span) }
    }

    pub(super) fn end_directive(&mut self, span: Span) -> Parse<()> {
        match self.block() {
            None => Err(self.stray(Directive::End, span)),
            Some(Block { kind: BlockKind::If | BlockKind::Switch(_), .. }) => {
                self.blocks.pop();
                Ok(())
            }
            Some(Block { kind: BlockKind::While(start), span, .. }) => {
                let (start, span) = (*start as u32, *span);
                self.jump(start, span)?;
                self.while_condition(span)
            }
            Some(Block { kind: BlockKind::For { name, level, step, body, .. }, span, .. }) => {
                let (name, level, step, body, span) = (*name, *level, *step, *body, *span);
                let place = self.symbols.local_place(name, level);
                let Some(Value::Float(value)) = self.symbols.at(&place) else {
                    return Err(self.error(span, "the variable of this #for is no float any more"));
                };
                let value = value + step;
                self.symbols.set(&place, Value::Float(value));
                self.jump(body as u32, span)?;
                self.for_goes_on(value, span)
            }
        }
    }

    /// Leaves the innermost loop, `#switch` or macro.
    pub(super) fn break_directive(&mut self, span: Span) -> Parse<()> {
        let base = self.frames.last().map_or(0, |f| f.blocks);
        while self.blocks.len() > base {
            if matches!(self.blocks.last(), Some(Block { kind: BlockKind::If, .. })) {
                self.blocks.pop();
            } else {
                return self.leave_block(span);
            }
        }
        match self.frames.last_mut() {
            Some(f) if matches!(f.kind, FrameKind::Macro(_)) => {
                f.at = f.end;
                Ok(())
            }
            _ => Err(self.stray(Directive::Break, span)),
        }
    }

    /// `#macro Name(A, B, optional C) … #end`.
    pub(super) fn define_macro(&mut self, end: u32, span: Span) -> Parse<()> {
        if end == u32::MAX {
            return Err(self.error(span, "this macro has no #end"));
        }
        let name = self.raw_name("#macro")?;
        self.expect_raw("(", "a macro")?;
        let mut parameters = Vec::new();
        while !self.accept_raw(")")? {
            let mut parameter = self.raw_name("a macro's parameter")?;
            let mut optional = false;
            if &*self.names.text(parameter) == "optional"
                && let Some(Raw::Name(_)) = self.raw()
            {
                optional = true;
                parameter = self.raw_name("a macro's parameter")?;
            }
            parameters.push((parameter, optional));
            if parameters.len() > PARAMETER_LIMIT {
                return Err(self.error(span, format!("a macro with more than {PARAMETER_LIMIT} parameters")));
            }
            if !self.accept_raw(",")? {
                self.expect_raw(")", "a macro's parameters")?;
                break;
            }
        }
        let Some(frame) = self.frames.last() else { return Ok(()) };
        let text = self.names.text(name);
        let value = Macro { name: text, parameters, code: frame.code.clone(), body: frame.at..end as usize };
        let place = Place { name, level: 0, path: ArrayVec::new() };
        self.symbols.set(&place, Value::Macro(Arc::new(value)));
        self.jump(end, span)?;
        self.take_raw()
    }

    /// Reads a macro's arguments and goes on with its body.
    pub(super) fn call_macro(&mut self, m: &Arc<Macro>, span: Span) -> Parse<()> {
        self.expect_raw("(", "a macro call")?;
        self.nesting += 1;
        let arguments = self.arguments(m, span);
        self.nesting -= 1;
        let arguments = arguments?;
        self.symbols.enter();
        let level = self.symbols.level();
        for (&(name, _), argument) in m.parameters.iter().zip(arguments) {
            match argument {
                Argument::Place(place) => self.symbols.bind_alias(name, level, place),
                Argument::Value(value, size) => {
                    let place = self.symbols.local_place(name, level);
                    self.symbols.set(&place, value);
                    self.symbols.set_size(&place, size);
                }
                Argument::Missing => {}
            }
        }
        self.push_frame(m.code.clone(), m.body.clone(), FrameKind::Macro(m.clone()), span)
    }

    fn arguments(&mut self, m: &Arc<Macro>, span: Span) -> Parse<Vec<Argument>> {
        let mut arguments = Vec::with_capacity(m.parameters.len());
        let mut closed = self.ahead.is_none() && self.accept_raw(")")?;
        while !closed {
            if arguments.len() == m.parameters.len() {
                let message = format!("the macro `{}` takes {} arguments, but here are more", m.name, m.parameters.len());
                return Err(self.error(span, message));
            }
            if self.ahead.is_none() && matches!(self.raw(), Some(Raw::Sign(s)) if matches!(SIGNS[usize::from(s)], "," | ")")) {
                arguments.push(Argument::Missing);
            } else {
                let argument = self.argument()?;
                arguments.push(argument);
            }
            // Commas may be left out.
            closed = !self.accept(",")? && self.at(")")?;
            if closed {
                // Not counted as open by `next`, so it must not be counted as closed.
                self.nesting += 1;
                self.expect(")")?;
            }
        }
        for i in 0..m.parameters.len() {
            if !m.parameters[i].1 && !matches!(arguments.get(i), Some(Argument::Place(_) | Argument::Value(..))) {
                let name = self.names.text(m.parameters[i].0);
                return Err(self.error(span, format!("the macro `{}` needs an argument for `{name}`", m.name)));
            }
        }
        Ok(arguments)
    }

    /// An argument: a variable by reference where it stands alone, else a value.
    fn argument(&mut self) -> Parse<Argument> {
        let span = self.raw_span();
        // Where a comma was left out, the argument's first token has been looked at, and is a value.
        let raw = if self.ahead.is_none() { self.raw() } else { None };
        if let Some(Raw::Name(name)) = raw
            && self.stands_alone()
            && !matches!(self.symbols.get(name), Some(Value::Macro(_)))
        {
            if self.symbols.deprecation(name).is_some() {
                let text = self.symbols.deprecation(name).map(|d| d.message.to_string()).unwrap_or_default();
                self.warning(span, text);
            }
            self.take_raw()?;
            let mut place = self.symbols.place(name);
            if self.at_bracket() {
                place = self.indices(place, span)?;
            }
            return Ok(Argument::Place(place));
        }
        let (value, size) = self.sized_rvalue()?;
        Ok(Argument::Value(value, size))
    }

    pub(super) fn at_bracket(&self) -> bool {
        matches!(self.raw(), Some(Raw::Sign(s)) if SIGNS[usize::from(s)] == "[")
    }

    /// Whether the name that follows, with its indices, is a whole argument.
    fn stands_alone(&self) -> bool {
        let mut ahead = 1;
        let mut depth = 0u32;
        loop {
            match self.raw_at(ahead) {
                Some(Raw::Sign(s)) => match SIGNS[usize::from(s)] {
                    "[" => depth += 1,
                    "]" if depth > 0 => depth -= 1,
                    "," | ")" if depth == 0 => return true,
                    _ if depth == 0 => return false,
                    _ => {}
                },
                None => return false,
                Some(Raw::Directive { .. }) => return false,
                Some(_) if depth == 0 => return false,
                Some(_) => {}
            }
            ahead += 1;
        }
    }

    /// The place of an array's element: takes all `[ … ]` that follow.
    pub(super) fn indices(&mut self, mut place: Place, span: Span) -> Parse<Place> {
        while self.at_bracket() {
            let Some(array) = self.symbols.array(&place).cloned() else {
                return Err(self.error(span, "this is no array"));
            };
            let mut at = 0usize;
            for &size in &array.sizes {
                if !self.at_bracket() {
                    return Err(self.error(span, format!("an array of {} dimensions needs as many indices", array.sizes.len())));
                }
                self.expect("[")?;
                let i = self.full_float()?;
                self.expect("]")?;
                // Indices are truncated; a little below an integer counts as the integer.
                let i = (i + EPSILON).trunc();
                if !(i >= 0.0 && i < size as f64) {
                    return Err(self.error(span, format!("index {i} is outside of the array's size {size}")));
                }
                at = at * size + i as usize;
            }
            // Do not hold on to the array: an assignment to it would have to copy it.
            drop(array);
            if place.path.try_push(at as u32).is_err() {
                return Err(self.error(span, "arrays of arrays are nested too deep"));
            }
        }
        Ok(place)
    }

    /// `#include "name"`.
    pub(super) fn include(&mut self, span: Span) -> Parse<()> {
        let name = self.string_value()?;
        self.accept_raw(";")?;
        if self.frames.iter().filter(|f| matches!(f.kind, FrameKind::Include)).count() >= INCLUDE_LIMIT {
            return Err(self.error(span, format!("include files are nested more than {INCLUDE_LIMIT} deep; does one include itself?")));
        }
        let code = self.include_code(&name, span)?;
        let end = code.tokens.len();
        self.symbols.enter();
        self.push_frame(code, 0..end, FrameKind::Include, span)
    }

    /// The scope-free variable that a name stands for, for `#read` and `trace`.
    pub(super) fn variable(&mut self, context: &str) -> Parse<(Place, Sym)> {
        let span = self.raw_span();
        let name = self.raw_name(context)?;
        let mut place = self.symbols.place(name);
        if self.at_bracket() {
            place = self.indices(place, span)?;
        }
        Ok((place, name))
    }
}
