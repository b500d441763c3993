//! Every real image and mesh file in the shared data loads as its manifest says or fails with a clear message, and no
//! file, however broken, makes a parser panic or take memory that its data do not fill.

mod broken;
#[cfg(unix)]
mod hostile;
mod meshes;
mod sequences;
mod volumes;

use insonify_testing::shared as data;
