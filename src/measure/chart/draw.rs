//! Charts as SVG and PNG: error against a cost on logarithmic axes with the Pareto front, and bars of an error by
//! stage.
//!
//! Methods differ in colour (Okabe & Ito's palette, which colour-blind people tell apart) and in the shape of their
//! marks.

use std::sync::Once;

use plotters::coord::{CoordTranslate, Shift};
use plotters::prelude::*;
use plotters::style::{FontStyle, register_font};

use super::axis::LogAxis;
use super::front::pareto;
use crate::error::{Error, Result};
use crate::io::png::encode_png;
use crate::math::srgb::linear_from_srgb;

/// Okabe & Ito (2008), grey in place of yellow, which is weak on white.
pub(in crate::measure) const COLOURS: [RGBColor; 8] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(0, 0, 0),
    RGBColor(150, 150, 150),
];

/// Size of a chart in pixels.
const SIZE: (u32, u32) = (900, 620);
/// The font of charts and sheets, once [`fonts`] has registered it.
pub(crate) const FONT: &str = "sans-serif";

/// Unit in which the numbers of an axis are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// Shares as percent.
    Percent,
    /// Milliseconds, or seconds from a thousand on.
    Milliseconds,
    /// Seconds, or minutes from 120 on.
    Seconds,
    /// Bytes for each vertex, or kB from ten thousand on.
    BytesPerVertex,
    /// A plain number.
    Number,
}

impl Unit {
    /// A number with its unit.
    pub fn text(self, value: f64) -> String {
        let plain = |v: f64| plain(v, usize::MAX);
        // Minus zero looks odd.
        let value = value + 0.0;
        match self {
            Self::Percent => format!("{} %", plain(100.0 * value)),
            Self::Milliseconds if value >= 1000.0 => format!("{} s", plain(value / 1000.0)),
            Self::Milliseconds => format!("{} ms", plain(value)),
            Self::Seconds if value >= 120.0 => format!("{} min", plain(value / 60.0)),
            Self::Seconds => format!("{} s", plain(value)),
            Self::BytesPerVertex if value >= 10_000.0 => format!("{} kB", plain(value / 1000.0)),
            Self::BytesPerVertex => format!("{} B", plain(value)),
            Self::Number => plain(value),
        }
    }
}

/// A number with at most three digits, so that it claims no false precision, and `most` decimals.
pub(in crate::measure) fn plain(value: f64, most: usize) -> String {
    let digits = if value.abs() >= 100.0 || value == 0.0 { 0 } else { (2 - value.abs().log10().floor() as i32).max(0) };
    let text = format!("{value:.*}", most.min(digits as usize));
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// A point of a chart.
#[derive(Clone, Debug, PartialEq)]
pub struct Point {
    /// Method; the points of one are joined in their order.
    pub series: String,
    /// Cost, positive.
    pub x: f64,
    /// Error, positive.
    pub y: f64,
}

/// Drawing of the Pareto front, the points that no other beats in both cost and error.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Front {
    /// Joined by a line.
    #[default]
    Drawn,
    /// Not drawn.
    Left,
}

/// Error against a cost.
#[derive(Clone, Debug, PartialEq)]
pub struct Scatter {
    /// Title over the chart.
    pub title: String,
    /// Titles of the axes, x and y.
    pub axes: [String; 2],
    /// Units of the axes, x and y.
    pub units: [Unit; 2],
    /// Points in the order of the series.
    pub points: Vec<Point>,
    /// Errors at which a dashed line is drawn, with their names.
    pub lines: Vec<(f64, String)>,
    /// Drawing of the Pareto front.
    pub front: Front,
}

/// An error by stage.
#[derive(Clone, Debug, PartialEq)]
pub struct Bars {
    /// Title over the chart.
    pub title: String,
    /// Stages in the order of their colours.
    pub stages: Vec<String>,
    /// Name, RMS of each stage, and measured RMS of the whole.
    pub rows: Vec<(String, Vec<f64>, f64)>,
}

/// A chart that can be drawn.
pub trait Drawing {
    /// Draws the chart on a whole area.
    ///
    /// # Errors
    /// The backend's.
    fn draw<B: DrawingBackend>(&self, root: &DrawingArea<B, Shift>) -> Result<()>;
}

/// Draws a chart as SVG.
///
/// # Errors
/// The backend's.
pub fn as_svg(drawing: &impl Drawing) -> Result<String> {
    fonts();
    let mut text = String::new();
    let root = SVGBackend::with_string(&mut text, SIZE).into_drawing_area();
    drawing.draw(&root)?;
    root.present().map_err(|e| failed(&e))?;
    drop(root);
    Ok(text)
}

