//! Inspection of one pixel: the values that the stages of the frame computed for it, and the exact values.
//!
//! The values of the stages are read back from the device: depth, both normals, mask, the variant of the tile, derivatives, splat texels, the
//! recorded choice.
//!
//! The exact values are computed in f64 by the references, which are the Rust versions of the shader functions. From the same inputs as in the
//! shaders, they compute the weights of the flavours, the random thresholds and the choice that follows from them, and the page and level of the
//! virtual texture. The exact derivatives are those on the triangle that was drawn.
//!
//! That triangle is found in the terrain data ([`World`]), in the node that was drawn at the pixel. Its heights are quantised, and its vertices on
//! the sides of patches are moved, as in the shader. Its normal is not quantised. The triangle is not reconstructed from neighbouring pixels, because
//! neighbours often lie on different triangles.
//!
//! The weights after the height blend come from the device, because this module does not read the heights of detail textures. They are the weights in
//! the projection with the largest weight.

use crate::base::error::{Error, Result};
use crate::culling::Levels;
use crate::frame::picture::AovSet;
use crate::frame::{Frame, RenderRequest, Renderer, VariantChoice};
use crate::geometry::reference::{place, vertex};
use crate::geometry::surface::{NodeTriangle, Surface, inside_m, triangles_near};
use crate::gpu::read_texture;
use crate::scene::{Blend, Scene};
use crate::shading::{Estimator, salt};
use crate::shared::flavour_weights::{self, FlavourParams};
use crate::shared::noise::{self, HashedPoint};
use crate::shared::{biplanar, select, triplanar};
use crate::variant::{Flavour, Variant};
use crate::view::camera::View;
use crate::virtual_texture::{LEVELS, PAGE_TEXELS, PageId, TEXELS_PER_M, anisotropy};
use crate::world::{NodeId, World};
use glam::DVec3;

/// Layers that are read from the picture.
const LAYERS: [&str; 4] = ["depth", "mask", "variant", "choice"];
/// Largest accepted horizontal distance of a visible point from its triangle: the first number, metres, plus the second number times the longer of
/// the two steps to a neighbouring pixel. Points lie outside their triangles because of rounding: positions are f32, and the rasteriser rounds screen
/// coordinates, usually to multiples of 1/256 pixel.
const BESIDE: [f64; 2] = [1e-3, 0.02];
/// Largest accepted distance of a visible point from the plane of its triangle: the first number, metres, plus the second number times the height of
/// a pixel at the depth of the point, metres.
const OFF_PLANE: [f64; 2] = [2e-3, 0.05];

/// The values of one terrain pixel. Vectors are in world axes: x east, y north, z up.
#[derive(Clone, Debug, PartialEq)]
pub struct Pixel {
    /// Column and row, from the top left.
    pub pixel: [u32; 2],
    /// Position in the world, metres: the point on the pixel's ray at the depth that the device wrote. The depth is f32, so it is rounded by about
    /// 1e-7 of the distance. The point may be farther from the exact surface, because vertices are rounded, too (`BESIDE`, `OFF_PLANE`).
    pub position: [f64; 3],
    /// Sector that contains the position, counted from the world's south-west corner.
    pub sector: [i32; 2],
    /// Distance of the surface point along the view direction, metres.
    pub depth_m: f64,
    /// Distance of the surface point from the camera, metres.
    pub distance_m: f64,
    /// Unit normal that shading, weights and projections use, as stored.
    pub shading_normal: [f64; 3],
    /// Unit normal of the triangle, as stored, but turned towards the camera.
    pub triangle_normal: [f64; 3],
    /// The triangle that was drawn; `None` if the world has no triangle at the position. This can happen if the shader that places vertices was
    /// edited.
    pub triangle: Option<Triangle>,
    /// Changes of the position from this pixel to the next pixel on the right, and to the next pixel below.
    pub steps: [Derivative; 2],
    /// Flavours that the pixel needs, as bits of [`Flavour`]: 1..=31.
    pub mask: u8,
    /// Flavours of the variant that the pixel's tile runs, as bits of [`Flavour`].
    pub variant: u8,
    /// Weights of the flavours in that variant, in the order of [`Flavour::ALL`], summing to 1.
    pub flavours: [f64; 5],
    /// The splat texels around the pixel: south-west, south-east, north-west, north-east.
    pub splat: [Texel; 4],
    /// The first random choice that the device recorded: 0 = none, otherwise 1 + index of the splat texel + 4 times the axis of the projection.
    pub choice: u32,
    /// The first random choice as the references compute it; `None` = the pixel makes no random choice.
    pub draw: Option<Draw>,
    /// The position at which the pixel samples the virtual texture; `None` = it does not sample the virtual texture.
    pub page: Option<Page>,
}

