//! Files of foreign formats, read into arrays.

pub mod heightmap;