/// Draws a chart as PNG.
///
/// # Errors
/// The backend's.
pub fn as_png(drawing: &impl Drawing) -> Result<Vec<u8>> {
    fonts();
    let mut buffer = vec![255u8; (3 * SIZE.0 * SIZE.1) as usize];
    let root = BitMapBackend::with_buffer(&mut buffer, SIZE).into_drawing_area();
    drawing.draw(&root)?;
    root.present().map_err(|e| failed(&e))?;
    drop(root);
    let linear = |code: u8| linear_from_srgb(f64::from(code) / 255.0) as f32;
    let rgb: Vec<[f32; 3]> = buffer.as_chunks::<3>().0.iter().map(|c| c.map(linear)).collect();
    encode_png(SIZE.0 as usize, SIZE.1 as usize, &rgb, None)
}

/// Registers the font that text is drawn with.
pub(crate) fn fonts() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        for style in [FontStyle::Normal, FontStyle::Bold] {
            // Text is measured with this font; what shows an SVG takes its own of the same family.
            let _ = register_font(FONT, style, epaint_default_fonts::UBUNTU_LIGHT);
        }
    });
}

pub(in crate::measure) fn failed(error: &dyn std::fmt::Display) -> Error {
    Error::runtime(format!("chart: {error}"))
}

/// A range a little wider than the values, within the limits of an axis; one decade where there are none.
pub(in crate::measure) fn span(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let usable = values.filter(|v| v.is_finite() && *v > 0.0);
    let (low, high) = usable.fold((f64::INFINITY, 0.0f64), |(l, h), v| (l.min(v), h.max(v)));
    if high == 0.0 { (0.1, 1.0) } else { (low / 1.5, high * 1.5) }
}

/// Text of a number on an axis.
pub(in crate::measure) type Numbers<'a> = &'a dyn Fn(&f64) -> String;

/// An empty chart on two logarithmic axes with their titles and the texts of their numbers.
pub(in crate::measure) fn on_axes<'a, B: DrawingBackend + 'a>(
    root: &'a DrawingArea<B, Shift>,
    title: &str,
    ends: [(f64, f64); 2],
    names: [&str; 2],
    texts: [Numbers<'_>; 2],
) -> Result<ChartContext<'a, B, Cartesian2d<LogAxis, LogAxis>>> {
    let [x, y] = ends.map(LogAxis::new);
    let mut chart = ChartBuilder::on(root)
        .caption(title, (FONT, 22))
        .margin(14)
        .x_label_area_size(52)
        .y_label_area_size(84)
        .build_cartesian_2d(x, y)
        .map_err(|e| failed(&e))?;
    chart
        .configure_mesh()
        .x_desc(names[0])
        .y_desc(names[1])
        .x_label_formatter(texts[0])
        .y_label_formatter(texts[1])
        .label_style((FONT, 15))
        .axis_desc_style((FONT, 17))
        .light_line_style(RGBColor(240, 240, 240))
        .draw()
        .map_err(|e| failed(&e))?;
    Ok(chart)
}

/// Draws the points of the `index`-th series in its colour and shape of marks, and its name in the legend.
pub(in crate::measure) fn marks<'a, B, T>(
    chart: &mut ChartContext<'a, B, T>,
    index: usize,
    name: String,
    points: &[(f64, f64)],
) -> Result<()>
where
    B: DrawingBackend + 'a,
    T: CoordTranslate<From = (f64, f64)>,
{
    let style = ShapeStyle::from(&COLOURS[index % COLOURS.len()]).filled();
    let drawn = match index % 3 {
        0 => chart.draw_series(points.iter().map(|p| Circle::new(*p, 6, style).into_dyn())),
        1 => chart.draw_series(points.iter().map(|p| TriangleMarker::new(*p, 8, style).into_dyn())),
        _ => chart.draw_series(points.iter().map(|p| Cross::new(*p, 6, style.stroke_width(3)).into_dyn())),
    };
    drawn.map_err(|e| failed(&e))?.label(name).legend(move |(x, y)| match index % 3 {
        0 => Circle::new((x + 9, y), 6, style).into_dyn(),
        1 => TriangleMarker::new((x + 9, y), 8, style).into_dyn(),
        _ => Cross::new((x + 9, y), 6, style.stroke_width(3)).into_dyn(),
    });
    Ok(())
}

