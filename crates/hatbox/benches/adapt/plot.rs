//! Curves in doubly logarithmic panels, as SVG.

use std::fmt::Write as _;

/// Points (x, error) of one method.
#[derive(Clone)]
pub(crate) struct Curve {
    pub(crate) name: &'static str,
    pub(crate) dashed: bool,
    pub(crate) points: Vec<[f64; 2]>,
}

/// A diagram.
#[derive(Clone)]
pub(crate) struct Panel {
    pub(crate) title: String,
    pub(crate) curves: Vec<Curve>,
}

/// Size of a panel, and the margins for its labels.
const SIZE: [f64; 2] = [380.0, 300.0];
const MARGIN: [f64; 2] = [52.0, 34.0];
const COLORS: [(&str, &str); 4] =
    [("constant", "#b5651d"), ("linear", "#1f77b4"), ("bilinear", "#2a9d4a"), ("quadratic", "#c2185b")];

/// All panels, two in a row, and what the lines mean.
pub(crate) fn draw(panels: &[Panel]) -> String {
    let rows = panels.len().div_ceil(2);
    let (width, height) = (2.0 * SIZE[0], rows as f64 * SIZE[1] + 24.0);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" font-family=\"sans-serif\" \
         font-size=\"11\">\n<rect width=\"{width}\" height=\"{height}\" fill=\"white\"/>\n"
    );
    for (k, panel) in panels.iter().enumerate() {
        let origin = [(k % 2) as f64 * SIZE[0], (k / 2) as f64 * SIZE[1]];
        draw_panel(&mut svg, panel, origin);
    }
    for (k, (name, color)) in COLORS.iter().enumerate() {
        let x = MARGIN[0] + 100.0 * k as f64;
        let y = height - 10.0;
        let _ = writeln!(svg, "<text x=\"{x}\" y=\"{y}\" fill=\"{color}\">{name}</text>");
    }
    let x = MARGIN[0] + 400.0;
    let _ = writeln!(svg, "<text x=\"{x}\" y=\"{}\">solid: adaptive, dashed: uniform</text>\n</svg>", height - 10.0);
    svg
}

/// The powers of ten around what is shown along an axis.
fn decades(panel: &Panel, axis: usize) -> [f64; 2] {
    let values = || panel.curves.iter().flat_map(|curve| &curve.points).map(|p| p[axis]).filter(|v| *v > 0.0);
    let (lo, hi) = values().fold((f64::INFINITY, 0.0), |(lo, hi): (f64, f64), v| (lo.min(v), hi.max(v)));
    if lo > hi { [0.0, 1.0] } else { [lo.log10().floor(), hi.log10().ceil().max(lo.log10().floor() + 1.0)] }
}

fn draw_panel(svg: &mut String, panel: &Panel, [left, top]: [f64; 2]) {
    let range = [decades(panel, 0), decades(panel, 1)];
    let inner = [SIZE[0] - MARGIN[0] - 14.0, SIZE[1] - 2.0 * MARGIN[1]];
    let x = |value: f64| left + MARGIN[0] + inner[0] * (value.log10() - range[0][0]) / (range[0][1] - range[0][0]);
    let y = |value: f64| top + MARGIN[1] + inner[1] * (range[1][1] - value.log10()) / (range[1][1] - range[1][0]);
    let [x0, x1] = range[0].map(|decade| x(10_f64.powf(decade)));
    let [y0, y1] = range[1].map(|decade| y(10_f64.powf(decade)));
    let _ = writeln!(svg, "<text x=\"{x0}\" y=\"{}\" font-weight=\"bold\">{}</text>", y1 - 8.0, panel.title);
    for decade in range[0][0] as i32..=range[0][1] as i32 {
        let at = x(10_f64.powi(decade));
        let _ = writeln!(svg, "<path d=\"M{at:.1} {y0:.1}V{y1:.1}\" stroke=\"#ddd\"/>");
        let label =
            if decade < 0 { format!("{}", 10_f64.powi(decade)) } else { format!("{}", 10_u64.pow(decade as u32)) };
        let _ = writeln!(svg, "<text x=\"{at:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{label}</text>", y0 + 14.0);
    }
    for decade in range[1][0] as i32..=range[1][1] as i32 {
        let at = y(10_f64.powi(decade));
        let _ = writeln!(svg, "<path d=\"M{x0:.1} {at:.1}H{x1:.1}\" stroke=\"#ddd\"/>");
        let label = format!("{} %", 100.0 * 10_f64.powi(decade));
        let _ = writeln!(svg, "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{label}</text>", x0 - 5.0, at + 4.0);
    }
    for curve in &panel.curves {
        let color = COLORS.iter().find(|(name, _)| *name == curve.name).map_or("black", |(_, color)| color);
        let dash = if curve.dashed { " stroke-dasharray=\"5 4\"" } else { "" };
        let points: Vec<String> = curve
            .points
            .iter()
            .filter(|p| p[0] > 0.0 && p[1] > 0.0)
            .map(|p| format!("{:.1},{:.1}", x(p[0]), y(p[1])))
            .collect();
        let line = points.join(" ");
        let _ =
            writeln!(svg, "<polyline points=\"{line}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"1.6\"{dash}/>");
        for point in &points {
            let (cx, cy) = point.split_once(',').unwrap_or_default();
            let _ = writeln!(svg, "<circle cx=\"{cx}\" cy=\"{cy}\" r=\"2.4\" fill=\"{color}\"/>");
        }
    }
}
