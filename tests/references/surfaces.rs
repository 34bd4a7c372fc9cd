//! Tests the references of terrain access, shading and the virtual texture. Filtered values are compared with sums over all texels, weighted by tent
//! functions. Blends are compared with the sums of their parts.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::OnceLock;

use glam::{DVec2, DVec3};
use kernels::base::colour;
use kernels::blocks::{self, BlockFormat};
use kernels::materials::{CompressedChain, Palette};
use kernels::scene::{self, Scene};
use kernels::shading::reference::{Pixel, Rules, Shaded, shade};
use kernels::shared::flavour_weights::{self, FlavourParams};
use kernels::shared::{snapped_projection, splat_blend, tiling, triplanar};
use kernels::terrain::palette_means;
use kernels::terrain::reference::{Cell, Ground, Projection, Spot, Surface};
use kernels::variant::{Flavour, Variant};
use kernels::virtual_texture::{LEVELS, TEXELS_PER_M, reference};
use kernels::world::payload::{NodePayload, SPLAT_SIDE, TEXTURE_SIDE};
use kernels::world::{NodeId, World};

use crate::statistics::Random;

/// The built-in world with small textures. Only one node and its parent are loaded.
struct Loaded {
    scene: &'static Scene,
    palette: &'static Palette,
    node: NodeId,
    payload: NodePayload,
    ground: Ground<'static>,
}

fn loaded() -> &'static Loaded {
    static LOADED: OnceLock<Loaded> = OnceLock::new();
    LOADED.get_or_init(|| {
        let mut scene = scene::parse(scene::DEFAULT_TEXT, "default", Path::new(".")).expect("the built-in scene is valid");
        // The materials are rotated, tinted and have strong bumps, so that a fault in any of these three causes a difference.
        for (number, material) in (1..).zip(&mut scene.materials) {
            material.orientation_deg = 25.0 * f64::from(number);
            material.tint = [0.5, 1.0, 1.25];
            material.normal_strength = 3.0;
        }
        scene.blend.mip_bias = 0.5;
        let scene: &'static Scene = Box::leak(Box::new(scene));
        let world: &'static World = Box::leak(Box::new(World::new(scene).expect("a procedural world needs no files")));
        let layout = world.layout();
        let palette: &'static Palette =
            Box::leak(Box::new(Palette::sketch(scene, 64, layout.sector_m, |_| Ok(())).expect("procedural textures")));
        let materials = |node: &NodeId| {
            let corner = node.origin_m(layout);
            let at = |k: u32| world.material_at(corner.x + 8.0 + 16.0 * f64::from(k % 4), corner.y + 8.0 + 16.0 * f64::from(k / 4));
            (0..16).map(at).collect::<BTreeSet<u8>>().len()
        };
        let mut row = (0..160).map(|x| NodeId { lod: 0, x, y: 80 });
        let node = row.find(|node| materials(node) > 1).expect("a node with two materials");
        let parent = node.parent().expect("LOD 0 has parents");
        let payload = world.bake(node, &palette_means(palette));
        let ground = Ground::new(world, palette, &[parent, node], scene.blend.height_sharpness);
        Loaded { scene, palette, node, payload, ground }
    })
}

impl Loaded {
    /// South-west corner of the node, metres from the south-west corner of the world.
    fn corner(&self) -> DVec2 {
        DVec2::new(f64::from(self.node.x), f64::from(self.node.y)) * 64.0
    }

    /// A random place in the node, at least 8 m from its border.
    fn place(&self, random: &mut Random) -> DVec2 {
        self.corner() + DVec2::new(random.between(8.0, 56.0), random.between(8.0, 56.0))
    }

    fn spot(&self, place: DVec2) -> Spot {
        self.ground.spot(place).expect("inside the node")
    }
}

fn assert_close(found: Surface, expected: Surface, tolerance: f64) {
    let off = found.plus(-1.0, expected);
    let vectors = off.albedo.abs().max_element().max(off.gradient.abs().max_element() / (1.0 + expected.gradient.length()));
    let worst = [off.height, off.smoothness, off.occlusion].into_iter().map(f64::abs).fold(vectors, f64::max);
    assert!(worst <= tolerance, "{found:?}, not {expected:?}");
}

