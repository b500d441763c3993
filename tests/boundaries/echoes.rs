//! What naga reads in the shader of radio-frequency echoes against what its pass declares.

use std::collections::BTreeMap;
use std::mem::offset_of;

use insonify_gpu::Access;
use insonify_imaging::rf::device::{BIN, EchoParams, INVOCATIONS, OWN, SHADER, STORAGE};
use naga::valid::{Capabilities, ValidationFlags, Validator};
use naga::{AddressSpace, StorageAccess};

use super::shaders::block_of;

#[test]
fn the_pass_of_echoes_is_that_declared() {
    let module =
        naga::front::wgsl::parse_str(SHADER).unwrap_or_else(|error| panic!("{}", error.emit_to_string(SHADER)));
    let checked = Validator::new(ValidationFlags::all(), Capabilities::empty()).validate(&module);
    assert!(checked.is_ok(), "{:?}", checked.err());
    let entries: Vec<_> = module
        .entry_points
        .iter()
        .map(|entry| (&*entry.name, entry.workgroup_size))
        .collect();
    assert_eq!(entries, [("echoes", [INVOCATIONS as u32, 1, 1])]);
    let bound = module
        .global_variables
        .iter()
        .filter_map(|(_, variable)| Some((variable.binding?.binding, variable.space)));
    let bound: BTreeMap<u32, AddressSpace> = bound.collect();
    assert_eq!(bound.len(), 1 + STORAGE.len());
    for (number, access) in (0..).zip([Access::Read].iter().chain(&STORAGE)) {
        let access = match access {
            Access::Read => StorageAccess::LOAD,
            Access::Write => StorageAccess::LOAD | StorageAccess::STORE,
        };
        assert_eq!(bound[&number], AddressSpace::Storage { access }, "binding {number}");
    }
    let (members, span) = block_of(&module);
    assert_eq!((members.len(), span), (7, size_of::<EchoParams>()));
    for (name, offset) in [
        ("lines", offset_of!(EchoParams, lines)),
        ("samples", offset_of!(EchoParams, samples)),
        ("length", offset_of!(EchoParams, length)),
        ("rows", offset_of!(EchoParams, rows)),
        ("ahead", offset_of!(EchoParams, ahead)),
        ("first", offset_of!(EchoParams, first)),
        ("count", offset_of!(EchoParams, count)),
    ] {
        assert_eq!(members.get(name), Some(&offset), "{name}");
    }
    for (name, value) in [("BIN", BIN), ("OWN", OWN)] {
        assert!(SHADER.contains(&format!("const {name} = {value}u;")), "{name}");
    }
}
