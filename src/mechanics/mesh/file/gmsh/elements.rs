//! Tetrahedra and the regions they belong to.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use super::kinds::CORNERS;
use super::names::Names;
use super::{Fault, ReadOptions};

/// What regions are taken from.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Regions {
    /// The first physical group, or the volume where there is none.
    Groups,
    /// The volume of the geometry.
    Volumes,
}

impl Regions {
    pub fn chosen(options: &ReadOptions) -> Result<Regions, Fault> {
        const GROUPS: &str = "gmsh:physical";
        const VOLUMES: &str = "gmsh:geometrical";
        if let Some(name) = options.displacement {
            let expected = format!("a point array `{name}`, which only VTK files can hold");
            return Err(Fault::whole("a Gmsh mesh", expected));
        }
        match options.region {
            None | Some(GROUPS) => Ok(Regions::Groups),
            Some(VOLUMES) => Ok(Regions::Volumes),
            Some(name) => {
                let found = format!("a Gmsh mesh, which has the regions `{GROUPS}` and `{VOLUMES}`");
                Err(Fault::whole(found, format!("a cell array `{name}`")))
            }
        }
    }
}

/// Where a tetrahedron belongs.
#[derive(Clone, Copy)]
pub(super) struct Membership {
    /// Its first physical group.
    group: Option<i32>,
    /// Its volume.
    volume: i32,
}

impl Membership {
    /// The sign of a group tells of an orientation and is left out.
    pub fn new(group: Option<i32>, volume: i32) -> Membership {
        let group = group.and_then(i32::checked_abs);
        Membership { group, volume }
    }
}

/// The tetrahedra of a file.
pub(super) struct Elements {
    chosen: Regions,
    pub corners: Vec<[u32; CORNERS]>,
    pub regions: Vec<i32>,
    /// Vertices, lines and surfaces.
    pub skipped: usize,
    groups: BTreeSet<i32>,
    volumes: BTreeSet<i32>,
    /// How often tetrahedra are in groups beyond their first.
    pub further_groups: usize,
    first_groups: HashMap<[u32; CORNERS], Option<i32>>,
}

impl Elements {
    pub fn new(chosen: Regions) -> Elements {
        Elements {
            chosen,
            corners: Vec::new(),
            regions: Vec::new(),
            skipped: 0,
            groups: BTreeSet::new(),
            volumes: BTreeSet::new(),
            further_groups: 0,
            first_groups: HashMap::new(),
        }
    }

    pub fn push(&mut self, corners: [u32; CORNERS], of: Membership) {
        let group = of.group.filter(|_| self.chosen == Regions::Groups);
        self.corners.push(corners);
        self.regions.push(group.unwrap_or(of.volume));
        match group {
            Some(group) => self.groups.insert(group),
            None => self.volumes.insert(of.volume),
        };
    }

    /// As [`Elements::push`], for files that repeat a tetrahedron for each group that it is in: the first stays. One that
    /// stands twice in the same group is a fault of the mesh and stays, too.
    pub fn push_first(&mut self, corners: [u32; CORNERS], of: Membership) {
        if *self.first_groups.entry(corners).or_insert(of.group) == of.group {
            self.push(corners, of);
        } else {
            self.further_groups += 1;
        }
    }

    /// The names of the groups that are regions.
    pub fn names(&self, names: Names) -> BTreeMap<i32, String> {
        names
            .into_iter()
            .filter(|(group, _)| self.groups.contains(group))
            .collect()
    }

    /// What a user may not expect of the regions.
    pub fn warnings(&self) -> Vec<String> {
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