/// A triangle as it was drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Triangle {
    /// LOD of the triangle's node, 0 = finest.
    pub lod: u8,
    /// Distance between drawn vertices at that LOD and vertex stride, metres.
    pub spacing_m: f64,
    /// Unit normal of the triangle.
    pub normal: [f64; 3],
}

/// Change of the position from a pixel to its neighbour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Derivative {
    /// The step that the shader computes, metres.
    pub shader: [f64; 3],
    /// The step to the point where the ray of the neighbouring pixel meets the plane of the triangle, metres; `None` if the ray does not meet the
    /// plane, or the triangle is not known.
    pub exact: Option<[f64; 3]>,
}

impl Derivative {
    /// Length of the difference between the two steps, divided by the length of the exact step; `None` without an exact step.
    pub fn error(&self) -> Option<f64> {
        let exact = DVec3::from_array(self.exact?);
        let share = (DVec3::from_array(self.shader) - exact).length() / exact.length();
        share.is_finite().then_some(share)
    }

    /// Error, in mip levels, that the shader's step causes: log2 of the quotient of the lengths of the two steps, shader / exact. Above 0, the mip
    /// level is too coarse; below 0, it is too fine. `None` without an exact step.
    pub fn mips(&self) -> Option<f64> {
        let ratio = DVec3::from_array(self.shader).length() / DVec3::from_array(self.exact?).length();
        let mips = ratio.log2();
        mips.is_finite().then_some(mips)
    }
}

/// A texel of the splat map next to the pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct Texel {
    /// Name of the texel's material in the scene.
    pub material: String,
    /// Index of the material in the palette.
    pub index: u32,
    /// Bilinear weight, 0..=1; also the probability with which a random choice takes the texel.
    pub weight: f64,
    /// Weight after the height blend of all four materials, 0..=1, in the projection with the largest weight.
    pub blended: f64,
}

/// The first random choice, as the references compute it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Draw {
    /// The first flavour of the pixel's variant that chooses at random.
    pub flavour: Flavour,
    /// Threshold that chooses the projection, [0, 1); `None` = the projections are blended.
    pub projection: Option<f64>,
    /// Threshold that chooses the splat texel, [0, 1).
    pub material: f64,
    /// Weights of the projections along x, y and z, summing to 1.
    pub projections: [f64; 3],
    /// The choice that follows from the thresholds, encoded as [`Pixel::choice`]. The device computes in f32. So it may choose differently if a
    /// threshold is within about 1e-6 of the border between two choices, or if the point is very close to the border of a noise cell.
    pub expected: u32,
}

