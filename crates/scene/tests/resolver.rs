//! A scene reads files of its own folder and of the search paths, and no others.

#![allow(clippy::unwrap_used, clippy::panic)]

mod support;

use etendue_scene::formats::{ResolveError, Resolver};
use support::TempFolder;

#[test]
fn files_outside_are_refused() {
    let scene = TempFolder::new("resolver-scene");
    let other = TempFolder::new("resolver-other");
    let inside = scene.put("textures/a.png", "a");
    let secret = other.put("secret.txt", "s");
    let resolver = Resolver::new(scene.path(), &[]);
    let resolve = |name: &str| resolver.resolve(scene.path(), name);
    assert_eq!(resolve("textures/a.png").unwrap(), inside);
    assert_eq!(resolve("textures\\a.png").unwrap(), inside);
    assert_eq!(resolve("textures/../textures/a.png").unwrap(), inside);
    assert!(matches!(resolve("b.png"), Err(ResolveError::NotFound(_))));
    assert!(matches!(resolve("textures"), Err(ResolveError::Unfit(_))));
    // Whether such a file exists is not told.
    assert!(matches!(resolve(secret.to_str().unwrap()), Err(ResolveError::Outside(_))));
    assert!(matches!(resolve("/no/such/file"), Err(ResolveError::Outside(_))));
    assert!(matches!(resolve("../no-such-file"), Err(ResolveError::Outside(_))));
    let with_path = Resolver::new(scene.path(), &[other.path().to_owned()]);
    assert_eq!(with_path.resolve(scene.path(), "secret.txt").unwrap(), secret);
}

#[cfg(unix)]
#[test]
fn links_must_stay_inside() {
    let scene = TempFolder::new("resolver-links");
    let other = TempFolder::new("resolver-linked");
    let secret = other.put("secret.txt", "s");
    let inside = scene.put("a.txt", "a");
    std::os::unix::fs::symlink(&secret, scene.path().join("out.txt")).unwrap();
    std::os::unix::fs::symlink(&inside, scene.path().join("in.txt")).unwrap();
    let resolver = Resolver::new(scene.path(), &[]);
    assert!(matches!(resolver.resolve(scene.path(), "out.txt"), Err(ResolveError::Outside(_))));
    assert_eq!(resolver.resolve(scene.path(), "in.txt").unwrap(), inside);
}
