//! Sentences about a mesh and a solution.

use super::exchange::Solved;
use super::face::Faces;

/// Names that are listed at most.
const MOST_NAMES: usize = 6;

/// What was left out or simplified.
pub fn of_faces(faces: &Faces) -> Vec<String> {
    let r = &faces.report;
    let mut notes = Vec::new();
    let left_out =
        [(r.zero_area, "without area"), (r.not_finite, "with corners that are no numbers"), (r.too_far, "too far from the origin")];
    let words: Vec<String> = left_out.iter().filter(|(n, _)| *n > 0).map(|(n, what)| format!("{n} {what}")).collect();
    if !words.is_empty() {
        notes.push(format!("triangles left out: {}", words.join(", ")));
    }
    if r.planes > 0 {
        notes.push(format!("{} infinite planes are lit in a square about the rest of the scene only", r.planes));
    }
    if !r.not_diffuse.is_empty() {
        let mut names: Vec<String> =
            r.not_diffuse.keys().take(MOST_NAMES).map(|n| if n.is_empty() { "(unnamed)".to_owned() } else { n.clone() }).collect();
        if r.not_diffuse.len() > MOST_NAMES {
            names.push(format!("{} more", r.not_diffuse.len() - MOST_NAMES));
        }
        notes.push(format!("not diffuse, taken for diffuse with their albedo (glass: clear): {}", names.join(", ")));
    }
    notes
}

/// Energy, row sums, reciprocity.
pub fn of_solution(solved: &Solved) -> Vec<String> {
    let mut notes = Vec::new();
    let [emitted, direct, absorbed] = solved.fluxes().map(|s| f64::from(s.average()));
    let given = emitted + direct;
    if given > 0.0 {
        notes.push(format!(
            "energy: {given:.4} W given ({emitted:.4} by surfaces, {direct:.4} by other lights), {absorbed:.4} absorbed; the other {:.2} % left the scene",
            100.0 * (1.0 - absorbed / given)
        ));
    } else {
        notes.push("no light: nothing emits and no light reaches a surface".into());
    }
    if !solved.row_sums.is_empty() {
        let (mut sum, mut area, mut most) = (0.0f64, 0.0f64, 0.0f32);
        for (i, n) in solved.mesh.nodes.iter().enumerate() {
            if n.is_leaf() && !n.is_cluster() && !solved.irradiance[i].is_black() {
                let s = solved.row_sums.get(i).copied().unwrap_or(0.0);
                sum += f64::from(s) * f64::from(n.area);
                area += f64::from(n.area);
                most = most.max(s);
            }
        }
        if area > 0.0 {
            notes.push(format!(
                "form factors of a lit element sum to {:.4} in the mean, {most:.4} at most (1 in a closed room)",
                sum / area
            ));
        }
    }
    if let Some(r) = solved.reciprocity {
        notes.push(format!("reciprocity: A F differs from its reverse by {:.2} % in the mean", 100.0 * r));
    }
    notes
}
