//! Tests of the functions of `view/frame.wgsl` and `view/full_screen.wgsl`: how the two normals of a pixel are written and read, rays, and the
//! triangle of a full-screen pass. Also tests where the samples of pixels lie (`terrain/footprint.wgsl`). In passes, the uniforms of these functions
//! are in a uniform buffer. Here, they are a private variable that each row of inputs sets.

use glam::{DVec2, DVec3};
use kernels::base::wgsl::{self, Wgsl};
use kernels::probe::table::{Cells, Table};
use kernels::shared::{hash, normal_pair, octahedral, view};
use kernels::temporal::SamplePattern;
use kernels::terrain::FOOTPRINT_WGSL;
use kernels::view::normals::NormalEncoding;

use crate::fixtures::{self, gpu, wgsl_text};

/// Numbers of a row: the code of the encoding, shading normal, normal of the plane, ray, and a pixel.
const INPUTS: usize = 12;
/// Numbers of a result: the texel, the two decoded normals, and the ray of the pixel.
const RESULTS: usize = 13;
/// The rays of the camera: through pixel (0, 0), and the steps per pixel to the right and down.
const RAYS: [[f32; 3]; 3] = [[-0.75, 0.5, 1.0], [0.01, 0.0015, -0.002], [0.003, -0.02, 0.0005]];

/// The declaration of the uniforms, which a test replaces.
const BINDING: &str = "@group(0) @binding(0) var<uniform> frame: Frame;";

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
        module(&kernels::view::WGSL),
        vector(RAYS[0]),
        vector(RAYS[1]),
        vector(RAYS[2]),
    );
    let rows = rows();
    let inputs: Vec<u32> = rows.iter().flatten().map(|x| x.to_bits()).collect();
    let table = Table::new(gpu(), &body, [INPUTS, RESULTS], Cells::Reals).expect("the WGSL compiles");
    let results: Vec<f32> = table.run(&inputs).expect("the device works").into_iter().map(f32::from_bits).collect();
    // Bounds of rounding errors. Components of unit vectors have an error of a few 2^-24, after a division, a square root and some sums: at most
    // 1e-6. Components of a ray are up to 22 at the largest pixel. Three products and two sums give them an error below 4 * 2^-24 * 22 = 6e-6.
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
    // A code may differ from that of the reference if two codes are equally near within the rounding of f32. Neighbouring codes are more than 0.001
    // apart, so this happens for fewer than 1 in 1000 directions per decision.
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

/// The WGSL of a file and of the files that it needs, except the shared functions, which a table already has.
fn module(file: &'static Wgsl) -> String {
    let text = |piece: wgsl::Piece| {
        let planted = fixtures::wgsl_files().into_iter().find(|file| file.path == piece.path).map(wgsl_text);
        planted.unwrap_or(piece.text)
    };
    let own: String = wgsl::pieces(&[file]).into_iter().filter(|piece| !piece.path.starts_with("shared/")).map(text).collect();
    assert!(own.contains(BINDING), "the module has no uniforms of a frame");
    own.replace(BINDING, "var<private> frame: Frame;")
}

#[test]
fn samples_of_pixels_equal_their_reference() {
    let body = format!(
        "{}
fn probe(row: array<f32, 3>) -> array<f32, 2> {{
    frame.sample_pattern = u32(row[0]);
    let offset = surface_sample_offset(vec2<u32>(u32(row[1]), u32(row[2])));
    return array<f32, 2>(offset.x, offset.y);
}}",
        module(&FOOTPRINT_WGSL)
    );
    let patterns = [SamplePattern::Centre, SamplePattern::LeftEdges, SamplePattern::TopEdges];
    let rows: Vec<(SamplePattern, [u32; 2])> = (0..75).map(|i| (patterns[i as usize / 25], [i % 5, i / 5 % 5])).collect();
    let inputs: Vec<u32> = rows.iter().flat_map(|(pattern, [x, y])| [pattern.code(), *x, *y].map(|x| (x as f32).to_bits())).collect();
    let found = Table::new(gpu(), &body, [3, 2], Cells::Reals).expect("the WGSL compiles").run(&inputs).expect("the device works");
    for ((pattern, pixel), found) in rows.iter().zip(found.chunks_exact(2)) {
        let [expected, found] = [pattern.offset(*pixel), [found[0], found[1]].map(|bits| f64::from(f32::from_bits(bits)))];
        assert!((0..2).all(|axis| (found[axis] - expected[axis]).abs() < 1e-7), "{pattern:?} {pixel:?}: {found:?}, not {expected:?}");
    }
}

