//! Readers of external file formats. They return plain arrays of samples (for PNG and JPEG pictures: a decoder), and what a file says about them.

mod chromaticities;
pub mod coded;
pub mod colours;
pub mod fault;
pub mod heightmap;
mod jpeg;
pub mod openexr;
