//! Fonts in place of those that a scene names and this machine has not.

use std::path::PathBuf;

/// Folders with fonts.
const FOLDERS: &[&str] = &[
    "/usr/share/fonts/truetype/liberation",
    "/usr/share/fonts/truetype/liberation2",
    "/usr/share/fonts/liberation",
    "/usr/share/fonts/liberation-fonts",
    "/usr/share/fonts/truetype/dejavu",
    "/usr/share/fonts/dejavu",
    "/usr/share/fonts/TTF",
    "/usr/share/fonts/truetype/povray",
    "/Library/Fonts",
];

/// A family of fonts: parts of the names that stand for it, and what can take its place, the best (metric-compatible) first. `*` is the style.
const FAMILIES: &[(&[&str], &[&str])] = &[
    (&["cour", "mono", "consola", "crystal", "lucon"], &["LiberationMono-*.ttf", "DejaVuSansMono*.ttf", "crystal.ttf"]),
    (
        &["times", "timrom", "serif", "georgia", "garamond", "palatino", "pala", "cambria", "bookman", "roman"],
        &["LiberationSerif-*.ttf", "DejaVuSerif*.ttf", "timrom.ttf"],
    ),
    (&[""], &["LiberationSans-*.ttf", "DejaVuSans*.ttf", "cyrvetic.ttf"]),
];

/// A font to take where `name` is not there: of the same family and style as far as the name tells, else a sans-serif one.
pub(super) fn substitute(name: &str, library: &[PathBuf]) -> Option<PathBuf> {
    let file = name.rsplit(['/', '\\']).next().unwrap_or(name).to_lowercase();
    let stem = file.strip_suffix(".ttf").or_else(|| file.strip_suffix(".otf")).or_else(|| file.strip_suffix(".ttc")).unwrap_or(&file);
    // Windows names its styles so: arialbd, timesi, courbi.
    let bold = stem.contains("bold") || stem.ends_with("bd") || stem.ends_with("bi") || stem.ends_with("black");
    let italic = ["italic", "oblique"].iter().any(|s| stem.contains(s)) || stem.ends_with("bi") || (stem.ends_with('i') && stem.len() > 4);
    let (_, fonts) = FAMILIES.iter().find(|(names, _)| names.iter().any(|n| stem.contains(n) && !(n == &"serif" && stem.contains("sans"))))?;
    let folders = || FOLDERS.iter().map(PathBuf::from).chain(library.iter().cloned());
    for font in *fonts {
        let styles: &[&str] = match (bold, italic) {
            (true, true) => &["BoldItalic", "-BoldOblique", "-BoldItalic"],
            (true, false) => &["Bold", "-Bold"],
            (false, true) => &["Italic", "-Oblique", "-Italic"],
            _ => &[],
        };
        for style in styles.iter().chain(&["Regular", ""]) {
            let file = font.replace('*', style);
            if let Some(path) = folders().map(|f| f.join(&file)).find(|p| p.is_file()) {
                return Some(path);
            }
        }
    }
    None
}
