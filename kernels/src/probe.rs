//! Shared functions as tables: rows of numbers in, rows of numbers out, on the GPU or by the reference in f32 or f64.
//!
//! One table serves the command line and the tests of agreement, so that both look at the same thing. f64 is the truth, f32 the
//! yardstick for the shader's error. All three take the same columns; values are rounded to f32 on the way to f32 and GPU, so a
//! comparison should be given values that f32 holds.

use serde::Serialize;

use crate::error::{Error, Result};
use crate::gpu::{self, Gpu};
use crate::scene::nearest;
use crate::shared::blue_noise::{RANKS, SLICES};
use crate::shared::noise::{self, HashedPoint, NoiseKind, hashed_anisotropic, hashed_isotropic};
use crate::shared::real::{Real, add, scale};
use crate::shared::{
    biplanar, derivatives, hex_tiling, layers, octahedral, select, snapped_projection, splat_blend, texel_choice, triplanar,
};

/// Whole numbers travel as f32, which holds them exactly up to this magnitude.
const EXACT: i32 = 1 << 24;

/// Last place of [`crate::shared::blue_noise::ranks`].
const MASK_PLACES: i32 = (RANKS * (1 + SLICES)).cast_signed() - 1;

/// Rows given to the GPU in one go: bounds its buffers.
const GPU_ROWS: usize = 1 << 20;

/// A column of a probe's table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Column {
    /// Name in the table's header.
    pub name: &'static str,
    /// Unit, or what the number means.
    pub unit: &'static str,
    /// Smallest and largest value of a column of whole numbers; absent where any number will do.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub whole: Option<[i32; 2]>,
}

impl Column {
    const fn real(name: &'static str, unit: &'static str) -> Column {
        Column { name, unit, whole: None }
    }

    const fn whole(name: &'static str, unit: &'static str, low: i32, high: i32) -> Column {
        Column { name, unit, whole: Some([low, high]) }
    }

    /// Whether a value may stand in this column.
    ///
    /// # Errors
    /// Says what the column takes.
    pub fn accepts(&self, value: f64) -> std::result::Result<(), String> {
        match self.whole {
            Some([low, high]) if value.fract() != 0.0 || !(f64::from(low)..=f64::from(high)).contains(&value) => {
                Err(format!("`{}` takes whole numbers from {low} to {high}, not {value}", self.name))
            }
            _ => Ok(()),
        }
    }
}

type Reference<T> = fn(&[T], &mut Vec<T>);

/// A shared function as a table.
pub struct Probe {
    /// The name used on the command line.
    pub name: &'static str,
    /// One sentence for people.
    pub about: &'static str,
    /// Columns read.
    pub inputs: &'static [Column],
    /// Columns made.
    pub outputs: &'static [Column],
    /// WGSL that defines `fn probe(row: array<f32, IN>) -> array<f32, OUT>` over the shared functions.
    pub wgsl: &'static str,
    single: Reference<f32>,
    double: Reference<f64>,
}

impl std::fmt::Debug for Probe {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Probe").field("name", &self.name).finish_non_exhaustive()
    }
}

