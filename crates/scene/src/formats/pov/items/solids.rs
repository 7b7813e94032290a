//! The shapes: what stands between the braces before the modifiers.
