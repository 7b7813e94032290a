//! Programs: what expressions are compiled to.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::operation::{Binary, Unary};
use super::{Function, Internal};
use crate::Context;

/// Number of a register. The first hold the arguments, then come the constants, then the rest.
pub(super) type Register = u32;

/// One step. `to` is the register that it sets.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) enum Instruction {
    Unary {
        operation: Unary,
        to: Register,
        a: Register,
    },
    Binary {
        operation: Binary,
        to: Register,
        a: Register,
        b: Register,
    },
    Copy {
        to: Register,
        a: Register,
    },
    /// Goes on at an instruction.
    Jump {
        target: u32,
    },
    /// Goes on at an instruction unless `a` is below 0.
    JumpUnlessNegative {
        a: Register,
        target: u32,
    },
    /// Goes on at an instruction unless `a` is 0.
    JumpUnlessZero {
        a: Register,
        target: u32,
    },
    /// Goes on at an instruction unless a ≤ b.
    JumpUnlessLessEqual {
        a: Register,
        b: Register,
        target: u32,
    },
    /// Calls `calls[call]` with the registers from `first` on; sets as many from `to` on as the callee returns.
    Call {
        call: u32,
        to: Register,
        first: Register,
    },
}

/// Something that is called.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) enum Callee {
    /// Another function: itself, number of arguments, number of results.
    Function(Arc<Function>, u32, u32),
    /// An internal function.
    Internal(Internal),
}

impl Callee {
    pub(super) fn arguments(&self) -> u32 {
        match self {
            Self::Function(_, arguments, _) => *arguments,
            Self::Internal(f) => 3 + f.extra_parameters(),
        }
    }

    pub(super) fn results(&self) -> u32 {
        match self {
            Self::Function(_, _, results) => *results,
            Self::Internal(_) => 1,
        }
    }
}

/// An expression in three-address code.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Unchecked")]
pub struct Program {
    pub(super) arguments: u32,
    pub(super) constants: Vec<f64>,
    pub(super) code: Vec<Instruction>,
    pub(super) calls: Vec<Callee>,
    /// Size of the register file.
    pub(super) registers: u32,
    pub(super) result: Register,
}

/// A program as it comes from outside.
#[derive(Deserialize)]
struct Unchecked {
    arguments: u32,
    constants: Vec<f64>,
    code: Vec<Instruction>,
    calls: Vec<Callee>,
    registers: u32,
    result: Register,
}

impl TryFrom<Unchecked> for Program {
    type Error = &'static str;

    fn try_from(u: Unchecked) -> Result<Self, Self::Error> {
        let Unchecked { arguments, constants, code, calls, registers, result } = u;
        let program = Self { arguments, constants, code, calls, registers, result };
        if program.is_valid() { Ok(program) } else { Err("a function's program names registers that it does not have") }
    }
}

impl Program {
    /// Most registers that a program may have.
    pub(super) const MAX_REGISTERS: u32 = 1 << 20;

    pub(super) fn constant(arguments: u32, value: f64) -> Self {
        Self { arguments, constants: vec![value], code: Vec::new(), calls: Vec::new(), registers: arguments + 1, result: arguments }
    }

    /// Whether all registers, targets and calls are there.
    pub(super) fn is_valid(&self) -> bool {
        let fixed = u64::from(self.arguments) + self.constants.len() as u64;
        let has = |r: Register, n: u32| u64::from(r) + u64::from(n) <= u64::from(self.registers);
        let sets = |r: Register, n: u32| u64::from(r) >= fixed && has(r, n);
        let target = |t: u32| t as usize <= self.code.len();
        self.registers <= Self::MAX_REGISTERS
            && fixed <= u64::from(self.registers)
            && has(self.result, 1)
            && self.code.iter().all(|i| match *i {
                Instruction::Unary { to, a, .. } | Instruction::Copy { to, a } => sets(to, 1) && has(a, 1),
                Instruction::Binary { to, a, b, .. } => sets(to, 1) && has(a, 1) && has(b, 1),
                Instruction::Jump { target: t } => target(t),
                Instruction::JumpUnlessNegative { a, target: t } | Instruction::JumpUnlessZero { a, target: t } => has(a, 1) && target(t),
                Instruction::JumpUnlessLessEqual { a, b, target: t } => has(a, 1) && has(b, 1) && target(t),
                Instruction::Call { call, to, first } => {
                    self.calls.get(call as usize).is_some_and(|c| c.results() <= 5 && sets(to, c.results()) && has(first, c.arguments()))
                }
            })
    }

