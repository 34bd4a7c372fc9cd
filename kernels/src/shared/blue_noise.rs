//! Blue-noise masks: tables of ranks, which [`noise::mask`](super::noise::mask) converts to thresholds. The errors that these thresholds cause in
//! neighbouring pixels mostly cancel when they are seen from a distance.
//!
//! The void-and-cluster method (Ulichney, *The void-and-cluster method for dither array generation*, SPIE 1913, 1993) places points one by one at the
//! position with the least energy. The energy is the sum of Gaussians around the existing points. The index of a point in this order is its rank. The
//! spatio-temporal mask (Wolfe, Morrical, Akenine-Möller, Ramamoorthi, *Spatiotemporal Blue Noise Masks*, EGSR 2022) applies the method to a volume:
//! the energy between two points is the spatial Gaussian if they share a slice, the temporal Gaussian if they share a pixel, and zero otherwise.
//!
//! Masks are computed at run time in integer arithmetic, so that machines compute the same masks: energies come from tables of integers up to 2^24,
//! the initial pattern comes from a hash, and fixed rules break ties. The points of each spatio-temporal slice are then ranked again within the
//! slice, in the order that they have in the volume, so that each slice contains every rank once.

use std::sync::OnceLock;

use super::hash;

/// Edge length of a mask, pixels. Masks repeat with this period.
pub const EDGE: u32 = 64;
/// Slices of the spatio-temporal mask, one per frame. The mask repeats with this period.
pub const SLICES: u32 = 16;
/// Number of ranks of a mask or slice. Each rank from 0 to `RANKS` - 1 occurs once.
pub const RANKS: u32 = EDGE * EDGE;

const SIDE: usize = EDGE as usize;
const AREA: usize = SIDE * SIDE;
/// Standard deviation of both Gaussians, in pixels and frames, as in Wolfe et al.
const SIGMA: f64 = 1.9;
/// Distance in rows or columns beyond which the spatial Gaussian is cut off, pixels. It is 4.2 standard deviations, where the Gaussian is 1.4e-4.
const REACH: usize = 8;
/// Energy that a point adds at its own position. If every position has a point, the energy at a position is at most 27 times this value, which fits
/// 32 bits.
const UNIT: f64 = 16_777_216.0;
/// In the initial pattern, one in `FIRST_PART` positions has a point. The method requires that fewer than half of the positions have points; Ulichney
/// uses about a tenth.
const FIRST_PART: usize = 10;
const SEED: u32 = 0x0b1e;

/// The ranks of the blue-noise mask, then the ranks of each slice of the spatio-temporal mask. The mask and each slice have EDGE x EDGE ranks, row by
/// row. They are computed at the first call.
pub fn ranks() -> &'static [u32] {
    static MASKS: OnceLock<Vec<u32>> = OnceLock::new();
    MASKS.get_or_init(|| {
        let mut all = void_and_cluster(1, SEED);
        let volume = void_and_cluster(SLICES as usize, SEED + 1);
        all.extend(volume.chunks(AREA).flat_map(ranked_anew));
        all
    })
}

/// Replaces the values of a slice, which are distinct, by their ranks within the slice, from 0.
fn ranked_anew(slice: &[u32]) -> Vec<u32> {
    let mut order: Vec<usize> = (0..slice.len()).collect();
    order.sort_unstable_by_key(|&i| slice[i]);
    let mut ranks = vec![0; slice.len()];
    for (rank, i) in (0..).zip(order) {
        ranks[i] = rank;
    }
    ranks
}

/// The ranks of a torus of `slices` x 64 x 64 points. Each rank, from 0 to the number of points - 1, occurs once.
fn void_and_cluster(slices: usize, seed: u32) -> Vec<u32> {
    let mut torus = Torus::new(slices, seed);
    let points = slices * AREA;
    let mut start: Vec<(u32, usize)> = (0..).zip(0..points).map(|(word, i)| (hash::mix(seed, word, 1), i)).collect();
    start.sort_unstable();
    let first = points / FIRST_PART;
    for &(_, i) in &start[..first] {
        torus.turn(i);
    }
    // Moves points from clusters to voids as long as this lowers the energy. The loop ends, because the energy cannot fall for ever.
    loop {
        let cluster = torus.tightest_cluster();
        torus.turn(cluster);
        let void = torus.largest_void();
        if torus.energy[void] >= torus.energy[cluster] {
            torus.turn(cluster);
            break;
        }
        torus.turn(void);
    }
    let mut ranks = vec![0; points];
    let mut taken = Vec::with_capacity(first);
    for rank in (0..first).rev() {
        let i = torus.tightest_cluster();
        torus.turn(i);
        ranks[i] = rank;
        taken.push(i);
    }
    for i in taken {
        torus.turn(i);
    }
    // This loop covers Ulichney's last two phases. The last phase looks for the tightest cluster of free positions. This is also the largest void,
    // because the energy of the points and the energy of the free positions add up to the same sum at every position, apart from the hashes that
    // break ties.
    for rank in first..points {
        let i = torus.largest_void();
        torus.turn(i);
        ranks[i] = rank;
    }
    ranks.into_iter().map(|rank| u32::try_from(rank).expect("65 536 points at most")).collect()
}