/// A position in the virtual texture, and the size of the pixel there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Page {
    /// The page that contains the position, at the level that follows from `covered`.
    pub id: PageId,
    /// Position in the page, texels of the page's level from its south-west corner, at least 0 and below [`PAGE_TEXELS`].
    pub texel: [f64; 2],
    /// Horizontal lengths of the steps to the two neighbouring pixels, the shorter length first, in texels of level 0. They include the mip bias.
    pub footprint: [f64; 2],
    /// The length that determines the level, in texels of level 0. It is the larger of two lengths: that of the shorter step, and that of the longer
    /// step divided by the anisotropy.
    pub covered: f64,
    /// Level before it is rounded down: log2 of `covered`, at least 0.
    pub lod: f64,
    /// Mip level inside the page, 0..=1: a page has two mip levels.
    pub mip: f64,
    /// The page that was sampled: `id` or, if `id` was not available, a coarser page; `None` if there was none and the far atlas was used.
    pub served: Option<PageId>,
}

impl Pixel {
    /// Whether the recorded choice equals the choice of the references.
    pub fn agrees(&self) -> bool {
        self.choice == self.draw.map_or(0, |draw| draw.expected)
    }

    /// Angle between the stored and the true normal of the triangle, radians; `None` if the triangle is not known.
    pub fn normal_error(&self) -> Option<f64> {
        let (stored, exact) = (DVec3::from_array(self.triangle_normal), DVec3::from_array(self.triangle?.normal));
        // The angle is computed from the distance of the two unit vectors, because the arc cosine is inaccurate for small angles.
        Some(2.0 * ((stored - exact).length() / 2.0).min(1.0).asin())
    }
}

/// Decodes a recorded choice. Returns the index of the splat texel, 0..=3, and the axis of the projection, 0..=2; `None` = there was no choice.
pub fn chosen(choice: u32) -> Option<(usize, usize)> {
    let code = choice.checked_sub(1)? as usize;
    Some((code % 4, code / 4))
}

/// Returns the pixel at a position in normalised picture coordinates, which are 0..1 from left to right and from top to bottom. If the position is
/// outside the picture, the result is the nearest pixel.
pub fn pixel_at(probe: [f32; 2], size: [u32; 2]) -> [u32; 2] {
    std::array::from_fn(|k| ((f64::from(probe[k]) * f64::from(size[k])).floor().max(0.0) as u32).min(size[k].saturating_sub(1)))
}

/// The centre of a pixel, in normalised picture coordinates as for [`pixel_at`].
pub fn probe_of(pixel: [u32; 2], size: [u32; 2]) -> [f32; 2] {
    std::array::from_fn(|k| ((f64::from(pixel[k]) + 0.5) / f64::from(size[k].max(1))) as f32)
}

/// The world position on the ray through the centre of a pixel, at a distance of `depth_m` metres along the view direction.
pub fn place_at(view: &View, [x, y]: [u32; 2], depth_m: f64) -> DVec3 {
    view.pose.position + view.ray(f64::from(x), f64::from(y)) * depth_m
}