/// Width of a sector, distance of the near plane, and position of the camera, which is in the middle of its sector, 40 m up; metres.
const SECTOR_M: f64 = 64.0;
const NEAR_M: f64 = 0.1;
const EYE: DVec3 = DVec3::new(32.0, 32.0, 40.0);

/// A table that computes footprints for a camera with these rays. A row: the code of the sample pattern, a pixel, its depth, and the normal of the
/// plane. A result: the sector, the position in it, and the two derivatives.
fn footprints(rays: [[f32; 3]; 3]) -> Table<'static> {
    let vector = |values: [f32; 3]| format!("vec3<f32>({:?}, {:?}, {:?})", values[0], values[1], values[2]);
    let body = format!(
        "{}
fn probe(row: array<f32, 7>) -> array<f32, 11> {{
    frame.sample_pattern = u32(row[0]);
    frame.normals = NORMALS_EXACT;
    frame.sector_m = {SECTOR_M:?};
    frame.camera_sector = vec2<i32>(7, 9);
    frame.camera = vec3<f32>({:?}, {:?}, {:?});
    frame.near_m = {NEAR_M:?};
    frame.ray_00 = {};
    frame.ray_dx = {};
    frame.ray_dy = {};
    let plane = vec3<f32>(row[4], row[5], row[6]);
    let found = surface_footprint(vec2<u32>(u32(row[1]), u32(row[2])), row[3], frame_normals(plane, plane, plane));
    let place = found.place;
    return array<f32, 11>(f32(place.sector.x), f32(place.sector.y), place.position.x, place.position.y, place.position.z,
        found.ddx.x, found.ddx.y, found.ddx.z, found.ddy.x, found.ddy.y, found.ddy.z);
}}",
        module(&FOOTPRINT_WGSL),
        EYE.x,
        EYE.y,
        EYE.z,
        vector(rays[0]),
        vector(rays[1]),
        vector(rays[2]),
    );
    Table::new(gpu(), &body, [7, 11], Cells::Reals).expect("the WGSL compiles")
}

/// The position of a result, relative to the south-west corner of the camera's sector.
fn position_of(found: &[f64]) -> DVec3 {
    (DVec2::new(found[2], found[3]) + DVec2::new(found[0] - 7.0, found[1] - 9.0) * SECTOR_M).extend(found[4])
}

