//! Report of a registration as text and as a page.

use std::fmt::Write;

use nalgebra::Point3;

use insonify_anatomy::registration::skin::Skin;
use insonify_anatomy::registration::{Registration, bounds};
use insonify_base::output::OutputError;
use insonify_base::table::{Cell, Table};
use insonify_report::page::Page;
use insonify_report::plot::{Axis, Plot, Series};

/// Distances (mm) up to which each colour counts.
const COLOURS: [(f64, &str); 4] = [
    (1.0, "#009e73"),
    (2.0, "#e69f00"),
    (5.0, "#d55e00"),
    (f64::INFINITY, "#cc0044"),
];
/// Largest number of points of a surface in the picture.
const MAX_POINTS: usize = 3000;
/// Width of a view, pixels.
const VIEW_PX: f64 = 380.0;

/// Returns the report as one self-contained HTML document, with both surfaces from three sides.
///
/// # Errors
/// [`OutputError`] if a plot cannot be drawn.
pub fn page(registration: &Registration, skin: &Skin) -> Result<String, OutputError> {
    let mut page = Page::new("Registration of anatomy to a surface");
    let number = |value: f64| Cell::number(format!("{value:.2}"));
    let head = [Cell::from("stage"), Cell::number("RMS, mm"), Cell::number("95 %, mm")];
    let (rigid, quadratic) = (&registration.rigid, &registration.quadratic);
    let rows = [
        ("rigid", rigid.rms_mm, rigid.p95_mm),
        ("quadratic", quadratic.rms_mm, quadratic.p95_mm),
    ];
    page.table(&Table::new(head).with(rows.map(|(name, rms, p95)| [Cell::from(name), number(rms), number(p95)])));
    page.paragraph(
        "",
        &format!(
            "Distances of the {} surface points from the skin of the volume; RMS without outliers. Least Jacobian on the volume: {:.2}.",
            registration.mapped.len(),
            quadratic.jacobian_min
        ),
    );
    if !registration.landmarks_mm.is_empty() {
        let head = [
            Cell::from("landmark"),
            Cell::number("rigid, mm"),
            Cell::number("quadratic, mm"),
        ];
        let rows = registration.landmarks_mm.iter();
        let rows = rows.map(|pair| {
            [
                Cell::from(pair.name.as_str()),
                number(pair.rigid_mm),
                number(pair.quadratic_mm),
            ]
        });
        page.table(&Table::new(head).with(rows));
    }
    if !registration.targets_mm.is_empty() {
        let head = [Cell::from("organ"), Cell::number("expected error, mm")];
        let rows = registration.targets_mm.iter();
        let rows = rows.map(|target| [Cell::from(target.name.as_str()), number(target.expected_mm)]);
        page.table(&Table::new(head).with(rows));
    }
    page.wide_figure(
        &views(registration, skin),
        "Skin of the volume (grey) and surface points by distance: below 1 mm green, 2 mm yellow, 5 mm orange, above red. \
         From the front, the side and the feet.",
    );
    page.plots(&[histogram(registration)])?;
    Ok(page.finish())
}

fn views(registration: &Registration, skin: &Skin) -> String {
    let [low, high] = bounds(skin.points().iter().copied());
    let planes = [[0, 2], [1, 2], [0, 1]];
    let largest = (0..3).map(|axis| high[axis] - low[axis]).fold(1.0, f64::max);
    let scale = (VIEW_PX - 20.0) / largest;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {} {VIEW_PX}\">",
        3.0 * VIEW_PX
    );
    for (view, [a, b]) in planes.into_iter().enumerate() {
        // The head is up, the front of the body too.
        let pixel = |point: &Point3<f64>| {
            let x = view as f64 * VIEW_PX + VIEW_PX / 2.0 + scale * (point[a] - (low[a] + high[a]) / 2.0);
            let y = scale * (point[b] - (low[b] + high[b]) / 2.0);
            (x, if b == 2 { VIEW_PX / 2.0 - y } else { VIEW_PX / 2.0 + y })
        };
        let mut dot = |point: &Point3<f64>, radius: f64, colour: &str| {
            let (x, y) = pixel(point);
            // Writing to a string does not fail.
            let _ = write!(
                svg,
                "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius}\" fill=\"{colour}\"/>"
            );
        };
        let step = 1 + skin.points().len() / MAX_POINTS;
        skin.points()
            .iter()
            .step_by(step)
            .for_each(|point| dot(point, 0.7, "#b0b7be"));
        for (point, distance) in registration
            .mapped
            .iter()
            .step_by(1 + registration.mapped.len() / MAX_POINTS)
        {
            let class = COLOURS.iter().find(|(limit, _)| distance < limit);
            dot(point, 1.4, class.unwrap_or(&COLOURS[COLOURS.len() - 1]).1);
        }
    }
    svg + "</svg>"
}

fn histogram(registration: &Registration) -> Plot {
    const BINS: usize = 30;
    let mut sorted: Vec<f64> = registration.mapped.iter().map(|(_, distance)| *distance).collect();
    sorted.sort_by(f64::total_cmp);
    let end_mm = sorted.get(sorted.len() * 49 / 50).copied().unwrap_or(1.0).max(0.01);
    let width = end_mm / BINS as f64;
    let mut points = vec![[0.0, 0.0]];
    for bin in 0..BINS {
        let range = bin as f64 * width..(bin + 1) as f64 * width;
        let count = sorted.iter().filter(|distance| range.contains(distance)).count() as f64;
        points.extend([[range.start, count], [range.end, count]]);
    }
    points.push([end_mm, 0.0]);
    Plot::new(
        "Distances of surface points from the skin",
        Axis::linear("distance, mm"),
        Axis::linear("points"),
        vec![Series::line("98 % of the points", 0, points)],
    )
}