impl Probe {
    /// The probe of this name.
    ///
    /// # Errors
    /// There is none: names the nearest.
    pub fn find(name: &str) -> Result<&'static Probe> {
        PROBES.iter().find(|probe| probe.name == name).ok_or_else(|| {
            let names: Vec<&str> = PROBES.iter().map(|probe| probe.name).collect();
            let hint =
                nearest(name, &names).map_or_else(|| format!("there are {}", names.join(", ")), |near| format!("did you mean `{near}`?"));
            Error::Request(format!("no kernel is called `{name}`: {hint}"))
        })
    }

    /// Evaluates the reference in single precision over row-major `rows` (a whole number of rows of `inputs`).
    pub fn on_f32(&self, rows: &[f32]) -> Vec<f32> {
        self.evaluate(self.single, rows)
    }

    /// Evaluates the reference in double precision over row-major `rows` (a whole number of rows of `inputs`).
    pub fn on_f64(&self, rows: &[f64]) -> Vec<f64> {
        self.evaluate(self.double, rows)
    }

    /// Evaluates the shader over row-major `rows` (a whole number of rows of `inputs`).
    ///
    /// # Errors
    /// The device is lost or refuses the shader.
    pub fn on_gpu(&self, gpu: &Gpu, rows: &[f32]) -> Result<Vec<f32>> {
        let (columns, results) = (self.inputs.len(), self.outputs.len());
        let mut all = Vec::with_capacity(rows.len() / columns * results);
        for part in rows.chunks(GPU_ROWS * columns) {
            all.extend(gpu::probe::run(gpu, self.wgsl, part, columns, results)?);
        }
        Ok(all)
    }

    fn evaluate<T: Real>(&self, reference: Reference<T>, rows: &[T]) -> Vec<T> {
        let mut all = Vec::with_capacity(rows.len() / self.inputs.len() * self.outputs.len());
        for row in rows.chunks_exact(self.inputs.len()) {
            reference(row, &mut all);
        }
        all
    }
}

const fn real(name: &'static str, unit: &'static str) -> Column {
    Column::real(name, unit)
}

