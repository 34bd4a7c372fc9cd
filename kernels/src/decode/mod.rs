//! Readers of external file formats; they return plain arrays.

mod chromaticities;
pub mod coded;
pub mod colours;
pub mod fault;
pub mod heightmap;
mod jpeg;
pub mod openexr;
