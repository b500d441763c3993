//! What naga reads in the shaders against what the passes declare.

use std::collections::BTreeMap;

use insonify_imaging::effects::buffers::Buffer;
use insonify_imaging::effects::pass::{Band, Grid, Pass};
use insonify_imaging::effects::{REGISTRY, Wanted};
use insonify_imaging::synth::tables::Tables;
pub(super) use insonify_testing::shader::{block_of, layout};
use naga::valid::{Capabilities, GlobalUse, ModuleInfo, ValidationFlags, Validator};
use naga::{AddressSpace, Module, StorageAccess};

use super::plans::{Scene, everything, scenes};

pub(super) fn tables(scene: &Scene) -> Tables {
    Tables::new(scene.anatomy.clone(), scene.settings.clone()).expect("tables")
}

/// Every pass of every effect, in all variants that the scenes of these tests bring forth.
pub(super) fn passes() -> Vec<&'static Pass> {
    let mut found: BTreeMap<(&str, &str), &'static Pass> = BTreeMap::new();
    for scene in scenes() {
        let tables = tables(&scene);
        for effect in REGISTRY {
            for pass in (effect.passes)(&tables) {
                found.insert((pass.name, pass.entry), pass);
            }
        }
    }
    found.into_values().collect()
}

/// A parsed and validated shader.
pub(super) fn parse(pass: &Pass) -> (Module, ModuleInfo) {
    let source = pass.source();
    let module = naga::front::wgsl::parse_str(&source)
        .unwrap_or_else(|error| panic!("{}: {}", pass.name, error.emit_to_string(&source)));
    let info = Validator::new(ValidationFlags::all(), Capabilities::empty())
        .validate(&module)
        .unwrap_or_else(|error| panic!("{}: {}", pass.name, error.emit_to_string(&source)));
    (module, info)
}

fn entry(pass: &Pass, module: &Module) -> usize {
    let at = module.entry_points.iter().position(|entry| entry.name == pass.entry);
    at.unwrap_or_else(|| panic!("{}: no entry point {}", pass.name, pass.entry))
}

#[test]
fn every_variant_of_every_pass_is_covered() {
    let names: Vec<_> = passes().iter().map(|pass| (pass.name, pass.entry)).collect();
    for expected in [
        ("shadow_loss", "tissue"),
        ("shadow_loss", "tissue_and_needle"),
        ("shadow", "penumbra"),
        ("speckle_axial", "axial_pass"),
        ("tone", "by_hand"),
        ("tone", "automatic"),
    ] {
        assert!(names.contains(&expected), "{expected:?} is not among {names:?}");
    }
    assert!(names.len() >= REGISTRY.len() + 4);
}

#[test]
fn bindings_are_those_declared() {
    for pass in passes() {
        let (module, info) = parse(pass);
        let own = info.get_entry_point(entry(pass, &module));
        let mut used: BTreeMap<u32, (AddressSpace, GlobalUse)> = BTreeMap::new();
        for (handle, variable) in module.global_variables.iter() {
            let Some(binding) = variable.binding.filter(|_| !own[handle].is_empty()) else {
                continue;
            };
            assert_eq!(binding.group, 0, "{}: {:?}", pass.name, variable.name);
            let twice = used.insert(binding.binding, (variable.space, own[handle]));
            assert!(
                twice.is_none(),
                "{}: binding {} is used twice",
                pass.name,
                binding.binding
            );
        }
        let numbers: Vec<u32> = used.keys().copied().collect();
        let declared: Vec<u32> = (0..=pass.bindings.len() as u32).collect();
        assert_eq!(numbers, declared, "{}: bindings used, bindings declared", pass.name);
        let access = StorageAccess::LOAD;
        assert_eq!(used[&0].0, AddressSpace::Storage { access }, "{}: binding 0", pass.name);
        for (number, &(resource, how)) in (1..).zip(pass.bindings) {
            let place = format!("{}: binding {number}, {resource:?}", pass.name);
            let (space, usage) = used[&number];
            let expected = if how.writes() {
                StorageAccess::LOAD | StorageAccess::STORE
            } else {
                StorageAccess::LOAD
            };
            assert_eq!(space, AddressSpace::Storage { access: expected }, "{place}");
            assert_eq!(
                usage.contains(GlobalUse::WRITE),
                how.writes(),
                "{place}: written or not"
            );
        }
    }
}

#[test]
fn no_resource_is_bound_twice_to_a_pass() {
    for pass in passes() {
        for (at, (resource, _)) in pass.bindings.iter().enumerate() {
            assert!(
                pass.bindings[..at].iter().all(|(other, _)| other != resource),
                "{}: {resource:?}",
                pass.name
            );
        }
    }
}