/// Every probe.
pub const PROBES: &[Probe] = &[
    Probe {
        name: "octahedral",
        about: "A direction as an octahedral code of 8 + 8 bits (best of the four neighbours), and decoded again",
        inputs: &[real("n_x", "direction, any length"), real("n_y", "direction"), real("n_z", "direction")],
        outputs: &[
            real("e_x", "continuous code, -1..1"),
            real("e_y", "continuous code, -1..1"),
            Column::whole("code_x", "8-bit code", 0, 254),
            Column::whole("code_y", "8-bit code", 0, 254),
            real("decoded_x", "unit vector"),
            real("decoded_y", "unit vector"),
            real("decoded_z", "unit vector"),
        ],
        wgsl: "\
fn probe(row: array<f32, 3>) -> array<f32, 7> {
    let n = vec3<f32>(row[0], row[1], row[2]);
    let e = octahedral_encode(n);
    let stored = octahedral_encode8_precise(n);
    let code = round(stored * 255.0);
    let decoded = octahedral_decode(octahedral_dequantise8(stored));
    return array<f32, 7>(e.x, e.y, code.x, code.y, decoded.x, decoded.y, decoded.z);
}",
        single: octahedral_row,
        double: octahedral_row,
    },
    Probe {
        name: "hashed-alpha",
        about: "Hashed-alpha thresholds of a point: four independent numbers, stable under motion",
        inputs: &[
            Column::whole("kind", "0 = isotropic, 1 = anisotropic", 0, 1),
            Column::whole("sector_x", "sectors east of the south-west corner", -EXACT, EXACT),
            Column::whole("sector_y", "sectors north of the south-west corner", -EXACT, EXACT),
            real("x", "m east in the sector"),
            real("y", "m north in the sector"),
            real("z", "m, elevation"),
            real("sector_m", "m, a power of two in 32..=16384"),
            real("ddx_x", "m, step to the pixel on the right"),
            real("ddx_y", "m"),
            real("ddx_z", "m"),
            real("ddy_x", "m, step to the pixel below"),
            real("ddy_y", "m"),
            real("ddy_z", "m"),
            real("hash_scale", "cell size in pixels"),
            Column::whole("seed", "seed", 0, EXACT),
            Column::whole("salt", "number of the decision", 0, EXACT),
        ],
        outputs: &[real("u_0", "0..1"), real("u_1", "0..1"), real("u_2", "0..1"), real("u_3", "0..1")],
        wgsl: "\
fn probe(row: array<f32, 16>) -> array<f32, 4> {
    let u = noise_thresholds(
        u32(row[0]),
        vec2<i32>(i32(row[1]), i32(row[2])),
        vec3<f32>(row[3], row[4], row[5]),
        row[6],
        vec3<f32>(row[7], row[8], row[9]),
        vec3<f32>(row[10], row[11], row[12]),
        row[13],
        0,
        vec2<u32>(0u, 0u),
        0u,
        u32(row[14]),
        u32(row[15]),
        vec4<u32>(0u),
    );
    return array<f32, 4>(u.x, u.y, u.z, u.w);
}",
        single: hashed_alpha_row,
        double: hashed_alpha_row,
    },
    Probe {
        name: "noise",
        about: "Thresholds of the kinds of noise that are not hashed alpha, and which ranks of the masks they take",
        inputs: &[
            Column::whole("kind", "2 = white, 3 = world, 4 = ign, 5 = blue, 6 = stbn", 2, 6),
            Column::whole("sector_x", "sectors east of the south-west corner", -EXACT, EXACT),
            Column::whole("sector_y", "sectors north of the south-west corner", -EXACT, EXACT),
            real("x", "m east in the sector"),
            real("y", "m north in the sector"),
            real("z", "m, elevation"),
            real("sector_m", "m, a power of two in 32..=16384"),
            Column::whole("world_level", "log2 of cells per metre", -EXACT, EXACT),
            Column::whole("pixel_x", "column", 0, EXACT),
            Column::whole("pixel_y", "row", 0, EXACT),
            Column::whole("frame", "index", 0, EXACT),
            Column::whole("seed", "seed", 0, EXACT),
            Column::whole("salt", "number of the decision", 0, EXACT),
            Column::whole("rank_0", "what stands at index_0; of use to blue and stbn", 0, EXACT),
            Column::whole("rank_1", "what stands at index_1", 0, EXACT),
            Column::whole("rank_2", "what stands at index_2", 0, EXACT),
            Column::whole("rank_3", "what stands at index_3", 0, EXACT),
        ],
        outputs: &[
            Column::whole("index_0", "place of the rank in the masks", 0, MASK_PLACES),
            Column::whole("index_1", "place", 0, MASK_PLACES),
            Column::whole("index_2", "place", 0, MASK_PLACES),
            Column::whole("index_3", "place", 0, MASK_PLACES),
            real("u_0", "0..1"),
            real("u_1", "0..1"),
            real("u_2", "0..1"),
            real("u_3", "0..1"),
        ],
        wgsl: "\
fn probe(row: array<f32, 17>) -> array<f32, 8> {
    let kind = u32(row[0]);
    let pixel = vec2<u32>(u32(row[8]), u32(row[9]));
    let frame = u32(row[10]);
    let seed = u32(row[11]);
    let salt = u32(row[12]);
    let u = noise_thresholds(
        kind,
        vec2<i32>(i32(row[1]), i32(row[2])),
        vec3<f32>(row[3], row[4], row[5]),
        row[6],
        vec3<f32>(0.0),
        vec3<f32>(0.0),
        1.0,
        i32(row[7]),
        pixel,
        frame,
        seed,
        salt,
        vec4<u32>(u32(row[13]), u32(row[14]), u32(row[15]), u32(row[16])),
    );
    return array<f32, 8>(
        f32(noise_rank_index(kind, pixel, frame, seed, salt, 0u)),
        f32(noise_rank_index(kind, pixel, frame, seed, salt, 1u)),
        f32(noise_rank_index(kind, pixel, frame, seed, salt, 2u)),
        f32(noise_rank_index(kind, pixel, frame, seed, salt, 3u)),
        u.x, u.y, u.z, u.w,
    );
}",
        single: noise_row,
        double: noise_row,
    },
    Probe {
        name: "derivatives",
        about: "Step of the position to the neighbouring pixel: its ray cut with the plane through the point",
        inputs: &[
            real("ray_x", "ray of the pixel"),
            real("ray_y", "ray"),
            real("ray_z", "ray"),
            real("step_x", "from its ray to the neighbour's"),
            real("step_y", "ray"),
            real("step_z", "ray"),
            real("t", "the point is ray * t; m where rays have no unit"),
            real("normal_x", "plane's normal, any length"),
            real("normal_y", "normal"),
            real("normal_z", "normal"),
        ],
        outputs: &[real("d_x", "unit of ray * t"), real("d_y", "unit of ray * t"), real("d_z", "unit of ray * t")],
        wgsl: "\
fn probe(row: array<f32, 10>) -> array<f32, 3> {
    let d = derivatives_on_plane(
        vec3<f32>(row[0], row[1], row[2]), vec3<f32>(row[3], row[4], row[5]), row[6], vec3<f32>(row[7], row[8], row[9])
    );
    return array<f32, 3>(d.x, d.y, d.z);
}",
        single: derivatives_row,
        double: derivatives_row,
    },
    Probe {
        name: "splat-blend",
        about: "Weights of four splat texels: bilinear, modified by material height; at once, and term by term",
        inputs: &[
            real("fraction_x", "0..1 between the texels, east"),
            real("fraction_y", "0..1 between the texels, north"),
            real("h_00", "height, 0..1"),
            real("h_10", "height, 0..1"),
            real("h_01", "height, 0..1"),
            real("h_11", "height, 0..1"),
            real("sharpness", "k in w' = w 2^(k h)"),
        ],
        outputs: &[
            real("w_00", "0..1"),
            real("w_10", "0..1"),
            real("w_01", "0..1"),
            real("w_11", "0..1"),
            real("run_00", "0..1"),
            real("run_10", "0..1"),
            real("run_01", "0..1"),
            real("run_11", "0..1"),
        ],
        wgsl: "\
fn probe(row: array<f32, 7>) -> array<f32, 8> {
    let fraction = vec2<f32>(row[0], row[1]);
    let heights = vec4<f32>(row[2], row[3], row[4], row[5]);
    let w = splat_blend_weights(fraction, heights, row[6]);
    let bilinear = splat_blend_bilinear(fraction);
    var terms = mat4x4<f32>(vec4<f32>(1.0, 0.0, 0.0, 0.0), vec4<f32>(0.0, 1.0, 0.0, 0.0), vec4<f32>(0.0, 0.0, 1.0, 0.0), vec4<f32>(0.0, 0.0, 0.0, 1.0));
    var run = splat_blend_start();
    var sum = vec4<f32>(0.0);
    for (var i = 0u; i < 4u; i++) {
        run = splat_blend_add(run, bilinear[i], heights[i], row[6]);
        sum = run.keep * sum + run.share * terms[i];
    }
    sum /= dot(sum, vec4<f32>(1.0));
    return array<f32, 8>(w.x, w.y, w.z, w.w, sum.x, sum.y, sum.z, sum.w);
}",
        single: splat_blend_row,
        double: splat_blend_row,
    },
    Probe {
        name: "tri-planar",
        about: "Weights of three projections, and the normal bent by the height gradients seen in them",
        inputs: &[
            real("n_x", "direction, any length"),
            real("n_y", "direction"),
            real("n_z", "direction"),
            real("sharpness", "k in w = |n|^k"),
            real("g_0_y", "height gradient in the x projection, along y"),
            real("g_0_z", "along z"),
            real("g_1_x", "height gradient in the y projection, along x"),
            real("g_1_z", "along z"),
            real("g_2_x", "height gradient in the z projection, along x"),
            real("g_2_y", "along y"),
        ],
        outputs: &[
            real("w_x", "0..1"),
            real("w_y", "0..1"),
            real("w_z", "0..1"),
            real("bent_x", "unit vector"),
            real("bent_y", "unit vector"),
            real("bent_z", "unit vector"),
        ],
        wgsl: "\
fn probe(row: array<f32, 10>) -> array<f32, 6> {
    let n = vec3<f32>(row[0], row[1], row[2]);
    let w = triplanar_weights(n, row[3]);
    let gradient = w.x * triplanar_from_gradient(vec2<f32>(row[4], row[5]), 0u)
        + w.y * triplanar_from_gradient(vec2<f32>(row[6], row[7]), 1u)
        + w.z * triplanar_from_gradient(vec2<f32>(row[8], row[9]), 2u);
    let bent = triplanar_perturb(n, gradient);
    return array<f32, 6>(w.x, w.y, w.z, bent.x, bent.y, bent.z);
}",
        single: tri_planar_row,
        double: tri_planar_row,
    },
    Probe {
        name: "select",
        about: "Choice of an index by weight, out of all four and out of the first three",
        inputs: &[
            real("w_0", "weight, >= 0"),
            real("w_1", "weight, >= 0"),
            real("w_2", "weight, >= 0"),
            real("w_3", "weight, >= 0"),
            real("u", "uniform number, 0..1"),
        ],
        outputs: &[Column::whole("of_4", "index", 0, 3), Column::whole("of_3", "index", 0, 2)],
        wgsl: "\
fn probe(row: array<f32, 5>) -> array<f32, 2> {
    let of_4 = select_of_4(vec4<f32>(row[0], row[1], row[2], row[3]), row[4]);
    let of_3 = select_of_3(vec3<f32>(row[0], row[1], row[2]), row[4]);
    return array<f32, 2>(f32(of_4), f32(of_3));
}",
        single: select_row,
        double: select_row,
    },
    Probe {
        name: "biplanar",
        about: "The two projections that a surface faces most, and their weights",
        inputs: &[
            real("n_x", "direction, any length"),
            real("n_y", "direction"),
            real("n_z", "direction"),
            real("sharpness", "k of tri-planar weights"),
        ],
        outputs: &[
            Column::whole("axis_0", "0 = x, 1 = y, 2 = z", 0, 2),
            Column::whole("axis_1", "axis", 0, 2),
            real("w_0", "0..1"),
            real("w_1", "0..1"),
        ],
        wgsl: "\
fn probe(row: array<f32, 4>) -> array<f32, 4> {
    let b = biplanar_projections(vec3<f32>(row[0], row[1], row[2]), row[3]);
    return array<f32, 4>(f32(b.axes.x), f32(b.axes.y), b.weights.x, b.weights.y);
}",
        single: biplanar_row,
        double: biplanar_row,
    },
    Probe {
        name: "hex-tiling",
        about: "The three hexagons around a point, their weights, and the texture's offset in the first",
        inputs: &[
            Column::whole("sector_0", "whole sectors along the first coordinate", -EXACT, EXACT),
            Column::whole("sector_1", "whole sectors along the second", -EXACT, EXACT),
            real("x_0", "m beyond them"),
            real("x_1", "m beyond them"),
            real("sector_m", "m"),
            real("repeats", "of the texture along a sector"),
            Column::whole("salt", "number of the lattice", 0, EXACT),
        ],
        outputs: &[
            Column::whole("level", "log2 of hexagons along a sector", -10, 15),
            Column::whole("id_0_0", "column of the first hexagon", 0, 65_535),
            Column::whole("id_0_1", "its row", 0, 65_535),
            Column::whole("id_1_0", "column of the second", 0, 65_535),
            Column::whole("id_1_1", "its row", 0, 65_535),
            Column::whole("id_2_0", "column of the third", 0, 65_535),
            Column::whole("id_2_1", "its row", 0, 65_535),
            real("w_0", "0..1"),
            real("w_1", "0..1"),
            real("w_2", "0..1"),
            real("offset_0", "0..1, in the first hexagon"),
            real("offset_1", "0..1"),
        ],
        wgsl: "\
fn probe(row: array<f32, 7>) -> array<f32, 12> {
    let level = hex_tiling_level(row[5]);
    let t = hex_tiling_at(vec2<i32>(i32(row[0]), i32(row[1])), vec2<f32>(row[2], row[3]), row[4], level);
    let offset = hex_tiling_offset(t.first, u32(row[6]));
    let ids = array<vec2<f32>, 3>(vec2<f32>(hex_tiling_id(t, 0u)), vec2<f32>(hex_tiling_id(t, 1u)), vec2<f32>(hex_tiling_id(t, 2u)));
    return array<f32, 12>(
        f32(level), ids[0].x, ids[0].y, ids[1].x, ids[1].y, ids[2].x, ids[2].y, t.weights.x, t.weights.y, t.weights.z, offset.x, offset.y,
    );
}",
        single: hex_tiling_row,
        double: hex_tiling_row,
    },
    Probe {
        name: "texel-choice",
        about: "A mip level and a texel by chance, whose expectation is the trilinear filter",
        inputs: &[
            real("lod", "level of detail"),
            Column::whole("levels", "of the texture", 1, 15),
            real("u_level", "uniform number, 0..1"),
            real("coordinate", "texture coordinate, repeats"),
            Column::whole("size", "of the level, texels", 1, 16_384),
            real("u_texel", "uniform number, 0..1"),
        ],
        outputs: &[Column::whole("level", "mip level", 0, 14), Column::whole("texel", "column or row", 0, 16_383)],
        wgsl: "\
fn probe(row: array<f32, 6>) -> array<f32, 2> {
    let level = texel_choice_level(row[0], u32(row[1]), row[2]);
    return array<f32, 2>(f32(level), f32(texel_choice_texel(row[3], u32(row[4]), row[5])));
}",
        single: texel_choice_row,
        double: texel_choice_row,
    },
    Probe {
        name: "layers",
        about: "Weights of eight layers blended one over the other, of four splat texels that each show one of them",
        inputs: &[
            real("w_00", "weight of a texel, 0..1"),
            real("w_10", "weight"),
            real("w_01", "weight"),
            real("w_11", "weight"),
            Column::whole("l_00", "its layer", 0, 7),
            Column::whole("l_10", "layer", 0, 7),
            Column::whole("l_01", "layer", 0, 7),
            Column::whole("l_11", "layer", 0, 7),
        ],
        outputs: &[
            real("layer_0", "0..1"),
            real("layer_1", "0..1"),
            real("layer_2", "0..1"),
            real("layer_3", "0..1"),
            real("layer_4", "0..1"),
            real("layer_5", "0..1"),
            real("layer_6", "0..1"),
            real("layer_7", "0..1"),
        ],
        wgsl: "\
fn probe(row: array<f32, 8>) -> array<f32, 8> {
    let weights = vec4<f32>(row[0], row[1], row[2], row[3]);
    let layers = vec4<u32>(u32(row[4]), u32(row[5]), u32(row[6]), u32(row[7]));
    var blended: array<f32, 8>;
    var below = 0.0;
    for (var layer = 0u; layer < LAYERS; layer++) {
        let share = layers_share(weights, layers, layer);
        let opacity = layers_opacity(layer, share, below);
        below += share;
        for (var i = 0u; i < LAYERS; i++) {
            blended[i] = mix(blended[i], select(0.0, 1.0, i == layer), opacity);
        }
    }
    return blended;
}",
        single: layers_row,
        double: layers_row,
    },
    Probe {
        name: "snapped-projection",
        about: "The one plane that a normal is projected along, and what it makes of a position, of sectors and of a gradient",
        inputs: &[
            real("n_x", "direction, any length"),
            real("n_y", "direction"),
            real("n_z", "direction"),
            real("cosine", "of the slope where steep begins"),
            real("p_x", "m"),
            real("p_y", "m"),
            real("p_z", "m"),
            Column::whole("sector_x", "sectors east", -(1 << 20), 1 << 20),
            Column::whole("sector_y", "sectors north", -(1 << 20), 1 << 20),
            Column::whole("sector_z", "sectors up", -(1 << 20), 1 << 20),
            Column::whole("fixed", "repeats per sector, in 2^-24", -EXACT, EXACT),
            real("g_0", "height gradient along the first coordinate"),
            real("g_1", "along the second"),
        ],
        outputs: &[
            Column::whole("plane", "0..2 = looking along x, y, z; 3, 4 = along (1, 1), (1, -1)", 0, 4),
            Column::whole("sectors_0", "sectors along the first coordinate", -(1 << 21), 1 << 21),
            Column::whole("sectors_1", "along the second", -(1 << 21), 1 << 21),
            Column::whole("rate", "repeats per sector along the first, in 2^-24", -EXACT, EXACT),
            real("c_0", "m along the first"),
            real("c_1", "m along the second"),
            real("gradient_x", "in the volume"),
            real("gradient_y", "in the volume"),
            real("gradient_z", "in the volume"),
        ],
        wgsl: "\
fn probe(row: array<f32, 13>) -> array<f32, 9> {
    let plane = snapped_plane(vec3<f32>(row[0], row[1], row[2]), row[3]);
    let sectors = snapped_sectors(vec3<i32>(i32(row[7]), i32(row[8]), i32(row[9])), plane);
    let c = snapped_coordinates(vec3<f32>(row[4], row[5], row[6]), plane);
    let g = snapped_from_gradient(vec2<f32>(row[11], row[12]), plane);
    return array<f32, 9>(f32(plane), f32(sectors.x), f32(sectors.y), f32(snapped_fixed(i32(row[10]), plane)), c.x, c.y, g.x, g.y, g.z);
}",
        single: snapped_projection_row,
        double: snapped_projection_row,
    },
];

