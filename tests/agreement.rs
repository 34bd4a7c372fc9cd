//! Compares the GPU with the references: the function of every probe, and both paths of the classification pass.
//!
//! Each probe (`kernels::probe`) defines what is compared and which error is accepted. Only the culling probes are given NaN and infinity, because
//! WGSL lets a shader assume that there are none.
//!
//! Where a result is discontinuous (an index, a code, a cell), a row whose distance from the threshold is within the tolerance may fall on either
//! side. Such rows are counted, and each case limits their number. Each comparison is also run on mutants of the shader, which it must reject, and on
//! the reference in f32, which it must accept.

use std::collections::BTreeSet;

use bytemuck::{Zeroable, bytes_of};
use kernels::base::wgsl::Piece;
use kernels::classification::{self, Classification, Lists, reference::tile_masks, tiles};
use kernels::geometry;
use kernels::gpu::bindings::{Binding, aspect, view};
use kernels::gpu::{self, Gpu, GpuOptions, Recording};
use kernels::probe::table::Cells;
use kernels::probe::{Draw, EPS, PROBES, Probe, Verdict};
use kernels::shared::splat_blend;
use kernels::view::FrameUniforms;

use crate::fixtures::{gpu, open};

/// Number of random rows of each probe.
const ROWS: u32 = 4096;

// ---------------------------------------------------------------- the comparator

/// How a probe is compared.
struct Case {
    probe: &'static str,
    /// Rows with values at the ends of the ranges.
    extremes: fn() -> Vec<Vec<f64>>,
    /// Largest number of rows that may lie on the other side of a threshold.
    other_side_at_most: usize,
    /// Mutants: the shared file ("" for the probe's own text), the text to replace in it, and the replacement.
    mutants: &'static [(&'static str, &'static str, &'static str)],
}

/// Returns copies of a row. In each copy, one of the columns is NaN, infinite, denormal, near 1e-15 or 1e15 (the limits of the culling tests), or far
/// beyond these limits.
fn with_ends(plain: &[f64], columns: impl Iterator<Item = usize>) -> Vec<Vec<f64>> {
    let ends = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e-45, -1e-45, 0.9e-15, 1e-15, 1.1e-15, 0.9e15, 1e15, 1.1e15, -1e16, 3e38];
    let row = |column: usize, end: f64| {
        let mut row = plain.to_vec();
        row[column] = end;
        row
    };
    columns.flat_map(|column| ends.map(|end| row(column, end))).collect()
}

impl Case {
    fn probe(&self) -> &'static Probe {
        Probe::find(self.probe).unwrap_or_else(|e| panic!("{e}"))
    }

    fn rows(&self, table: u32) -> Vec<f64> {
        let random = (0..ROWS).map(|row| (self.probe().random)(&mut Draw { row, column: 0, table }));
        let rows: Vec<f64> = (self.extremes)().into_iter().chain(random).flatten().collect();
        let probe = self.probe();
        let rows = probe.rounded(&rows);
        for row in rows.chunks(probe.inputs.len()) {
            for (column, &x) in probe.inputs.iter().zip(row) {
                column.accepts(x).unwrap_or_else(|e| panic!("{}: {e}", self.probe));
            }
        }
        rows
    }

    /// Compares results with the truth. Returns the largest share of the tolerance that was used and the number of rows on the other side of a
    /// threshold, or an error that describes the first difference.
    fn compare(&self, rows: &[f64], got: &[f64]) -> Result<(f64, usize), String> {
        let probe = self.probe();
        let (columns, results) = (probe.inputs.len(), probe.outputs.len());
        let truth = probe.on_f64(rows);
        if got.len() != truth.len() {
            return Err(format!("{} results instead of {}", got.len(), truth.len()));
        }
        let (mut share, mut other_side, mut differing, mut first) = (0.0_f64, 0, 0, String::new());
        for ((row, got), want) in rows.chunks(columns).zip(got.chunks(results)).zip(truth.chunks(results)) {
            let verdict = if got.iter().all(|x| x.is_finite()) { (probe.judge)(row, got, want) } else { Verdict::Differs };
            match verdict {
                Verdict::Agrees(s) => share = share.max(s),
                Verdict::OtherSide => other_side += 1,
                Verdict::Differs => {
                    differing += 1;
                    if differing == 1 {
                        first = format!("row {row:?} gives {got:?}, the truth is {want:?}");
                    }
                }
            }
        }
        if differing > 0 {
            return Err(format!("{}: {differing} of {} rows differ; the first: {first}", self.probe, rows.len() / columns));
        }
        if other_side > self.other_side_at_most {
            let most = self.other_side_at_most;
            return Err(format!("{}: {other_side} rows are on the other side of a threshold; the limit is {most}", self.probe));
        }
        Ok((share, other_side))
    }
}

// ---------------------------------------------------------------- the probes

/// Directions that are special: without a usable length, very short or very long, along an axis, one step of f32 off an axis, and along a diagonal. A
/// direction along an axis has exact codes in any precision; one step of f32 off the axis is the smallest deviation from it.
fn directions() -> Vec<[f64; 3]> {
    let mut all = vec![[0.0; 3], [2e-30, 0.0, 0.0], [1e-31, -1e-31, 1e-31], [9e29, -5e29, 1e29], [3e-30, 4e-30, -5e-30]];
    for axis in 0..3 {
        for sign in [1.0, -1.0] {
            let mut v = [0.0; 3];
            v[axis] = sign;
            all.push(v);
            v[(axis + 1) % 3] = EPS;
            v[(axis + 2) % 3] = -EPS;
            all.push(v);
        }
    }
    for k in 0..8 {
        all.push([0, 1, 2].map(|i| if k >> i & 1 == 0 { 0.25 } else { -0.25 }));
    }
    all
}

