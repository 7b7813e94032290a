//! The plot of error over time.

use anyhow::anyhow;
use plotters::coord::combinators::IntoLogRange;
use plotters::prelude::*;

use super::curve::Curve;

const SIZE: (u32, u32) = (880, 540);

/// Colors that people with color-blindness tell apart (Okabe and Ito 2008), then darker ones of them.
const COLORS: [RGBColor; 12] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(0, 0, 0),
    RGBColor(0, 70, 110),
    RGBColor(130, 57, 0),
    RGBColor(0, 97, 70),
    RGBColor(125, 74, 102),
    RGBColor(141, 97, 0),
];

/// An SVG picture of relMSE over CPU seconds, both logarithmic.
///
/// # Errors
/// What the plotting library says.
pub(super) fn error_over_time(curves: &[Curve]) -> anyhow::Result<String> {
    let points = |c: &Curve| -> Vec<(f64, f64)> {
        c.points.iter().map(|p| (p.cpu_s, p.relmse)).filter(|&(x, y)| x > 0.0 && y > 0.0 && x.is_finite() && y.is_finite()).collect()
    };
    let all: Vec<(f64, f64)> = curves.iter().flat_map(points).collect();
    let range = |of: fn(&(f64, f64)) -> f64| {
        let (low, high) = all.iter().map(of).fold((f64::INFINITY, 0.0f64), |(a, b), v| (a.min(v), b.max(v)));
        if low < high { low * 0.8..high * 1.25 } else { 0.1..10.0 }
    };
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
        let fault = |e: &dyn std::fmt::Display| anyhow!("the plot could not be drawn: {e}");
        area.fill(&WHITE).map_err(|e| fault(&e))?;
        let mut chart = ChartBuilder::on(&area)
            .margin(16)
            .x_label_area_size(44)
            .y_label_area_size(72)
            .build_cartesian_2d(range(|p| p.0).log_scale(), range(|p| p.1).log_scale())
            .map_err(|e| fault(&e))?;
        chart
            .configure_mesh()
            .axis_desc_style(("sans-serif", 15))
            .label_style(("sans-serif", 13))
            .x_desc("CPU seconds")
            .y_desc("relMSE")
            .x_label_formatter(&|v| short(*v))
            .y_label_formatter(&|v| format!("{v:.0e}"))
            .light_line_style(BLACK.mix(0.05))
            .draw()
            .map_err(|e| fault(&e))?;
        for (curve, color) in curves.iter().zip(COLORS.into_iter().cycle()) {
            let line = points(curve);
            chart
                .draw_series(LineSeries::new(line.clone(), color.stroke_width(2)))
                .map_err(|e| fault(&e))?
                .label(&curve.method)
                .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], color.stroke_width(2)));
            chart.draw_series(line.into_iter().map(|p| Circle::new(p, 3, color.filled()))).map_err(|e| fault(&e))?;
        }
        chart
            .configure_series_labels()
            .label_font(("sans-serif", 14))
            .position(SeriesLabelPosition::LowerLeft)
            .background_style(WHITE.mix(0.85))
            .border_style(BLACK.mix(0.3))
            .draw()
            .map_err(|e| fault(&e))?;
        area.present().map_err(|e| fault(&e))?;
    }
    Ok(svg)
}

fn short(v: f64) -> String {
    if v >= 1.0 { format!("{v:.0}") } else { format!("{v}") }
}
