//! Computes the masks of tiles on the CPU: the reference for both shaders of the classification pass.

use crate::classification::{TILE, tiles};

/// Returns, for every tile of 8 x 8 pixels, row by row, the OR of the masks of its terrain pixels; 0 = no terrain pixel. `mask` and `terrain` have
/// one entry per pixel; `forced`, if given, replaces the mask of every terrain pixel.
pub fn tile_masks(size: [u32; 2], mask: &[u8], terrain: &[bool], forced: Option<u8>) -> Vec<u8> {
    let [columns, rows] = tiles(size);
    let mut out = vec![0; (columns * rows) as usize];
    for y in 0..size[1] {
        for x in 0..size[0] {
            let pixel = (y * size[0] + x) as usize;
            if terrain[pixel] {
                out[(y / TILE * columns + x / TILE) as usize] |= forced.unwrap_or(mask[pixel]);
            }
        }
    }
    out
}