/// `N` values of a row from place `at` on.
fn take<T: Real, const N: usize>(row: &[T], at: usize) -> [T; N] {
    std::array::from_fn(|i| row[at + i])
}

fn octahedral_row<T: Real>(row: &[T], out: &mut Vec<T>) {
    let n = take(row, 0);
    let stored = octahedral::encode8_precise(n);
    out.extend(octahedral::encode(n));
    out.extend(stored.map(|s| (s * T::of(255.0)).round()));
    out.extend(octahedral::decode(octahedral::dequantise8(stored)));
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "Column::accepts keeps these columns whole and in range")]
fn hashed_alpha_row<T: Real>(row: &[T], out: &mut Vec<T>) {
    let point = HashedPoint {
        sector: take::<T, 2>(row, 1).map(|v| v.to_f64() as i32),
        position: take(row, 3),
        sector_m: row[6],
        ddx: take(row, 7),
        ddy: take(row, 10),
        hash_scale: row[13],
    };
    let [seed, salt] = take::<T, 2>(row, 14).map(|v| v.to_f64() as u32);
    out.extend(if row[0] < T::one() { hashed_isotropic(&point, seed, salt) } else { hashed_anisotropic(&point, seed, salt) });
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "Column::accepts keeps these columns whole and in range")]
fn noise_row<T: Real>(row: &[T], out: &mut Vec<T>) {
    let zero = T::zero();
    let point = HashedPoint {
        sector: take::<T, 2>(row, 1).map(|v| v.to_f64() as i32),
        position: take(row, 3),
        sector_m: row[6],
        ddx: [zero; 3],
        ddy: [zero; 3],
        hash_scale: T::one(),
    };
    let kind = NoiseKind::ALL[row[0].to_f64() as usize];
    let level = row[7].to_f64() as i32;
    let [x, y, frame, seed, salt] = take::<T, 5>(row, 8).map(|v| v.to_f64() as u32);
    let ranks = take::<T, 4>(row, 13).map(|v| v.to_f64() as u32);
    out.extend([0, 1, 2, 3].map(|decision| T::of(f64::from(noise::rank_index(kind, [x, y], frame, seed, salt, decision)))));
    out.extend(if kind.needs_mask() {
        noise::mask(kind, [x, y], frame, seed, salt, ranks)
    } else {
        noise::thresholds(kind, &point, level, [x, y], frame, seed, salt)
    });
}

