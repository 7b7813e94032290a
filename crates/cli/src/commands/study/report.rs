//! The report as table, JSON and web page.

use std::fmt::Write;
use std::path::Path;

use super::curve::Curve;
use super::limits::limits;

/// All points as comma-separated values.
pub(super) fn csv(curves: &[Curve]) -> String {
    let mut text = "method,spp,cpu_s,wall_s,relmse\n".to_owned();
    for curve in curves {
        for p in &curve.points {
            let _ = writeln!(text, "{},{},{:.6},{:.6},{:.9e}", curve.method, p.spp, p.cpu_s, p.wall_s, p.relmse);
        }
    }
    text
}

/// Everything but the pictures.
pub(super) fn json(scene: &Path, reference: &str, curves: &[Curve], failures: &[(String, String)]) -> String {
    let methods: Vec<_> = curves
        .iter()
        .map(|c| {
            serde_json::json!({
                "method": c.method,
                "points": c.points,
                "final": c.last.as_ref().map(|(comparison, _)| comparison),
                "efficiency": c.efficiency(),
                "slope": c.slope(),
                "notes": c.notes,
                "limits": limits(&c.method),
            })
        })
        .collect();
    let failures: Vec<_> = failures.iter().map(|(m, why)| serde_json::json!({ "method": m, "reason": why })).collect();
    let value = serde_json::json!({
        "scene": scene.file_name().map(|n| n.to_string_lossy()),
        "reference": reference,
        "methods": methods,
        "not_rendered": failures,
    });
    format!("{value:#}\n")
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

const STYLE: &str = "
:root { color-scheme: light dark; }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 72rem; margin: 2rem auto; padding: 0 1rem; }
table { border-collapse: collapse; }
th, td { padding: .25rem .75rem; text-align: right; border-bottom: 1px solid #8884; font-variant-numeric: tabular-nums; }
th:first-child, td:first-child { text-align: left; }
figure { margin: 0; }
.pictures { display: grid; grid-template-columns: repeat(auto-fit, minmax(20rem, 1fr)); gap: 1rem; }
.pictures img { width: 100%; height: auto; }
.plot { background: #fff; max-width: 100%; height: auto; }
";

/// A web page beside the pictures; it needs nothing from elsewhere.
pub(super) fn html(scene: &Path, reference: &str, curves: &[Curve], failures: &[(String, String)]) -> String {
    let name = escape(&scene.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned()));
    let mut page = format!(
        "<!doctype html>\n<html lang=\"en\">\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" content=\"width=device-width\">\n\
         <title>Study of {name}</title>\n<style>{STYLE}</style>\n<h1>Study of {name}</h1>\n\
         <p>Reference: {}. relMSE is the mean of (x − reference)² / (reference² + 0.01); efficiency is 1 / (relMSE × CPU seconds). The trend is \
         the slope of the error over time in a log–log plot: −1 where all that is left is noise, 0 where more time no longer helps.</p>\n\
         <img class=\"plot\" src=\"error.svg\" alt=\"relMSE over CPU seconds for each method\">\n",
        escape(reference)
    );
    page.push_str(
        "<table>\n<tr><th>method<th>samples<th>CPU s<th>relMSE<th>FLIP<th>SSIM<th>mean R, G, B against the reference<th>efficiency<th>trend\n",
    );
    let mut sorted: Vec<&Curve> = curves.iter().collect();
    let error = |c: &Curve| c.points.last().map_or(f64::INFINITY, |p| p.relmse);
    sorted.sort_by(|a, b| error(a).total_cmp(&error(b)));
    for curve in &sorted {
        let (Some(p), Some((c, _))) = (curve.points.last(), &curve.last) else { continue };
        let [r, g, b] = c.mean_ratio.map(|m| format!("{:+.2}%", (m - 1.0) * 100.0));
        let or_dash = |v: Option<String>| v.unwrap_or_else(|| "–".to_owned());
        let _ = writeln!(
            page,
            "<tr><td><a href=\"#{m}\">{m}</a><td>{}<td>{:.2}<td>{:.3e}<td>{:.4}<td>{}<td>{r}, {g}, {b}<td>{}<td>{}",
            p.spp,
            p.cpu_s,
            p.relmse,
            c.flip,
            or_dash(c.ssim.map(|s| format!("{s:.4}"))),
            or_dash(curve.efficiency().map(|e| format!("{e:.3}"))),
            or_dash(curve.slope().map(|s| format!("{s:.2}"))),
            m = escape(&curve.method),
        );
    }
    page.push_str("</table>\n");
    for curve in &sorted {
        let m = escape(&curve.method);
        let _ = write!(page, "<h2 id=\"{m}\">{m}</h2>\n<p>{}</p>\n", escape(limits(&curve.method)));
        for note in &curve.notes {
            let _ = writeln!(page, "<p>{}</p>", escape(note));
        }
        let _ = writeln!(
            page,
            "<div class=\"pictures\"><figure><img src=\"{m}.png\" alt=\"picture by {m}\"><figcaption>{m}</figcaption></figure>\
             <figure><img src=\"{m}-flip.png\" alt=\"FLIP of {m}\"><figcaption>FLIP against the reference</figcaption></figure>\
             <figure><img src=\"reference.png\" alt=\"reference\"><figcaption>reference</figcaption></figure></div>"
        );
    }
    if !failures.is_empty() {
        page.push_str("<h2>Not rendered</h2>\n<ul>\n");
        for (method, why) in failures {
            let _ = writeln!(page, "<li>{}: {}", escape(method), escape(why));
        }
        page.push_str("</ul>\n");
    }
    page.push_str(
        "<p><a href=\"sheet.png\">Contact sheet</a> · <a href=\"errors.csv\">errors.csv</a> · <a href=\"study.json\">study.json</a></p>\n</html>\n",
    );
    page
}