/// Inspects a pixel of the picture that `request` draws. The sample pattern of the request must be `Centre`, because the exact values are those at
/// the centre of the pixel. Returns `None` for sky.
///
/// The picture is shaded once more, by shaders that record choices. These shaders are compiled when they are first needed. If the last picture has
/// the same geometry, the geometry is not drawn again.
///
/// # Errors
/// When the pixel lies outside the picture or the device fails.
pub fn inspect(renderer: &mut Renderer<'_>, request: &RenderRequest, pixel: [u32; 2]) -> Result<Option<Pixel>> {
    let ([x, y], [width, height]) = (pixel, request.view.size);
    if x >= width || y >= height {
        return Err(Error::Request(format!("a picture of {width}x{height} has no pixel {x}, {y}: columns and rows count from 0")));
    }
    let again = {
        let mut r = *request;
        r.outputs.aovs = AovSet::from_names(&LAYERS)?;
        r.outputs.lit = false;
        r.outputs.keep_geometry = true;
        r
    };
    let index = y as usize * width as usize + x as usize;
    let frame = renderer.draw(&again)?;
    let inspected = frame.inspect()?[index];
    let [shading_normal, plane] = stored_normals(&frame, index)?;
    let picture = frame.read()?;
    let [depth_m, mask, variant, choice] = LAYERS.map(|name| picture.values(name).map_or(0.0, |values| values[index]));
    if depth_m <= 0.0 {
        return Ok(None);
    }
    let (scene, world, view) = (renderer.scene(), renderer.world(), renderer.view(&again));

    let depth_m = f64::from(depth_m);
    let ray = view.ray(f64::from(x), f64::from(y));
    let plane = DVec3::from_array(plane);
    let seen = if plane.dot(ray) > 0.0 { -plane } else { plane };
    let position = place_at(&view, pixel, depth_m);
    let distance_m = ray.length() * depth_m;
    let [ddx, ddy] = [inspected.ddx, inspected.ddy].map(|step| step.map(f64::from));

    let longest = [ddx, ddy].map(|step| DVec3::from_array(step).length()).into_iter().fold(0.0, f64::max);
    let spot = Spot {
        position,
        normal: seen,
        beside_m: BESIDE[0] + BESIDE[1] * longest,
        off_plane_m: OFF_PLANE[0] + OFF_PLANE[1] * depth_m * view.ray_dy.length(),
    };
    let triangle = spot.triangle(world, &picture.report.drawn, &picture.report.levels);
    let steps = [(ddx, view.ray_dx), (ddy, view.ray_dy)].map(|(shader, ray_step)| Derivative {
        shader,
        exact: triangle.and_then(|triangle| step_on_plane(ray, ray_step, depth_m, triangle.normal)),
    });

    let (mask, variant, choice) = (mask as u8, variant as u8, choice as u32);
    let forced = matches!(request.shading.variant, VariantChoice::Forced(_) | VariantChoice::GenericForced(_));
    let all = flavour_weights::weights(distance_m, shading_normal[2], &FlavourParams::new(&scene.flavours));
    let flavours = flavour_weights::weights_for(all, u32::from(variant), forced);

    // The inputs are the f32 values of the shader, so that the noise usually has the same cells as in the shader.
    let sector_m = world.layout().sector_m;
    let place = Place::of(view.sector.to_array(), inspected.position.map(f64::from), sector_m);
    let weights = inspected.bilinear.map(f64::from);
    let draw = drawing(request.shading.estimator, flavours).map(|drawing| {
        let point = HashedPoint { sector: place.sector, position: place.position, sector_m, ddx, ddy, hash_scale: scene.blend.hash_scale };
        let (seed, frame) = (request.shading.seed, request.shading.frame);
        let u = noise::thresholds(request.shading.noise, &point, noise::WORLD_LEVEL, pixel, frame, seed, drawing.salt);
        drawing.draw(u, projections(request.shading.estimator, shading_normal, scene.blend.triplanar_sharpness), weights)
    });
    let samples_pages = flavours[Flavour::VirtualTexture.index()] > 0.0;
    let page = samples_pages.then(|| {
        let asked = Page::of(&place, [ddx, ddy], sector_m, &Blend { anisotropy: renderer.demands().anisotropy, ..scene.blend.clone() });
        Page { served: renderer.page_serving(asked.id), ..asked }
    });

    Ok(Some(Pixel {
        pixel,
        position: position.to_array(),
        sector: place.sector,
        depth_m,
        distance_m,
        shading_normal,
        triangle_normal: seen.to_array(),
        triangle,
        steps,
        mask,
        variant,
        flavours,
        splat: std::array::from_fn(|i| Texel::of(scene, inspected.splat[i], [weights[i], f64::from(inspected.blended[i])])),
        choice,
        draw,
        page,
    }))
}

/// Returns two stored normals of a pixel of the last frame: the shading normal, and the normal of the triangle's plane.
fn stored_normals(frame: &Frame<'_, '_>, index: usize) -> Result<[[f64; 3]; 2]> {
    let encoding = frame.request().geometry.normals;
    let texels = read_texture(frame.renderer().gpu(), &frame.geometry_targets().normals, wgpu::TextureAspect::All, encoding.bytes())?;
    let bytes = encoding.bytes() as usize;
    Ok(encoding.decode(&texels[bytes * index..bytes * (index + 1)]))
}