const CASES: &[Case] = &[
    Case {
        probe: "octahedral",
        extremes: || directions().into_iter().map(|n| n.to_vec()).collect(),
        // Rows with two equally near codes. The error of 16 ULP (2^-19) is 2^-12 of the distance of two codes (2^-7), so 1 of the 4096 random rows is
        // expected. The limit also admits 20 symmetric extremes, which lie between codes: the 8 diagonals, and the 6 directions one step off an axis.
        other_side_at_most: 4 + 20,
        mutants: &[
            ("octahedral", "(vec2<f32>(1.0) - abs(flat.yx)) * octahedral_sign(flat)", "vec2<f32>(1.0) - abs(flat.yx)"),
            // The nearest code of each coordinate instead of the code of the nearest direction.
            ("", "octahedral_encode8_precise(n)", "octahedral_quantise8(e)"),
            ("octahedral", "if error < best_error", "if i == 0u"),
            ("octahedral", "return v / sqrt(dot(v, v));", "return v;"),
        ],
    },
    Case {
        probe: "octahedral-codes",
        extremes: || directions().into_iter().flat_map(|n| [2.0, 8.0, 12.0, 16.0].map(|bits| [&n[..], &[bits]].concat())).collect(),
        // At 16 bits, the error of 16 ULP (2^-19) is 2^-4 of the distance of two codes (2^-15). A quarter of the random rows has 16 bits. For each of
        // the two coordinates, an eighth of this quarter (128 rows) lies within the error of the middle between two codes, and twice 128 rows do so
        // for the nearest direction. At 12 bits it is a sixteenth of these numbers.
        other_side_at_most: 600,
        mutants: &[
            // In this order: the lower code instead of the nearest; a wrong number of steps; the nearest code of each coordinate instead of the code
            // of the nearest direction; the first of the four codes around instead of the best.
            ("octahedral", "round(usable_2(e) * half)", "floor(usable_2(e) * half)"),
            ("", "- 1u)) - 1u)", "- 1u)) - 2u)"),
            ("", "octahedral_encode_precise(n, half, step)", "fast"),
            ("octahedral", "if error < best_error", "if i == 0u"),
        ],
    },
    Case {
        probe: "normal-pair",
        extremes: || {
            let mut rows = Vec::new();
            for n in directions() {
                for ray in [[0.0; 3], [0.0, 1.0, 0.0], [-3e3, 0.0, 0.0], [0.1, 0.2, -0.3], n] {
                    for shading in [n, [0.0, 0.0, 1.0], [0.0, -1.0, -1.0]] {
                        rows.push([n, ray, shading].concat());
                    }
                }
            }
            rows
        },
        // Rows with two equally near points of the finer lattice. The error of 16 ULP (2^-19) is 2^-9 of the distance of two points (2^-10), so 8 of
        // the 4096 random rows are expected. The limit also admits 300 extremes. The extremes between points are those whose plane's normal lies
        // along one of the 8 diagonals or one step off an axis (6 normals). There are 15 rows for each normal.
        other_side_at_most: 24 + 300,
        mutants: &[
            // In this order: a prediction that is rounded down; a decoder whose window of differences does not match the encoder's; points that share
            // an index; a plain plane on the fine lattice; a plane seen from behind; a normal with z < 0; the first lattice point around instead of
            // the nearest; a vector that is not normalised.
            ("normal_pair", "(p + NORMAL_PAIR_FINE + 4) >>", "(p + NORMAL_PAIR_FINE) >>"),
            ("normal_pair", "(low - predicted + 16)", "(low - predicted)"),
            ("normal_pair", "* (2 * half + 1) + (p.x", "* (2 * half) + (p.x"),
            ("normal_pair", "normal_pair_nearest(upper, seen, NORMAL_PAIR_PLAIN)", "normal_pair_nearest(upper, seen, NORMAL_PAIR_FINE)"),
            ("normal_pair", "dot(decoded, ray) * along <= 0.0", "false"),
            ("normal_pair", "select(n, -n, n.z < 0.0)", "n"),
            ("normal_pair", "if error < best_error", "if i == 0"),
            ("normal_pair", "return v / sqrt(dot(v, v));", "return v;"),
        ],
    },
    Case {
        probe: "hashed-alpha",
        extremes: || {
            let mut rows = Vec::new();
            for kind in [0.0, 1.0] {
                for sector in [[0.0, 0.0], [16_777_216.0, -16_777_216.0]] {
                    for position in [[0.0, 0.0, 0.0], [31.999_998, 1e-3, 8848.0], [0.0, 0.0, -1e9], [1e20, -1e20, 9e29]] {
                        // Footprints of zero, footprints below and above the range of scales, and powers of two, whose level is a whole number.
                        for [x, y] in [[0.0, 0.0], [1e-9, 1e-9], [1e9, 1e12], [0.25, 0.125], [1.0, 1.0], [32.0, 4.0], [0.03, 3.0]] {
                            for seed in [0.0, 4_294_967_295.0] {
                                let row = [&[kind][..], &sector, &position, &[32.0, x, 0.0, 0.0, 0.0, y, 0.0, 1.0, seed, seed]];
                                rows.push(row.concat());
                            }
                        }
                    }
                }
            }
            rows
        },
        // In half of the rows each axis has its own level. About 0.1 of 4096 rows is expected to have a level within 1e-5 of a whole number.
        other_side_at_most: 4,
        mutants: &[
            // In this order: a blend that is not made uniform; the coarse scale twice; a seed without the salt; one cell too few in a sector.
            ("noise", "noise_correct(x.x, lerp_factor)", "x.x"),
            ("noise", "return noise_blend(coarse, fine, level - lower);", "return noise_blend(coarse, coarse, level - lower);"),
            ("noise", "hash_mix(seed, salt, level)", "hash_mix(seed, seed, level)"),
            ("noise", "bitcast<u32>(sector) * cells_per_sector +", "bitcast<u32>(sector) * (cells_per_sector - 1u) +"),
        ],
    },
    Case {
        probe: "noise",
        extremes: || {
            let mut rows = Vec::new();
            for kind in [2.0, 3.0, 4.0, 5.0, 6.0] {
                for place in [[0.0; 5], [16_777_216.0, -16_777_216.0, 31.999_998, 1e-3, 8848.0], [1.0, -1.0, 1e20, -1e20, -9e29]] {
                    for level in [0.0, -5.0, 16.0, 17.0, -16_777_216.0, 16_777_216.0] {
                        for [pixel, word] in
                            [[0.0, 0.0], [63.0, 15.0], [64.0, 16.0], [16_777_216.0, 36_288_000.0], [16_777_216.0, 4_294_967_295.0]]
                        {
                            for rank in [0.0, 4095.0, 4096.0, 16_777_216.0] {
                                let row = [&[kind][..], &place, &[32.0, level, pixel, pixel, word, word, word, rank, rank, 0.0, 1.0]];
                                rows.push(row.concat());
                            }
                        }
                    }
                }
            }
            rows
        },
        other_side_at_most: 0,
        mutants: &[
            // Interleaved gradient noise, in this order: a high word without one of its parts; the same symmetry for two decisions; no rotation; a
            // lattice that the frame does not move.
            ("noise", "+ (other >> 16u)", ""),
            ("noise", "select(shifted, shifted.yx, decision >= 2u)", "shifted"),
            ("noise", "noise_interleaved_gradient_value(turned, frame) + h.z", "noise_interleaved_gradient_value(turned, frame)"),
            ("noise", "+ frame * NOISE_IGN_FRAME", ""),
            // Masks, in this order: slices that repeat after 15 frames; the blue mask as the first slice; rows and columns exchanged; the same shift
            // for all decisions; no jitter; a jitter of the static mask that changes in every frame; ranks beyond the last one.
            ("noise", "frame % NOISE_MASK_SLICES", "frame % 15u"),
            ("noise", "1u + frame % NOISE_MASK_SLICES", "frame % NOISE_MASK_SLICES"),
            ("noise", "shifted.y * NOISE_MASK_EDGE + shifted.x", "shifted.x * NOISE_MASK_EDGE + shifted.y"),
            ("noise", "vec4<u32>(seed, salt, decision, NOISE_MASK_EDGE)", "vec4<u32>(seed, salt, 0u, NOISE_MASK_EDGE)"),
            ("noise", "(jitter >> vec4<u32>(12u))", "vec4<u32>(0u)"),
            ("noise", "select(0u, frame, kind == NOISE_SPATIO_TEMPORAL_BLUE)", "frame"),
            ("noise", "min(ranks, vec4<u32>(NOISE_MASK_RANKS - 1u))", "ranks"),
            // White noise, in this order: the wrong cells; a level that is not clamped; noise that does not change with the frame.
            ("noise", "vec3<i32>(k), seed, salt);\n}\n\n// The high", "vec3<i32>(k + 1), seed, salt);\n}\n\n// The high"),
            ("noise", "let k = clamp(level, i32(NOISE_LEVEL_MIN), i32(NOISE_LEVEL_MAX));", "let k = level;"),
            ("noise", "vec4<u32>(pixel, frame, hash_mix(seed, salt, 0u))", "vec4<u32>(pixel, 0u, hash_mix(seed, salt, 0u))"),
        ],
    },
    Case {
        probe: "derivatives",
        extremes: || {
            let mut rows = Vec::new();
            for n in directions() {
                for t in [0.0, 0.1, 20_000.0] {
                    rows.push([&[0.3, 0.9, -0.2, 0.0009, 0.0, 0.0, t][..], &n].concat());
                    rows.push([&[0.0, 1.0, 0.0, 0.0, -0.0002, -0.0009, t][..], &n].concat());
                }
                // A step of zero, and a step as long as the ray.
                rows.push([&[0.3, 0.9, -0.2, 0.0, 0.0, 0.0, 10.0][..], &n].concat());
                rows.push([&[0.3, 0.9, -0.2, 0.9, -0.3, 0.1, 10.0][..], &n].concat());
                // Rays of very different lengths: the squares of the shortest are denormal in f32, and the squares of the longest do not fit f32.
                for size in [1e-20, 1e-15, 1e15, 1e20, 1e30, 3e38] {
                    let ray = [0.3, 0.9, -0.2, 0.0009, 0.0, 0.0].map(|x: f64| x * size);
                    rows.push([&ray[..], &[1.0 / size], &n].concat());
                }
            }
            rows
        },
        // Rows whose ray lies in the plane, within the error: 2^-19 of the random rows, and some of the extremes, which are made of axes.
        other_side_at_most: 16,
        mutants: &[
            // In this order: one coordinate of the step twice; the point's own ray instead of the neighbour's; no limit at grazing angles; a normal
            // that is not normalised, which changes only the effect of the limit; no limit of the length of the neighbour's ray.
            ("", "vec3<f32>(row[3], row[4], row[5])", "vec3<f32>(row[3], row[3], row[5])"),
            ("derivatives", "ray_step - neighbour *", "ray_step - ray *"),
            ("derivatives", "max(side * dot(n, neighbour), limit)", "(side * dot(n, neighbour))"),
            ("derivatives", "octahedral_unit(normal)", "normal"),
            ("derivatives", "usable_within_3(neighbour, 1e18) && ", ""),
        ],
    },
    Case {
        probe: "splat-blend",
        extremes: || {
            let mut rows = Vec::new();
            let ends = [0.0, 1e-20, 1e-6, 0.5, 1.0 - 0.5 * EPS, 1.0, -3.0, 7.0];
            for x in ends {
                for y in ends {
                    for k in [0.0, 8.0, 1e4, 1e9, -1.0] {
                        rows.push(vec![x, y, 0.0, 1.0, 0.25, 1.0, k]);
                        rows.push(vec![x, y, -1e6, 1e6, 0.0, 0.5, k]);
                    }
                }
            }
            rows
        },
        other_side_at_most: 0,
        mutants: &[
            ("splat_blend", "return bent / (bent.x + bent.y + bent.z + bent.w);", "return bent;"),
            ("splat_blend", "f.x * g.y, g.x * f.y,", "g.x * f.y, f.x * g.y,"),
            ("splat_blend", "exp2(exponent)", "exp(exponent)"),
            ("splat_blend", "usable_positive_1(sharpness, SPLAT_BLEND_MAX_SHARPNESS)", "usable_positive_1(sharpness, 64.0)"),
            // The weights term by term: the sum so far is not multiplied by the factor of the new largest term; the first term counts as the largest.
            ("splat_blend", "(run.weight / w) * exp2(min(k * (run.height - h), 120.0)), 1.0", "1.0, 1.0"),
            ("splat_blend", "if score > run.score {", "if run.weight <= 0.0 {"),
        ],
    },
    Case {
        probe: "tri-planar",
        extremes: || {
            let mut rows = Vec::new();
            for n in directions() {
                for k in [0.0, 4.0, 1e4, 1e9, -1.0] {
                    for slope in [0.0, 1.0, 1e5] {
                        rows.push([&n[..], &[k, slope, -slope, slope, slope, -slope, slope]].concat());
                    }
                }
            }
            rows
        },
        other_side_at_most: 0,
        mutants: &[
            // In this order: weights that are not normalised; zero to the power of zero as 0; a gradient along the wrong axis; a normal that bends
            // the wrong way; a normal bent by the whole gradient instead of its part along the surface.
            ("triplanar", "return w / (w.x + w.y + w.z);", "return w;"),
            ("triplanar", "select(0.0, 1.0, sharpness <= 0.0)", "0.0"),
            ("triplanar", "return vec3<f32>(g.x, 0.0, g.y);", "return vec3<f32>(g.x, g.y, 0.0);"),
            ("triplanar", "unit - (g -", "unit + (g -"),
            ("triplanar", "(g - unit * dot(unit, g))", "g"),
        ],
    },
    Case {
        probe: "select",
        extremes: || {
            let mut rows = Vec::new();
            for bits in 0..16 {
                for u in [0.0, 0.25, 0.5, 0.75, 1.0 - 0.5 * EPS, 1.0, -1.0, 2.0] {
                    for size in [1.0, 1e-20, 1e29] {
                        // The sum of one, two or four equal weights is exact, and so is its product with u. So u can lie exactly on a threshold.
                        rows.push((0..4).map(|i| if bits >> i & 1 == 0 { 0.0 } else { size }).chain([u]).collect());
                        rows.push((0..4).map(|i| if bits >> i & 1 == 0 { -size } else { size }).chain([u]).collect());
                    }
                }
            }
            rows
        },
        // A random row lies on a threshold with a probability of 6 * 2^-23, so none of the 4096 is expected. Extremes lie on one if u is 3/4 and all
        // four weights are equal, because the sum of three of them is rounded.
        other_side_at_most: 8,
        mutants: &[
            // In this order: index 0 although its weight is 0; the first threshold in place of the second; the last index although its weight is 0;
            // negative weights that count.
            ("select", "if target_sum < below_1 {", "if target_sum <= below_1 {"),
            ("select", "if target_sum < below_2 {", "if target_sum < below_1 {"),
            ("select", "if w.w > 0.0 {", "if w.w >= 0.0 {"),
            ("select", "usable_positive_4(weights, SELECT_MAX_WEIGHT)", "weights"),
        ],
    },
    Case {
        probe: "biplanar",
        extremes: || {
            let mut rows = Vec::new();
            for n in directions() {
                for k in [0.0, 4.0, 8.0, 1e4, 1e9, -1.0] {
                    rows.push([&n[..], &[k]].concat());
                }
            }
            // Rows at which the second projection changes: two components are equal, and the third is below or above them.
            for third in [0.0, 0.5, 1.0 - EPS, 1.0 + EPS, 2.0] {
                rows.push(vec![1.0, 1.0, third, 8.0]);
                rows.push(vec![third, -1.0, 1.0, 4.0]);
                rows.push(vec![1.0, third, -1.0, 2.0]);
            }
            rows
        },
        // Extremes: 8 diagonals with 6 powers each, 6 rows one step of f32 off a diagonal, and some rows in which two components of weight 0 are
        // equal.
        other_side_at_most: 80,
        mutants: &[
            // In this order: a third projection that is dropped with a seam; weights that are not normalised; a wrong power; the wrong axis left out.
            ("biplanar", "max(kept - BIPLANAR_DIAGONAL, vec2<f32>(0.0))", "kept"),
            ("biplanar", "w / (w.x + w.y)", "w"),
            ("biplanar", "0.125 * usable_positive_1", "usable_positive_1"),
            ("biplanar", "a.x <= a.y && a.x <= a.z", "a.x <= a.y"),
        ],
    },
    Case {
        probe: "hex-tiling",
        extremes: || {
            let mut rows = Vec::new();
            for sector in [[0.0, 0.0], [16_777_216.0, -16_777_216.0], [-1.0, 1.0]] {
                for position in [[0.0, 0.0], [64.0, 64.0], [-1e-6, 1e-6], [31.999_998, 0.0], [3e30, -1e20]] {
                    for repeats in [0.0, 1e-9, 16.0, 32.0, -4.0] {
                        rows.push([&sector[..], &position, &[64.0, repeats, 7.0]].concat());
                    }
                }
            }
            rows
        },
        // Some random rows, and the extremes at a corner of a cell or a step off it. They lie, within the error, on a cell's border, where one
        // hexagon replaces another and both have weight 0, or halfway between two levels.
        other_side_at_most: 32,
        mutants: &[
            // In this order: weights that are not sharpened; a seam at sector borders; the same offset for all hexagons of a column; weights that are
            // not normalised; the wrong weights in the upper triangle.
            ("hex_tiling", "return square * square * square * w;", "return w;"),
            ("hex_tiling", "(s.x << (HEX_TILING_SKEW_BITS + step)) - skewed_y", "(s.x << (HEX_TILING_SKEW_BITS + step))"),
            ("hex_tiling", "vec4<u32>(id, salt, 0u)", "vec4<u32>(id.xx, salt, 0u)"),
            ("hex_tiling", "sharp / (sharp.x + sharp.y + sharp.z)", "sharp"),
            ("hex_tiling", "vec3<f32>(f.x + f.y - 1.0, 1.0 - f.y, 1.0 - f.x)", "vec3<f32>(f.x + f.y - 1.0, 1.0 - f.x, 1.0 - f.y)"),
        ],
    },
    Case {
        probe: "texel-choice",
        extremes: || {
            let mut rows = Vec::new();
            for u in [0.0, 0.5, 1.0 - 0.5 * EPS] {
                for lod in [-1e30, -1.0, 0.0, 0.5, 3.0, 1e30] {
                    for coordinate in [0.0, 0.999_999, -1e-7, 0.5, -3.25, 1e5, 1e20] {
                        for size in [1.0, 2.0, 1024.0, 3.0] {
                            rows.push(vec![lod, 5.0, u, coordinate, size, u]);
                        }
                    }
                }
            }
            rows
        },
        // u lies within the error of a threshold, which is 2^-23 times some hundred texels, in less than 1 of 4096 random rows. The limit also admits
        // extremes with a size of 3 texels and a coordinate just below a whole repeat, whose product is rounded.
        other_side_at_most: 24,
        mutants: &[
            // In this order: always the level below; the nearest texel; a texel's corner in place of its centre; no repeat; the farther texel more
            // often.
            ("texel_choice", "select(0.0, 1.0, u < l - below)", "0.0"),
            ("texel_choice", "select(0.0, 1.0, u < x - below)", "select(0.0, 1.0, 0.5 < x - below)"),
            ("texel_choice", "* texels - 0.5", "* texels"),
            ("texel_choice", "texels - 1.0, texel < 0.0", "0.0, texel < 0.0"),
            ("texel_choice", "u < x - below", "u >= x - below"),
        ],
    },
    Case {
        probe: "layers",
        extremes: || {
            let mut rows = Vec::new();
            for fraction in [[0.0, 0.0], [1.0, 0.0], [0.5, 1.0], [1e-20, 1.0 - EPS], [0.5, 0.5]] {
                for layers in [[0.0; 4], [7.0; 4], [7.0, 6.0, 1.0, 0.0], [0.0, 1.0, 6.0, 7.0], [3.0, 3.0, 5.0, 5.0]] {
                    rows.push([&splat_blend::bilinear(fraction)[..], &layers].concat());
                }
            }
            rows
        },
        other_side_at_most: 0,
        mutants: &[
            // In this order: a share used as an opacity; a transparent layer 0; a share that includes the layers above; a texel that is left out.
            ("layers", "m.x / max(m.x + m.y, 1e-30)", "m.x"),
            ("layers", "1.0, layer == 0u", "m.x, layer == 0u"),
            ("layers", "layers == vec4<u32>(layer)", "layers >= vec4<u32>(layer)"),
            ("layers", "vec4<f32>(1.0));", "vec4<f32>(1.0, 1.0, 1.0, 0.0));"),
        ],
    },
    Case {
        probe: "snapped-projection",
        extremes: || {
            let mut rows = Vec::new();
            for n in directions() {
                for cosine in [0.0, 0.8, 1.0] {
                    for fixed in [0.0, 1.0, -1.0, 255.0, -256.0, 16_777_216.0, -16_777_216.0] {
                        rows.push([&n[..], &[cosine, 1.0, -2.0, 3.0, 5.0, -7.0, 11.0, fixed, 0.5, -0.25]].concat());
                    }
                }
            }
            rows
        },
        // Directions without x and y, and directions whose z is at the threshold.
        other_side_at_most: 100,
        mutants: &[
            // In this order: the two diagonals exchanged; sectors with the wrong sign; a rate without its low 8 bits; steep and gentle slopes
            // exchanged; a border at 45 degrees instead of 22.5; a gradient with the wrong sign.
            ("snapped_projection", "(u.x > 0.0) == (u.y > 0.0)", "(u.x > 0.0) != (u.y > 0.0)"),
            ("snapped_projection", "place.y - place.x", "place.x - place.y"),
            ("snapped_projection", "(((per_sector_fixed & 255) * SNAPPED_DIAGONAL) >> 8u)", "0"),
            ("snapped_projection", "a.z >= cosine", "a.z < cosine"),
            ("snapped_projection", "a.y <= SNAPPED_HALF_STEP * a.x", "a.y <= a.x"),
            ("snapped_projection", "vec3<f32>(-along, along, g.y)", "vec3<f32>(along, along, g.y)"),
        ],
    },
    Case {
        probe: "hash",
        extremes: || {
            let ends = [0, 1, 0x7fff_ffff, 0x8000_0000, 0xffff_ffff_u32, 0x7fc0_0001];
            let words = (0..6 * 6 * 6 * 6).map(|k: usize| [0, 1, 2, 3].map(|i| ends[k / 6_usize.pow(i) % 6]));
            words.map(|v| v.map(f64::from).to_vec()).collect()
        },
        other_side_at_most: 0,
        mutants: &[
            // In this order: OR instead of XOR in each of the two hashes; a constant that is off by one; a sum in place of chained hashes; a
            // conversion of all 32 bits, which is rounded.
            ("hash", "h ^= h >>", "h |= h >>"),
            ("hash", "(word >> 22u) ^ word", "(word >> 22u) | word"),
            ("hash", "2891336453u", "2891336454u"),
            ("hash", "hash_pcg(level + hash_pcg(salt + hash_pcg(seed)))", "hash_pcg(level + salt + seed)"),
            ("hash", "h >> 8u) * 5.96", "h) * 2.3283064365386963e-10 + 0.0 * 5.96"),
        ],
    },
    Case {
        probe: "flavour-weights",
        extremes: || {
            let mut rows = Vec::new();
            for distance in [0.0, 30.0, 300.0, 1500.0, 1e9] {
                for normal_z in [-1.0, 0.0, 0.682, 0.731, 0.777, 0.819, 1.0] {
                    for given in [0.0, 1.0] {
                        rows.push(vec![distance, normal_z, given, 0.0, given, 1.0, given, 21.0, given]);
                    }
                }
            }
            rows
        },
        other_side_at_most: 0,
        mutants: &[
            ("flavour_weights", "t * t * (3.0 - 2.0 * t)", "t"),
            ("flavour_weights", "flavour_behind(d, params.cliff_near_m,", "flavour_behind(d, params.cliff_far_atlas_m,"),
            ("flavour_weights", "mask |= select(0u, 16u, weights[4] > FLAVOUR_MIN_WEIGHT);", ""),
            ("flavour_weights", "w[i] /= sum;", "w[i] /= max(sum, 1.0);"),
        ],
    },
    Case {
        probe: "frustum",
        extremes: || {
            let mut rows = Vec::new();
            for n in [[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [0.6, 0.0, -0.8], [0.0; 3]] {
                for w in [-1.0, 0.0, 1.0, 1e6] {
                    for (low, high) in [([0.0; 3], [0.0; 3]), ([-1.0; 3], [1.0; 3]), ([-1e7, 0.0, -500.0], [1e7, 64.0, 3000.0])] {
                        rows.push([&n[..], &[w], &low, &high].concat());
                    }
                }
            }
            // Rows made from a box beyond the plane, and from one that is not beyond it.
            for w in [-5.0, 5.0] {
                rows.extend(with_ends(&[0.6, 0.0, -0.8, w, -1.0, -1.0, -1.0, 1.0, 1.0, 1.0], 0..10));
            }
            rows
        },
        // In half of the random rows, the box is 2^-24 to 1 of its distance off the plane, with as many rows in each octave. The margin is 2^-21 to
        // 2^-20 of the distance, so an eighth of these rows lies within it. Half of those lie on the visible side, where no difference is accepted.
        other_side_at_most: 400,
        mutants: &[
            // In this order: the opposite corner; a plane through the origin; a margin to the wrong side.
            ("culling", "select(low, high,", "select(high, low,"),
            ("culling", "+ plane.w < -(", "< -("),
            ("culling", "-(CULLING_SLACK * size + CULLING_FLUSHED)", "CULLING_SLACK * size"),
            // No check whether the numbers of box and plane are usable.
            ("culling", "return known && terms.x", "return terms.x"),
        ],
    },
    Case {
        probe: "normal-cone",
        extremes: || {
            let mut rows = Vec::new();
            for axis in directions() {
                for sine in [0.0, 0.5, 1.0 - 0.5 * EPS, 1.0] {
                    for [far, radius] in [[1.0, 0.0], [1.0, 0.5], [100.0, 100.0], [1e6, 1.0]] {
                        rows.push([&axis[..], &[sine, 0.0, 0.6 * far, -0.8 * far, radius]].concat());
                    }
                }
            }
            // Rows made from a patch that faces away, and from one that does not.
            for z in [-100.0, 100.0] {
                rows.extend(with_ends(&[0.0, 0.0, -1.0, 0.5, 0.0, 0.0, z, 1.0], 0..8));
            }
            rows
        },
        // As for the frustum, with octaves of an angle. More rows lie within the margin: it is a margin of the cosine, so it is a wide angle where
        // the sine is small.
        other_side_at_most: 900,
        mutants: &[
            // In this order: no sphere; no cone; the larger of the two angles instead of their sum; no limit at a right angle; a margin to the wrong
            // side.
            ("culling", "radius / distance);", "0.0);"),
            ("culling", "vec2<f32>(sin_half_angle, radius", "vec2<f32>(0.0, radius"),
            ("culling", "sines.x * cosines.y + cosines.x * sines.y + CULLING_ROUNDING", "max(sines.x, sines.y)"),
            ("culling", "cosines.x * cosines.y - sines.x * sines.y <= CULLING_ROUNDING", "false"),
            ("culling", "cosines.x * sines.y + CULLING_ROUNDING", "cosines.x * sines.y - 0.01"),
            // No check whether the distance of the patch is usable.
            ("culling", "usable_within_3(to_patch, CULLING_MOST)", "true"),
        ],
    },
    Case {
        probe: "occlusion",
        extremes: || {
            let mut rows = Vec::new();
            // In this order: a camera that looks along y; one that looks along -z, with a field of view of 1 degree across and of 175 degrees down;
            // one so far from the origin that distances lose their digits; a matrix of zeros, which gives no distances.
            let cameras = [
                [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 1.0, 0.0, 0.0]],
                [[114.6, 0.0, 0.0, 0.0], [0.0, 0.0437, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0]],
                [[1.0, 0.0, 0.0, -5e6], [0.0, 0.0, 1.0, 0.0], [0.0, 1.0, 0.0, -1e6]],
                [[0.0; 4]; 3],
            ];
            for camera in cameras {
                for near in [1e-7, 1e-3, 0.1, 1e6] {
                    for (low, high) in [
                        ([0.0; 3], [0.0; 3]),
                        ([-1.0; 3], [1.0; 3]),
                        ([-0.5, 0.1, -0.5], [0.5, 0.1, 0.5]),
                        ([-0.5, 1e6, -0.5], [0.5, 1e6 + 1.0, 0.5]),
                        ([-1e7, 64.0, -500.0], [1e7, 128.0, 3000.0]),
                        ([5.0, 5.0, -20.0], [-5.0, 6.0, -10.0]),
                    ] {
                        for size in [[1.0, 1.0], [1.0, 8192.0], [1920.0, 1080.0]] {
                            for stored in [0.0, 1e-6, near / 10.0, 1.0] {
                                rows.push([&camera.concat()[..], &[near], &low, &high, &size, &[stored; 4]].concat());
                            }
                        }
                    }
                }
            }
            // Rows made from a box that is in front of the camera and hidden.
            let plain = [&cameras[0].concat()[..], &[0.1], &[-1.0, 5.0, -1.0], &[1.0, 6.0, 1.0], &[16_384.0, 16_384.0], &[0.5; 4]].concat();
            rows.extend(with_ends(&plain, (0..19).chain(21..25)));
            // A box far outside the picture, where screen positions lose their digits.
            rows.push(
                [
                    &cameras[2].concat()[..8],
                    &[0.0, 1.0, 0.0, 0.0],
                    &[0.1],
                    &[5_000_100.0, 1.0, 0.0],
                    &[5_000_100.0, 1.0, 0.0],
                    &[100.0; 2],
                    &[1.0; 4],
                ]
                .concat(),
            );
            rows
        },
        // A box's edge may lie anywhere between two pixels, so the margin can move it to the next pixel. The margin is some 2^-20 of 4096 pixels, for
        // each of four edges. In addition, half of the depths are close to the stored depth, as for the frustum.
        other_side_at_most: 1500,
        mutants: &[
            // In this order: one corner left out; some corners twice; the image upside down; no margin at the first pixels; a margin inwards at the
            // last pixels; the depth of the farthest corner; a level that is too fine; hidden in one texel instead of all; boxes in front instead of
            // behind; boxes that reach behind the near plane as known; no check whether the numbers of the box are usable; a depth that is rounded to
            // the wrong side.
            ("culling", "corner < 8u", "corner < 7u"),
            ("culling", "vec3<u32>(1u, 2u, 4u)", "vec3<u32>(1u, 2u, 2u)"),
            ("culling", "vec2<f32>(x.x, -y.x) / w.x", "vec2<f32>(x.x, y.x) / w.x"),
            ("culling", "0.5 * (q - margin)", "0.5 * q"),
            ("culling", "0.5 * (q + margin)", "0.5 * (q - margin)"),
            ("culling", "nearest = min(nearest, sure)", "nearest = select(max(nearest, sure), sure, nearest > 1e38)"),
            ("culling", "select(vec2<u32>(0u), vec2<u32>(1u), (last", "select(vec2<u32>(0u), vec2<u32>(0u), (last"),
            ("culling", "all(vec4<f32>(depth) < farthest)", "any(vec4<f32>(depth) < farthest)"),
            ("culling", "all(vec4<f32>(depth) < farthest)", "all(vec4<f32>(depth) >= farthest)"),
            ("culling", "sure >= near && w.y", "w.y"),
            (
                "culling",
                "usable_within_3(low, CULLING_MOST) && usable_within_3(high, CULLING_MOST)\n        && usable_within_3(row_x",
                "usable_within_3(row_x",
            ),
            ("culling", "near / nearest * (1.0 + CULLING_FEW)", "near / nearest * (1.0 - CULLING_FEW)"),
        ],
    },
    Case {
        probe: "bc1",
        extremes: || {
            let ends = [0x0000_0000_u32, 0xffff_0000, 0x0000_ffff, 0xffff_ffff, 0x8410_07e0, 0x07e0_8410, 0x0001_0000];
            let indices = [0_u32, 0x5555_5555, 0xaaaa_aaaa, 0xffff_ffff, 0xe4e4_e4e4];
            let row = |k: usize| vec![f64::from(ends[k % 7]), f64::from(indices[k / 7 % 5]), (k / 35) as f64];
            (0..7 * 5 * 16).map(row).collect()
        },
        other_side_at_most: 0,
        mutants: &[
            // In this order: red and blue exchanged; no transparency; 5 % darker, which is more than the accepted error.
            ("", "bits.x, bits.y, bits.z, bits.w", "bits.z, bits.y, bits.x, bits.w"),
            ("", "bits.z, bits.w", "bits.z, bitcast<u32>(1.0)"),
            ("", "bitcast<vec4<u32>>(texel)", "bitcast<vec4<u32>>(texel * 0.95)"),
        ],
    },
    Case {
        probe: "bc3",
        extremes: || {
            let alphas = [0x0000_u32, 0x00ff, 0xff00, 0xffff, 0x8040, 0x4080, 0xfac6_8040, 0x5342_ff00];
            let row = |k: usize| {
                let upper = [0x8888_c6fa_u32, 0xffff_ffff, 0, 0x0539_7fac][k / 8 % 4];
                vec![f64::from(alphas[k % 8]), f64::from(upper), f64::from(0x07e0_f800_u32), f64::from(0xe4e4_e4e4_u32), (k / 32) as f64]
            };
            (0..8 * 4 * 16).map(row).collect()
        },
        other_side_at_most: 0,
        mutants: &[
            ("", "bits.x, bits.y, bits.z, bits.w", "bits.z, bits.y, bits.x, bits.w"),
            ("", "bits.z, bits.w", "bits.z, bitcast<u32>(1.0)"),
            ("", "bitcast<vec4<u32>>(texel)", "bitcast<vec4<u32>>(texel * 0.95)"),
        ],
    },
    Case {
        probe: "tiling",
        extremes: || {
            let mut rows = Vec::new();
            for distance in [0.0, 30.0, 30.0 * (1.0 + EPS), 60.0, 1e9] {
                for sector in [0.0, -16_777_216.0, 16_777_216.0] {
                    for fixed in [0.0, 1.0, 65_535.0] {
                        rows.push(vec![distance, 30.0, 1.0, sector, fixed, fixed, 8.0]);
                        rows.push(vec![distance, 1e-3, 0.0, sector, fixed, fixed, 0.0]);
                    }
                }
            }
            rows
        },
        other_side_at_most: 0,
        mutants: &[
            ("tiling", "log2(ratio)", "log(ratio)"),
            ("tiling", "f32(repeat >> s)", "f32((repeat >> s) | 1u)"),
            ("tiling", "(0xffffffffu >> (8u - s))", "0x00ffffffu"),
        ],
    },
    Case {
        probe: "reflection",
        extremes: || {
            let mut rows = Vec::new();
            for cosine in [0.0, 0.5, 1.0 - 0.5 * EPS, 1.0] {
                for rough in [0.0, 0.002, 1.0] {
                    rows.push(vec![cosine, rough, cosine, 1.0, 0.04, rough]);
                    rows.push(vec![cosine, rough, 1.0, cosine, 1.0, rough]);
                }
            }
            rows
        },
        other_side_at_most: 0,
        mutants: &[
            ("brdf", "(1.0 - c) * (1.0 + c) + c * c * a * a", "1.0 - c * c * (1.0 - a * a)"),
            ("brdf", "let lambda_l = v * sqrt(l * l", "let lambda_l = v * sqrt(v * v"),
            ("brdf", "(m2 * m2 * m)", "(m2 * m2)"),
            ("brdf", "-9.28", "-9.27"),
        ],
    },
    Case {
        probe: "depth-position",
        extremes: || {
            let mut rows = Vec::new();
            for width in [1.0, 8192.0] {
                // Fields of view of 1, 55 and 175 degrees.
                for half in [0.008_727, 0.5206, 22.9] {
                    for distance in [1e-3, 1.0, 1e6] {
                        rows.push(vec![0.0, 0.0, 1e-3 / distance, 1e-3, half, width]);
                        rows.push(vec![width - 1.0, 0.5 * width, 1e-3 / distance, 1e-3, half, width]);
                    }
                }
            }
            // A pixel at which nothing was drawn: depth 0.
            rows.push(vec![3.0, 4.0, 0.0, 0.1, 0.5, 64.0]);
            rows
        },
        other_side_at_most: 0,
        mutants: &[
            // In this order: no step down; rows and columns exchanged; the depth instead of its reciprocal; infinity where nothing was drawn.
            ("view", "ray_00 + ray_dx * pixel.x + ray_dy * pixel.y", "ray_00 + ray_dx * pixel.x"),
            ("view", "ray_dx * pixel.x + ray_dy * pixel.y", "ray_dx * pixel.y + ray_dy * pixel.x"),
            ("view", "near_m / usable,", "near_m * usable,"),
            ("view", "usable > VIEW_MIN_DEPTH", "true"),
        ],
    },
    Case {
        probe: "weld",
        extremes: || {
            let deltas = [0.0, 1.0, 2.0, 7.0, 15.0];
            let edge = |i: u32| [[f64::from(i), 0.0], [f64::from(i), 128.0], [0.0, f64::from(i)], [128.0, f64::from(i)]];
            let places = (0..=128).flat_map(edge);
            places.flat_map(|[x, y]| deltas.map(|d| vec![x, y, d, d, d, d])).collect()
        },
        other_side_at_most: 0,
        mutants: &[
            // In this order: the upper of two equally near vertices; a western border that does not move; a southern border that uses the delta of
            // the western neighbour.
            ("geometry/stitch.wgsl", "(step - 1u) / 2u", "step / 2u"),
            ("geometry/stitch.wgsl", "if index.x == 0u { kept.y = geometry_weld(index.y, deltas & 15u); }", ""),
            ("geometry/stitch.wgsl", "(deltas >> 4u) & 15u", "deltas & 15u"),
        ],
    },
    Case {
        probe: "moments",
        extremes: || {
            let mut rows = Vec::new();
            for [mean, spread] in [[0.0, 0.0], [1e6, 1e-3], [1e6, 0.0], [-1e6, 1.0], [1e-3, 1e3]] {
                for count in [1.0, 2.0, 3.0, 4096.0] {
                    rows.push(vec![mean, spread, count]);
                }
            }
            rows
        },
        other_side_at_most: 0,
        mutants: &[
            // In this order: sums without compensation; squares without the factor (n - 1) / n; a variance that is biased; the lower part of a sample
            // left out.
            ("moments", "(a.x - rest) + (b - part)", "0.0"),
            ("moments", "delta * (delta * ((n - 1.0) / n))", "delta * delta"),
            ("moments", "max(count - 1.0, 1.0)", "max(count, 1.0)"),
            ("moments", "moments_rounded(sample.y - state.y, zero)", "0.0"),
        ],
    },
    Case {
        probe: "reprojection",
        extremes: || {
            let mut rows = Vec::new();
            for y in [-5.0, 0.0, 1e-4, 1.0, 1e6, 1e9] {
                for normal in [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0; 3]] {
                    for [half, width] in [[0.008_727, 8192.0], [0.5, 1.0], [22.9, 640.0]] {
                        rows.push([&[0.1 * y, y, -0.05 * y, 0.0, 0.0, 0.0, half, width][..], &normal].concat());
                        rows.push([&[0.0, y, 0.0, 0.5, -0.25, 0.125, half, width][..], &normal].concat());
                    }
                }
            }
            rows
        },
        // Rows at the smallest and the largest distance that reprojection accepts, and rows whose plane contains the earlier eye.
        other_side_at_most: 64,
        mutants: &[
            // In this order: the vector between the eyes with the wrong sign; a shift that is added; a distance from the wrong row; a plane that
            // ignores the vector between the eyes; a ray with the wrong sign of x.
            ("motion", "let q = point + past.offset;", "let q = point - past.offset;"),
            ("motion", "/ distance - vec2<f32>(past.x_shift, past.y_shift)", "/ distance + vec2<f32>(past.x_shift, past.y_shift)"),
            ("motion", "dot(q, past.forward)", "dot(q, past.x_row)"),
            ("motion", "dot(normal, point + past.offset)", "dot(normal, point)"),
            ("motion", "past.forward + past.x_row * x", "past.forward - past.x_row * x"),
        ],
    },
];

