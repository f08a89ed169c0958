//! Line plots as SVG.

use plotters::coord::ranged1d::{AsRangedCoord, ValueFormatter};
use plotters::prelude::*;

/// Size of the drawing, in pixels before scaling.
const SIZE: (u32, u32) = (720, 400);
/// Colours that stay apart for colour-blind readers and on light and dark paper (after Okabe & Ito).
const COLOURS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(230, 159, 0),
    RGBColor(0, 158, 115),
    RGBColor(213, 94, 0),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
    RGBColor(128, 128, 128),
];
/// Values beyond this, or below its inverse on a logarithmic axis, are no measurements; the axes' marks need
/// a limit.
const LARGEST: f64 = 1e30;
/// A line of at most this many points shows them.
const MARKED_POINTS: usize = 40;

/// A plot of one or more lines.
#[derive(Clone, Debug)]
pub struct Plot {
    /// Title above the plot.
    pub title: String,
    /// Label of the horizontal axis, with its unit.
    pub x: String,
    /// Label of the vertical axis, with its unit.
    pub y: String,
    /// Logarithmic horizontal axis.
    pub log_x: bool,
    /// Logarithmic vertical axis.
    pub log_y: bool,
    /// The lines: name and points. Points that are not finite (or beyond 10³⁰), or not positive on a
    /// logarithmic axis (or below 10⁻³⁰), are omitted.
    pub lines: Vec<(String, Vec<(f64, f64)>)>,
}

impl Plot {
    /// The plot as an SVG element; its text and axes take the colour of the text around it.
    pub fn to_svg(&self) -> String {
        let shown = |value: f64, log: bool| value.abs() <= LARGEST && (!log || value >= 1.0 / LARGEST);
        let lines: Vec<(&str, Vec<(f64, f64)>)> = self
            .lines
            .iter()
            .map(|(name, points)| {
                let points = points.iter().copied();
                (&**name, points.filter(|&(x, y)| shown(x, self.log_x) && shown(y, self.log_y)).collect())
            })
            .collect();
        let all = || lines.iter().flat_map(|(_, points)| points);
        let x = range(all().map(|point| point.0), self.log_x);
        let y = range(all().map(|point| point.1), self.log_y);

        let mut svg = String::new();
        let area = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
        let drawn = match (self.log_x, self.log_y) {
            (false, false) => self.draw(&area, &lines, x, y),
            (true, false) => self.draw(&area, &lines, x.log_scale(), y),
            (false, true) => self.draw(&area, &lines, x, y.log_scale()),
            (true, true) => self.draw(&area, &lines, x.log_scale(), y.log_scale()),
        };
        drawn.and_then(|()| area.present()).expect("drawing into memory cannot fail");
        drop(area);
        svg.replace("\"#000000\"", "\"currentColor\"")
    }

    fn draw<'a, X, Y>(
        &self,
        area: &DrawingArea<SVGBackend<'a>, plotters::coord::Shift>,
        lines: &[(&str, Vec<(f64, f64)>)],
        x: X,
        y: Y,
    ) -> Result<(), DrawingAreaErrorKind<<SVGBackend<'a> as DrawingBackend>::ErrorType>>
    where
        X: AsRangedCoord<Value = f64>,
        Y: AsRangedCoord<Value = f64>,
        X::CoordDescType: ValueFormatter<f64>,
        Y::CoordDescType: ValueFormatter<f64>,
    {
        let mut chart = ChartBuilder::on(area)
            .caption(&self.title, ("sans-serif", 17))
            .margin(12)
            .x_label_area_size(42)
            .y_label_area_size(64)
            .build_cartesian_2d(x, y)?;
        let grid = RGBAColor(128, 128, 128, 0.25);
        chart
            .configure_mesh()
            .bold_line_style(grid)
            .light_line_style(TRANSPARENT)
            .x_desc(&self.x)
            .y_desc(&self.y)
            .x_label_formatter(&|value| mark(*value, self.log_x))
            .y_label_formatter(&|value| mark(*value, self.log_y))
            .label_style(("sans-serif", 13))
            .draw()?;
        for (index, (name, points)) in lines.iter().enumerate() {
            let colour = COLOURS[index % COLOURS.len()];
            let line = chart.draw_series(LineSeries::new(points.iter().copied(), colour.stroke_width(2)))?;
            if !name.is_empty() {
                line.label(*name)
                    .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(2)));
            }
            if points.len() <= MARKED_POINTS {
                chart.draw_series(points.iter().map(|&point| Circle::new(point, 3, colour.filled())))?;
            }
        }
        // One line is named by the title and the axis.
        if lines.len() > 1 && lines.iter().any(|(name, _)| !name.is_empty()) {
            let pixels = lines.iter().flat_map(|(_, points)| points).map(|point| chart.backend_coord(point));
            let corner = emptiest_corner(pixels, lines.len());
            chart
                .configure_series_labels()
                .position(corner)
                .label_font(("sans-serif", 13))
                .border_style(grid)
                .draw()?;
        }
        Ok(())
    }
}