/// A pattern of points on a torus (opposite edges are joined), and the energy of the pattern at every position.
struct Torus {
    slices: usize,
    /// The energy at every position, slice by slice, row by row.
    energy: Vec<u32>,
    /// For each position: all bits set if there is a point, zero otherwise.
    set: Vec<u32>,
    /// For each row: the least energy of its free positions, and the bitwise complement of the largest energy of its points. Because of the
    /// complement, both searches look for a minimum.
    rows: [Vec<u32>; 2],
    /// Spatial energy by distance in rows, then by distance in columns modulo 64. The columns are stored twice, so that a range of 64 columns may
    /// begin at any column.
    space: [[u32; 2 * SIDE]; REACH + 1],
    /// Temporal energy by distance in slices, modulo the number of slices. It is 0 for the point's own slice, which `space` covers.
    time: Vec<u32>,
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most 2^24")]
fn gaussian(square: usize) -> u32 {
    (UNIT * (-(square as f64) / (2.0 * SIGMA * SIGMA)).exp()).round() as u32
}

impl Torus {
    fn new(slices: usize, seed: u32) -> Torus {
        let around = |distance: usize, size: usize| (distance % size).min(size - distance % size);
        let weight = |row: usize, column: usize| if row.max(column) <= REACH { gaussian(row * row + column * column) } else { 0 };
        let mut torus = Torus {
            slices,
            // The initial energies are 8-bit hashes, which are less than 2^-16 of the energy that a point adds at its own position. They break most
            // ties between energies. If a tie remains, the lower index is chosen.
            energy: (0..).take(slices * AREA).map(|i| hash::mix(seed, i, 0) & 255).collect(),
            set: vec![0; slices * AREA],
            rows: [vec![0; slices * SIDE], vec![0; slices * SIDE]],
            space: std::array::from_fn(|row| std::array::from_fn(|column| weight(row, around(column, SIDE)))),
            time: (0..slices).map(|slice| if slice == 0 { 0 } else { gaussian(around(slice, slices).pow(2)) }).collect(),
        };
        for row in 0..slices * SIDE {
            torus.look_at(row);
        }
        torus
    }

    /// Updates the two entries of `rows` for a row.
    fn look_at(&mut self, row: usize) {
        let range = row * SIDE..(row + 1) * SIDE;
        let (mut void, mut cluster) = (u32::MAX, u32::MAX);
        for (&energy, &set) in self.energy[range.clone()].iter().zip(&self.set[range]) {
            void = void.min(energy | set);
            cluster = cluster.min(!(energy & set));
        }
        self.rows[0][row] = void;
        self.rows[1][row] = cluster;
    }

    /// Sets a point at a free position, or removes the point of an occupied position.
    fn turn(&mut self, point: usize) {
        let on = self.set[point] == 0;
        self.set[point] = !self.set[point];
        let (slice, y, x) = (point / AREA, point / SIDE % SIDE, point % SIDE);
        let add = |energy: &mut u32, by: u32| *energy = if on { *energy + by } else { *energy - by };
        for step in 0..=2 * REACH {
            let row = slice * SIDE + (y + SIDE + step - REACH) % SIDE;
            let weights = &self.space[step.abs_diff(REACH)][SIDE - x..];
            for (energy, &by) in self.energy[row * SIDE..(row + 1) * SIDE].iter_mut().zip(weights) {
                add(energy, by);
            }
            self.look_at(row);
        }
        for step in 1..self.slices {
            let other = (slice + step) % self.slices * SIDE + y;
            add(&mut self.energy[other * SIDE + x], self.time[step]);
            self.look_at(other);
        }
    }

    /// The free position with the least energy; the first of these positions if there are several.
    fn largest_void(&self) -> usize {
        self.place(0, |energy, set| energy | set)
    }

    /// The point with the most energy; the first of these points if there are several.
    fn tightest_cluster(&self) -> usize {
        self.place(1, |energy, set| !(energy & set))
    }

    fn place(&self, of: usize, key: impl Fn(u32, u32) -> u32) -> usize {
        let rows = &self.rows[of];
        let least = rows.iter().copied().min().expect("a torus has rows");
        let row = rows.iter().position(|&k| k == least).expect("one row has the minimum");
        (row * SIDE..(row + 1) * SIDE).find(|&i| key(self.energy[i], self.set[i]) == least).expect("the row has the minimum")
    }
}
