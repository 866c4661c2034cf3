//! Line charts as SVG: white ground, labelled axes, colours and markers that tell lines apart in grey print as well.

use plotters::chart::ChartContext;
use plotters::coord::Shift;
use plotters::coord::cartesian::Cartesian2d;
use plotters::coord::ranged1d::ValueFormatter;
use plotters::coord::types::RangedCoordf64;
use plotters::element::DashedPathElement;
use plotters::prelude::*;

/// What the axes take; the legend stands beside them.
const AXES: (u32, u32) = (560, 420);
/// What the legend takes at least, where its lines begin, how far apart they are, and about the width of a character.
const LEGEND: u32 = 200;
const TOP: u32 = 56;
const STEP: u32 = 24;
const CHARACTER: u32 = 8;
const FONT: &str = "sans-serif";

/// Colours that the colour-blind can tell apart (M. Okabe, K. Ito, "Color Universal Design", 2008), the dark ones first.
const COLOURS: [RGBColor; 8] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(0, 0, 0),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(120, 120, 120),
];

/// A chart.
pub struct Chart {
    /// Above it.
    pub title: String,
    /// What the horizontal axis counts, with its unit.
    pub x: &'static str,
    /// What the vertical axis counts, with its unit.
    pub y: &'static str,
    /// Whether the vertical axis is logarithmic.
    pub log: bool,
    /// The range of the horizontal axis.
    pub span: (f64, f64),
    /// Names of colours.
    pub names: Vec<String>,
    /// What solid and dashed lines are.
    pub styles: Vec<String>,
    /// The lines.
    pub lines: Vec<Line>,
}

/// A line of a chart.
pub struct Line {
    /// Index into the names.
    pub name: usize,
    /// Index into the styles: solid first, all others dashed, each its own way.
    pub style: usize,
    /// From left to right: x, y, and the least and largest y of repeats.
    pub points: Vec<[f64; 4]>,
}

type Failure = Box<dyn std::error::Error + Send + Sync>;
type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

impl Chart {
    /// The chart as SVG.
    pub fn svg(&self) -> Result<String, String> {
        let mut text = String::new();
        self.draw(&mut text).map_err(|error| format!("{}: cannot be plotted: {error}", self.title))?;
        Ok(text)
    }

    fn draw(&self, text: &mut String) -> Result<(), Failure> {
        let root = SVGBackend::with_string(text, self.size()).into_drawing_area();
        root.fill(&WHITE)?;
        let (axes, legend) = root.split_horizontally(AXES.0);
        let axes = axes.split_vertically(AXES.1).0;
        let mut builder = ChartBuilder::on(&axes);
        builder.margin(14).caption(&self.title, (FONT, 20)).x_label_area_size(46).y_label_area_size(64);
        let (from, to) = self.span;
        let (low, high) = self.range();
        if self.log {
            self.mesh(&mut builder.build_cartesian_2d(from..to, (low..high).log_scale())?)?;
        } else {
            self.mesh(&mut builder.build_cartesian_2d(from..to, low..high)?)?;
        }
        self.legend(&legend)?;
        root.present()?;
        Ok(())
    }

    /// As large as the legend needs it.
    fn size(&self) -> (u32, u32) {
        let lines = self.names.iter().chain(&self.styles);
        let longest = lines.clone().map(|name| name.chars().count() as u32).max().unwrap_or(0);
        let legend = 50 + CHARACTER * longest;
        (AXES.0 + legend.max(LEGEND), AXES.1.max(TOP + STEP * (lines.count() as u32 + 1)))
    }