/// Whether a byte belongs to an identifier.
fn is_word(byte: Option<&u8>) -> bool {
    byte.is_some_and(|b| b.is_ascii_alphanumeric() || *b == b'_')
}

/// Replaces each occurrence of an identifier, except inside longer identifiers.
fn rename(text: &str, from: &str, to: &str) -> String {
    let mut out = String::new();
    let mut rest = text;
    while let Some(at) = rest.find(from) {
        let (before, after) = (rest.as_bytes()[..at].last(), rest.as_bytes().get(at + from.len()));
        out.push_str(&rest[..at]);
        out.push_str(if is_word(before) || is_word(after) { from } else { to });
        rest = &rest[at + from.len()..];
    }
    out + rest
}

/// Returns a probe's text with one replacement, in this text or in a shared file that it calls. A changed file is put before the text, and its
/// declarations are renamed, so that they do not collide with the original ones.
fn mutant(body: &str, file: &str, from: &str, to: &str) -> String {
    if file.is_empty() {
        assert_eq!(body.matches(from).count(), 1, "`{from}` must occur exactly once");
        return body.replace(from, to);
    }
    let mut files = kernels::shared::WGSL.iter().copied().chain([&geometry::STITCH_WGSL]);
    let text = files.find(|wgsl| wgsl.path == file || wgsl.path == format!("shared/{file}.wgsl")).expect("a file of a probe").text;
    // Only the first occurrence is replaced, so that a mutant has one change.
    let count = text.matches(from).count();
    assert!(count >= 1, "{file}.wgsl: `{from}` does not occur");
    let mut all = format!("{}\n{body}", text.replacen(from, to, 1));
    for line in text.lines() {
        let declared = ["fn ", "const ", "struct "].iter().find_map(|keyword| line.strip_prefix(keyword));
        if let Some(name) = declared.and_then(|d| d.split(['(', ':', ' ']).next()) {
            all = rename(&all, name, &format!("{name}_mutant"));
        }
    }
    all
}

