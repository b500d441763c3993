//! Captions in capitals of 3 x 5 dots.

/// Side of a dot, pixels.
const DOT: usize = 2;

/// Height of a caption with its margins, pixels.
pub(crate) const HEIGHT: usize = 9 * DOT;

/// Five rows of three dots from the top, the leftmost dot in the highest bit of each octal digit.
fn glyph(letter: char) -> u16 {
    match letter {
        'a' => 0o25755,
        'b' => 0o65656,
        'c' => 0o34443,
        'd' => 0o65556,
        'e' => 0o74647,
        'f' => 0o74644,
        'g' => 0o34553,
        'h' => 0o55755,
        'i' => 0o72227,
        'j' => 0o11152,
        'k' => 0o55655,
        'l' => 0o44447,
        'm' => 0o57755,
        'n' => 0o65555,
        'o' => 0o25552,
        'p' => 0o65644,
        'q' => 0o25563,
        'r' => 0o65655,
        's' => 0o34216,
        't' => 0o72222,
        'u' => 0o55557,
        'v' => 0o55552,
        'w' => 0o55575,
        'x' => 0o55255,
        'y' => 0o55222,
        'z' => 0o71247,
        _ => 0,
    }
}

/// Writes `text` (lower case) in white with its upper left dot at `at` on a grey picture of `width` columns.
pub(crate) fn write(pixels: &mut [u8], width: usize, at: [usize; 2], text: &str) {
    for (place, letter) in text.chars().enumerate() {
        for dot in (0..15).filter(|dot| glyph(letter) >> (14 - dot) & 1 == 1) {
            let left = at[0] + (place * 4 + dot % 3) * DOT;
            let top = at[1] + dot / 3 * DOT;
            for row in top..top + DOT {
                pixels[row * width + left..][..DOT].fill(255);
            }
        }
    }
}