/// Weight of a texel in linear filtering: a tent around its centre. `x`: the position in texels, with centres at whole numbers.
fn tent(x: f64, i: usize) -> f64 {
    (1.0 - (x - i as f64).abs()).max(0.0)
}

/// Like [`tent`], for a texture of `size` texels that repeats.
fn repeated_tent(x: f64, i: usize, size: usize) -> f64 {
    let x = x.rem_euclid(size as f64);
    [-1.0, 0.0, 1.0].into_iter().map(|repeat| tent(x + repeat * size as f64, i)).sum()
}

#[test]
fn surfaces_are_summed_part_by_part() {
    let [a, b] = [1.0, 10.0].map(|s| Surface {
        albedo: DVec3::new(1.0, 2.0, 3.0) * s,
        height: 4.0 * s,
        gradient: DVec3::new(5.0, 6.0, 7.0) * s,
        smoothness: 8.0 * s,
        occlusion: 9.0 * s,
    });
    let sum = a.plus(0.5, b);
    assert_eq!((sum.albedo, sum.gradient), (DVec3::new(6.0, 12.0, 18.0), DVec3::new(30.0, 36.0, 42.0)));
    assert_eq!([sum.height, sum.smoothness, sum.occlusion], [24.0, 48.0, 54.0]);
    let steps = [DVec3::new(1.0, 2.0, 3.0), DVec3::new(-4.0, 5.0, 6.0)];
    let projection = Projection::of(1, DVec3::new(7.0, 8.0, 9.0), steps, 2.0);
    let expected = Projection { plane: 1, at: DVec2::new(7.0, 9.0), steps: [DVec2::new(4.0, 12.0), DVec2::new(-16.0, 24.0)] };
    assert_eq!(projection, expected);
}

#[test]
fn a_place_lies_in_the_finest_node_that_is_loaded() {
    let all = loaded();
    let spot = all.spot(all.corner() + DVec2::new(16.0, 48.0));
    assert_eq!((spot.node, spot.uv), (all.node, DVec2::new(0.25, 0.75)));
    let parent = all.node.parent().expect("LOD 0 has parents");
    let corner = DVec2::new(f64::from(parent.x), f64::from(parent.y)) * 128.0;
    // The centre of the sibling in the diagonally opposite quarter of the parent. The sibling is not loaded, so the place lies in the parent.
    let other =
        corner + DVec2::new(if all.node.x.is_multiple_of(2) { 96.0 } else { 32.0 }, if all.node.y.is_multiple_of(2) { 96.0 } else { 32.0 });
    let spot = all.spot(other);
    assert_eq!((spot.node, spot.uv), (parent, (other - corner) / 128.0));
    for outside in [corner - 1.0, corner + 129.0, corner + DVec2::new(-1.0, 64.0), corner + DVec2::new(64.0, 129.0)] {
        assert_eq!(all.ground.spot(outside), None, "{outside}");
    }
    // The border belongs to the node.
    assert_eq!(all.spot(all.corner()).node, all.node);
    assert_eq!(all.spot(all.corner() + 64.0).node, all.node);
}

#[test]
fn a_cell_has_the_four_splat_texels_around_a_place() {
    let all = loaded();
    let splat = &all.payload.splat;
    assert!(splat.iter().collect::<BTreeSet<_>>().len() > 1, "one material only");
    let mut random = Random(113);
    let mut changes = 0;
    for _ in 0..2000 {
        let uv = DVec2::new(random.unit(), random.unit());
        let Cell { ids, fraction } = all.ground.cell(&Spot { node: all.node, uv });
        let (x, y) = (uv.x * 64.0, uv.y * 64.0);
        // Texel (i, j) lies at (i, j) / 64.
        let expected =
            [(x.floor(), y.floor()), (x.floor() + 1.0, y.floor()), (x.floor(), y.floor() + 1.0), (x.floor() + 1.0, y.floor() + 1.0)]
                .map(|(i, j)| splat[j as usize * SPLAT_SIDE + i as usize]);
        assert_eq!(ids, expected, "{uv}");
        assert!((fraction[0] - x.fract()).abs() < 1e-12 && (fraction[1] - y.fract()).abs() < 1e-12, "{uv}: {fraction:?}");
        changes += usize::from(ids.iter().any(|&id| id != ids[0]));
    }
    assert!(changes > 0, "no place lies between two materials");
    let last = all.ground.cell(&Spot { node: all.node, uv: DVec2::ONE });
    assert_eq!((last.fraction, last.ids[3]), ([1.0; 2], splat[SPLAT_SIDE * SPLAT_SIDE - 1]));
}