/// Returns a probe's text with results rounded to 11 bits, as by a shader of half precision.
fn in_half_precision(probe: &Probe) -> String {
    let (columns, results) = (probe.inputs.len(), probe.outputs.len());
    let (cell, texel, [given, from, to]) = match probe.layout() {
        Cells::Reals => ("f32", "", ["", "", ""]),
        Cells::Bits => ("u32", "", ["", "bitcast<f32>", "bitcast<u32>"]),
        Cells::Texel(_) => ("u32", ", texel: vec4<f32>", [", texel", "bitcast<f32>", "bitcast<u32>"]),
    };
    let mut text = rename(probe.wgsl, "probe", "probe_exact");
    text += &format!(
        "\nfn probe(row: array<{cell}, {columns}>{texel}) -> array<{cell}, {results}> {{\n    var rounded = probe_exact(row{given});\n"
    );
    for (i, _) in probe.outputs.iter().enumerate().filter(|(_, column)| !column.is_word()) {
        text += &format!("    rounded[{i}] = {to}(quantizeToF16({from}(rounded[{i}])));\n");
    }
    text + "    return rounded;\n}"
}

fn check(name: &str) {
    let table = u32::try_from(CASES.iter().position(|c| c.probe == name).expect("a case")).expect("few");
    let case = &CASES[table as usize];
    let probe = case.probe();
    let rows = case.rows(table);
    let run = |body: &str| probe.on_gpu_by(gpu(), body, &rows).unwrap_or_else(|e| panic!("{name}: {e}\n{body}"));

    let got = probe.on_gpu(gpu(), &rows).unwrap_or_else(|e| panic!("{e}"));
    let single = case.compare(&rows, &probe.on_f32(&rows)).unwrap_or_else(|e| panic!("the reference in f32: {e}"));
    let (share, other_side) = case.compare(&rows, &got).unwrap_or_else(|e| panic!("{e}"));
    println!("{name}: {share:.4} of the tolerance used, {other_side} rows on the other side of a threshold; in f32 {single:?}");

    // Negative controls.
    for &(file, from, to) in case.mutants {
        assert!(case.compare(&rows, &run(&mutant(probe.wgsl, file, from, to))).is_err(), "{name}: `{to}` for `{from}` was not noticed");
    }
    // Block decoders are left out: their accepted error is one code of 8 bits, which is larger than the error of half precision.
    if probe.outputs.iter().any(|c| c.whole.is_none()) && !matches!(probe.layout(), Cells::Texel(_)) {
        assert!(case.compare(&rows, &run(&in_half_precision(probe))).is_err(), "{name}: half precision was not noticed");
    }
    let mut broken = got.clone();
    broken[0] = f64::NAN;
    assert!(case.compare(&rows, &broken).is_err(), "{name}: NaN was not noticed");
}

