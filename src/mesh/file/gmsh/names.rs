//! Names of the physical groups of a Gmsh file.

use std::collections::BTreeMap;

use super::reader::{Reader, quoted};
use super::{Fault, quote};

/// Names of the groups of volumes, by number.
pub(super) type Names = BTreeMap<i32, String>;

const OF_VOLUMES: i32 = 3;

/// Reads `$PhysicalNames`, which is text in binary files too.
pub(super) fn read(reader: &mut Reader) -> Result<Names, Fault> {
    let cursor = &mut reader.cursor;
    let mut names = Names::new();
    let number = || "a whole number of 32 bits".to_owned();
    for _ in 0..cursor.count()? {
        let (start, word) = cursor.peek();
        let dimension: i32 = cursor.number(number)?;
        if !(0..=OF_VOLUMES).contains(&dimension) {
            return Err(Fault::at(start, quote(word), "a dimension from 0 to 3"));
        }
        let group: i32 = cursor.number(number)?;
        let name = quoted(cursor)?;
        if dimension == OF_VOLUMES {
            names.insert(group, name);
        }
    }
    Ok(names)
}
