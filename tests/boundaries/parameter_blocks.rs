//! Parameter blocks: the same names at the same offsets in Rust and in WGSL.

use std::collections::BTreeSet;

use insonify_imaging::effects::REGISTRY;
use insonify_imaging::effects::pass::{Band, View};
use insonify_testing::shader::block_of;

use super::plans::scenes;
use super::shaders::{parse, tables};
use crate::support::scene;

#[test]
fn blocks_have_the_layout_of_their_structs() {
    let state = &scene::frame_of(&super::plans::everything().anatomy, 0);
    let mut checked = BTreeSet::new();
    for scene in scenes() {
        let tables = &tables(&scene);
        let view = View {
            tables,
            state,
            slab: None,
        };
        for pass in REGISTRY.iter().flat_map(|effect| (effect.passes)(tables)) {
            if !checked.insert((pass.name, pass.entry)) {
                continue;
            }
            let block = (pass.params)(&view, Band { first_row: 0, rows: 1 });
            let (mut members, span) = block_of(&parse(pass).0);
            assert_eq!(span, block.size, "{}: size of the block", pass.name);
            for &(name, offset) in block.members.iter().filter(|(name, _)| *name != "unused") {
                assert_eq!(members.remove(name), Some(offset), "{}: offset of {name}", pass.name);
            }
            members.retain(|name, _| !name.starts_with("unused"));
            assert!(
                members.is_empty(),
                "{}: members of the shader that Rust does not fill: {members:?}",
                pass.name
            );
        }
    }
}