impl Texel {
    fn of(scene: &Scene, index: u32, [weight, blended]: [f64; 2]) -> Texel {
        let material = scene.materials.get(index as usize).map_or_else(|| format!("no. {index}"), |m| m.name.clone());
        Texel { material, index, weight, blended }
    }
}

/// A position as in the shaders: a sector, and metres from its south-west corner; z is elevation.
struct Place {
    sector: [i32; 2],
    position: [f64; 3],
}

impl Place {
    /// Converts local coordinates, which are measured from the south-west corner of the camera's sector.
    fn of(camera_sector: [i32; 2], local: [f64; 3], sector_m: f64) -> Place {
        let steps = [local[0], local[1]].map(|x| (x / sector_m).floor());
        Place {
            sector: std::array::from_fn(|k| camera_sector[k] + steps[k] as i32),
            position: [local[0] - steps[0] * sector_m, local[1] - steps[1] * sector_m, local[2]],
        }
    }
}

/// Returns the step from the point `ray * t` to the point where the neighbouring ray, `ray + ray_step`, meets a plane. The plane contains `ray * t`
/// and has this `normal`. The eye is the origin. `None` if the neighbouring ray does not meet the plane.
fn step_on_plane(ray: DVec3, ray_step: DVec3, t: f64, normal: [f64; 3]) -> Option<[f64; 3]> {
    let normal = DVec3::from_array(normal);
    let neighbour = ray + ray_step;
    let hit = t * normal.dot(ray) / normal.dot(neighbour);
    (hit.is_finite() && hit > 0.0).then(|| (neighbour * hit - ray * t).to_array())
}

/// A visible surface point, and the tolerances of its position.
struct Spot {
    position: DVec3,
    /// Normal of the triangle, as the geometry pass stored it, but turned towards the camera.
    normal: DVec3,
    beside_m: f64,
    off_plane_m: f64,
}

impl Spot {
    /// Returns the triangle drawn at the point. If several triangles contain the point within the tolerances, for example at a common edge, the
    /// result is the triangle whose normal is most similar to the stored normal. `None` if no triangle contains it.
    fn triangle(&self, world: &World, drawn: &[NodeId], levels: &Levels) -> Option<Triangle> {
        let layout = world.layout();
        let at = self.position.truncate();
        let node = Surface { world, drawn, levels }.node_at(at)?;
        let normal = |near: NodeTriangle| {
            let [a, b, c] = near.corners.map(|corner| vertex(world, node, corner));
            let normal = (b - a).cross(c - a).try_normalize()?;
            (normal.dot(self.position - a).abs() <= self.off_plane_m).then_some((normal, near.stride))
        };
        let inside = |near: &NodeTriangle| inside_m(near.corners.map(|corner| place(world, node, corner)), at) >= -self.beside_m;
        let holding = triangles_near(node, layout, levels, at).into_iter().filter(inside);
        let likeness = |(normal, _): &(DVec3, u32)| normal.dot(self.normal);
        let (normal, stride) = holding.filter_map(normal).max_by(|a, b| likeness(a).total_cmp(&likeness(b)))?;
        Some(Triangle { lod: node.lod, spacing_m: layout.spacing_m(node.lod) * f64::from(stride), normal: normal.to_array() })
    }
}

/// The flavour that draws the first random number of a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Drawing {
    flavour: Flavour,
    /// The salt of the flavour's noise.
    salt: u32,
    /// Whether the projection is chosen at random, too.
    projects: bool,
}

