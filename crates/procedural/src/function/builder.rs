//! Builds programs: folds constants, computes nothing twice, puts small functions in where they are called.

use std::collections::HashMap;
use std::sync::Arc;

use super::operation::{Binary, Component, Unary};
use super::program::{Callee, Instruction, Program, Register};
use super::{Body, Function, MAX_DEPTH};

/// A straight callee up to this many instructions is copied into its caller.
const INLINE_CALLEE: usize = 64;
/// Callers beyond this many instructions call instead.
const INLINE_CALLER: usize = 4096;

/// A value within the function being built.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Operand(usize);

/// A function has more instructions or deeper calls than are allowed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TooLong;

/// What a register holds, to find values that are already there.
#[derive(Clone, PartialEq, Eq, Hash)]
enum Key {
    Unary(Unary, Operand),
    Binary(Binary, Operand, Operand),
    Call(usize, Vec<Operand>),
}

/// A loop being built; from [`Builder::begin_loop`] to [`Builder::end_loop`].
#[derive(Debug)]
pub struct Loop {
    variable: Operand,
    sum: Operand,
    product: bool,
    start: usize,
    scope: usize,
}

impl Loop {
    /// The running variable.
    pub fn variable(&self) -> Operand {
        self.variable
    }
}

/// A `select` being built; from [`Builder::begin_select`] to [`Builder::end_select`].
#[derive(Debug)]
pub struct Select {
    condition: Operand,
    to: Operand,
    /// The conditional jump to the next case.
    next: usize,
    /// Whether that is the test for zero.
    zero: bool,
    /// Jumps to the end.
    ends: Vec<usize>,
    scope: usize,
}

/// Makes a function step by step; the reader of expressions drives it.
///
/// ```
/// use etendue_procedural::{Context, function::{Binary, Builder}};
/// let mut b = Builder::new(vec!["x".into(), "y".into()]);
/// let (x, y) = (b.parameter("x").unwrap(), b.parameter("y").unwrap());
/// let sum = b.binary(Binary::Add, x, y);
/// let f = b.finish(sum).unwrap();
/// assert_eq!(f.eval(&[1.0, 2.0], &Context::at(Default::default())), 3.0);
/// ```
pub struct Builder {
    parameters: Vec<String>,
    constants: Vec<f64>,
    constant_of: HashMap<u64, usize>,
    /// Operands: where each stands.
    places: Vec<Place>,
    registers: u32,
    code: Vec<Instruction>,
    calls: Vec<Callee>,
    values: HashMap<Key, Operand>,
    /// Keys of `values` in the order of their entry, to forget those of a branch at its end.
    entered: Vec<Key>,
    /// Names of running variables, innermost last.
    variables: Vec<(String, Operand)>,
    depth: u32,
}

/// Registers are numbered as arguments, constants, rest; the number of constants is known at the end only.
#[derive(Clone, Copy)]
enum Place {
    Argument(u32),
    Constant(u32),
    Rest(u32),
}

impl Builder {
    /// Begins a function with these parameters.
    pub fn new(parameters: Vec<String>) -> Self {
        let places = (0..parameters.len() as u32).map(Place::Argument).collect();
        Self {
            parameters,
            constants: Vec::new(),
            constant_of: HashMap::new(),
            places,
            registers: 0,
            code: Vec::new(),
            calls: Vec::new(),
            values: HashMap::new(),
            entered: Vec::new(),
            variables: Vec::new(),
            depth: 0,
        }
    }

    /// A running variable of a loop or a parameter, by name; the innermost one. `u` is also `x` and `v` is `y`.
    pub fn parameter(&self, name: &str) -> Option<Operand> {
        let canonical = |n: &str| match n {
            "u" => "x".to_owned(),
            "v" => "y".to_owned(),
            n => n.to_owned(),
        };
        let name = canonical(name);
        let variable = self.variables.iter().rev().find(|(n, _)| canonical(n) == name).map(|(_, o)| *o);
        variable.or_else(|| self.parameters.iter().position(|p| canonical(p) == name).map(Operand))
    }

    fn place(&mut self, place: Place) -> Operand {
        self.places.push(place);
        Operand(self.places.len() - 1)
    }

    fn register(&mut self) -> Operand {
        self.registers = self.registers.saturating_add(1);
        self.place(Place::Rest(self.registers - 1))
    }

