//! Compares motion links with their reference in f64.

use glam::DVec3;
use kernels::composition::Layers;
use kernels::frame::{Frame, RenderRequest, Renderer, VariantChoice};
use kernels::gpu::{read_buffer, read_texture};
use kernels::metrics::Track;
use kernels::motion::reference::{Seen, link};
use kernels::motion::{LAGS, NO_LINK};
use kernels::scene::Scene;
use kernels::shared::motion::in_quarter;
use kernels::temporal::Resolve;
use kernels::variant::{Flavour, Variant};
use kernels::view::camera::{NEAR_M, Pose};

use crate::fixtures::{Folder, gpu, level_ground, request, second_renderer};

/// A size that is not a multiple of the workgroup size in either direction.
const SIZE: [u32; 2] = [93, 61];
const PIXELS: usize = (SIZE[0] * SIZE[1]) as usize;

/// Reads what the geometry pass wrote.
fn seen(frame: &Frame<'_, '_>) -> Seen {
    let (gpu, targets) = (frame.renderer().gpu(), frame.targets());
    let read = |texture, aspect, bytes| read_texture(gpu, texture, aspect, bytes).expect("the device works");
    let depth: Vec<f32> = bytemuck::pod_collect_to_vec(&read(&targets.geometry.depth_stencil, wgpu::TextureAspect::DepthOnly, 4));
    let encoding = frame.request().geometry.normals;
    let normals = read(&targets.geometry.normals, wgpu::TextureAspect::All, encoding.bytes());
    Seen {
        view: *frame.view(),
        distances: depth.iter().map(|&depth| if depth > 0.0 { NEAR_M / f64::from(depth) } else { 0.0 }).collect(),
        planes: normals.chunks_exact(encoding.bytes() as usize).map(|texel| DVec3::from_array(encoding.decode(texel)[1])).collect(),
    }
}

#[test]
fn links_equal_their_reference() {
    // The camera `cliff` sees a wall, whose depth differs much from pixel to pixel. The camera `ground` sees ground, whose depth is nearly the same
    // in neighbouring rows of pixels. There, a wrong link to another row or to the opposite edge of the picture is not rejected by its depth.
    let mut renderer = second_renderer();
    let [cliff, ground] = ["cliff", "ground"].map(|camera| request(&renderer, camera));
    compare(&mut renderer, "cliff", cliff, [1.5, 0.4, 2.0], false);
    compare(&mut renderer, "ground", ground, [0.15, 0.04, 0.2], false);
    // A camera 20 cm above the ground.
    let low = ground.with(|r| {
        r.view.pose.position.z = renderer.ground_m(r.view.pose.position.x, r.view.pose.position.y) + 0.2;
        r.view.pose.pitch = -1.1;
    });
    compare(&mut renderer, "low", low, [0.015, 0.004, 0.02], true);
}

#[test]
fn points_that_leave_a_picture_of_level_ground_have_no_link() {
    let temp = Folder::new("level-ground");
    let scene = Scene { detail_size: 64, ..level_ground(&temp) };
    let mut renderer = Renderer::new(gpu(), &scene, &|_| {}).expect("renders");
    // The camera looks straight down, so all pixels have nearly the same depth. A wrong link to a pixel at the opposite edge is not rejected by its
    // depth. The camera moves by about one pixel per frame to each side of the picture, so that points come in at this side.
    let position = DVec3::new(3.0, 2.0, renderer.ground_m(3.0, 2.0) + 10.0);
    let base = RenderRequest::new(Pose { position, yaw: 0.3, pitch: -1.55, fov: 1.0 }, SIZE);
    for (side, step_m) in [("right", [0.2, 0.0, 0.0]), ("left", [-0.2, 0.0, 0.0]), ("up", [0.0, 0.2, 0.0]), ("down", [0.0, -0.2, 0.0])] {
        compare(&mut renderer, side, base, step_m, true);
    }
}

