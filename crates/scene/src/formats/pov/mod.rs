//! POV-Ray 3.7 scene description language.
//!
//! ```text
//! text ─lexer→ tokens ─directives (#declare, #while, #macro, #include …)→ tokens ─items→ ClassicScene
//! ```
//!
//! The language is one recursive descent over a stream of tokens in which directives may stand anywhere, so all of it is one
//! [`Parser`] with its methods in several files: the language itself in `lexer`, `directive`, `expression` …, the items of a scene in
//! `items/`.

mod items;
mod parser;
mod probe;
mod value;

pub use parser::{Parse, Parser, Stop, Token};
pub use probe::Probe;
pub use value::Value;
