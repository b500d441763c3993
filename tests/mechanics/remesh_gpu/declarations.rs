//! Declarations of the passes of remeshing against what naga reads in their shader.

use std::collections::BTreeMap;
use std::mem::offset_of;

use insonify_gpu::Access;
use insonify_mechanics::remesh_gpu::tiles::{ALL, MAX_RANK, SHADER, SHADER_F64, SIDE, TileParams};
use naga::valid::{Capabilities, GlobalUse, ModuleInfo, ValidationFlags, Validator};
use naga::{AddressSpace, Module, StorageAccess};

use insonify_testing::shader::block_of;

fn parse(shader: &str, capabilities: Capabilities) -> (Module, ModuleInfo) {
    let module =
        naga::front::wgsl::parse_str(shader).unwrap_or_else(|error| panic!("{}", error.emit_to_string(shader)));
    let info = Validator::new(ValidationFlags::all(), capabilities)
        .validate(&module)
        .unwrap_or_else(|error| panic!("{}", error.emit_to_string(shader)));
    (module, info)
}

#[test]
fn the_passes_of_remeshing_are_those_declared() {
    let (plain, _) = parse(SHADER, Capabilities::empty());
    let (module, info) = parse(SHADER_F64, Capabilities::FLOAT64);
    assert_eq!(module.entry_points.len(), ALL.len());
    assert_eq!(plain.entry_points.len(), ALL.len() - 1, "without the one in f64");
    for pass in ALL {
        let place = module.entry_points.iter().position(|entry| entry.name == pass.entry);
        let place = place.unwrap_or_else(|| panic!("no entry point {}", pass.entry));
        assert_eq!(
            module.entry_points[place].workgroup_size,
            [pass.workgroup, 1, 1],
            "{}",
            pass.entry
        );
        let own = info.get_entry_point(place);
        let mut used: BTreeMap<u32, (AddressSpace, GlobalUse)> = BTreeMap::new();
        for (handle, variable) in module.global_variables.iter() {
            let Some(binding) = variable.binding.filter(|_| !own[handle].is_empty()) else {
                continue;
            };
            assert!(
                used.insert(binding.binding, (variable.space, own[handle])).is_none(),
                "{}: binding {} is used twice",
                pass.entry,
                binding.binding
            );
        }
        let numbers: Vec<u32> = used.keys().copied().collect();
        let declared: Vec<u32> = (0..=pass.storage.len() as u32).collect();
        assert_eq!(numbers, declared, "{}", pass.entry);
        for (number, access) in (1..).zip(pass.storage) {
            let (space, usage) = used[&number];
            let expected = match access {
                Access::Read => StorageAccess::LOAD,
                Access::Write => StorageAccess::LOAD | StorageAccess::STORE,
            };
            assert_eq!(
                space,
                AddressSpace::Storage { access: expected },
                "{}: binding {number}",
                pass.entry
            );
            assert_eq!(
                usage.contains(GlobalUse::WRITE),
                *access == Access::Write,
                "{}: binding {number}",
                pass.entry
            );
        }
    }
}

#[test]
fn the_parameters_and_the_tiles_of_remeshing_are_those_of_its_shader() {
    let (module, _) = parse(SHADER, Capabilities::empty());
    let (members, span) = block_of(&module);
    assert_eq!(span, size_of::<TileParams>());
    for (name, offset) in [
        ("size", offset_of!(TileParams, size)),
        ("rank", offset_of!(TileParams, rank)),
        ("stride", offset_of!(TileParams, stride)),
        ("first_tile", offset_of!(TileParams, first_tile)),
        ("tiles", offset_of!(TileParams, tiles)),
        ("rows", offset_of!(TileParams, rows)),
        ("columns", offset_of!(TileParams, columns)),
        ("rows_from", offset_of!(TileParams, rows_from)),
        ("columns_from", offset_of!(TileParams, columns_from)),
        ("add", offset_of!(TileParams, add)),
        ("limit", offset_of!(TileParams, limit)),
    ] {
        assert_eq!(members.get(name), Some(&offset), "{name}");
    }
    assert_eq!(members.len(), 11);
    assert!(SHADER.contains(&format!("const SIDE = {SIDE}u;")));
    assert!(SHADER_F64.contains(&format!("const MAX = {MAX_RANK}u;")));
}
