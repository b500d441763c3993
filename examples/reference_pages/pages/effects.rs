//! The page on the effects.

use std::io;

use insonify::imaging::effects::{Effect, EffectsTable, LISTED};
use serde_json::Value;

use super::{Entry, Source, definition, description, folded, page as page_of, shown};

/// The page.
pub(super) fn page() -> io::Result<String> {
    let schema = schemars::schema_for!(EffectsTable).to_value();
    let entries: io::Result<Vec<Entry>> = LISTED.iter().map(|effect| entry(effect, &schema)).collect();
    let lead = folded(
        "What each effect does, its keys, and a frame without it, on the left, and with it. The usual effects act in every \
         scene whose frames they can change; [guide.md](guide.md#one-effect-at-a-time) says which they are. Pictures show one \
         effect beside the tone curve, compounding beside speckle and shadows and the reduction of speckle beside speckle, by \
         the keys above them, some of which exaggerate; here is each, and then all of them together.",
    );
    let lead = format!("{lead}\n![Each effect alone, then all together](effects.png)\n");
    Ok(page_of("Effects", &lead, ["effect", "what it does"], &entries?))
}

fn entry(effect: &Effect, schema: &Value) -> io::Result<Entry> {
    let source = Source::read(format!("src/imaging/effects/{}.rs", effect.name))?;
    let docs = source.docs()?;
    let summary = docs.first().map_or("", |paragraph| after_the_name(paragraph));
    let mut section = format!("\n## {}\n{}", effect.name, shown(&docs));
    if effect.remove.is_none() {
        section += "\nEvery frame has it.\n";
    }
    if !effect.example.is_empty() {
        section += &format!("\n```toml\n{}\n```\n", effect.example);
    }
    if let Some(caption) = caption(effect) {
        section += &format!("\n![{caption}](effects/{}.png)\n", effect.name);
    }
    if let Some(table) = definition(&schema["properties"][effect.name], schema) {
        section += &format!(
            "\n{}",
            folded(&format!("Keys of `effects.{}`. {}", effect.name, description(table)))
        );
        section += &table["properties"]
            .as_object()
            .map_or_else(String::new, |keys| source.key_table(keys, schema));
    }
    Ok(Entry {
        name: effect.name,
        summary: summary.to_owned(),
        section: section + &source.link(),
    })
}

/// Caption of the picture of an effect, if it has one.
fn caption(effect: &Effect) -> Option<&'static str> {
    match effect.name {
        "scan_conversion" => Some("Beam space, a scanline in each column, and the frame made from it"),
        "truth" => Some("The layers of a frame, each from its least value in black to its largest in white"),
        "contact" => Some("The upper part of a frame without the effect, with a gap under the array, and with it"),
        // Every frame has it.
        "slice" => Some("A frame with smooth boundaries, and with these keys"),
        _ if effect.example.is_empty() => None,
        _ => Some("A frame without the effect, and with these keys"),
    }
}

/// A first paragraph without the name of the effect before its colon.
fn after_the_name(paragraph: &str) -> &str {
    paragraph.split_once(": ").map_or(paragraph, |(_, rest)| rest)
}