#[test]
fn every_probe_has_a_case() {
    let probes: BTreeSet<_> = PROBES.iter().map(|p| p.name).collect();
    assert_eq!(probes, CASES.iter().map(|c| c.probe).collect());
}

#[test]
fn octahedral_agrees() {
    check("octahedral");
}

#[test]
fn octahedral_codes_agree() {
    check("octahedral-codes");
}

#[test]
fn frustum_agrees() {
    check("frustum");
}

#[test]
fn normal_cone_agrees() {
    check("normal-cone");
}

#[test]
fn occlusion_agrees() {
    check("occlusion");
}

#[test]
fn blocks_agree() {
    check("bc1");
    check("bc3");
}

#[test]
fn normal_pair_agrees() {
    check("normal-pair");
}

#[test]
fn hashed_alpha_agrees() {
    check("hashed-alpha");
}

#[test]
fn noise_is_bit_equal() {
    check("noise");
}

#[test]
fn derivatives_agree() {
    check("derivatives");
}

#[test]
fn splat_blend_agrees() {
    check("splat-blend");
}

#[test]
fn tri_planar_agrees() {
    check("tri-planar");
}

#[test]
fn select_agrees() {
    check("select");
}

#[test]
fn biplanar_agrees() {
    check("biplanar");
}

#[test]
fn hex_tiling_agrees() {
    check("hex-tiling");
}

