//! The page on the constitutive laws of tissue.

use std::error::Error;

use insonify::mechanics::tissue::law::{AnyLaw, LawSpec, Tensor};
use insonify::mechanics::tissue::material::Material;
use insonify_report::plot::{Axis, Plot, Series};
use serde_json::{Map, Value};

use super::{Entry, Source, definition, description, folded, page, shown};

/// Moduli at small strain of the curves and examples: Young's modulus, kPa, and Poisson's ratio.
const MATERIAL: [f64; 2] = [10.0, 0.45];

/// Elongations of the curves, percent of the length at rest.
const ELONGATIONS: std::ops::RangeInclusive<i32> = -30..=50;

/// The page and a curve of each law.
pub(super) fn files() -> Result<Vec<(String, String)>, Box<dyn Error>> {
    let schema = schemars::schema_for!(LawSpec).to_value();
    let material = Material::new(MATERIAL[0], MATERIAL[1])?;
    let (mut files, mut entries) = (Vec::new(), Vec::new());
    let linear = AnyLaw::examples(material)?[0];
    for (name, spec) in LawSpec::examples() {
        let law = spec.law(material)?;
        entries.push(entry(name, &spec, &law, &schema)?);
        let mut series = vec![Series::line(name, 0, curve(&law))];
        if linear.0 != name {
            series.push(Series::line(linear.0, 6, curve(&linear.1)));
        }
        let axes = ["engineering strain", "nominal stress (kPa)"].map(Axis::linear);
        let [x, y] = axes;
        files.push((
            format!("laws/{name}.svg"),
            Plot::new(format!("Uniaxial stress, law {name}"), x, y, series).svg()?,
        ));
    }
    let lead = folded(&format!(
        "Constitutive laws of nonlinear tissue: `law` in the `[[material]]` of a static problem and in the `[[tissue.material]]` of a \
         scenario. All agree at small strain, where `young_kpa` (or `shear_kpa`) and `poisson` state them: `lambda` and `mu` are Lame's \
         parameters, `K = lambda + 2 mu / 3`. `H = du/dX` is the displacement gradient, `F = I + H`, `C = F^T F`, `J = det F`, `P` the \
         first Piola-Kirchhoff stress, which is `dW/dF` where there is an energy `W` per volume at rest. Curves are of a bar with free \
         sides, of {} kPa and Poisson's ratio {}, by the keys above them.",
        MATERIAL[0], MATERIAL[1]
    ));
    let text = page("Laws of tissue", &lead, ["law", "what it is"], &entries);
    files.insert(0, ("laws.md".to_owned(), text));
    Ok(files)
}

fn entry(name: &'static str, spec: &LawSpec, law: &AnyLaw, schema: &Value) -> Result<Entry, Box<dyn Error>> {
    let source = Source::read(format!("src/mechanics/tissue/law/{}.rs", name.replace('-', "_")))?;
    let variants = schema["oneOf"].as_array().into_iter().flatten();
    let mut variants = variants.filter(|variant| variant["properties"]["kind"]["const"] == name);
    let variant = variants.next().ok_or("a law without a schema")?;
    let mut keys: Map<String, Value> = [Some(variant), definition(variant, schema)]
        .into_iter()
        .flatten()
        .filter_map(|table| table["properties"].as_object())
        .flatten()
        .map(|(key, value)| (key.clone(), value.clone()))
        .collect();
    keys.remove("kind");
    let stated = serde_json::to_value(spec)?;
    let stated: String = keys.keys().map(|key| format!(", {key} = {}", stated[key])).collect();
    let mut section = format!("\n## {name}\n{}", shown(&source.docs_of_structure()?));
    let mut facts = match law.energy_kpa(&Tensor::zeros()) {
        Some(_) => "Its stress derives from an energy.".to_owned(),
        None => "It has no energy.".to_owned(),
    };
    if law.as_secant().is_some() {
        facts += " Viscoelastic tissue may have it.";
    }
    section += &format!("\n{facts}\n");
    section += &format!(
        "\n```toml\n[[material]]\nyoung_kpa = {:?}\npoisson = {:?}\nlaw = {{ kind = \"{name}\"{stated} }}\n```\n",
        MATERIAL[0], MATERIAL[1]
    );
    section += &format!("\n![Nominal stress of a bar against its engineering strain](laws/{name}.svg)\n");
    if !keys.is_empty() {
        section += &source.key_table(&keys, schema);
    }
    Ok(Entry {
        name,
        summary: description(variant),
        section: section + &source.link(),
    })
}

/// Nominal stress of a bar, kPa, by its elongation.
fn curve(law: &AnyLaw) -> Vec<[f64; 2]> {
    let point = |percent: i32| {
        let elongation = f64::from(percent) / 100.0;
        let strained = |side: f64| Tensor::from_diagonal(&[elongation, side, side].into());
        // The sides move until they are free of stress.
        let (mut low, mut high) = (-0.5, 0.5);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if law.stress_kpa(&strained(middle))[(1, 1)] < 0.0 {
                low = middle;
            } else {
                high = middle;
            }
        }
        [elongation, law.stress_kpa(&strained(low))[(0, 0)]]
    };
    ELONGATIONS.map(point).collect()
}
