//! Readers of external file formats; they return plain arrays.

pub mod heightmap;