/// Buffers are told apart by their names.
#[test]
fn buffers_have_names_of_their_own() {
    let mut names: BTreeMap<&str, &Buffer> = BTreeMap::new();
    let bound = passes()
        .into_iter()
        .flat_map(|pass| pass.bindings)
        .map(|(buffer, _)| *buffer);
    let own = REGISTRY.iter().flat_map(|effect| effect.buffers.iter().copied());
    for buffer in bound.chain(own) {
        let known = *names.entry(buffer.name).or_insert(buffer);
        assert!(std::ptr::eq(known, buffer), "two buffers have the name {buffer:?}");
    }
    assert!(names.len() >= 30, "{names:?}");
}

/// What no other effect binds is listed by its effect, which renews it when its tables change.
#[test]
fn effects_list_the_buffers_that_they_alone_bind() {
    let scene = everything();
    let tables = tables(&scene);
    for effect in REGISTRY {
        for buffer in effect.buffers {
            for other in REGISTRY.iter().filter(|other| other.name != effect.name) {
                let mut bindings = (other.passes)(&tables).into_iter().flat_map(|pass| pass.bindings);
                assert!(
                    bindings.all(|(bound, _)| bound != buffer),
                    "{} binds {buffer:?} of {}",
                    other.name,
                    effect.name
                );
            }
        }
    }
}

#[test]
fn workgroups_cover_the_work_and_no_more() {
    let mut checked = 0;
    for scene in scenes() {
        let tables = tables(&scene);
        let band = Band {
            first_row: 0,
            rows: tables.height() as u32,
        };
        for effect in REGISTRY
            .iter()
            .filter(|effect| matches!((effect.wanted)(&tables), Wanted::Yes(_)))
        {
            for pass in (effect.passes)(&tables) {
                let (module, _) = parse(pass);
                let [size, one, also_one] = module.entry_points[entry(pass, &module)].workgroup_size;
                assert_eq!((one, also_one), (1, 1), "{}", pass.name);
                let [x, y, z] = pass.grid.workgroups(&tables, band);
                let work = work(pass.grid, &tables);
                let place = format!(
                    "{} of {}: {x} x {y} x {z} groups of {size} for {work:?}",
                    pass.name, scene.name
                );
                assert_eq!((u64::from(y), u64::from(z)), (work[1], work[2]), "{place}");
                let invocations = u64::from(x) * u64::from(size);
                assert!(
                    invocations >= work[0] && invocations < work[0] + u64::from(size),
                    "{place}"
                );
                assert!([x, y, z].iter().all(|&groups| groups <= 65_535), "{place}");
                checked += 1;
            }
        }
    }
    assert!(checked > 60, "{checked}");
}

/// Invocations that a grid has along x, and groups along y and z.
fn work(grid: Grid, tables: &Tables) -> [u64; 3] {
    let (lines, samples) = (tables.lines() as u64, tables.samples() as u64);
    let (width, height) = (tables.width() as u64, tables.height() as u64);
    match grid {
        Grid::Samples => [samples, lines, 1],
        // One group a scanline, or what else a number of groups stands for, however many samples.
        Grid::Scanlines => [256, lines, 1],
        Grid::Workgroups(count) => {
            let [y, z] = count(tables).map(u64::from);
            [256, y, z]
        }
        Grid::FineSamples(count) | Grid::Looks(count) | Grid::FineLooks(count) => [samples, count(tables) as u64, 1],
        Grid::Pixels => [width, height, 1],
        Grid::Words => [tables.words_per_row() as u64, height, 1],
        Grid::Shared(groups) => [64 * u64::from(groups), 1, 1],
    }
}

#[test]
fn rows_of_tables_have_the_layout_of_their_structs() {
    use insonify_anatomy::volume::texture::AtlasEntry;
    use insonify_imaging::synth::tables::LabelRow;
    use std::mem::offset_of;
    let expected: [(&str, usize, &[(&str, usize)]); 2] = [
        (
            "LabelRow",
            size_of::<LabelRow>(),
            &[
                ("echo", offset_of!(LabelRow, echo)),
                ("impedance", offset_of!(LabelRow, impedance)),
                ("loss", offset_of!(LabelRow, loss)),
                ("attenuation", offset_of!(LabelRow, attenuation)),
                ("texture", offset_of!(LabelRow, texture)),
            ],
        ),
        (
            "TextureEntry",
            size_of::<AtlasEntry>(),
            &[
                ("to_voxel_x", offset_of!(AtlasEntry, to_voxel)),
                ("to_voxel_y", offset_of!(AtlasEntry, to_voxel) + 16),
                ("to_voxel_z", offset_of!(AtlasEntry, to_voxel) + 32),
                ("size", offset_of!(AtlasEntry, size)),
                ("offset", offset_of!(AtlasEntry, offset)),
            ],
        ),
    ];
    let mut found = 0;
    for pass in passes() {
        let (module, _) = parse(pass);
        for (name, size, members) in expected {
            let Some((layout, span)) = layout(&module, name) else {
                continue;
            };
            assert_eq!(span, size, "{}: {name}", pass.name);
            for (member, offset) in members {
                assert_eq!(layout.get(*member), Some(offset), "{}: {name}.{member}", pass.name);
            }
            found += 1;
        }
    }
    assert!(found >= 5, "{found}");
}