fn derivatives_row<T: Real>(row: &[T], out: &mut Vec<T>) {
    out.extend(derivatives::on_plane(take(row, 0), take(row, 3), row[6], take(row, 7)));
}

fn splat_blend_row<T: Real>(row: &[T], out: &mut Vec<T>) {
    let (fraction, heights) = (take(row, 0), take(row, 2));
    out.extend(splat_blend::weights(fraction, heights, row[6]));
    let mut run = splat_blend::Run::start();
    let mut sum = [T::zero(); 4];
    for (i, (w, h)) in splat_blend::bilinear(fraction).into_iter().zip(heights).enumerate() {
        run = run.add(w, h, row[6]);
        sum = scale(sum, run.keep);
        sum[i] = run.share;
    }
    out.extend(scale(sum, T::one() / sum.into_iter().fold(T::zero(), |s, x| s + x)));
}

fn tri_planar_row<T: Real>(row: &[T], out: &mut Vec<T>) {
    let n = take(row, 0);
    let w = triplanar::weights(n, row[3]);
    let along = |axis: u32, at: usize, w: T| scale(triplanar::from_gradient(take(row, at), axis), w);
    let gradient = add(add(along(0, 4, w[0]), along(1, 6, w[1])), along(2, 8, w[2]));
    out.extend(w);
    out.extend(triplanar::perturb(n, gradient));
}