#[test]
fn baked_maps_are_filtered_between_the_centres_of_their_texels() {
    let all = loaded();
    let [albedo, normal] = [(BlockFormat::Bc1, &all.payload.albedo), (BlockFormat::Bc3, &all.payload.normal)]
        .map(|(format, bytes)| blocks::decode(format, bytes, TEXTURE_SIDE, TEXTURE_SIDE));
    let mut random = Random(127);
    for round in 0..60 {
        let uv = if round == 0 { DVec2::ONE } else { DVec2::new(random.unit(), random.unit()) };
        // Texel (i, j) has its centre at (i - 1.5) / 128.
        let at = uv * 128.0 + 1.5;
        let filtered = |bytes: &[u8], channel: usize, is_srgb: bool| {
            let mut sum = 0.0;
            for (i, texel) in bytes.chunks_exact(4).enumerate() {
                let weight = tent(at.x, i % TEXTURE_SIDE) * tent(at.y, i / TEXTURE_SIDE);
                let value = f64::from(texel[channel]) / 255.0;
                sum += weight * if is_srgb { colour::linear_from_srgb(value) } else { value };
            }
            sum
        };
        let (found, found_normal) = all.ground.baked(&Spot { node: all.node, uv });
        let alpha = filtered(&albedo, 3, false).max(0.25);
        let expected = DVec3::from_array([0, 1, 2].map(|k| filtered(&albedo, k, true) / alpha));
        assert!((found.albedo - expected).abs().max_element() < 1e-9, "{uv}: {found:?}, not {expected}");
        let of_normal = [0, 1, 2, 3].map(|k| filtered(&normal, k, false));
        assert!((found.smoothness - of_normal[0]).abs() < 1e-9 && (found.occlusion - of_normal[2]).abs() < 1e-9, "{uv}: {found:?}");
        let xy = DVec2::new(of_normal[3], of_normal[1]) * 2.0 - 1.0;
        let expected = xy.extend((1.0 - xy.x * xy.x - xy.y * xy.y).max(1e-4).sqrt());
        assert!((found_normal - expected / expected.length()).abs().max_element() < 1e-9, "{uv}: {found_normal}");
        assert_eq!((found.height, found.gradient), (0.0, DVec3::ZERO));
    }
}

/// Samples the mip chain of a repeating texture at `uv`, by sums over all texels. `step` is the length of the longer derivative, in repeats per
/// pixel. If `is_srgb`, colours are converted to linear before they are filtered.
fn sampled(chain: &CompressedChain, is_srgb: bool, uv: DVec2, step: f64) -> [f64; 4] {
    let lod = (step * f64::from(chain.size)).log2().clamp(0.0, (chain.levels.len() - 1) as f64);
    let of_level = |level: usize| {
        let size = chain.level_size(level) as usize;
        let at = uv * size as f64 - 0.5;
        let mut sum = [0.0; 4];
        for (i, texel) in chain.decode(level).into_iter().enumerate() {
            let weight = repeated_tent(at.x, i % size, size) * repeated_tent(at.y, i / size, size);
            for (channel, (sum, code)) in sum.iter_mut().zip(texel).enumerate() {
                let value = f64::from(code) / 255.0;
                *sum += weight * if is_srgb && channel < 3 { colour::linear_from_srgb(value) } else { value };
            }
        }
        sum
    };
    let mut mixed = [0.0; 4];
    for level in 0..chain.levels.len() {
        let weight = tent(lod, level);
        if weight > 0.0 {
            mixed.iter_mut().zip(of_level(level)).for_each(|(to, from)| *to += weight * from);
        }
    }
    mixed
}