#[test]
fn footprints_lie_on_the_plane_that_the_centre_of_the_pixel_sees() {
    let table = footprints(RAYS);
    let rays = RAYS.map(|ray| DVec3::from_array(ray.map(f64::from)));
    let patterns = [SamplePattern::Centre, SamplePattern::LeftEdges, SamplePattern::TopEdges];
    let row = |index: u32| {
        let pixel = [index / 3 % 93, index / 7 % 61];
        // From planes that face the camera to planes that are nearly parallel to the ray.
        let ray = rays[0] + rays[1] * f64::from(pixel[0]) + rays[2] * f64::from(pixel[1]);
        let random = DVec3::from_array([0, 1, 2].map(|column| f64::from(random(index, column))));
        let normal = (random - ray * random.dot(ray) / ray.length_squared() * f64::from(index % 11) / 10.1).normalize();
        (patterns[index as usize % 3], pixel, 2.0 + f64::from(index % 200), normal)
    };
    let rows: Vec<_> = (0..3000).map(row).collect();
    let cells = |(pattern, [x, y], distance, normal): &(SamplePattern, [u32; 2], f64, DVec3)| {
        [f64::from(pattern.code()), f64::from(*x), f64::from(*y), NEAR_M / distance, normal.x, normal.y, normal.z]
            .map(|x| (x as f32).to_bits())
    };
    let inputs: Vec<u32> = rows.iter().flat_map(cells).collect();
    let found = table.run(&inputs).expect("the device works");
    let (mut limited, mut moved) = (0, 0);
    for ((pattern, pixel, distance, normal), found) in rows.iter().zip(found.chunks_exact(11)) {
        let found: Vec<f64> = found.iter().map(|bits| f64::from(f32::from_bits(*bits))).collect();
        let sectors = DVec2::new(found[0] - 7.0, found[1] - 9.0);
        let inside = DVec2::new(found[2], found[3]);
        assert!(inside.min_element() >= 0.0 && inside.max_element() <= SECTOR_M, "{inside:?} is outside its sector");
        let position = position_of(&found);
        let through = |x: f64, y: f64| rays[0] + rays[1] * x + rays[2] * y;
        let [x, y] = pixel.map(f64::from);
        let [dx, dy] = pattern.offset(*pixel);
        let (centre, ray) = (through(x, y), through(x + dx, y + dy));
        // The point that a ray hits on the plane through the point at the centre, as a multiple of the ray.
        let hit = |ray: DVec3| distance * normal.dot(centre) / normal.dot(ray);
        let t = hit(ray).clamp(0.5 * distance, 2.0 * distance);
        limited += usize::from(t != hit(ray));
        moved += usize::from(sectors != DVec2::ZERO);
        // Bound of the error of a position. The plane has a relative error of 3e-7, and the ray one of 1e-6. Together they change the distance by
        // 2e-6 t |ray| / |cos|, where t is the distance as a multiple of the ray, and cos is the cosine between ray and normal. A derivative has this
        // error divided by cos once more.
        let cosine = |ray: DVec3| normal.dot(ray).abs() / ray.length();
        let flat = cosine(ray).min(cosine(centre));
        let error = position.distance(EYE + ray * t);
        assert!(error <= 1e-5 + 4e-6 * t * ray.length() / flat, "{pattern:?}, {pixel:?}, {distance} m, cosine {flat}: {error} m off");
        // A derivative leads to the point of the plane through the sample that the ray of the neighbouring pixel hits.
        for (step, found) in rays[1..].iter().zip([&found[5..8], &found[8..11]]) {
            let neighbour = ray + *step;
            let steep = flat.min(cosine(neighbour));
            if steep < 0.02 {
                continue;
            }
            let expected = neighbour * (t * normal.dot(ray) / normal.dot(neighbour)) - ray * t;
            let error = (DVec3::new(found[0], found[1], found[2]) - expected).length();
            assert!(
                error <= 8e-6 * t * ray.length() / (steep * steep),
                "{pattern:?}, {pixel:?}, {distance} m, cosine {steep}: {error} m off {expected:?}"
            );
        }
    }
    assert!(limited > 5 && moved > 500, "{limited} limited, {moved} in another sector");
}

#[test]
fn a_sample_whose_ray_is_parallel_to_the_plane_is_at_most_twice_as_far_away() {
    // The sample on the top edge lies half a pixel above the centre. There the ray is exactly level, and the plane is level, too.
    let table = footprints([[1.0, 0.0, -0.5], [0.0, 0.001, 0.0], [0.0, 0.0, -1.0]]);
    let row = [SamplePattern::TopEdges.code() as f32, 0.0, 0.0, NEAR_M as f32 / 10.0, 0.0, 0.0, 1.0].map(f32::to_bits);
    let found: Vec<f64> = table.run(&row).expect("the device works").into_iter().map(|bits| f64::from(f32::from_bits(bits))).collect();
    let off = position_of(&found) - EYE;
    assert!((off - DVec3::new(20.0, -20.0 * 0.001 / 6.0, 0.0)).abs().max_element() < 1e-4, "{off:?}");
}
