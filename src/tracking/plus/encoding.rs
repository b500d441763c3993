//! Encodings of XML text.

/// Text of an XML file in the encodings that PLUS's parser reads: UTF-8, UTF-16, and ISO-8859-1 or ASCII where its
/// first line says so. The error tells what was found instead.
pub(super) fn decoded(bytes: &[u8]) -> Result<String, String> {
    let utf16 = |bytes: &[u8], word: fn([u8; 2]) -> u16| {
        let words: Vec<u16> = bytes.as_chunks().0.iter().map(|pair| word(*pair)).collect();
        String::from_utf16(&words).map_err(|_| "text that is not UTF-16".to_owned())
    };
    match bytes {
        [0xff, 0xfe, rest @ ..] | rest @ [b'<', 0, ..] => return utf16(rest, u16::from_le_bytes),
        [0xfe, 0xff, rest @ ..] | rest @ [0, b'<', ..] => return utf16(rest, u16::from_be_bytes),
        _ => {}
    }
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let declaration = bytes.split(|byte| *byte == b'>').next().unwrap_or_default();
    let declaration = String::from_utf8_lossy(declaration).to_ascii_lowercase();
    let stated = declaration
        .trim_start()
        .starts_with("<?xml")
        .then(|| declaration.split_once("encoding"));
    let stated = stated.flatten().and_then(|(_, rest)| rest.split(['"', '\'']).nth(1));
    match stated {
        Some("iso-8859-1" | "latin1" | "windows-1252" | "us-ascii") => {
            Ok(bytes.iter().map(|byte| char::from(*byte)).collect())
        }
        _ if !bytes.is_ascii() && !bytes.trim_ascii_start().starts_with(b"<") => Err("binary data".to_owned()),
        _ => String::from_utf8(bytes.to_vec()).map_err(|error| {
            let valid = error.utf8_error().valid_up_to();
            format!(
                "text that is not UTF-8 from byte {valid} on (its first line may state another: \
                 `<?xml version=\"1.0\" encoding=\"ISO-8859-1\"?>`)"
            )
        }),
    }
}
