//! Nodes and elements of Gmsh version 2.2.

use super::elements::{Elements, Membership, Regions};
use super::reader::{Item, Reader};
use super::{CORNERS, Fault, Kind, Nodes, quote};

/// Reads a count in text, which binary data follow.
fn count(reader: &mut Reader, item: Item) -> Result<usize, Fault> {
    let (start, word) = reader.cursor.peek();
    let count = reader.cursor.count()?;
    reader.start_data();
    let count = u64::try_from(count).map_err(|_| Fault::at(start, quote(word), "a count"))?;
    reader.room(start, count, item)
}

/// Reads a tag: a whole number from 0.
fn tag(reader: &mut Reader) -> Result<u64, Fault> {
    let start = reader.cursor.at;
    let tag = reader.int()?;
    u64::try_from(tag).map_err(|_| Fault::at(start, format!("the tag {tag}"), "a whole number from 0"))
}

/// Reads `$Nodes`, which starts at `section`.
pub(super) fn nodes(reader: &mut Reader, section: usize) -> Result<Nodes, Fault> {
    let count = count(
        reader,
        Item {
            ints: 1,
            floats: 3,
            ..Item::default()
        },
    )?;
    let mut nodes = Vec::with_capacity(count);
    for _ in 0..count {
        let tag = tag(reader)?;
        nodes.push((tag, reader.position(tag)?));
    }
    Nodes::new(nodes, section)
}

/// Reads `$Elements`.
pub(super) fn elements(reader: &mut Reader, nodes: &Nodes, regions: Regions) -> Result<Elements, Fault> {
    // At least a tag and a node each.
    let count = count(
        reader,
        Item {
            ints: 2,
            ..Item::default()
        },
    )?;
    let mut elements = Elements::new(regions);
    let mut read = 0;
    while read < count {
        let start = reader.cursor.at;
        let block = if reader.is_binary() {
            Block::binary(reader)?
        } else {
            reader.int()?;
            Block::ascii(reader)?
        };
        if block.elements > count - read {
            let found = format!("a block of {} elements after {read}", block.elements);
            return Err(Fault::at(start, found, format!("{count} in all")));
        }
        read += block.elements;
        block.read(reader, nodes, &mut elements)?;
    }
    Ok(elements)
}

/// Elements of one type: in text one, after its tag; in binary any number, each with its tag.
struct Block {
    kind: &'static Kind,
    elements: usize,
    tags: usize,
}

impl Block {
    fn ascii(reader: &mut Reader) -> Result<Block, Fault> {
        let kind = Self::kind(reader)?;
        let tags = Self::length(reader, 1)?;
        Ok(Block {
            kind,
            elements: 1,
            tags,
        })
    }

    fn binary(reader: &mut Reader) -> Result<Block, Fault> {
        let kind = Self::kind(reader)?;
        let start = reader.cursor.at;
        let elements = Self::length(reader, 1 + kind.nodes)?;
        let tags = Self::length(reader, 1)?;
        if elements == 0 {
            return Err(Fault::at(start, "a block of no elements", "at least one"));
        }
        let ints = tags.saturating_add(1 + kind.nodes);
        reader.room(
            start,
            elements as u64,
            Item {
                ints,
                ..Item::default()
            },
        )?;
        Ok(Block { kind, elements, tags })
    }

    fn kind(reader: &mut Reader) -> Result<&'static Kind, Fault> {
        let start = reader.cursor.at;
        Kind::usable(reader.int()?, start)
    }

    /// Reads a count of items of a given number of integers.
    fn length(reader: &mut Reader, ints: usize) -> Result<usize, Fault> {
        let start = reader.cursor.at;
        let count = tag(reader)?;
        reader.room(
            start,
            count,
            Item {
                ints,
                ..Item::default()
            },
        )
    }

    fn read(&self, reader: &mut Reader, nodes: &Nodes, elements: &mut Elements) -> Result<(), Fault> {
        for _ in 0..self.elements {
            if reader.is_binary() {
                reader.int()?;
            }
            if !self.kind.is_tetrahedron() {
                reader.skip_ints(self.tags + self.kind.nodes)?;
                elements.skipped += 1;
                continue;
            }
            let membership = self.membership(reader)?;
            let mut corners = [0; CORNERS];
            for corner in &mut corners {
                let start = reader.cursor.at;
                *corner = nodes.index(tag(reader)?, start)?;
            }
            reader.skip_ints(self.kind.further_nodes())?;
            elements.curved += usize::from(self.kind.further_nodes() > 0);
            elements.push_first(corners, membership);
        }
        Ok(())
    }

    /// Reads the tags of an element: physical group (0: none), volume, and any others.
    fn membership(&self, reader: &mut Reader) -> Result<Membership, Fault> {
        let mut tags = [0; 2];
        for index in 0..self.tags {
            let tag = reader.int()?;
            if let Some(known) = tags.get_mut(index) {
                *known = tag;
            }
        }
        let [group, volume] = tags;
        Ok(Membership::new(Some(group).filter(|group| *group != 0), volume))
    }
}