#[test]
fn texel_choice_agrees() {
    check("texel-choice");
}

#[test]
fn layers_agree() {
    check("layers");
}

#[test]
fn snapped_projection_agrees() {
    check("snapped-projection");
}

#[test]
fn hashes_are_bit_equal() {
    check("hash");
}

#[test]
fn flavour_weights_agree() {
    check("flavour-weights");
}

#[test]
fn tiling_agrees() {
    check("tiling");
}

#[test]
fn reflection_agrees() {
    check("reflection");
}

#[test]
fn depth_position_agrees() {
    check("depth-position");
}

#[test]
fn weld_is_equal() {
    check("weld");
}

#[test]
fn moments_agree() {
    check("moments");
}

#[test]
fn reprojection_agrees() {
    check("reprojection");
}

// ---------------------------------------------------------------- classification

/// Masks and terrain of a picture, as the geometry pass would write them.
struct Scenery {
    size: [u32; 2],
    mask: Vec<u8>,
    terrain: Vec<bool>,
}

impl Scenery {
    /// Returns random terrain and masks. A tile's share of terrain is 0, 3, 50 or 100 %. Its pixels have the same random mask, one random flavour
    /// each, or a random part of the tile's mask each.
    fn random(size: [u32; 2], table: u32) -> Scenery {
        let columns = tiles(size)[0];
        let (mut mask, mut terrain) = (Vec::new(), Vec::new());
        for pixel in 0..size[0] * size[1] {
            let (x, y) = (pixel % size[0], pixel / size[0]);
            let mut tile = Draw { row: y / 8 * columns + x / 8, column: 0, table };
            let density = [0.0, 0.03, 0.5, 1.0][tile.whole(4) as usize];
            let any = tile.whole(32) as u8;
            let kind = tile.whole(3) as u8;
            let mut draw = Draw { row: pixel, column: 0, table: table + 1000 };
            terrain.push(draw.unit() < density);
            mask.push(match kind {
                0 => any,
                1 => 1 << draw.whole(5) as u8,
                _ => any & draw.whole(32) as u8,
            });
        }
        Scenery { size, mask, terrain }
    }