/// The smallest range that shows all values with some room; any range where there is none.
fn range(values: impl Iterator<Item = f64>, log: bool) -> std::ops::Range<f64> {
    let (low, high) =
        values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), value| (l.min(value), h.max(value)));
    if low > high {
        return if log { 1.0..10.0 } else { 0.0..1.0 };
    }
    if log {
        // At least a decade, so that there are marks to read.
        let widen = (10.0 / (high / low)).sqrt().max(1.1);
        return low / widen..high * widen;
    }
    // Wide enough that neighbouring marks differ as numbers.
    let size = low.abs().max(high.abs());
    let room = (0.04 * (high - low)).max(1e-6 * size);
    let room = if high > low { room } else { (0.05 * size).max(0.5) };
    low - room..high + room
}

/// The corner of the drawing where a legend of this many lines hides the fewest points.
fn emptiest_corner(pixels: impl Iterator<Item = (i32, i32)>, lines: usize) -> SeriesLabelPosition {
    use SeriesLabelPosition::{LowerLeft, LowerRight, UpperLeft, UpperRight};
    let corners = [UpperRight, UpperLeft, LowerRight, LowerLeft];
    let (width, height) = (SIZE.0 as i32, SIZE.1 as i32);
    // About the legend's size, in pixels from the drawing's edge.
    let (right, upper) = (width * 7 / 10, 60 + 18 * lines as i32);
    let (left, lower) = (width - right, height - upper);
    let mut hidden = [0usize; 4];
    for (x, y) in pixels {
        for (hidden, corner) in hidden.iter_mut().zip(&corners) {
            let inside = match corner {
                UpperRight => x > right && y < upper,
                UpperLeft => x < left && y < upper,
                LowerRight => x > right && y > lower,
                _ => x < left && y > lower,
            };
            *hidden += usize::from(inside);
        }
    }
    let fewest = (0..4).min_by_key(|&corner| hidden[corner]).unwrap_or(0);
    corners.into_iter().nth(fewest).unwrap_or(UpperRight)
}

/// A mark's label: a number; on a logarithmic axis only those of 1, 2 and 5, as the others crowd.
fn mark(value: f64, log: bool) -> String {
    let mantissa = value / 10f64.powf(value.abs().log10().floor());
    let crowds = log && ![1.0, 2.0, 5.0, 10.0].iter().any(|shown| (mantissa - shown).abs() < 1e-6);
    if crowds { String::new() } else { number(value) }
}

/// A value in few characters.
fn number(value: f64) -> String {
    let size = value.abs();
    if size != 0.0 && !(1e-3..1e6).contains(&size) {
        return format!("{value:.0e}");
    }
    let text = format!("{value:.4}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".into() } else { text.into() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plot(log: bool, lines: Vec<(String, Vec<(f64, f64)>)>) -> String {
        let (title, x, y) = ("Error against time".into(), "seconds".into(), "relative error".into());
        Plot { title, x, y, log_x: log, log_y: log, lines }.to_svg()
    }

    #[test]
    fn texts_are_text_and_lines_have_their_colours() {
        let points = |scale: f64| (1..20).map(|i| (f64::from(i), scale / f64::from(i))).collect();
        for log in [false, true] {
            let svg = plot(log, vec![("day".into(), points(1.0)), ("night".into(), points(5.0))]);
            for text in ["Error against time", "seconds", "relative error", "day", "night"] {
                assert!(svg.contains(text), "{text} in {svg}");
            }
            assert!(svg.contains("<text") && svg.contains("#0072B2") && svg.contains("#E69F00"), "{svg}");
            assert!(svg.trim_end().ends_with("</svg>"));
        }
    }

    #[test]
    fn hostile_points_are_omitted() {
        let hostile = [(f64::NAN, 1.0), (1.0, f64::INFINITY), (0.0, 0.0), (-1.0, 2.0), (3.0, 3.0)];
        for log in [false, true] {
            for lines in [vec![], vec![(String::new(), vec![])], vec![("a".into(), hostile.to_vec())]] {
                let svg = plot(log, lines);
                assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
            }
        }
    }

    /// The centres of the points' circles, in pixels.
    fn circles(svg: &str) -> Vec<[f64; 2]> {
        let attribute = |tag: &str, name: &str| {
            let value = tag.split_once(&format!(" {name}=\"")).unwrap().1;
            value.split_once('"').unwrap().0.parse().unwrap()
        };
        svg.split("<circle").skip(1).map(|tag| ["cx", "cy"].map(|name| attribute(tag, name))).collect()
    }

    #[test]
    fn points_of_any_size_lie_inside_the_drawing() {
        let cases = [
            ("huge", false, [(0.0, f64::MAX / 4.0), (1.0, 0.0)], 1),
            ("flat", false, [(1e9, 1.0), (1e9 + 1e-6, 1.0 + 1e-16)], 2),
            ("wide", true, [(1e-30, 1e30), (1e30, 1e-30)], 2),
            ("too wide", true, [(1e-300, 1e300), (1e300, 1e-300)], 0),
        ];
        for (name, log, points, shown) in cases {
            let svg = plot(log, vec![(name.into(), points.to_vec())]);
            let circles = circles(&svg);
            assert_eq!(circles.len(), shown, "{name}: {svg}");
            let (width, height) = (f64::from(SIZE.0), f64::from(SIZE.1));
            let inside = |[x, y]: &[f64; 2]| (0.0..width).contains(x) && (0.0..height).contains(y);
            assert!(circles.iter().all(inside), "{name}: {circles:?}");
        }
    }
}
