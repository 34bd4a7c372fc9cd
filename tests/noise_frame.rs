//! Tests that the noise constants of the shaders are those of the host, and that the frame uses the kind of noise that is requested. `noise` tests
//! the noise itself.

use kernels::base::wgsl;
use kernels::frame::VariantChoice;
use kernels::frame::picture::AovSet;
use kernels::shared::blue_noise::{EDGE, RANKS, SLICES};
use kernels::shared::noise::{self, HashedPoint, NoiseKind, WORLD_LEVEL};
use kernels::shared::select;
use kernels::variant::{Flavour, Variant};

use crate::fixtures::{renderer, request};
use crate::layouts::constants;

/// A point for kinds of noise that do not depend on the ground.
const NOWHERE: HashedPoint<f64> =
    HashedPoint { sector: [0; 2], position: [0.0; 3], sector_m: 64.0, ddx: [0.0; 3], ddy: [0.0; 3], hash_scale: 1.0 };

#[test]
fn masks_lie_in_the_buffer_where_the_shader_looks() {
    let wgsl = constants(&wgsl::pieces(kernels::shared::WGSL));
    let [x, y] = noise::IGN_SLOPES;
    let expected = [
        ("NOISE_MASK_EDGE", EDGE),
        ("NOISE_MASK_RANKS", RANKS),
        ("NOISE_MASK_SLICES", SLICES),
        ("NOISE_IGN_SLOPE_X", x),
        ("NOISE_IGN_SLOPE_Y", y),
        ("NOISE_IGN_FRAME", noise::IGN_FRAME),
        ("NOISE_IGN_WHOLE", noise::IGN_WHOLE),
        ("NOISE_IGN_REST", noise::IGN_REST),
        ("NOISE_HASHED_ISOTROPIC", NoiseKind::HashedIsotropic.code()),
        ("NOISE_HASHED_ANISOTROPIC", NoiseKind::HashedAnisotropic.code()),
        ("NOISE_WHITE_SCREEN", NoiseKind::WhiteScreen.code()),
        ("NOISE_WHITE_WORLD", NoiseKind::WhiteWorld.code()),
        ("NOISE_INTERLEAVED_GRADIENT", NoiseKind::InterleavedGradient.code()),
        ("NOISE_BLUE", NoiseKind::Blue.code()),
        ("NOISE_SPATIO_TEMPORAL_BLUE", NoiseKind::SpatioTemporalBlue.code()),
    ];
    for (name, host) in expected {
        assert_eq!(wgsl.get(name), Some(&f64::from(host)), "{name}");
    }
    assert_eq!(wgsl.get("NOISE_LEVEL_MIN"), Some(&f64::from(noise::LEVEL_MIN)));
    assert_eq!(wgsl.get("NOISE_LEVEL_MAX"), Some(&f64::from(noise::LEVEL_MAX)));
    assert_eq!(wgsl.get("NOISE_LEAST_SHARE"), Some(&noise::LEAST_SHARE));
    assert_eq!(wgsl.get("NOISE_BORDER"), Some(&noise::BORDER));
}

#[test]
fn the_frame_chooses_by_the_noise_asked_for() {
    let mut renderer = renderer();
    let base = request(&renderer, "ground").with(|r| {
        r.shading.variant = VariantChoice::Forced(Variant::only(Flavour::FarCliff));
        r.outputs.aovs = AovSet::from_names(&["choice"]).expect("known layers");
    });
    for kind in NoiseKind::ALL {
        let mut pictures = Vec::new();
        // The first kinds need no mask. When a kind with a mask is requested for the first time, the renderer must upload the ranks of the mask to
        // the device.
        for (frame, seed) in [(0, 5), (17, 5), (17, 6)] {
            let request = base.with(|r| {
                r.shading.noise = kind;
                r.shading.frame = frame;
                r.shading.seed = seed;
            });
            let picture = renderer.render(&request).expect("renders");
            let choice: Vec<u32> = picture.values("choice").expect("requested").iter().map(|&c| c as u32).collect();
            if !matches!(kind, NoiseKind::HashedIsotropic | NoiseKind::HashedAnisotropic | NoiseKind::WhiteWorld) {
                // Computes the expected choice of a texel in the first tiling, from the bilinear weights of the pixel and the second threshold of the
                // CPU reference. The flavour far cliff uses the salt 2.
                let inspected = renderer.drawn_as(&request).and_then(|frame| frame.inspect()).expect("inspects");
                let differing = |frame: u32, decision: usize| {
                    let (mut wrong, mut seen) = (0, 0);
                    for (i, (pixel, &choice)) in (0..).zip(inspected.iter().zip(&choice)).filter(|(_, (_, c))| **c > 0) {
                        let at = [i % request.view.size[0], i / request.view.size[0]];
                        let u = noise::thresholds(kind, &NOWHERE, WORLD_LEVEL, at, frame, seed, 2)[decision];
                        wrong += usize::from(select::of_4(pixel.bilinear.map(f64::from), u) != (choice as usize - 1) % 4);
                        seen += 1;
                    }
                    assert!(seen > 1000, "{seen} pixels chose");
                    f64::from(u32::try_from(wrong).expect("few")) / f64::from(seen)
                };
                // In rare cases, rounding puts a sum of weights in f32 on the other side of the threshold.
                let wrong = differing(frame, 1);
                assert!(wrong < 1e-3, "{kind}, frame {frame}, seed {seed}: {wrong} of the choices differ");
                // Negative controls: the threshold of a different decision, and the threshold of the next frame.
                assert!(differing(frame, 0) > 0.1, "{kind}: the threshold of a different decision passed");
                assert_eq!(differing(frame + 1, 1) > 0.1, kind.is_per_frame(), "{kind}: the threshold of the next frame");
            }
            pictures.push(choice);
        }
        assert_eq!(pictures[0] != pictures[1], kind.is_per_frame(), "{kind}: frames 0 and 17");
        assert_ne!(pictures[1], pictures[2], "{kind}: two seeds");
    }
}
