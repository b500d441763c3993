//! Tetrahedra of a Gmsh file, and their regions.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use super::names::Names;
use super::{CORNERS, Fault, ReadOptions};

/// Source of the regions.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Regions {
    /// First physical group, or the volume where there is none.
    Groups,
    /// Volume of the geometry.
    Volumes,
}

impl Regions {
    pub(super) fn chosen(options: &ReadOptions) -> Result<Regions, Fault> {
        const GROUPS: &str = "gmsh:physical";
        const VOLUMES: &str = "gmsh:geometrical";
        if let Some(name) = options.displacement {
            let expected = format!("a point array `{name}`, which only VTK files can hold");
            return Err(Fault::of_file("a Gmsh mesh", expected));
        }
        match options.region {
            None | Some(GROUPS) => Ok(Regions::Groups),
            Some(VOLUMES) => Ok(Regions::Volumes),
            Some(name) => {
                let found = format!("a Gmsh mesh, which has the regions `{GROUPS}` and `{VOLUMES}`");
                Err(Fault::of_file(found, format!("a cell array `{name}`")))
            }
        }
    }
}

/// Groups and volume of a tetrahedron.
#[derive(Clone, Copy)]
pub(super) struct Membership {
    /// First physical group.
    group: Option<i32>,
    /// Volume of the geometry.
    volume: i32,
}

impl Membership {
    /// Drops the sign of a group, which denotes an orientation.
    pub(super) fn new(group: Option<i32>, volume: i32) -> Membership {
        let group = group.and_then(i32::checked_abs);
        Membership { group, volume }
    }
}

/// The tetrahedra of a file.
pub(super) struct Elements {
    chosen: Regions,
    pub corners: Vec<[u32; CORNERS]>,
    pub regions: Vec<i32>,
    /// Number of vertices, lines and surfaces.
    pub skipped: usize,
    /// Number of tetrahedra that have nodes beside their corners.
    pub curved: usize,
    groups: BTreeSet<i32>,
    volumes: BTreeSet<i32>,
    /// Number of memberships of tetrahedra in groups beyond their first.
    pub further_groups: usize,
    first_groups: HashMap<[u32; CORNERS], Option<i32>>,
}

impl Elements {
    pub(super) fn new(chosen: Regions) -> Elements {
        Elements {
            chosen,
            corners: Vec::new(),
            regions: Vec::new(),
            skipped: 0,
            curved: 0,
            groups: BTreeSet::new(),
            volumes: BTreeSet::new(),
            further_groups: 0,
            first_groups: HashMap::new(),
        }
    }

    pub(super) fn push(&mut self, corners: [u32; CORNERS], membership: Membership) {
        let group = membership.group.filter(|_| self.chosen == Regions::Groups);
        self.corners.push(corners);
        self.regions.push(group.unwrap_or(membership.volume));
        match group {
            Some(group) => self.groups.insert(group),
            None => self.volumes.insert(membership.volume),
        };
    }

    /// Adds a tetrahedron as [`Elements::push`] does, for files that repeat it for each of its groups: the first is
    /// kept. One repeated in the same group is a fault of the mesh and is kept too.
    pub(crate) fn push_first(&mut self, corners: [u32; CORNERS], membership: Membership) {
        if *self.first_groups.entry(corners).or_insert(membership.group) == membership.group {
            self.push(corners, membership);
        } else {
            self.further_groups += 1;
        }
    }

    /// Returns the names of the groups that are regions.
    pub(super) fn names(&self, names: Names) -> BTreeMap<i32, String> {
        names
            .into_iter()
            .filter(|(group, _)| self.groups.contains(group))
            .collect()
    }

    /// Returns warnings about regions that a user may not expect.
    pub(super) fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        if self.further_groups > 0 && self.chosen == Regions::Groups {
            warnings.push(format!(
                "tetrahedra are in several physical groups ({} times in a further one); the first is their region",
                self.further_groups
            ));
        }
        for both in self.groups.intersection(&self.volumes) {
            warnings.push(format!(
                "region {both} is physical group {both} together with volume {both}, which is in no group"
            ));
        }
        warnings
    }
}
