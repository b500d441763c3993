//! The page on the kinds of probes.

use std::error::Error;

use insonify::Probe;
use insonify::probe::{Aperture, BeamGrid, Bounds, ProbeKind, ProbeShape, ProbeSpec, Ray};
use insonify::tracking::TrackingError;
use serde_json::{Map, Value};

use super::{Entry, Source, description, folded, page};

/// Length of the scanlines of the examples, mm.
const DEPTH_MM: f64 = 50.0;

/// Number of scanlines that are drawn.
const LINES: u32 = 33;

/// Pixels of a drawing for each millimetre.
const PIXELS_PER_MM: f64 = 3.0;

/// Around the sector of a drawing, mm.
const MARGIN_MM: f64 = 6.0;

/// The page and a drawing of each kind.
pub(super) fn files() -> Result<Vec<(String, String)>, Box<dyn Error>> {
    let kinds = schemars::schema_for!(ProbeKind).to_value();
    let table = schemars::schema_for!(ProbeSpec).to_value();
    let (mut files, mut entries) = (Vec::new(), Vec::new());
    for (name, shape) in ProbeShape::EXAMPLES {
        entries.push(entry(name, &shape, &kinds, &table)?);
        files.push((format!("probes/{name}.svg"), drawing(&Probe::new(shape, DEPTH_MM)?)?));
    }
    let lead = folded(&format!(
        "Kinds of transducers: `[probe]` of a scene. `depth_mm` is the length of every scanline, `frequency_mhz` the centre frequency, by \
         default that of the kind, `lines` and `samples` the number of scanlines and of samples along each. Drawings show {LINES} scanlines of \
         the probes of the examples, the array in bold; x, towards the marked side, points to the right and y, into the body, down. \
         Those of a full circle overlap opposite to y, so that the frame has no seam there.",
    ));
    let of_all = schemars::schema_for!(Aperture).to_value();
    let keys = of_all["properties"].as_object().cloned().unwrap_or_default();
    let source = Source::read("src/tracking/probe/aperture.rs".to_owned())?;
    let lead = format!(
        "{lead}\nKeys of all kinds, from which the point spread follows:\n{}",
        source.key_table(&keys, &of_all)
    );
    let text = page("Kinds of probes", &lead, ["kind", "what it is"], &entries);
    files.insert(0, ("probes.md".to_owned(), text));
    Ok(files)
}

fn entry(name: &'static str, shape: &ProbeShape, kinds: &Value, table: &Value) -> Result<Entry, Box<dyn Error>> {
    let source = Source::read(format!("src/tracking/probe/{}.rs", name.replace('-', "_")))?;
    let is_named = |schema: &&Value| schema["const"] == name;
    let kind = kinds["oneOf"].as_array().into_iter().flatten().find(is_named);
    let cases = table["allOf"].as_array().into_iter().flatten();
    let mut cases = cases.filter(|case| case["if"]["properties"]["kind"]["const"] == name);
    let (kind, case) = kind.zip(cases.next()).ok_or("a kind without a schema")?;
    // Keys of other kinds are refused.
    let keys: Map<String, Value> = case["then"]["properties"]
        .as_object()
        .into_iter()
        .flatten()
        .filter(|(_, schema)| schema.is_object())
        .map(|(key, schema)| (key.clone(), schema.clone()))
        .collect();
    let numbers = shape.numbers();
    let stated: String = numbers
        .iter()
        .map(|(key, value)| format!("{key} = {value:?}, "))
        .collect();
    let words = description(kind);
    let site = format!("{:?}", shape.kind().site()).to_lowercase();
    let facts = format!("{words} Place of the array: {site}.");
    let shared = shape.kind().shared_aperture_mm().map(|aperture_mm| {
        format!(" All scanlines share an aperture of {aperture_mm} mm, which widens the beam with depth.")
    });
    let mut section = format!("\n## {name}\n");
    section += &format!("\n{}", folded(&(facts + &shared.unwrap_or_default())));
    section += &format!("\n```toml\nprobe = {{ kind = \"{name}\", {stated}depth_mm = {DEPTH_MM:?} }}\n```\n");
    section += &format!("\n![Scanlines of the probe](probes/{name}.svg)\n");
    section += &source.key_table(&keys, table);
    Ok(Entry {
        name,
        summary: words.split(" Takes `").next().unwrap_or_default().to_owned(),
        section: section + &source.link(),
    })
}

/// Scanlines and array as an SVG document, with a bar of 10 mm.
fn drawing(probe: &Probe) -> Result<String, TrackingError> {
    let grid = BeamGrid::new(&Probe { lines: LINES, ..*probe })?;
    let Bounds { min, max } = grid.bounds_mm();
    let rounded = |number: f64| (number * 100.0).round() / 100.0 + 0.0;
    let [left, top] = min.map(|side| rounded(side - MARGIN_MM));
    let [width, height] = [0, 1].map(|axis| rounded(max[axis] - min[axis] + 2.0 * MARGIN_MM));
    let [wide, high] = [width, height].map(|side| (side * PIXELS_PER_MM).round());
    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{wide}\" height=\"{high}\" viewBox=\"{left} {top} {width} {height}\">\n\
         <rect x=\"{left}\" y=\"{top}\" width=\"{width}\" height=\"{height}\" fill=\"#fff\"/>\n\
         <g stroke=\"#0072b2\" stroke-width=\"0.3\">\n"
    );
    let mut array = String::new();
    for Ray { origin, direction } in grid.rays() {
        let [x, y] = origin.map(rounded);
        let [far_x, far_y] = [0, 1].map(|axis| rounded(origin[axis] + grid.depth_mm() * direction[axis]));
        text += &format!("<line x1=\"{x}\" y1=\"{y}\" x2=\"{far_x}\" y2=\"{far_y}\"/>\n");
        array += &format!("{x},{y} ");
    }
    let [x, y] = [left + 2.0, top + height - 2.0].map(rounded);
    text += &format!(
        "</g>\n<g fill=\"none\" stroke=\"#000\" stroke-linecap=\"round\">\n\
         <polyline points=\"{}\" stroke-width=\"1\"/>\n<line x1=\"{x}\" y1=\"{y}\" x2=\"{}\" y2=\"{y}\" stroke-width=\"0.5\"/>\n</g>\n\
         <text x=\"{x}\" y=\"{}\" font-family=\"sans-serif\" font-size=\"3\">10 mm</text>\n</svg>\n",
        array.trim_end(),
        rounded(x + 10.0),
        rounded(y - 1.0)
    );
    Ok(text)
}