    /// A number.
    pub fn number(&mut self, value: f64) -> Operand {
        if let Some(&o) = self.constant_of.get(&value.to_bits()) {
            return Operand(o);
        }
        self.constants.push(value);
        let o = self.place(Place::Constant(self.constants.len() as u32 - 1));
        self.constant_of.insert(value.to_bits(), o.0);
        o
    }

    fn known(&self, o: Operand) -> Option<f64> {
        match self.places[o.0] {
            Place::Constant(i) => Some(self.constants[i as usize]),
            _ => None,
        }
    }

    fn enter(&mut self, key: Key, value: Operand) {
        if self.values.insert(key.clone(), value).is_none() {
            self.entered.push(key);
        }
    }

    fn leave_scope(&mut self, scope: usize) {
        for key in self.entered.drain(scope..) {
            self.values.remove(&key);
        }
    }

    /// An operation of one value.
    pub fn unary(&mut self, operation: Unary, a: Operand) -> Operand {
        if operation == Unary::Sqr {
            return self.binary(Binary::Multiply, a, a);
        }
        if let Some(a) = self.known(a) {
            return self.number(operation.apply(a));
        }
        let key = Key::Unary(operation, a);
        if let Some(&o) = self.values.get(&key) {
            return o;
        }
        let to = self.register();
        // Registers are operand numbers until `finish`, which knows how many constants there are.
        self.code.push(Instruction::Unary { operation, to: to.0 as u32, a: a.0 as u32 });
        self.enter(key, to);
        to
    }

    /// An operation of two values.
    pub fn binary(&mut self, operation: Binary, a: Operand, b: Operand) -> Operand {
        match (operation, self.known(a), self.known(b)) {
            (_, Some(a), Some(b)) => return self.number(operation.apply(a, b)),
            (Binary::Pow, None, Some(2.0)) => return self.binary(Binary::Multiply, a, a),
            (Binary::Pow, None, Some(3.0)) => {
                let square = self.binary(Binary::Multiply, a, a);
                return self.binary(Binary::Multiply, square, a);
            }
            (Binary::Pow, None, Some(4.0)) => {
                let square = self.binary(Binary::Multiply, a, a);
                return self.binary(Binary::Multiply, square, square);
            }
            (Binary::Pow, None, Some(0.5)) => return self.unary(Unary::Sqrt, a),
            _ => {}
        }
        let key = Key::Binary(operation, a, b);
        if let Some(&o) = self.values.get(&key) {
            return o;
        }
        let to = self.register();
        self.code.push(Instruction::Binary { operation, to: to.0 as u32, a: a.0 as u32, b: b.0 as u32 });
        self.enter(key, to);
        to
    }

    /// Begins `select(condition, …)`. Then the code of each case is built: for negative conditions, for zero, for positive ones. Each
    /// but the last is followed by [`Self::next_case`], the last by [`Self::end_select`]. Of two, the second is for all that are not
    /// negative.
    pub fn begin_select(&mut self, condition: Operand) -> Select {
        let to = self.register();
        let next = self.code.len();
        self.code.push(Instruction::JumpUnlessNegative { a: condition.0 as u32, target: u32::MAX });
        Select { condition, to, next, zero: false, ends: Vec::new(), scope: self.entered.len() }
    }

    /// Ends the first or second case with its value.
    pub fn next_case(&mut self, select: &mut Select, value: Operand) {
        self.code.push(Instruction::Copy { to: select.to.0 as u32, a: value.0 as u32 });
        self.leave_scope(select.scope);
        select.ends.push(self.code.len());
        self.code.push(Instruction::Jump { target: u32::MAX });
        self.land(select.next);
        select.zero = !select.zero;
        if select.zero {
            select.next = self.code.len();
            self.code.push(Instruction::JumpUnlessZero { a: select.condition.0 as u32, target: u32::MAX });
        }
    }

    /// Ends the last case with its value; the value of all.
    pub fn end_select(&mut self, select: Select, value: Operand) -> Operand {
        self.code.push(Instruction::Copy { to: select.to.0 as u32, a: value.0 as u32 });
        self.leave_scope(select.scope);
        if select.zero {
            // The second case was the last: the test for zero leads to it either way.
            let here = select.next as u32 + 1;
            if let Some(Instruction::JumpUnlessZero { target, .. }) = self.code.get_mut(select.next) {
                *target = here;
            }
        }
        for end in select.ends {
            self.land(end);
        }
        select.to
    }

