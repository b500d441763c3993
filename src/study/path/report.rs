pub const FILES: &[&str] = &[];