#[test]
fn materials_are_turned_repeated_filtered_tinted_and_bent() {
    let all = loaded();
    let mut random = Random(131);
    for round in 0..40 {
        let id = round % all.scene.materials.len();
        let (material, entry) = (&all.scene.materials[id], &all.palette.entries[id]);
        let (scale, plane) = (round as u32 % 3, round as u32 % 5);
        let at = DVec2::new(random.between(-9.0, 9.0), random.between(-9.0, 9.0));
        // The step per pixel is from less than a texel to several repeats of the texture.
        let size = random.between(-10.0, 3.0).exp2() * material.tile_m;
        let steps = [0.0, 1.0].map(|turn: f64| DVec2::from_angle(turn + f64::from(round as u32)) * size * random.between(0.5, 1.0));
        let found = all.ground.material(id as u8, &Projection { plane, at, steps }, scale);
        // u points along the orientation, v is perpendicular to it. At scale s, a repeat of the texture is 2^s times as wide as at scale 0.
        let (sin, cos) = material.orientation_deg.to_radians().sin_cos();
        let tile_m = material.tile_m * f64::from(1_u32 << scale);
        let uv = DVec2::new(at.x * cos + at.y * sin, at.y * cos - at.x * sin) / tile_m;
        let step = steps[0].length().max(steps[1].length()) / tile_m;
        let layer = entry.albedo_layer as usize;
        let arrays = &all.palette.arrays;
        let [r, g, b, _] = sampled(&arrays.albedo[layer], true, uv, step);
        let [smoothness, y, occlusion, x] = sampled(&arrays.normal[layer], false, uv, step);
        let [height, mask, ..] = sampled(&arrays.height[layer], false, uv, step);
        let tinted = |value: f64, tint: f64| value * (1.0 + mask * (tint - 1.0));
        let (x, y) = (2.0 * x - 1.0, 2.0 * y - 1.0);
        // The slope of a surface with this normal, multiplied by the normal strength of the material, which is 3. The sign is negative, because the
        // surface descends in the direction in which its normal leans.
        let factor = -3.0 / (1.0 - x * x - y * y).max(0.05 * 0.05).sqrt();
        let slope = [factor * (x * cos - y * sin), factor * (x * sin + y * cos)];
        let expected = Surface {
            albedo: DVec3::new(tinted(r, 0.5), tinted(g, 1.0), tinted(b, 1.25)),
            height,
            gradient: DVec3::from_array(snapped_projection::from_gradient(slope, plane)),
            smoothness,
            occlusion,
        };
        // Repeats per sector are rounded to 2^-24. Over some metres, this moves a texel by less than 1e-5 texels.
        assert_close(found, expected, 1e-4);
    }
}

#[test]
fn a_cell_blends_its_four_materials() {
    let all = loaded();
    let mut random = Random(137);
    let count = all.scene.materials.len();
    for _ in 0..50 {
        let cell = Cell { ids: [0; 4].map(|_: u8| random.below(count) as u8), fraction: [random.unit(), random.unit()] };
        let at = DVec2::new(random.between(-9.0, 9.0), random.between(-9.0, 9.0));
        let projection = Projection { plane: random.below(5) as u32, at, steps: [DVec2::X * 0.01, DVec2::Y * 0.02] };
        let taps = cell.ids.map(|id| all.ground.material(id, &projection, 1));
        let sum = |weights: [f64; 4]| taps.iter().zip(weights).fold(Surface::default(), |sum, (&tap, weight)| sum.plus(weight, tap));
        let heights = taps.map(|tap| tap.height);
        let weights = splat_blend::weights(cell.fraction, heights, all.scene.blend.height_sharpness);
        assert_close(all.ground.blend(&cell, &projection, 1), sum(weights), 1e-12);
        assert_close(all.ground.mean(&cell, &projection, 1), sum(splat_blend::bilinear(cell.fraction)), 1e-12);
    }
}

// ---------------------------------------------------------------- shading

/// A random pixel in the node: on flat to steep ground, near to far.
fn pixel(all: &Loaded, random: &mut Random) -> Pixel {
    let [x, y, z] = random.direction();
    let step = random.between(-9.0, -4.0).exp2();
    Pixel {
        position: all.place(random).extend(random.between(300.0, 310.0)),
        steps: [DVec3::from_array(random.direction()) * step, DVec3::from_array(random.direction()) * step],
        normal: DVec3::new(x, y, z.abs() + 0.3).normalize(),
        distance_m: random.between(2.0, 11.0).exp2(),
    }
}

fn as_surface(shaded: &Shaded) -> Surface {
    Surface { albedo: shaded.albedo, smoothness: shaded.smoothness, occlusion: shaded.occlusion, ..Surface::default() }
}