fn select_row<T: Real>(row: &[T], out: &mut Vec<T>) {
    let index = |i: usize| T::of(f64::from(u8::try_from(i).expect("at most 3")));
    out.push(index(select::of_4(take(row, 0), row[4])));
    out.push(index(select::of_3(take(row, 0), row[4])));
}

fn biplanar_row<T: Real>(row: &[T], out: &mut Vec<T>) {
    let (axes, weights) = biplanar::projections(take(row, 0), row[3]);
    out.extend(axes.map(|axis| T::of(f64::from(axis))));
    out.extend(weights);
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "Column::accepts keeps these columns whole and in range")]
fn hex_tiling_row<T: Real>(row: &[T], out: &mut Vec<T>) {
    let level = hex_tiling::level(row[5]);
    let tiling = hex_tiling::at(take::<T, 2>(row, 0).map(|v| v.to_f64() as i32), take(row, 2), row[4], level);
    out.push(T::of(f64::from(level)));
    out.extend(tiling.ids.as_flattened().iter().map(|&id| T::of(f64::from(id))));
    out.extend(tiling.weights);
    out.extend(hex_tiling::offset::<T>(tiling.ids[0], row[6].to_f64() as u32));
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "Column::accepts keeps these columns whole and in range")]
fn texel_choice_row<T: Real>(row: &[T], out: &mut Vec<T>) {
    let whole = |at: usize| row[at].to_f64() as u32;
    out.push(T::of(f64::from(texel_choice::level(row[0], whole(1), row[2]))));
    out.push(T::of(f64::from(texel_choice::texel(row[3], whole(4), row[5]))));
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "Column::accepts keeps these columns whole and in range")]
fn layers_row<T: Real>(row: &[T], out: &mut Vec<T>) {
    let of = take::<T, 4>(row, 4).map(|v| v.to_f64() as u32);
    let mut below = T::zero();
    let mut opacities = [T::zero(); layers::LAYERS];
    for (layer, opacity) in (0..).zip(&mut opacities) {
        let share = layers::share(take(row, 0), of, layer);
        *opacity = layers::opacity(layer, share, below);
        below = below + share;
    }
    out.extend(layers::weights(opacities));
}

#[allow(clippy::cast_possible_truncation, reason = "Column::accepts keeps these columns whole and in range")]
fn snapped_projection_row<T: Real>(row: &[T], out: &mut Vec<T>) {
    let plane = snapped_projection::plane(take(row, 0), row[3]);
    let whole = |v: T| v.to_f64() as i32;
    out.push(T::of(f64::from(plane)));
    out.extend(snapped_projection::sectors(take::<T, 3>(row, 7).map(whole), plane).map(|s| T::of(f64::from(s))));
    out.push(T::of(f64::from(snapped_projection::fixed(whole(row[10]), plane))));
    out.extend(snapped_projection::coordinates(take(row, 4), plane));
    out.extend(snapped_projection::from_gradient(take(row, 11), plane));
}
