//! Declarations of a shader, as naga reads them.

use std::collections::BTreeMap;

use insonify_gpu::buffer::SLOT_BYTES;
use naga::{Module, TypeInner};

/// Offsets of the members of a struct of a shader, and its size.
pub fn layout(module: &Module, name: &str) -> Option<(BTreeMap<String, usize>, usize)> {
    let (_, ty) = module.types.iter().find(|(_, ty)| ty.name.as_deref() == Some(name))?;
    let TypeInner::Struct { members, span } = &ty.inner else {
        return None;
    };
    let offsets = members
        .iter()
        .filter_map(|member| Some((member.name.clone()?, member.offset as usize)))
        .collect();
    Some((offsets, *span as usize))
}

/// The struct that a pass binds as its parameter block.
pub fn block_of(module: &Module) -> (BTreeMap<String, usize>, usize) {
    let (_, variable) = module
        .global_variables
        .iter()
        .find(|(_, variable)| variable.binding.is_some_and(|at| at.binding == 0))
        .expect("a parameter block");
    let name = module.types[variable.ty].name.as_deref().expect("a named struct");
    let (members, span) = layout(module, name).expect("a struct");
    assert!(
        span as u64 <= SLOT_BYTES,
        "{name} takes {span} bytes, a slot holds {SLOT_BYTES}"
    );
    (members, span)
}