    /// Whether it runs from the first instruction to the last.
    pub(super) fn is_straight(&self) -> bool {
        self.code.iter().all(|i| {
            matches!(i, Instruction::Unary { .. } | Instruction::Binary { .. } | Instruction::Copy { .. } | Instruction::Call { .. })
        })
    }

    /// The value for arguments. `fuel` pays for instructions that loops repeat, and for calls.
    pub(super) fn run(&self, arguments: &[f64], context: &Context, fuel: &mut u64) -> f64 {
        // Three sizes, so that small functions do not pay for clearing a large file.
        match self.registers {
            0..=24 => self.run_in(&mut [0.0; 24], arguments, context, fuel),
            25..=96 => self.run_in(&mut [0.0; 96], arguments, context, fuel),
            97..=512 => self.run_in(&mut [0.0; 512], arguments, context, fuel),
            n => self.run_in(&mut vec![0.0; n as usize], arguments, context, fuel),
        }
    }

    fn run_in(&self, r: &mut [f64], arguments: &[f64], context: &Context, fuel: &mut u64) -> f64 {
        let n = self.arguments as usize;
        let given = n.min(arguments.len());
        r[..given].copy_from_slice(&arguments[..given]);
        r[n..n + self.constants.len()].copy_from_slice(&self.constants);
        let mut at = 0;
        while let Some(instruction) = self.code.get(at) {
            at += 1;
            match *instruction {
                Instruction::Unary { operation, to, a } => r[to as usize] = operation.apply(r[a as usize]),
                Instruction::Binary { operation, to, a, b } => r[to as usize] = operation.apply(r[a as usize], r[b as usize]),
                Instruction::Copy { to, a } => r[to as usize] = r[a as usize],
                Instruction::Jump { target } => {
                    // Backward jumps are those of loops.
                    let target = target as usize;
                    if target < at {
                        let cost = (at - target) as u64;
                        if *fuel < cost {
                            return f64::NAN;
                        }
                        *fuel -= cost;
                    }
                    at = target;
                }
                Instruction::JumpUnlessNegative { a, target } => {
                    // A NaN is not negative either.
                    if !matches!(r[a as usize].partial_cmp(&0.0), Some(std::cmp::Ordering::Less)) {
                        at = self.forward(at, target);
                    }
                }
                Instruction::JumpUnlessZero { a, target } => {
                    if r[a as usize] != 0.0 {
                        at = self.forward(at, target);
                    }
                }
                Instruction::JumpUnlessLessEqual { a, b, target } => {
                    if !matches!(r[a as usize].partial_cmp(&r[b as usize]), Some(std::cmp::Ordering::Less | std::cmp::Ordering::Equal)) {
                        at = self.forward(at, target);
                    }
                }
                Instruction::Call { call, to, first } => {
                    let callee = &self.calls[call as usize];
                    let first = first as usize;
                    let given = &r[first..first + callee.arguments() as usize];
                    match callee {
                        Callee::Internal(f) => r[to as usize] = f.eval(given, context),
                        Callee::Function(f, _, results) => {
                            if *fuel < 16 {
                                return f64::NAN;
                            }
                            *fuel -= 16;
                            let value = f.call(given, context, fuel);
                            let to = to as usize;
                            r[to..to + *results as usize].copy_from_slice(&value[..*results as usize]);
                        }
                    }
                }
            }
        }
        r[self.result as usize]
    }

    /// Conditional jumps go forward only; in a program from elsewhere a backward one ends it.
    fn forward(&self, at: usize, target: u32) -> usize {
        let target = target as usize;
        if target >= at { target } else { self.code.len() }
    }
}
