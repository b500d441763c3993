//! Entities, nodes and elements of Gmsh version 4.1.

use std::collections::HashMap;

use super::elements::{Elements, Membership, Regions};
use super::reader::{Item, Reader};
use super::{CORNERS, Fault, Kind, Nodes};

const OF_VOLUMES: i32 = 3;

/// A volume of the geometry, or its part in a partition.
pub(super) struct Volume {
    membership: Membership,
    /// Number of its physical groups.
    groups: usize,
}

/// Volumes by their tags.
pub(super) type Volumes = HashMap<i32, Volume>;

/// Reads `$Entities`.
pub(super) fn entities(reader: &mut Reader, volumes: &mut Volumes) -> Result<(), Fault> {
    reader.start_data();
    each_entity(reader, volumes, |_, tag| Ok(tag))
}

/// Reads `$PartitionedEntities`: entities, each with its parent entity and its partitions.
pub(super) fn partitioned(reader: &mut Reader, volumes: &mut Volumes) -> Result<(), Fault> {
    reader.start_data();
    reader.size()?;
    let ghosts = reader.count(INT_PAIR)?;
    reader.skip_ints(2 * ghosts)?;
    each_entity(reader, volumes, |reader, tag| {
        let (dimension, parent) = (reader.int()?, reader.int()?);
        ints(reader)?;
        Ok(if dimension == OF_VOLUMES { parent } else { tag })
    })
}

const INT: Item = Item {
    ints: 1,
    sizes: 0,
    floats: 0,
};
const INT_PAIR: Item = Item { ints: 2, ..INT };

/// Reads the counts of points, curves, surfaces and volumes, and the entities. `volume` reads what follows a tag and
/// returns the volume of the geometry to which the entity belongs.
fn each_entity(
    reader: &mut Reader,
    volumes: &mut Volumes,
    volume: impl Fn(&mut Reader, i32) -> Result<i32, Fault>,
) -> Result<(), Fault> {
    let mut counts = [0; 4];
    for (dimension, count) in counts.iter_mut().enumerate() {
        let floats = if dimension == 0 { 3 } else { 6 };
        *count = reader.count(Item {
            ints: 1,
            sizes: 1,
            floats,
        })?;
    }
    for (dimension, count) in counts.into_iter().enumerate() {
        for _ in 0..count {
            let tag = reader.int()?;
            let volume = volume(reader, tag)?;
            reader.skip_floats(if dimension == 0 { 3 } else { 6 })?;
            let groups = ints(reader)?;
            // Bounding entities, which a point lacks.
            if dimension > 0 {
                ints(reader)?;
            }
            if dimension == OF_VOLUMES as usize {
                volumes.insert(
                    tag,
                    Volume {
                        membership: Membership::new(groups.first().copied(), volume),
                        groups: groups.len(),
                    },
                );
            }
        }
    }
    Ok(())
}

/// Reads a count and that many ints.
fn ints(reader: &mut Reader) -> Result<Vec<i32>, Fault> {
    let count = reader.count(INT)?;
    (0..count).map(|_| reader.int()).collect()
}

/// Reads `$Nodes`, which starts at `section`.
pub(super) fn nodes(reader: &mut Reader, section: usize) -> Result<Nodes, Fault> {
    const NODE: Item = Item {
        ints: 0,
        sizes: 1,
        floats: 3,
    };
    reader.start_data();
    let (blocks, counts_end) = (reader.size()?, reader.cursor.at);
    let total = reader.count(NODE)?;
    // The least and the greatest tag.
    reader.skip_sizes(2)?;
    let mut nodes = Vec::with_capacity(total);
    for _ in 0..blocks {
        let start = reader.cursor.at;
        let (dimension, _, parametric) = (reader.int()?, reader.int()?, reader.int()?);
        let parameters = match (dimension, parametric) {
            (0..=OF_VOLUMES, 0) => 0,
            (0..=OF_VOLUMES, 1) => dimension as usize,
            _ => {
                let found = format!("dimension {dimension}, parametric {parametric}");
                return Err(Fault::at(start, found, "a dimension from 0 to 3, and 0 or 1"));
            }
        };
        let count = reader.count(NODE)?;
        let tags: Vec<u64> = (0..count).map(|_| reader.size()).collect::<Result<_, _>>()?;
        for tag in tags {
            nodes.push((tag, reader.position(tag)?));
            reader.skip_floats(parameters)?;
        }
    }
    sum(counts_end, "nodes", nodes.len(), total)?;
    Nodes::new(nodes, section)
}

/// Reads `$Elements`.
pub(super) fn elements(
    reader: &mut Reader,
    nodes: &Nodes,
    volumes: &Volumes,
    regions: Regions,
) -> Result<Elements, Fault> {
    reader.start_data();
    let (blocks, counts_end) = (reader.size()?, reader.cursor.at);
    // At least a tag and a node each.
    let total = reader.count(Item {
        ints: 0,
        sizes: 2,
        floats: 0,
    })?;
    reader.skip_sizes(2)?;
    let mut elements = Elements::new(regions);
    for _ in 0..blocks {
        let start = reader.cursor.at;
        let (dimension, entity) = (reader.int()?, reader.int()?);
        let kind_start = reader.cursor.at;
        let kind = Kind::usable(reader.int()?, kind_start)?;
        let count = reader.count(Item {
            ints: 0,
            sizes: 1 + kind.nodes,
            floats: 0,
        })?;
        if !kind.is_tetrahedron() {
            reader.skip_sizes(count * (1 + kind.nodes))?;
            elements.skipped += count;
            continue;
        }
        if dimension != OF_VOLUMES {
            let found = format!("tetrahedra on an entity of dimension {dimension}");
            return Err(Fault::at(start, found, "tetrahedra in volumes, of dimension 3"));
        }
        let volume = volumes.get(&entity);
        let membership = volume.map_or(Membership::new(None, entity), |volume| volume.membership);
        for _ in 0..count {
            reader.size()?;
            let mut corners = [0; CORNERS];
            for corner in &mut corners {
                let tag_start = reader.cursor.at;
                *corner = nodes.index(reader.size()?, tag_start)?;
            }
            reader.skip_sizes(kind.further_nodes())?;
            elements.curved += usize::from(kind.further_nodes() > 0);
            elements.push(corners, membership);
        }
        elements.further_groups += count * volume.map_or(0, |volume| volume.groups.saturating_sub(1));
    }
    sum(counts_end, "elements", elements.corners.len() + elements.skipped, total)?;
    Ok(elements)
}

/// Checks that the items of the blocks add up to the total given before them, at `offset`.
fn sum(offset: usize, what: &str, found: usize, stated: usize) -> Result<(), Fault> {
    if found == stated {
        Ok(())
    } else {
        Err(Fault::at(
            offset,
            format!("{found} {what} in the blocks"),
            format!("{stated}"),
        ))
    }
}
