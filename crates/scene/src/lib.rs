//! What a scene file says: a format-neutral description and the readers that produce it.
//!
//! ```text
//! file ─formats::read→ SceneDesc ─passes→ SceneDesc ─(etendue-render) compile→ Scene
//! ```
//!
//! A [`SceneDesc`] is plain data: serialisable, every node with the place it came from, nothing resolved that the
//! file left open. Nothing here renders, and nothing here is `unsafe`.

pub mod desc;
pub mod formats;
pub mod ior;
pub mod param;
pub mod passes;
pub mod report;
pub mod settings;
pub mod span;
pub mod validate;

pub use desc::SceneDesc;
pub use report::{Fault, Loss, ReadError, Report, Severity};
pub use settings::RenderSettings;
pub use span::{FileId, Span};