    fn upload(&self, gpu: &Gpu) -> geometry::Targets {
        let [width, height] = self.size;
        let texture = |label, format, aspect, texels: Option<&[u8]>| {
            let size = wgpu::Extent3d { width, height, depth_or_array_layers: 1 };
            let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size,
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
                view_formats: &[],
            });
            if let Some(texels) = texels {
                gpu.queue.write_texture(
                    wgpu::TexelCopyTextureInfo { texture: &texture, mip_level: 0, origin: wgpu::Origin3d::ZERO, aspect },
                    texels,
                    wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(width), rows_per_image: None },
                    size,
                );
            }
            texture
        };
        let stencil: Vec<u8> = self.terrain.iter().map(|&t| u8::from(t)).collect();
        geometry::Targets {
            depth_stencil: texture("depth and stencil", geometry::DEPTH_FORMAT, wgpu::TextureAspect::StencilOnly, Some(&stencil)),
            mask: texture("mask", wgpu::TextureFormat::R8Uint, wgpu::TextureAspect::All, Some(&self.mask)),
            normals: texture("normals", wgpu::TextureFormat::Rgba8Unorm, wgpu::TextureAspect::All, None),
        }
    }

    fn classify(&self, gpu: &Gpu, pass: &Classification, layout: &wgpu::BindGroupLayout, forced: Option<u8>) -> Vec<Vec<u32>> {
        let mut uniforms = FrameUniforms::zeroed();
        uniforms.size = self.size;
        uniforms.tiles = tiles(self.size);
        uniforms.forced_mask = forced.map_or(0, u32::from);
        let buffer = gpu.buffer_with("frame", wgpu::BufferUsages::UNIFORM, bytes_of(&uniforms));
        let frame = gpu.group("frame", layout, &[buffer.as_entire_binding()]);
        let (targets, lists) = (self.upload(gpu), Lists::new(gpu, self.size, classification::TILE));
        let groups = [&frame];
        let mut rec = Recording::new(gpu, &groups);
        pass.encode(&mut rec, &targets, &lists);
        rec.submit().unwrap_or_else(|e| panic!("{e}"));
        lists.read(gpu).unwrap_or_else(|e| panic!("{e}"))
    }

    /// Compares the 32 lists with the masks of the tiles. The order of tiles in a list does not matter.
    fn compare(&self, lists: &[Vec<u32>], masks: &[u8]) -> Result<(), String> {
        let columns = tiles(self.size)[0];
        let mut expected = vec![Vec::new(); 32];
        for (tile, &mask) in (0u32..).zip(masks) {
            if mask != 0 {
                let entry = (tile % columns) | (tile / columns) << 12 | u32::from(mask) << 24;
                expected[0].push(entry);
                expected[usize::from(mask)].push(entry);
            }
        }
        for (list, (got, want)) in lists.iter().zip(&mut expected).enumerate() {
            let mut got = got.clone();
            got.sort_unstable();
            want.sort_unstable();
            if got != *want {
                return Err(format!("{:?}, list {list} differs: {} tiles, {} expected", self.size, got.len(), want.len()));
            }
        }
        if lists.len() == 32 { Ok(()) } else { Err(format!("{} lists", lists.len())) }
    }
}

