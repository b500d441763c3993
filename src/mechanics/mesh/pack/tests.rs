use naga::front::wgsl;
use naga::valid::{Capabilities, ValidationFlags, Validator};

use super::*;
use crate::mechanics::mesh::TetMesh;
use crate::mechanics::mesh::grid::TANGLED;
use crate::mechanics::mesh::locator::MAX_WALK;

const SHADER: &str = include_str!("../../../../shaders/warp.wgsl");

#[test]
fn shader_is_valid_and_its_block_has_the_layout_of_the_struct() {
    let module = wgsl::parse_str(SHADER).unwrap_or_else(|e| panic!("{}", e.emit_to_string(SHADER)));
    Validator::new(ValidationFlags::all(), Capabilities::empty())
        .validate(&module)
        .unwrap_or_else(|e| panic!("{}", e.emit_to_string(SHADER)));
    let members = |name: &str| {
        let (_, ty) = module
            .types
            .iter()
            .find(|(_, ty)| ty.name.as_deref() == Some(name))
            .expect(name);
        match &ty.inner {
            naga::TypeInner::Struct { members, span } => (members.clone(), *span as usize),
            other => panic!("{name} is {other:?}"),
        }
    };
    let (params, span) = members("WarpParams");
    assert_eq!(span, size_of::<WarpParams>());
    let offsets: Vec<usize> = params.iter().map(|m| m.offset as usize).collect();
    use std::mem::offset_of;
    assert_eq!(
        offsets,
        [
            offset_of!(WarpParams, lines),
            offset_of!(WarpParams, samples),
            offset_of!(WarpParams, planes),
            offset_of!(WarpParams, elements),
            offset_of!(WarpParams, carries_at),
            offset_of!(WarpParams, tangled),
            offset_of!(WarpParams, deformed),
            offset_of!(WarpParams, reference),
        ]
    );
    let (grid, span) = members("Grid");
    assert_eq!(span, size_of::<GridParams>());
    let offsets: Vec<usize> = grid.iter().map(|m| m.offset as usize).collect();
    assert_eq!(
        offsets,
        [
            offset_of!(GridParams, origin),
            offset_of!(GridParams, per_mm),
            offset_of!(GridParams, low),
            offset_of!(GridParams, starts_at),
            offset_of!(GridParams, high),
            offset_of!(GridParams, lists_at),
            offset_of!(GridParams, cells),
            offset_of!(GridParams, frames_at),
        ]
    );
}

#[test]
fn shader_uses_the_constants_of_the_locator() {
    for line in [
        format!("const TANGLED: u32 = 0x{TANGLED:x}u;"),
        format!("const MAX_WALK: u32 = {MAX_WALK}u;"),
        format!("const MAPPED: f32 = {:.1};", crate::mechanics::mesh::map::MAPPED as f32),
        format!(
            "const BACKGROUND: f32 = {:.1};",
            crate::mechanics::mesh::map::BACKGROUND as f32
        ),
        format!("const FOLDED: f32 = {:.1};", crate::mechanics::mesh::map::FOLDED as f32),
        format!(
            "const OUTSIDE: f32 = {:.1};",
            crate::mechanics::mesh::map::OUTSIDE as f32
        ),
    ] {
        assert!(SHADER.lines().any(|l| l == line), "warp.wgsl lacks `{line}`");
    }
}

#[test]
fn pieces_stay_within_their_places_however_the_nodes_move() {
    let mesh = TetMesh::over_box([0.0; 3], [10.0; 3], 200).unwrap();
    let capacities = WarpCapacities::of(&mesh);
    let mut states = States::<f32>::new(&mesh);
    let start = params(&states);
    let moved = |stretch: f64| -> Vec<[f64; 3]> {
        let away = |n: &[f64; 3]| [n[0] * stretch - n[1], n[1] * 0.2, n[2] + 500.0];
        mesh.nodes().iter().map(away).collect()
    };
    for (current, reference) in [(1.0, 1.0), (1.7, 1.0), (1.0, 40.0), (900.0, 0.3)] {
        states.update(Some(&moved(current)), Some(&moved(reference))).unwrap();
        let own = params(&states);
        assert_eq!(
            (own.carries_at, own.deformed.lists_at),
            (start.carries_at, start.deformed.lists_at)
        );
        let ends = |pieces: &[Piece], buffer, item| {
            let own = pieces.iter().filter(|piece| piece.buffer == buffer);
            own.map(|piece| (piece.at as usize + piece.bytes.len()) / item)
                .max()
                .unwrap_or(0)
        };
        let (front, behind) = (super::reference(&states), deformed(&states));
        assert!(ends(&front, WarpBuffer::Frames, 16) <= own.deformed.frames_at as usize);
        assert!(ends(&front, WarpBuffer::Starts, 4) <= own.deformed.starts_at as usize);
        assert!(ends(&front, WarpBuffer::Lists, 4) <= own.deformed.lists_at as usize);
        assert_eq!(ends(&behind, WarpBuffer::Frames, 16), capacities.frames);
        assert!(ends(&behind, WarpBuffer::Starts, 4) <= capacities.starts);
        assert!(ends(&behind, WarpBuffer::Lists, 4) <= capacities.lists);
        assert_eq!(
            ends(&[topology(&states)], WarpBuffer::Neighbours, 16),
            capacities.neighbours
        );
    }
}