/// Draws the names of all series in a corner.
pub(in crate::measure) fn legend<'a, B, T>(
    chart: &mut ChartContext<'a, B, T>,
    position: SeriesLabelPosition,
) -> Result<()>
where
    B: DrawingBackend + 'a,
    T: CoordTranslate,
{
    chart
        .configure_series_labels()
        .position(position)
        .background_style(WHITE.mix(0.85))
        .border_style(RGBColor(200, 200, 200))
        .label_font((FONT, 15))
        .draw()
        .map_err(|e| failed(&e))
}

impl Drawing for Scatter {
    fn draw<B: DrawingBackend>(&self, root: &DrawingArea<B, Shift>) -> Result<()> {
        root.fill(&WHITE).map_err(|e| failed(&e))?;
        let shown: Vec<&Point> =
            self.points.iter().filter(|p| [p.x, p.y].iter().all(|v| v.is_finite() && *v > 0.0)).collect();
        let x = span(shown.iter().map(|p| p.x));
        // Room for the legend.
        let x = (x.0, x.1 * (x.1 / x.0).powf(0.35));
        let y = span(shown.iter().map(|p| p.y).chain(self.lines.iter().map(|l| l.0)));
        let names = [self.axes[0].as_str(), self.axes[1].as_str()];
        let texts: [Numbers<'_>; 2] = [&|v| self.units[0].text(*v), &|v| self.units[1].text(*v)];
        let mut chart = on_axes(root, &self.title, [x, y], names, texts)?;
        for (level, name) in &self.lines {
            let line = [(x.0, *level), (x.1, *level)];
            let colour = RGBColor(90, 90, 90);
            let style = ShapeStyle::from(&colour).stroke_width(1);
            chart.draw_series(DashedLineSeries::new(line, 6, 4, style)).map_err(|e| failed(&e))?;
            let text = format!("{name}: {}", self.units[1].text(*level));
            let text = Text::new(text, (8, -18), (FONT, 14).into_font().color(&colour));
            chart.draw_series([EmptyElement::at((x.0, *level)) + text]).map_err(|e| failed(&e))?;
        }
        if self.front == Front::Drawn {
            let places: Vec<(f64, f64)> = shown.iter().map(|p| (p.x, p.y)).collect();
            let front: Vec<(f64, f64)> = pareto(&places).into_iter().map(|i| places[i]).collect();
            let grey = ShapeStyle::from(&RGBColor(170, 170, 170)).stroke_width(3);
            chart
                .draw_series(LineSeries::new(front, grey))
                .map_err(|e| failed(&e))?
                .label("Pareto front")
                .legend(move |(x, y)| PathElement::new(vec![(x, y), (x + 18, y)], grey));
        }
        let mut series: Vec<&str> = Vec::new();
        for point in &shown {
            if !series.contains(&point.series.as_str()) {
                series.push(&point.series);
            }
        }
        for (index, name) in series.into_iter().enumerate() {
            let colour = COLOURS[index % COLOURS.len()];
            let points: Vec<(f64, f64)> = shown.iter().filter(|p| p.series == name).map(|p| (p.x, p.y)).collect();
            let thin = ShapeStyle::from(&colour).stroke_width(1);
            chart.draw_series(LineSeries::new(points.clone(), thin)).map_err(|e| failed(&e))?;
            marks(&mut chart, index, name.to_owned(), &points)?;
        }
        legend(&mut chart, SeriesLabelPosition::UpperRight)
    }
}

impl Drawing for Bars {
    fn draw<B: DrawingBackend>(&self, root: &DrawingArea<B, Shift>) -> Result<()> {
        root.fill(&WHITE).map_err(|e| failed(&e))?;
        let total = |stages: &[f64]| stages.iter().filter(|v| v.is_finite()).sum::<f64>();
        let longest = self.rows.iter().map(|(_, stages, whole)| total(stages).max(*whole));
        let longest = longest.filter(|v| v.is_finite()).fold(0.0, f64::max).max(1e-6) * 1.4;
        let count = self.rows.len().max(1);
        let mut chart = ChartBuilder::on(root)
            .caption(&self.title, (FONT, 22))
            .margin(14)
            .x_label_area_size(52)
            .y_label_area_size(220)
            .build_cartesian_2d(0.0..longest, 0.0..count as f64)
            .map_err(|e| failed(&e))?;
        // The first row at the top, its name at the middle of its bar.
        let name = |v: &f64| {
            let row = count as f64 - 0.5 - *v;
            let index = row.round();
            let named = (row - index).abs() < 1e-6 && index >= 0.0;
            if named { self.rows.get(index as usize).map_or_else(String::new, |r| r.0.clone()) } else { String::new() }
        };
        chart
            .configure_mesh()
            .disable_y_mesh()
            .y_labels(2 * count + 1)
            .x_desc("RMS error, the stages one after the other; the mark is the measured whole")
            .x_label_formatter(&|v| Unit::Percent.text(*v))
            .y_label_formatter(&name)
            .label_style((FONT, 15))
            .axis_desc_style((FONT, 17))
            .draw()
            .map_err(|e| failed(&e))?;
        for (index, stage) in self.stages.iter().enumerate() {
            let style = ShapeStyle::from(&COLOURS[index % COLOURS.len()]).filled();
            let bars = self.rows.iter().enumerate().filter_map(|(row, (_, stages, _))| {
                let (from, length) = (total(&stages[..index.min(stages.len())]), stages.get(index).copied()?);
                let middle = count as f64 - 0.5 - row as f64;
                Some(Rectangle::new([(from, middle - 0.3), (from + length, middle + 0.3)], style))
            });
            chart
                .draw_series(bars)
                .map_err(|e| failed(&e))?
                .label(stage.clone())
                .legend(move |(x, y)| Rectangle::new([(x + 2, y - 5), (x + 16, y + 5)], style));
        }
        let whole = self.rows.iter().enumerate().map(|(row, (_, _, whole))| {
            let middle = count as f64 - 0.5 - row as f64;
            PathElement::new(vec![(*whole, middle - 0.42), (*whole, middle + 0.42)], BLACK.stroke_width(3))
        });
        chart.draw_series(whole).map_err(|e| failed(&e))?;
        legend(&mut chart, SeriesLabelPosition::UpperRight)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn scatter() -> Scatter {
        let point = |series: &str, x: f64, y: f64| Point { series: series.into(), x, y };
        Scatter {
            title: "bunny".into(),
            axes: ["relight".into(), "error".into()],
            units: [Unit::Milliseconds, Unit::Percent],
            points: vec![
                point("a", 1.0, 0.02),
                point("a", 10.0, 0.004),
                point("b", 100.0, 0.001),
                point("b", f64::NAN, 0.0),
                point("c", 2000.0, 0.0005),
            ],
            lines: vec![(0.06, "the dipole's own".into())],
            front: Front::Drawn,
        }
    }

    #[test]
    fn units_are_plain() {
        assert_eq!(Unit::Percent.text(0.001), "0.1 %");
        assert_eq!(Unit::Percent.text(0.05), "5 %");
        assert_eq!(Unit::Milliseconds.text(100.0), "100 ms");
        assert_eq!(Unit::Milliseconds.text(2500.0), "2.5 s");
        assert_eq!(Unit::Seconds.text(0.25), "0.25 s");
        assert_eq!(Unit::Seconds.text(600.0), "10 min");
        assert_eq!(Unit::BytesPerVertex.text(1057.0), "1057 B");
        assert_eq!(Unit::Number.text(0.003), "0.003");
    }

    #[test]
    fn charts_name_what_they_show_and_are_the_same_every_time() {
        let svg = as_svg(&scatter()).unwrap();
        for text in ["bunny", "relight", "error", "Pareto front", "the dipole's own", "10 ms", "0.1 %"] {
            let escaped = text.replace('\'', "&apos;");
            assert!(svg.contains(text) || svg.contains(&escaped), "{text}: {svg}");
        }
        assert_eq!(svg, as_svg(&scatter()).unwrap());
        let without = as_svg(&Scatter { front: Front::Left, ..scatter() }).unwrap();
        assert!(!without.contains("Pareto front") && without.contains("bunny"));
        assert_eq!(as_png(&scatter()).unwrap(), as_png(&scatter()).unwrap());
    }

    #[test]
    fn nothing_is_a_chart_too() {
        let empty = Scatter { points: Vec::new(), lines: Vec::new(), ..scatter() };
        assert!(as_svg(&empty).unwrap().contains("bunny"));
        let bars = Bars { title: "stages".into(), stages: Vec::new(), rows: Vec::new() };
        assert!(as_svg(&bars).unwrap().contains("stages"));
        assert!(!as_png(&bars).unwrap().is_empty());
    }

    #[test]
    fn bars_show_every_stage_of_every_row() {
        let bars = Bars {
            title: "stages".into(),
            stages: vec!["sampling".into(), "basis".into()],
            rows: vec![("one".into(), vec![0.01, 0.02], 0.025), ("two".into(), vec![0.005, 0.0], 0.004)],
        };
        let svg = as_svg(&bars).unwrap();
        for text in ["sampling", "basis", "one", "two"] {
            assert!(svg.contains(text), "{text}");
        }
    }
}
