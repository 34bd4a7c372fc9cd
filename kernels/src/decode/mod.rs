//! Readers of external file formats; they return plain arrays.

mod chromaticities;
pub mod colours;
pub mod fault;
pub mod heightmap;
pub mod jpeg;
pub mod openexr;
