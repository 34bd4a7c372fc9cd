//! Computes costs under the assumption that all pixels of a tile or patch are shaded in lockstep. Each pixel then costs the fetches of all flavours
//! that occur in its tile or patch.

use std::collections::HashMap;

use kernels::frame::Renderer;
use kernels::quadtree;
use kernels::shading::Estimator;
use kernels::variant::{Flavour, Variant};
use kernels::world::NodeId;

/// The settings that determine the number of fetches of each flavour.
#[derive(Clone, Copy)]
pub(super) struct Prices {
    pub(super) estimator: Estimator,
    pub(super) two_tilings: bool,
}

impl Prices {
    /// Returns the number of fetches that a pixel should take if it is shaded with all flavours of a variant. The additional fetch in scenes with
    /// colour modulation is not included.
    pub(super) fn of(self, variant: Variant) -> u32 {
        let twice = |flavour| self.two_tilings && flavour == Flavour::Splat && self.estimator.has_two_tilings();
        variant.flavours().map(|flavour| self.estimator.promised_fetches(flavour) * if twice(flavour) { 2 } else { 1 }).sum()
    }
}

/// Returns the index of the tile that contains pixel `at`. `tile` is the side of a tile in pixels.
fn tile_of(at: usize, size: [u32; 2], tile: u32) -> usize {
    let (x, y) = (at as u32 % size[0], at as u32 / size[0]);
    (y / tile * size[0].div_ceil(tile) + x / tile) as usize
}

/// Returns the mean cost of terrain pixels. A pixel costs the fetches of all flavours that occur in its tile. `None` if no pixel shows terrain.
pub(super) fn per_tile(masks: &[u8], size: [u32; 2], tile: u32, prices: Prices) -> Option<f64> {
    grouped(masks, prices, |at| tile_of(at, size, tile))
}

/// Returns the set of flavours in the tile of each pixel; 0 if the pixel shows no terrain.
pub(super) fn tile_sets(masks: &[u8], size: [u32; 2], tile: u32) -> Vec<u8> {
    let mut sets = vec![0; (size[0].div_ceil(tile) * size[1].div_ceil(tile)) as usize];
    for (at, mask) in masks.iter().enumerate() {
        sets[tile_of(at, size, tile)] |= mask;
    }
    masks.iter().enumerate().map(|(at, &mask)| if mask == 0 { 0 } else { sets[tile_of(at, size, tile)] }).collect()
}

/// Returns the mean cost of terrain pixels. A pixel costs the fetches of all flavours that occur at visible pixels of its patch of 16 x 16 quads.
/// `None` if no pixel shows terrain.
pub(super) fn per_patch(masks: &[u8], positions: &[[f32; 3]], renderer: &Renderer<'_>, drawn: &[NodeId], prices: Prices) -> Option<f64> {
    let layout = renderer.world().layout();
    let lods = quadtree::lod_map(drawn);
    grouped(masks, prices, |at| {
        let [x, y, _] = positions[at].map(f64::from);
        let place = [x, y].map(|v| (v + layout.world_m() / 2.0) / layout.sector_m);
        let lod = quadtree::lod_at(&lods, place).unwrap_or(0);
        // A node of the quadtree has 8 x 8 patches, and its side is 2^lod sectors.
        let patch = |v: f64| (v * 8.0 / f64::from(1u32 << lod)).floor() as i64;
        (lod, patch(place[0]), patch(place[1]))
    })
}

fn grouped<K: std::hash::Hash + Eq>(masks: &[u8], prices: Prices, group: impl Fn(usize) -> K) -> Option<f64> {
    let mut groups: HashMap<K, (u8, u64)> = HashMap::new();
    for (at, &mask) in masks.iter().enumerate().filter(|(_, mask)| **mask != 0) {
        let entry = groups.entry(group(at)).or_default();
        entry.0 |= mask;
        entry.1 += 1;
    }
    let cost = |mask: u8| Variant::new(mask).map_or(0, |variant| prices.of(variant));
    // The order in which the hash map yields the groups does not affect the sums, because all terms are integers.
    let (sum, pixels) = groups.values().fold((0, 0), |(sum, pixels), &(mask, n)| (sum + u64::from(cost(mask)) * n, pixels + n));
    (pixels > 0).then(|| sum as f64 / pixels as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    const FC5: Prices = Prices { estimator: Estimator::Fc5, two_tilings: false };

    #[test]
    fn a_tile_pays_for_what_any_of_its_pixels_needs() {
        // The picture has 8 x 4 pixels. The left half needs the far atlas (2 fetches), except one pixel that needs the near cliff (12 fetches). The
        // right half needs the virtual texture (4 fetches), except one pixel that shows sky.
        let mut masks: Vec<u8> = (0..32).map(|i| if i % 8 < 4 { 2 } else { 1 }).collect();
        masks[3] = 4;
        masks[31] = 0;
        let of = |tile| per_tile(&masks, [8, 4], tile, FC5);
        // In tiles of 4 x 4 pixels, each of the 16 pixels on the left costs 2 + 12 = 14, and each of the 15 terrain pixels on the right costs 4.
        assert_eq!(of(4), Some((14.0 * 16.0 + 4.0 * 15.0) / 31.0));
        assert_eq!(of(8), Some(18.0));
        // In tiles of one pixel, each pixel costs only its own flavour.
        assert_eq!(of(1), Some((2.0 * 15.0 + 12.0 + 4.0 * 15.0) / 31.0));
        assert_eq!(per_tile(&[0; 4], [2, 2], 8, FC5), None);
        let sets = tile_sets(&masks, [8, 4], 4);
        assert_eq!([sets[0], sets[3], sets[4], sets[31]], [6, 6, 1, 0]);
    }

    #[test]
    fn two_tilings_cost_splat_twice_where_the_estimator_has_them() {
        let price = |estimator, two_tilings, variant| Prices { estimator, two_tilings }.of(variant);
        let both = Variant::new(17).expect("vt and splat");
        assert_eq!([false, true].map(|two| price(Estimator::Fc5, two, both)), [52, 100]);
        let hex = [false, true].map(|two| price(Estimator::Hex, two, both));
        assert_eq!(hex[0], hex[1], "hex-tiled splat has one tiling");
    }
}