#[test]
fn each_flavour_is_the_blend_that_its_name_says() {
    let all = loaded();
    let (ground, blend, flavours) = (&all.ground, &all.scene.blend, &all.scene.flavours);
    let params = FlavourParams::new(flavours);
    let mut random = Random(139);
    let mut upper = 0;
    for _ in 0..60 {
        let pixel = pixel(all, &mut random);
        let spot = all.spot(pixel.position.truncate());
        let cell = ground.cell(&spot);
        let planes = triplanar::weights(pixel.normal.to_array(), blend.triplanar_sharpness);
        // Returns the sum of the surfaces of the three projections, with the tri-planar weights.
        let over_planes = |of: &dyn Fn(&Projection) -> Surface| {
            (0..3_u32).zip(planes).fold(Surface::default(), |sum, (plane, weight)| {
                sum.plus(weight, of(&Projection::of(plane, pixel.position, pixel.steps, 0.5)))
            })
        };
        let cliff = flavour_weights::steep(pixel.normal.z, params.cliff_cos);
        let (scale, share) = tiling::scales(pixel.distance_m, flavours.cliff_near_m, cliff);
        upper += usize::from(share > 0.0);
        let two = |of: &dyn Fn(&Projection, u32) -> Surface| {
            let [lower, upper] = [scale, scale + 1].map(|scale| over_planes(&|projection| of(projection, scale)));
            lower.plus(share, upper.plus(-1.0, lower))
        };
        let rules = |two_tilings| Rules { flavours, blend, two_tilings };
        let cases = [
            (Flavour::NearCliff, false, over_planes(&|projection| ground.mean(&cell, projection, 0))),
            (Flavour::FarCliff, false, two(&|projection, scale| ground.mean(&cell, projection, scale))),
            (Flavour::Splat, false, over_planes(&|projection| ground.blend(&cell, projection, 0))),
            (Flavour::Splat, true, two(&|projection, scale| ground.blend(&cell, projection, scale))),
            (Flavour::VirtualTexture, false, reference::sample(ground, pixel.position, pixel.steps, 0.5).expect("inside the node")),
        ];
        for (flavour, two_tilings, expected) in cases {
            let found = shade(ground, rules(two_tilings), &pixel, Variant::only(flavour)).expect("inside the node");
            assert_close(as_surface(&found), Surface { height: 0.0, gradient: DVec3::ZERO, ..expected }, 1e-12);
            let normal = triplanar::perturb(pixel.normal.to_array(), expected.gradient.to_array());
            assert!((found.normal - DVec3::from_array(normal)).length() < 1e-9, "{flavour:?}: {found:?}");
        }
        let found = shade(ground, rules(false), &pixel, Variant::only(Flavour::FarAtlas)).expect("inside the node");
        let (expected, normal) = ground.baked(&spot);
        assert_close(as_surface(&found), expected, 1e-12);
        assert!((found.normal - normal).length() < 1e-12, "{found:?}");
        // Several flavours are summed by their weights, and their normals are summed, too.
        let variant = Variant::new(31).expect("all flavours");
        let weights = flavour_weights::weights_for(flavour_weights::weights(pixel.distance_m, pixel.normal.z, &params), 31, true);
        let (mut sum, mut normal) = (Surface::default(), DVec3::ZERO);
        for (flavour, weight) in Flavour::ALL.into_iter().zip(weights) {
            let one = shade(ground, rules(false), &pixel, Variant::only(flavour)).expect("inside the node");
            sum = sum.plus(weight, as_surface(&one));
            normal += one.normal * weight;
        }
        let found = shade(ground, rules(false), &pixel, variant).expect("inside the node");
        assert_close(as_surface(&found), sum, 1e-12);
        assert!((found.normal - normal / normal.length()).length() < 1e-12, "{found:?}");
    }
    assert!(upper > 5, "{upper} pixels blend two scales");
    let outside = Pixel { position: DVec3::ZERO, ..pixel(all, &mut random) };
    let rules = Rules { flavours, blend, two_tilings: false };
    assert_eq!(shade(ground, rules, &outside, Variant::only(Flavour::Splat)), None);
}

// ---------------------------------------------------------------- virtual texture

