//! Tests of the functions of `view/frame.wgsl` and `view/full_screen.wgsl`: how the two normals of a pixel are written and read, rays, and the triangle
//! of a full-screen pass. Passes use these functions with a uniform buffer; here, the uniforms are a private variable that each row sets.

use kernels::probe::table::{Cells, Table};
use kernels::shared::{hash, normal_pair, octahedral, view};
use kernels::view::normals::NormalEncoding;

use crate::fixtures::{gpu, wgsl_text};

/// Numbers of a row: the code of the encoding, shading normal, normal of the plane, ray, and a pixel.
const INPUTS: usize = 12;
/// Numbers of a result: the texel, the two decoded normals, and the ray of the pixel.
const RESULTS: usize = 13;
/// The rays of the camera: through pixel (0, 0), and the steps per pixel to the right and down.
const RAYS: [[f32; 3]; 3] = [[-0.75, 0.5, 1.0], [0.01, 0.0015, -0.002], [0.003, -0.02, 0.0005]];

/// Returns a number from -1 to 1 that is a multiple of 2^-24.
fn random(row: u32, column: u32) -> f32 {
    (hash::pcg4d([row, column, 53, 1])[0] >> 7) as f32 / 16_777_216.0 - 1.0
}

/// Returns the inputs: random directions for each encoding. In every second row, the shading normal is near the normal of the plane, as on terrain.
fn rows() -> Vec<[f32; INPUTS]> {
    let row = |index: u32| {
        let vector = |from: u32| [from, from + 1, from + 2].map(|column| random(index, column));
        let unit = |v: [f32; 3]| octahedral::unit(v.map(f64::from)).map(|x| x as f32);
        let (plane, ray, off) = (unit(vector(0)), vector(3), vector(6));
        let near = [0, 1, 2].map(|k| plane[k] + 0.1 * off[k]);
        let shading = unit(if index.is_multiple_of(2) { near } else { off });
        let mut row = [0.0; INPUTS];
        row[0] = NormalEncoding::ALL[index as usize / 2 % 3].code() as f32;
        row[1..4].copy_from_slice(&shading);
        row[4..7].copy_from_slice(&plane);
        row[7..10].copy_from_slice(&ray);
        row[10..12].copy_from_slice(&[(index % 1920) as f32, (index % 1080) as f32]);
        row
    };
    (0..6000).map(row).collect()
}

/// The WGSL of both files, with uniforms that a shader can set.
fn wgsl() -> String {
    let binding = "@group(0) @binding(0) var<uniform> frame: Frame;";
    let frame = wgsl_text(&kernels::view::WGSL);
    assert!(frame.contains(binding), "frame.wgsl declares its uniforms in another way");
    let constants: String = NormalEncoding::ALL
        .into_iter()
        .map(|encoding| format!("const NORMALS_{}: u32 = {}u;\n", encoding.name().to_uppercase().replace('-', "_"), encoding.code()))
        .collect();
    constants + &frame.replace(binding, "var<private> frame: Frame;") + &wgsl_text(&kernels::view::FULL_SCREEN)
}

/// The largest difference between the components of two vectors.
fn off(found: &[f32], expected: [f64; 3]) -> f64 {
    found.iter().zip(expected).map(|(found, expected)| (f64::from(*found) - expected).abs()).fold(0.0, f64::max)
}

