//! What a scene file says: a format-neutral description and the readers that produce it.