/// Compares both paths of the pass with the reference. The subgroup path is used if the adapter has subgroup operations.
#[test]
fn classification_agrees_on_both_paths() {
    let plain = open(GpuOptions { plain: true });
    assert!(!plain.features.contains(wgpu::Features::SUBGROUP));
    for (path, gpu) in [("the adapter's best", gpu()), ("plain", &plain)] {
        let layout = gpu.layout("frame", wgpu::ShaderStages::COMPUTE, &[Binding::Uniform]);
        let pass = Classification::new(gpu, &layout, classification::TILE).unwrap_or_else(|e| panic!("{e}"));
        for (table, size) in (0..).zip([[150, 91], [64, 64], [1, 1], [7, 17], [8, 8], [1021, 9], [640, 361]]) {
            let scenery = Scenery::random(size, table);
            for forced in [None, Some(2), Some(31)] {
                let lists = scenery.classify(gpu, &pass, &layout, forced);
                let masks = tile_masks(size, &scenery.mask, &scenery.terrain, forced);
                scenery.compare(&lists, &masks).unwrap_or_else(|e| panic!("{path}, forced {forced:?}: {e}"));
            }
        }
    }
}

/// Runs the classification with other source files than the stage's own, and binds the layout of `Classification`.
fn classify_by(gpu: &Gpu, pieces: Vec<Piece>, scenery: &Scenery) -> Vec<Vec<u32>> {
    let shader = gpu::Shader::new(gpu, "mutant", pieces).unwrap_or_else(|e| panic!("{e}"));
    let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some("mutant"),
        layout: None,
        module: &shader.module,
        entry_point: Some("classification_main"),
        compilation_options: Default::default(),
        cache: None,
    });
    let mut uniforms = FrameUniforms::zeroed();
    uniforms.size = scenery.size;
    uniforms.tiles = tiles(scenery.size);
    let buffer = gpu.buffer_with("frame", wgpu::BufferUsages::UNIFORM, bytes_of(&uniforms));
    let (targets, lists) = (scenery.upload(gpu), Lists::new(gpu, scenery.size, classification::TILE));
    let frame = gpu.group("frame", &pipeline.get_bind_group_layout(0), &[buffer.as_entire_binding()]);
    let group = gpu.group(
        "mutant",
        &pipeline.get_bind_group_layout(1),
        &[
            wgpu::BindingResource::TextureView(&view(&targets.mask)),
            wgpu::BindingResource::TextureView(&aspect(&targets.depth_stencil, wgpu::TextureAspect::StencilOnly)),
            lists.tiles.as_entire_binding(),
            lists.arguments.as_entire_binding(),
        ],
    );
    let mut encoder = gpu.encoder("mutant");
    {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &frame, &[]);
        pass.set_bind_group(1, &group, &[]);
        pass.dispatch_workgroups(uniforms.tiles[0], uniforms.tiles[1], 1);
    }
    gpu.submit_and_wait(encoder).unwrap_or_else(|e| panic!("{e}"));
    lists.read(gpu).unwrap_or_else(|e| panic!("{e}"))
}

/// Negative controls: passes with one error each.
#[test]
fn wrong_classification_is_noticed() {
    let scenery = Scenery::random([150, 91], 0);
    let masks = tile_masks(scenery.size, &scenery.mask, &scenery.terrain, None);
    for subgroups in [false, true] {
        if subgroups && !gpu().features.contains(wgpu::Features::SUBGROUP) {
            println!("left out: this adapter has no subgroup operations");
            continue;
        }
        let run = |from: &str, to: &str| {
            let mut pieces = if subgroups { &classification::SUBGROUP_MODULE } else { &classification::PLAIN_MODULE }.pieces();
            let count: usize = pieces.iter().map(|piece| piece.text.matches(from).count()).sum();
            assert_eq!(count, 1, "`{from}` must occur exactly once");
            pieces.iter_mut().for_each(|piece| piece.text = piece.text.replace(from, to));
            scenery.compare(&classify_by(gpu(), pieces, &scenery), &masks)
        };
        run("fn classification_main", "fn classification_main").unwrap_or_else(|e| panic!("{e}"));
        // In this order: the largest mask instead of the OR of all masks; sky counted as terrain; the wrong rows of a tile; no entries in the list of
        // all tiles.
        let one = if subgroups { "subgroupOr(" } else { "atomicOr(" };
        let largest = if subgroups { "subgroupMax(" } else { "atomicMax(" };
        let mut mutants = vec![
            (one, largest),
            ("textureLoad(stencil_target, pixel, 0).r == 0u", "textureLoad(stencil_target, pixel, 0).r == 2u"),
            ("vec2<u32>(thread % TILE, thread / TILE)", "vec2<u32>(thread % TILE, thread / 4u)"),
            ("atomicAdd(&arguments[0].instance_count, 1u)", "atomicAdd(&arguments[0].instance_count, 0u)"),
        ];
        if subgroups {
            mutants.push(("if lane == 0u {", "if thread == 0u {"));
        }
        for (from, to) in mutants {
            // If a subgroup is as large as the workgroup, its first lane is the workgroup's first thread, so this mutant changes nothing.
            let whole = from.starts_with("if lane") && gpu().info.subgroup_max_size >= 64;
            assert!(whole || run(from, to).is_err(), "subgroups {subgroups}: `{to}` for `{from}` was not noticed");
        }
    }
}

/// Negative controls of the comparison above: lists that differ from the reference's in one respect.
#[test]
fn classification_comparison_notices_differences() {
    let scenery = Scenery::random([150, 91], 0);
    let masks = tile_masks(scenery.size, &scenery.mask, &scenery.terrain, None);
    assert!(masks.contains(&0) && masks.iter().collect::<BTreeSet<_>>().len() > 16, "the scenery is too plain");
    let layout = gpu().layout("frame", wgpu::ShaderStages::COMPUTE, &[Binding::Uniform]);
    let pass = Classification::new(gpu(), &layout, classification::TILE).unwrap_or_else(|e| panic!("{e}"));
    let lists = scenery.classify(gpu(), &pass, &layout, None);
    scenery.compare(&lists, &masks).unwrap_or_else(|e| panic!("{e}"));
    let rejects = |what: &str, change: &dyn Fn(&mut Vec<Vec<u32>>)| {
        let mut changed = lists.clone();
        change(&mut changed);
        assert!(scenery.compare(&changed, &masks).is_err(), "{what}: not noticed");
    };
    let used = (1..32).find(|&i| !lists[i].is_empty()).expect("tiles");
    rejects("a tile lost", &|l| {
        l[used].pop();
    });
    rejects("a tile twice", &|l| l[0].push(lists[0][0]));
    rejects("a tile in the wrong list", &|l| {
        let tile = l[used].pop().expect("used");
        l[if used == 1 { 2 } else { 1 }].push(tile);
    });
    rejects("a mask with a bit too many", &|l| l[0][0] ^= 1 << 28);
    rejects("column and row exchanged", &|l| {
        for entry in &mut l[0] {
            *entry = (*entry & 0xff00_0000) | (*entry & 4095) << 12 | (*entry >> 12 & 4095);
        }
    });
    // Wrong references, in this order: pixels without terrain count; only a tile's first pixel counts; the picture's last column is left out.
    let everywhere = vec![true; scenery.terrain.len()];
    assert!(scenery.compare(&lists, &tile_masks(scenery.size, &scenery.mask, &everywhere, None)).is_err());
    let only_first: Vec<bool> = scenery.terrain.iter().enumerate().map(|(i, &t)| t && i % 150 % 8 == 0 && i / 150 % 8 == 0).collect();
    assert!(scenery.compare(&lists, &tile_masks(scenery.size, &scenery.mask, &only_first, None)).is_err());
    let narrower: Vec<bool> = scenery.terrain.iter().enumerate().map(|(i, &t)| t && i % 150 != 149).collect();
    let others = tile_masks(scenery.size, &scenery.mask, &narrower, None);
    assert_ne!(others, masks, "the last column must matter");
    assert!(scenery.compare(&lists, &others).is_err());
}
