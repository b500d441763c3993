//! Suggestions for misspelt words of a file.

/// Minimum similarity (Jaro-Winkler, 0 to 1) at which a word is suggested: letters swapped, one wrong or an ending left
/// out.
const SIMILAR: f64 = 0.8;

/// Returns the candidate most similar to a word, if any is similar enough.
pub(crate) fn nearest<'a>(word: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    // Similarity takes time proportional to the product of the lengths: no key is as long as what a broken file may
    // contain.
    let short: String = word.chars().take(60).collect();
    let scored = candidates.into_iter().map(|candidate| {
        (
            strsim::jaro_winkler(&short.to_lowercase(), &candidate.to_lowercase()),
            candidate,
        )
    });
    scored
        .filter(|(score, _)| *score >= SIMILAR)
        .reduce(|best, next| if next.0 > best.0 { next } else { best })
        .map(|(_, candidate)| candidate)
}

/// Extracts the key and the known keys from serde's message about an unknown field.
pub(super) fn unknown_field(message: &str) -> Option<(String, Vec<String>)> {
    unknown(message, "unknown field `")
}

/// Suggests a name for serde's message about an unknown variant.
pub(super) fn unknown_variant(message: &str) -> Option<String> {
    let (found, known) = unknown(message, "unknown variant `")?;
    nearest(&found, known.iter().map(String::as_str)).map(|meant| format!("did you mean \"{meant}\"?"))
}

fn unknown(message: &str, start: &str) -> Option<(String, Vec<String>)> {
    let rest = message.strip_prefix(start)?;
    let end = rest.find("`, ")?;
    let known = rest[end + 3..]
        .split('`')
        .skip(1)
        .step_by(2)
        .map(str::to_owned)
        .collect();
    Some((rest[..end].to_owned(), known))
}

/// Help for an unknown key: a similar key of the same table, the table where a key of that name belongs, or all
/// known keys.
pub(super) fn for_key(key: &str, known: &[String], home: impl FnOnce() -> Option<String>) -> Option<String> {
    let similar = nearest(key, known.iter().map(String::as_str)).map(|meant| format!("did you mean `{meant}`?"));
    let all = || (!known.is_empty()).then(|| format!("known here: {}", known.join(", ")));
    similar.or_else(home).or_else(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slips_are_recognised_and_strangers_are_not() {
        let keys = ["depth_mm", "width_mm", "frequency_mhz"];
        assert_eq!(nearest("depht_mm", keys), Some("depth_mm"));
        assert_eq!(nearest("frequency", keys), Some("frequency_mhz"));
        assert_eq!(nearest("Width_mm", keys), Some("width_mm"));
        assert_eq!(nearest("colour", keys), None);
    }

    #[test]
    fn messages_of_serde_are_understood() {
        let found = unknown_field("unknown field `a`, expected one of `b`, `c`, `d`");
        assert_eq!(found, Some(("a".into(), vec!["b".into(), "c".into(), "d".into()])));
        assert_eq!(
            unknown_field("unknown field `a`, expected `b` or `c`").map(|f| f.1.len()),
            Some(2)
        );
        assert_eq!(unknown_field("missing field `a`"), None);
    }

    #[test]
    fn an_unknown_key_is_corrected_or_sent_home_or_told_what_is_known() {
        let help = |key, home: Option<&str>| for_key(key, &["width".into()], || home.map(str::to_owned));
        assert_eq!(help("widht", Some("there")).as_deref(), Some("did you mean `width`?"));
        assert_eq!(help("depth", Some("there")).as_deref(), Some("there"));
        assert_eq!(help("depth", None).as_deref(), Some("known here: width"));
    }
}