    /// The range of the vertical axis: that of the values with some room.
    fn range(&self) -> (f64, f64) {
        let values = || self.lines.iter().flat_map(|line| &line.points).flat_map(|point| &point[1..]);
        let (low, high) =
            values().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), &v| (a.min(v), b.max(v)));
        if !(low.is_finite() && high.is_finite()) {
            return if self.log { (0.1, 1.0) } else { (0.0, 1.0) };
        }
        if self.log {
            let low = low.max(1e-12);
            return (low / 1.4, high.max(low) * 1.4);
        }
        let room = (0.06 * (high - low)).max(1e-3 * high.abs()).max(1e-6);
        (low - room, high + room)
    }

    fn mesh<Y>(
        &self,
        chart: &mut ChartContext<'_, SVGBackend<'_>, Cartesian2d<RangedCoordf64, Y>>,
    ) -> Result<(), Failure>
    where
        Y: Ranged<ValueType = f64> + ValueFormatter<f64>,
    {
        chart
            .configure_mesh()
            .x_desc(self.x)
            .y_desc(self.y)
            .x_labels(11)
            .y_labels(8)
            .x_label_formatter(&|x| format!("{x:.0}"))
            .y_label_formatter(&|y| number(*y))
            .label_style((FONT, 14))
            .axis_desc_style((FONT, 16))
            .light_line_style(RGBColor(240, 240, 240))
            .bold_line_style(RGBColor(215, 215, 215))
            .draw()?;
        for line in &self.lines {
            let colour = COLOURS[line.name % COLOURS.len()];
            let path = || line.points.iter().map(|&[x, y, ..]| (x, y));
            if line.style == 0 {
                chart.draw_series(LineSeries::new(path(), colour.stroke_width(2)))?;
            } else {
                let (stroke, gap) = dash(line.style);
                chart.draw_series(DashedLineSeries::new(path(), stroke, gap, colour.stroke_width(2)))?;
            }
            let spans = line.points.iter().filter(|point| point[3] > point[2]);
            let spans = spans.map(|&[x, _, low, high]| PathElement::new(vec![(x, low), (x, high)], colour));
            chart.draw_series(spans)?;
            match line.name % 3 {
                0 => chart.draw_series(path().map(|at| Circle::new(at, 4, colour.filled())))?,
                1 => chart.draw_series(path().map(|at| TriangleMarker::new(at, 6, colour.filled())))?,
                _ => chart.draw_series(path().map(|at| Cross::new(at, 4, colour.stroke_width(2))))?,
            };
        }
        Ok(())
    }

    fn legend(&self, area: &Area<'_>) -> Result<(), Failure> {
        let (mut y, step) = (TOP as i32, STEP as i32);
        for (index, name) in self.names.iter().enumerate() {
            let colour = COLOURS[index % COLOURS.len()];
            area.draw(&PathElement::new(vec![(4, y), (34, y)], colour.stroke_width(2)))?;
            match index % 3 {
                0 => area.draw(&Circle::new((19, y), 4, colour.filled()))?,
                1 => area.draw(&TriangleMarker::new((19, y), 6, colour.filled()))?,
                _ => area.draw(&Cross::new((19, y), 4, colour.stroke_width(2)))?,
            }
            area.draw(&Text::new(name.clone(), (42, y - 7), (FONT, 15)))?;
            y += step;
        }
        if self.styles.len() > 1 {
            y += 12;
            for (index, name) in self.styles.iter().enumerate() {
                let ends = vec![(4, y), (34, y)];
                if index == 0 {
                    area.draw(&PathElement::new(ends, BLACK.stroke_width(2)))?;
                } else {
                    let (stroke, gap) = dash(index);
                    area.draw(&DashedPathElement::new(ends, stroke, gap, BLACK.stroke_width(2)))?;
                }
                area.draw(&Text::new(name.clone(), (42, y - 7), (FONT, 15)))?;
                y += step;
            }
        }
        Ok(())
    }
}

/// Stroke and gap of a style; no two have the same.
pub fn dash(style: usize) -> (u32, u32) {
    let others = style.saturating_sub(1);
    ([9, 5, 2][others % 3], 4 + 5 * (others / 3) as u32)
}

/// A tick with as many digits as it needs.
fn number(value: f64) -> String {
    let text = format!("{value:.4}");
    text.trim_end_matches('0').trim_end_matches('.').into()
}