/// Returns the first flavour, in the order of shading, whose weight is above 0 and which draws random numbers with this estimator.
fn drawing(estimator: Estimator, flavours: [f64; 5]) -> Option<Drawing> {
    // In most estimators, near cliff blends its projections, so no projection is chosen. In `Stf`, near cliff takes a single tap, so a projection is
    // chosen, too.
    let in_order = [
        (Flavour::NearCliff, salt::NEAR_CLIFF, estimator == Estimator::Stf),
        (Flavour::FarCliff, salt::FAR_CLIFF, true),
        (Flavour::Splat, salt::SPLAT, true),
    ];
    let draws = |flavour: Flavour| flavours[flavour.index()] > 0.0 && estimator.is_stochastic(Variant::only(flavour));
    let first = in_order.into_iter().find(|&(flavour, ..)| draws(flavour));
    first.map(|(flavour, salt, projects)| Drawing { flavour, salt, projects })
}

impl Drawing {
    fn draw(self, u: [f64; 4], projections: [f64; 3], weights: [f64; 4]) -> Draw {
        let (projection, material) = if self.projects { (Some(u[0]), u[1]) } else { (None, u[0]) };
        let axis = projection.map_or(0, |u| select::of_3(projections, u));
        let code = 1 + select::of_4(weights, material) + 4 * axis;
        Draw { flavour: self.flavour, projection, material, projections, expected: u32::try_from(code).unwrap_or(u32::MAX) }
    }
}

/// Weights of the projections along x, y and z, for estimators that draw random numbers.
fn projections(estimator: Estimator, normal: [f64; 3], sharpness: f64) -> [f64; 3] {
    if estimator != Estimator::Biplanar {
        return triplanar::weights(normal, sharpness);
    }
    let (axes, weights) = biplanar::projections(normal, sharpness);
    let mut of_axis = [0.0; 3];
    for (axis, weight) in axes.into_iter().zip(weights) {
        of_axis[axis as usize] = weight;
    }
    of_axis
}