    /// Lets a jump lead to the next instruction.
    fn land(&mut self, jump: usize) {
        let here = self.code.len() as u32;
        if let Some(
            Instruction::Jump { target }
            | Instruction::JumpUnlessNegative { target, .. }
            | Instruction::JumpUnlessZero { target, .. }
            | Instruction::JumpUnlessLessEqual { target, .. },
        ) = self.code.get_mut(jump)
        {
            *target = here;
        }
    }

    /// Begins `sum` or `prod` with a running variable from `first` to `last` by steps of 1.
    pub fn begin_loop(&mut self, name: String, first: Operand, last: Operand, product: bool) -> Loop {
        let variable = self.register();
        let sum = self.register();
        let neutral = self.number(if product { 1.0 } else { 0.0 });
        self.code.push(Instruction::Copy { to: variable.0 as u32, a: first.0 as u32 });
        self.code.push(Instruction::Copy { to: sum.0 as u32, a: neutral.0 as u32 });
        let start = self.code.len();
        self.code.push(Instruction::JumpUnlessLessEqual { a: variable.0 as u32, b: last.0 as u32, target: u32::MAX });
        self.variables.push((name, variable));
        Loop { variable, sum, product, start, scope: self.entered.len() }
    }

    /// Ends a loop with the value of its term; the sum or product.
    pub fn end_loop(&mut self, l: Loop, term: Operand) -> Operand {
        self.variables.pop();
        let one = self.number(1.0);
        let operation = if l.product { Binary::Multiply } else { Binary::Add };
        self.code.push(Instruction::Binary { operation, to: l.sum.0 as u32, a: l.sum.0 as u32, b: term.0 as u32 });
        self.code.push(Instruction::Binary { operation: Binary::Add, to: l.variable.0 as u32, a: l.variable.0 as u32, b: one.0 as u32 });
        self.code.push(Instruction::Jump { target: l.start as u32 });
        self.leave_scope(l.scope);
        self.land(l.start);
        l.sum
    }

    /// A call of a function, and one component of what it returns (looked at for vectors only). Missing arguments are 0.
    pub fn call(&mut self, function: &Arc<Function>, arguments: &[Operand], component: Component) -> Operand {
        let zero = self.number(0.0);
        let wanted = function.parameters.len();
        let arguments: Vec<_> = (0..wanted).map(|i| arguments.get(i).copied().unwrap_or(zero)).collect();
        if let Some(program) = function.program()
            && program.is_straight()
            && program.code.len() <= INLINE_CALLEE
            && self.code.len() <= INLINE_CALLER
        {
            return self.inline(program, &arguments);
        }
        let callee = match &function.body {
            Body::Internal(f) => Callee::Internal(*f),
            _ => Callee::Function(function.clone(), wanted as u32, function.components() as u32),
        };
        self.depth = self.depth.max(function.depth);
        let first = self.invoke(callee, arguments);
        if !function.is_vector() {
            return first;
        }
        let count = function.components();
        let number = |b: &mut Self, i: usize| if i < count { Operand(first.0 + i) } else { b.number(0.0) };
        match component {
            Component::Number(i) => number(self, usize::from(i)),
            _ => {
                let mut sum = self.number(0.0);
                for (i, w) in component.weights().into_iter().enumerate().filter(|(_, w)| *w != 0.0) {
                    let (w, v) = (self.number(w), number(self, i));
                    let term = self.binary(Binary::Multiply, w, v);
                    sum = if i == 0 { term } else { self.binary(Binary::Add, sum, term) };
                }
                sum
            }
        }
    }

    /// Copies a straight program in.
    fn inline(&mut self, program: &Program, arguments: &[Operand]) -> Operand {
        let mut map: Vec<Operand> = arguments.to_vec();
        for c in &program.constants {
            map.push(self.number(*c));
        }
        let zero = self.number(0.0);
        map.resize(program.registers as usize, zero);
        for instruction in &program.code {
            match *instruction {
                Instruction::Unary { operation, to, a } => map[to as usize] = self.unary(operation, map[a as usize]),
                Instruction::Binary { operation, to, a, b } => map[to as usize] = self.binary(operation, map[a as usize], map[b as usize]),
                Instruction::Copy { to, a } => map[to as usize] = map[a as usize],
                Instruction::Call { call, to, first } => {
                    let callee = program.calls[call as usize].clone();
                    if let Callee::Function(f, ..) = &callee {
                        self.depth = self.depth.max(f.depth);
                    }
                    let results = callee.results() as usize;
                    let arguments = (0..callee.arguments()).map(|i| map[(first + i) as usize]).collect();
                    let value = self.invoke(callee, arguments);
                    for i in 0..results {
                        map[to as usize + i] = Operand(value.0 + i);
                    }
                }
                // `is_straight` has told that there are none.
                _ => {}
            }
        }
        map[program.result as usize]
    }