/// Compares the links of a sequence. `step_m`: how far the camera moves per frame to the right, up and forwards, metres. `all_ground`: whether the
/// pictures show no sky and hide no ground.
fn compare(renderer: &mut Renderer<'_>, camera: &str, base: RenderRequest, step_m: [f64; 3], all_ground: bool) {
    let flavour = Variant::only(Flavour::FarAtlas);
    let base = base.with(|r| {
        r.view.size = SIZE;
        r.shading.variant = VariantChoice::Forced(flavour);
    });
    let layers = Layers::new(gpu(), SIZE);
    // Positions are written only for streams with a resolve.
    let track = Track { resolve: Resolve::Exponential, ..Track::default() };
    let mut meter = renderer.meter(SIZE, &[track], None).expect("the passes compile");
    let [right, up, forward] = base.view.pose.axes();
    let mut frames: Vec<Seen> = Vec::new();
    let mut before: Vec<u32> = Vec::new();
    let (mut linked, mut hidden, mut uncertain, mut outside) = ([0; LAGS], 0, 0, 0);
    // The camera moves in all directions and turns. Points come into the picture, leave it, and appear from behind nearer points.
    for index in 0..6u32 {
        let step = f64::from(index);
        let request = base.with(|r| {
            r.view.pose.position += (right * step_m[0] + up * step_m[1] + forward * step_m[2]) * step;
            r.view.pose.yaw += 0.004 * step;
            r.view.pose.pitch += 0.002 * step;
        });
        frames.push(seen(&renderer.draw(&request).expect("draws")));
        renderer.draw_flavours(&request, flavour, &layers).expect("draws");
        let (sums, _) = renderer.drawn_as(&request).expect("drawn").measure(&layers, &mut meter, &[Some(flavour)]).expect("measures");
        let read = |buffer, bytes| read_buffer(gpu(), buffer, bytes).expect("the device works");
        let links: Vec<u32> = bytemuck::pod_collect_to_vec(&read(&meter.motion.links, (PIXELS * LAGS * 4) as u64));
        let positions: Vec<[f32; 2]> = bytemuck::pod_collect_to_vec(&read(&meter.motion.positions, PIXELS as u64 * 8));
        let now = &frames[index as usize];
        let reach = (0..PIXELS).filter(|&at| now.distances[at] > 0.0).count();
        assert!(reach > PIXELS / 2, "{reach} of {PIXELS} pixels show terrain");
        for lag in 1..=LAGS {
            let of_lag = &links[(lag - 1) * PIXELS..lag * PIXELS];
            let past = (index as usize).checked_sub(lag).map(|earlier| &frames[earlier]);
            let mut followed = [0u64; 2];
            for at in 0..PIXELS {
                let pixel = [at as u32 % SIZE[0], at as u32 / SIZE[0]];
                let found = of_lag[at];
                if lag > 1 && !in_quarter(pixel[1], index % 4) {
                    // At lags above 1, the pass writes only the links of one quarter of the rows. The links of the other quarters must stay as they
                    // were.
                    assert_eq!(found, before.get((lag - 1) * PIXELS + at).copied().unwrap_or(0), "frame {index}, lag {lag}, pixel {at}");
                    continue;
                }
                followed[0] += u64::from(now.distances[at] > 0.0);
                followed[1] += u64::from(found != NO_LINK);
                let Some(past) = past else {
                    assert_eq!(found, NO_LINK, "frame {index}, lag {lag}, pixel {at}");
                    continue;
                };
                let expected = link(now, past, at);
                if expected.is_uncertain {
                    uncertain += 1;
                    continue;
                }
                let wanted = expected.pixel.map_or(NO_LINK, |pixel| pixel as u32);
                assert_eq!(found, wanted, "frame {index}, lag {lag}, pixel {at}: {expected:?}");
                if lag == 1 {
                    let position = expected.position.unwrap_or([-1e9; 2]);
                    // Positions in f32 have an error of less than 1e-3 pixels; see `reprojection_agrees` in `agreement.rs`. -1e9 is exact in f32.
                    let is_close = (0..2).all(|k| (f64::from(positions[at][k]) - position[k]).abs() < 1e-3);
                    assert!(is_close, "frame {index}, pixel {at}: {:?}, {position:?}", positions[at]);
                }
                linked[lag - 1] += usize::from(wanted != NO_LINK && wanted != at as u32);
                hidden += usize::from(wanted == NO_LINK && expected.pixel.is_none() && now.distances[at] > 0.0);
                outside += usize::from(now.distances[at] <= 0.0);
            }
            let sums = &sums[0].lags[lag - 1];
            assert_eq!((sums.terrain, sums.linked), (followed[0], followed[1]), "frame {index}, lag {lag}");
        }
        before = links;
    }
    println!("{camera}: {linked:?} linked to other pixels, {hidden} were not seen, {uncertain} are uncertain, {outside} are sky");
    // Each case must occur: links to other pixels, terrain that was not visible before, and sky. The last two are not required if `all_ground` is
    // true. Few links are uncertain (`Link::is_uncertain`).
    assert!(linked.iter().all(|&count| count > 1000), "{camera}: {linked:?}");
    assert!(all_ground || hidden > 500 && outside > 500, "{camera}: {hidden} {outside}");
    assert!(uncertain * 50 < linked.iter().sum::<usize>(), "{uncertain} of {linked:?}");
}