impl Page {
    /// Computes the position in the virtual texture, in f64 and by the formulas of `virtual_texture.wgsl`.
    fn of(place: &Place, steps: [[f64; 3]; 2], sector_m: f64, blend: &Blend) -> Page {
        let texels = |step: [f64; 3]| step[0].hypot(step[1]) * TEXELS_PER_M * blend.mip_bias.exp2();
        let [across, down] = steps.map(texels);
        let footprint = [across.min(down), across.max(down)];
        let covered = footprint[0].max(footprint[1] / f64::from(anisotropy(blend.anisotropy)));
        let lod = covered.max(1.0).log2();
        let level = (lod.floor() as u32).min(LEVELS - 1);

        let pages_per_m = TEXELS_PER_M / f64::from(PAGE_TEXELS);
        let along = |k: usize| {
            let pages = (f64::from(place.sector[k]) * sector_m + place.position[k]).max(0.0) * pages_per_m / f64::from(1u32 << level);
            (pages.floor() as u32, (pages - pages.floor()) * f64::from(PAGE_TEXELS))
        };
        let [(x, u), (y, v)] = [along(0), along(1)];
        let mip = (lod - f64::from(level)).clamp(0.0, 1.0);
        Page { id: PageId { level, x, y }, texel: [u, v], footprint, covered, lod, mip, served: None }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec2;

    use crate::scene;
    use crate::shared::derivatives::on_plane;

    use super::*;

    /// A pseudo-random number in [0, 1).
    fn unit(i: u32, k: u32) -> f64 {
        f64::from(crate::shared::hash::pcg4d([i, k, 3, 9])[0]) / 4_294_967_296.0
    }

    #[test]
    fn pixels_and_shares_are_each_others_inverse() {
        for size in [[1, 1], [3, 7], [1920, 1080], [16_384, 4093]] {
            for pixel in [[0, 0], [size[0] / 2, size[1] / 3], [size[0] - 1, size[1] - 1]] {
                assert_eq!(pixel_at(probe_of(pixel, size), size), pixel, "{size:?}");
            }
            assert_eq!(pixel_at([-0.5, 1.5], size), [0, size[1] - 1]);
            assert_eq!(pixel_at([1.0, 0.0], size), [size[0] - 1, 0]);
        }
    }

    #[test]
    fn an_exact_normal_gives_the_references_derivative_and_a_rounded_one_an_error() {
        let (ray, steps) = (DVec3::new(0.2, 1.0, -0.3), [DVec3::new(1e-3, 0.0, 0.0), DVec3::new(0.0, 2e-4, -1e-3)]);
        let normal = DVec3::new(-0.3, -0.1, 0.9).normalize().to_array();
        for step in steps {
            let exact = step_on_plane(ray, step, 80.0, normal);
            let shader = on_plane(ray.to_array(), step.to_array(), 80.0, normal);
            let same = Derivative { shader, exact };
            assert!(same.error().is_some_and(|e| e < 1e-10) && same.mips().is_some_and(|m| m.abs() < 1e-10), "{same:?}");
            // The exact step lies in the plane.
            assert!(DVec3::from_array(exact.expect("in view")).dot(DVec3::from_array(normal)).abs() < 1e-12);
            let doubled = Derivative { shader: shader.map(|x| 2.0 * x), exact };
            assert!((doubled.error().expect("known") - 1.0).abs() < 1e-9 && (doubled.mips().expect("known") - 1.0).abs() < 1e-9);
        }
        // The plane is seen almost edge-on, and the ray of the neighbour misses it.
        assert_eq!(step_on_plane(DVec3::Y, DVec3::new(0.0, 0.0, 1e-3), 10.0, [0.0, -1e-4, 1.0]), None);
        let unknown = Derivative { shader: [1.0; 3], exact: None };
        assert_eq!((unknown.error(), unknown.mips()), (None, None));
    }

    #[test]
    fn the_worlds_own_triangle_is_found_and_none_above_it() {
        let scene = scene::load(scene::DEFAULT).expect("built in");
        let world = World::new(&scene).expect("a world");
        let layout = *world.layout();
        let node = layout.node_at(layout.finest_lod, 1879.64, -1069.62).expect("in the world");
        for i in 0..60 {
            let at = node.origin_m(&layout) + DVec2::new(unit(i, 5), unit(i, 6)) * layout.node_m(node.lod);
            let height = |x: f64, y: f64| world.surface_height_m(x, y);
            let spot = |up: f64| Spot { position: at.extend(height(at.x, at.y) + up), normal: DVec3::Z, beside_m: 1e-9, off_plane_m: 1e-6 };
            let triangle = spot(0.0).triangle(&world, &[node], &Levels::new(&[node], 0, |_, _| 0)).expect("every place has a triangle");
            assert_eq!((triangle.lod, triangle.spacing_m), (node.lod, layout.spacing_m(node.lod)));
            // The slope of the triangle is that of the surface, up to rounding.
            let [x, y, z] = triangle.normal;
            let step = 1e-7;
            let slope = [height(at.x + step, at.y) - height(at.x, at.y), height(at.x, at.y + step) - height(at.x, at.y)].map(|d| d / step);
            assert!((slope[0] + x / z).abs() < 1e-3 && (slope[1] + y / z).abs() < 1e-3, "{slope:?} {triangle:?}");
            assert_eq!(spot(0.1).triangle(&world, &[node], &Levels::new(&[node], 0, |_, _| 0)), None, "nothing is drawn in the air");
            assert_eq!(spot(0.0).triangle(&world, &[], &Levels::default()), None);
        }
    }

    #[test]
    fn choices_are_drawn_by_the_first_flavour_that_draws() {
        let near_and_splat = [0.0, 0.0, 0.5, 0.0, 0.5];
        let first = |estimator, flavours| drawing(estimator, flavours).map(|d| (d.flavour, d.projects));
        assert_eq!(first(Estimator::Fc5, near_and_splat), Some((Flavour::NearCliff, false)));
        assert_eq!(first(Estimator::Stf, near_and_splat), Some((Flavour::NearCliff, true)));
        assert_eq!(first(Estimator::Exact, near_and_splat), None);
        assert_eq!(first(Estimator::Fc5, [0.0, 0.5, 0.0, 0.5, 0.0]), Some((Flavour::FarCliff, true)));
        assert_eq!(first(Estimator::Fc5, [0.5, 0.0, 0.0, 0.0, 0.5]), None);
        assert_eq!(first(Estimator::Stf, [0.5, 0.0, 0.0, 0.0, 0.5]), Some((Flavour::Splat, true)));
        // The threshold 0.95 selects texel 3 from the weights 0.1, 0.2, 0.3, 0.4. The threshold 0.5 selects axis 1 from the weights 0.2, 0.5, 0.3.
        let weights = [0.1, 0.2, 0.3, 0.4];
        let far = Drawing { flavour: Flavour::FarCliff, salt: salt::FAR_CLIFF, projects: true }.draw(
            [0.5, 0.95, 0.0, 0.0],
            [0.2, 0.5, 0.3],
            weights,
        );
        assert_eq!((far.expected, chosen(far.expected)), (8, Some((3, 1))));
        let near = Drawing { flavour: Flavour::NearCliff, salt: salt::NEAR_CLIFF, projects: false }.draw(
            [0.15, 0.95, 0.0, 0.0],
            [0.2, 0.5, 0.3],
            weights,
        );
        assert_eq!((near.projection, near.material, near.expected, chosen(near.expected)), (None, 0.15, 2, Some((1, 0))));
        assert_eq!(chosen(0), None);
    }

    #[test]
    fn pages_follow_the_footprint_and_the_place() {
        let scene = scene::load(scene::DEFAULT).expect("built in");
        let page = |footprint: [f64; 2], anisotropy: u16, mip_bias: f64| {
            let place = Place { sector: [3, 2], position: [10.25, 63.5, 700.0] };
            let [across, down] = footprint.map(|texels| texels / TEXELS_PER_M);
            Page::of(&place, [[across, 0.0, 50.0], [0.0, -down, 0.0]], 64.0, &Blend { anisotropy, mip_bias, ..scene.blend.clone() })
        };
        let near = page([0.5, 0.25], 1, 0.0);
        assert_eq!((near.id, near.texel, near.lod), (PageId { level: 0, x: 3 * 64 + 10, y: 2 * 64 + 63 }, [64.0, 128.0], 0.0));
        let far = page([9.0, 3.0], 1, 0.0);
        assert!((far.covered - 9.0).abs() < 1e-9 && (far.lod - 9f64.log2()).abs() < 1e-9 && (far.mip - (9f64 / 8.0).log2()).abs() < 1e-9);
        // The edge of a page of level 3 is 8 m. The position is 202.25 m east and 191.5 m north of the world's south-west corner.
        assert_eq!(far.id, PageId { level: 3, x: 25, y: 23 });
        assert!((far.texel[0] - 2.25 * 32.0).abs() < 1e-9 && (far.texel[1] - 7.5 * 32.0).abs() < 1e-9, "{far:?}");
        // The longer step is divided by the anisotropy, which is limited to 4 for pages. A mip bias of 1 doubles both steps.
        assert_eq!(page([9.0, 3.0], 2, 0.0).id.level, 2);
        assert_eq!(page([9.0, 3.0], 16, 0.0).id.level, 1);
        assert_eq!(page([9.0, 3.0], 1, 1.0).id.level, 4);
        assert_eq!(page([1e9, 1e9], 1, 0.0).id.level, LEVELS - 1);
    }

    #[test]
    fn local_coordinates_are_put_into_sectors() {
        let place = Place::of([80, 79], [130.5, -0.25, 9.0], 64.0);
        assert_eq!((place.sector, place.position), ([82, 78], [2.5, 63.75, 9.0]));
    }
}