    /// The call itself: arguments into registers in a row; the first of its results, which are operands in a row.
    fn invoke(&mut self, callee: Callee, arguments: Vec<Operand>) -> Operand {
        let same = |c: &Callee| match (c, &callee) {
            (Callee::Function(a, ..), Callee::Function(b, ..)) => Arc::ptr_eq(a, b),
            (Callee::Internal(a), Callee::Internal(b)) => a == b,
            _ => false,
        };
        let results = callee.results();
        let call = self.calls.iter().position(same).unwrap_or_else(|| {
            self.calls.push(callee);
            self.calls.len() - 1
        });
        let key = Key::Call(call, arguments.clone());
        if let Some(&o) = self.values.get(&key) {
            return o;
        }
        // Arguments that stand in a row already, such as x, y, z, stay where they are.
        let in_a_row = arguments.windows(2).all(|w| self.follows(w[0], w[1]));
        let first = if in_a_row && !arguments.is_empty() {
            arguments[0]
        } else {
            let copies: Vec<_> = arguments.iter().map(|_| self.register()).collect();
            for (to, a) in copies.iter().zip(&arguments) {
                self.code.push(Instruction::Copy { to: to.0 as u32, a: a.0 as u32 });
            }
            copies.first().copied().unwrap_or(Operand(0))
        };
        let to = self.register();
        for _ in 1..results {
            self.register();
        }
        self.code.push(Instruction::Call { call: call as u32, to: to.0 as u32, first: first.0 as u32 });
        self.enter(key, to);
        to
    }

    fn follows(&self, a: Operand, b: Operand) -> bool {
        match (self.places[a.0], self.places[b.0]) {
            (Place::Argument(i), Place::Argument(j)) | (Place::Constant(i), Place::Constant(j)) | (Place::Rest(i), Place::Rest(j)) => {
                j == i + 1
            }
            _ => false,
        }
    }

    /// Whether the function has become too long; readers stop then.
    pub fn is_too_long(&self) -> bool {
        self.code.len() + self.constants.len() + self.registers as usize > Program::MAX_REGISTERS as usize / 2
    }

    /// The function whose value is `result`.
    ///
    /// # Errors
    /// [`TooLong`] beyond about 500,000 instructions or [`MAX_DEPTH`] nested calls.
    pub fn finish(self, result: Operand) -> Result<Function, TooLong> {
        if self.is_too_long() || self.depth >= MAX_DEPTH {
            return Err(TooLong);
        }
        let (arguments, constants) = (self.parameters.len() as u32, self.constants.len() as u32);
        let at = |o: &mut Register| {
            *o = match self.places[*o as usize] {
                Place::Argument(i) => i,
                Place::Constant(i) => arguments + i,
                Place::Rest(i) => arguments + constants + i,
            };
        };
        let mut code = self.code.clone();
        for instruction in &mut code {
            match instruction {
                Instruction::Unary { to, a, .. } | Instruction::Copy { to, a } => [to, a].map(at),
                Instruction::Binary { to, a, b, .. } => {
                    at(b);
                    [to, a].map(at)
                }
                Instruction::Jump { .. } => continue,
                Instruction::JumpUnlessNegative { a, .. } | Instruction::JumpUnlessZero { a, .. } => {
                    at(a);
                    continue;
                }
                Instruction::JumpUnlessLessEqual { a, b, .. } => [a, b].map(at),
                Instruction::Call { to, first, .. } => [to, first].map(at),
            };
        }
        let mut result = result.0 as u32;
        at(&mut result);
        let registers = arguments + constants + self.registers;
        let program = Program { arguments, constants: self.constants.clone(), code, calls: self.calls, registers, result };
        Ok(Function::from_program(self.parameters, program, self.depth + 1))
    }
}
