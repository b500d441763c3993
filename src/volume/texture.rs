//! tmp
/// t
#[derive(Clone, Debug)]
pub struct SolidTexture;
