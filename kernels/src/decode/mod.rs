//! Readers of the file formats of other programs. They return arrays of samples, and what the file says about the samples. For PNG and JPEG
//! pictures, they return a decoder instead of samples.

mod chromaticities;
pub mod coded;
pub mod colours;
pub mod fault;
pub mod heightmap;
mod jpeg;
pub mod openexr;