#[test]
fn a_page_has_the_level_of_its_footprint() {
    let steps = |a: f64, b: f64| [DVec3::new(a * 0.6, a * 0.8, 5.0), DVec3::new(0.0, b, -7.0)];
    // 256 texels per metre. The vertical part of a step does not count.
    for (a, b, bias, anisotropy, texels) in [
        (0.5, 0.25, 0.0, 1.0, 128.0),
        (0.25, 0.5, 0.0, 1.0, 128.0),
        (0.5, 0.25, 0.0, 4.0, 64.0),
        (0.5, 0.0625, 0.0, 4.0, 32.0),
        (0.0625, 0.5, 0.0, 4.0, 32.0),
        (0.5, 0.25, 1.0, 1.0, 256.0),
        (0.5, 0.25, -2.0, 1.0, 32.0),
    ] {
        let found = reference::texels(steps(a, b), bias, anisotropy);
        assert!((found / texels - 1.0).abs() < 1e-12, "{a} {b} {bias} {anisotropy}: {found}");
    }
    // Level l has texels of 2^l / 256 m.
    for (texels, level) in [(0.1, 0), (1.0, 0), (1.9, 0), (2.1, 1), (3.9, 1), (4.1, 2), (1025.0, 10), (1e9, LEVELS - 1)] {
        assert_eq!(reference::level(steps(texels / 256.0, 0.0), 0.0, 1.0), level, "{texels} texels");
    }
}

/// Returns the surface at a place: the texels around it, each `texel_m` metres wide, filtered by tent functions. The gradient of a texel is converted
/// to a normal before it is filtered.
fn filtered_texels(all: &Loaded, at: DVec2, texel_m: f64) -> Surface {
    let mut sum = Surface::default();
    let mut normal = DVec3::ZERO;
    let nearest = (at / texel_m).floor();
    for k in 0..9 {
        let centre = (nearest + DVec2::new(f64::from(k % 3), f64::from(k / 3)) - 0.5) * texel_m;
        let off = (at - centre).abs() / texel_m;
        let weight = (1.0 - off.x).max(0.0) * (1.0 - off.y).max(0.0);
        let steps = [DVec3::X * texel_m, DVec3::Y * texel_m];
        let cell = all.ground.cell(&all.spot(centre));
        let texel = all.ground.blend(&cell, &Projection::of(2, centre.extend(0.0), steps, 0.0), 0);
        sum = sum.plus(weight, texel);
        let leaning = DVec3::new(-texel.gradient.x, -texel.gradient.y, 1.0);
        normal += weight * leaning / leaning.length();
    }
    let z = (1.0 - normal.x * normal.x - normal.y * normal.y).max(0.01).sqrt();
    Surface { gradient: DVec3::new(-normal.x, -normal.y, 0.0) / z, ..sum }
}

#[test]
fn pages_are_filtered_between_texels_and_between_mips() {
    let all = loaded();
    let mut random = Random(149);
    for round in 0..60 {
        let place = all.place(&mut random);
        // Lengths of the steps per pixel: at least half a texel of the finest level. The coarsest texels that are filtered are 4 m wide.
        let texels = random.between(-1.0, 7.0).exp2();
        let longer = if round % 2 == 0 { 1.0 } else { random.between(1.0, 4.0) };
        let steps = [DVec3::X * (texels / TEXELS_PER_M), DVec3::Y * (longer * texels / TEXELS_PER_M)];
        let bias: f64 = [0.0, 0.5, -1.0][round % 3];
        let found = reference::sample(&all.ground, place.extend(300.0), steps, bias).expect("inside the node");
        // The longer step determines the level. A page has two mips, and the texels of the second mip are twice as wide.
        let covered = longer * texels * bias.exp2();
        let level = covered.log2().floor().clamp(0.0, f64::from(LEVELS - 1));
        let mip = (covered.log2() - level).clamp(0.0, 1.0);
        let [fine, coarse] = [0.0, 1.0].map(|mip| filtered_texels(all, place, (level + mip).exp2() / TEXELS_PER_M));
        assert_close(found, fine.plus(mip, coarse.plus(-1.0, fine)), 1e-9);
    }
    assert_eq!(reference::sample(&all.ground, DVec3::ZERO, [DVec3::X, DVec3::Y], 0.0), None);
}