#[test]
fn stored_normals_and_rays_equal_their_references() {
    let vector = |values: [f32; 3]| format!("vec3<f32>({:?}, {:?}, {:?})", values[0], values[1], values[2]);
    let body = format!(
        "{}
fn probe(row: array<f32, {INPUTS}>) -> array<f32, {RESULTS}> {{
    frame.normals = u32(row[0]);
    frame.ray_00 = {};
    frame.ray_dx = {};
    frame.ray_dy = {};
    let texel = frame_normals(vec3<f32>(row[1], row[2], row[3]), vec3<f32>(row[4], row[5], row[6]), vec3<f32>(row[7], row[8], row[9]));
    let shading = frame_shading_normal(texel);
    let plane = frame_plane(texel);
    let ray = frame_ray(vec2<f32>(row[10], row[11]));
    return array<f32, {RESULTS}>(texel.x, texel.y, texel.z, texel.w, shading.x, shading.y, shading.z, plane.x, plane.y, plane.z, ray.x, ray.y, ray.z);
}}",
        wgsl(),
        vector(RAYS[0]),
        vector(RAYS[1]),
        vector(RAYS[2]),
    );
    let rows = rows();
    let inputs: Vec<u32> = rows.iter().flatten().map(|x| x.to_bits()).collect();
    let table = Table::new(gpu(), &body, [INPUTS, RESULTS], Cells::Reals).expect("the WGSL compiles");
    let results: Vec<f32> = table.run(&inputs).expect("the device works").into_iter().map(f32::from_bits).collect();
    // Components of unit vectors and of rays have a rounding error of a few 2^-24 after a division, a square root and some sums: at most 1e-6. At the
    // largest pixel, the ray has components up to 22, and three products and two sums have an error below 4 * 2^-24 * 22 = 6e-6.
    let (limit, ray_limit) = (1e-6, 6e-6);
    let mut other_codes = 0;
    for (row, result) in rows.iter().zip(results.chunks_exact(RESULTS)) {
        let three = |from: usize| [0, 1, 2].map(|k| f64::from(row[from + k]));
        let (shading, plane, ray) = (three(1), three(4), three(7));
        let encoding = NormalEncoding::ALL[row[0] as usize];
        let bytes: Vec<u8> = match encoding {
            NormalEncoding::Exact => bytemuck::cast_slice(&result[..4]).to_vec(),
            NormalEncoding::Octahedral | NormalEncoding::PlaneFirst => result[..4].iter().map(|x| (x * 255.0).round() as u8).collect(),
        };
        // The texel is read as the reference reads it.
        let decoded = encoding.decode(&bytes);
        for (found, expected) in [&result[4..7], &result[7..10]].into_iter().zip(decoded) {
            assert!(off(found, expected) < limit, "{encoding}, {row:?}: {found:?} is read, not {expected:?}");
        }
        // The texel is what the reference writes.
        let code = octahedral::encode_precise(shading, 8);
        let expected = match encoding {
            NormalEncoding::Exact => {
                let [[a, b], [c, d]] = [shading, plane].map(octahedral::encode);
                let error =
                    result[..4].iter().zip([a, b, c, d]).map(|(found, expected)| (f64::from(*found) - expected).abs()).fold(0.0, f64::max);
                assert!(error < limit, "{row:?}: {:?} is stored, not {:?}", &result[..4], [a, b, c, d]);
                bytes.clone()
            }
            NormalEncoding::Octahedral => [code, octahedral::encode_precise(plane, 8)].as_flattened().iter().map(|x| *x as u8).collect(),
            NormalEncoding::PlaneFirst => normal_pair::encode(plane, ray, code).to_le_bytes().to_vec(),
        };
        other_codes += usize::from(bytes != expected);
        let rays = RAYS.map(|ray| ray.map(f64::from));
        let expected = view::ray(rays, [f64::from(row[10]), f64::from(row[11])]);
        assert!(off(&result[10..13], expected) < ray_limit, "{row:?}: ray {:?}, not {expected:?}", &result[10..13]);
    }
    // A code differs if two codes are equally near within the rounding of f32: steps of a code are above 0.001, so this is the case for fewer than 1 in
    // 1000 directions per decision.
    assert!(other_codes * 200 < rows.len(), "{other_codes} of {} texels differ from those of the reference", rows.len());
}

#[test]
fn the_triangle_of_a_full_screen_pass_covers_the_screen() {
    let body = format!(
        "{}\nfn probe(row: array<f32, 1>) -> array<f32, 4> {{
    let p = full_screen_position(u32(row[0]));
    return array<f32, 4>(p.x, p.y, p.z, p.w);
}}",
        wgsl_text(&kernels::view::FULL_SCREEN)
    );
    let inputs = [0.0f32, 1.0, 2.0].map(f32::to_bits);
    let found = Table::new(gpu(), &body, [1, 4], Cells::Reals).expect("the WGSL compiles").run(&inputs).expect("the device works");
    let found: Vec<f32> = found.into_iter().map(f32::from_bits).collect();
    // The right angle is at the lower left corner of the screen, and the hypotenuse passes through the upper right corner.
    assert_eq!(found, [-1.0, -1.0, 0.0, 1.0, 3.0, -1.0, 0.0, 1.0, -1.0, 3.0, 0.0, 1.0]);
}
