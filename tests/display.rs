//! Tests of the display stage: tone mapping on the device agrees with its reference, and does not change anything that is measured.

use kernels::display::{Display, Exposure, FORMAT, ToneCurve, reference};
use kernels::frame::RenderRequest;
use kernels::frame::picture::Picture;
use kernels::gpu::{Recording, read_texture};
use kernels::lighting;

use crate::fixtures::{gpu, renderer, request};

/// Largest accepted difference between a displayed 8-bit value and the reference, in addition to rounding to whole values. The difference comes from
/// `pow`, for which WGSL allows the error of exp2(y log2(x)). log2 has an absolute error of 2^-21 near 1 and of 3 ulp elsewhere, so the relative
/// error of `pow` stays below 1e-5. At the largest value, 255, this is a difference of 0.003.
const CODE: f64 = 0.01;

/// Changes a request, so that the renderer also tone-maps the picture with this exposure and returns the result in `Picture::displayed`.
fn displayed(request: &mut RenderRequest, exposure: Exposure) {
    request.outputs.displayed = true;
    request.stages.display = exposure;
}

/// Returns the largest difference between a displayed 8-bit value and the unrounded value of the reference, minus 0.5, which rounding may add.
fn worst(picture: &Picture, exposure: Exposure) -> f64 {
    let codes = picture.displayed.as_ref().expect("requested");
    let pairs = picture.hdr.iter().zip(codes);
    let distances = pairs.flat_map(|(texel, code)| {
        let value = reference::tone_map([texel[0], texel[1], texel[2]].map(f64::from), exposure);
        (0..3).map(move |k| (value[k] * 255.0 - f64::from(code[k])).abs() - 0.5)
    });
    distances.fold(0.0, f64::max)
}

#[test]
fn displayed_pictures_agree_with_the_reference() {
    let mut renderer = renderer();
    for stops in [0.0, -3.0, 2.5] {
        for tone_curve in ToneCurve::ALL {
            let exposure = Exposure { exposure: stops, tone_curve };
            let request = request(&renderer, "ground").with(|r| displayed(r, exposure));
            let picture = renderer.render(&request).expect("renders");
            assert!(worst(&picture, exposure) <= CODE, "{exposure:?}: {}", worst(&picture, exposure));
            // Negative controls: an exposure that is off by a third of a stop, and the wrong curve.
            let off = Exposure { exposure: stops + 1.0 / 3.0, ..exposure };
            let other = if tone_curve == ToneCurve::Clip { ToneCurve::Reinhard } else { ToneCurve::Clip };
            let other = Exposure { tone_curve: other, ..exposure };
            assert!(worst(&picture, off) > 1.0 && worst(&picture, other) > 1.0, "{exposure:?}: a wrong exposure was not noticed");
        }
    }
}

#[test]
fn exposure_changes_nothing_that_is_measured() {
    let mut renderer = renderer();
    let plain = request(&renderer, "ground");
    let shown = plain.with(|r| displayed(r, Exposure { exposure: 4.0, tone_curve: ToneCurve::Clip }));
    let (plain, shown) = (renderer.render(&plain).expect("renders"), renderer.render(&shown).expect("renders"));
    assert!(plain.displayed.is_none() && shown.displayed.is_some());
    assert_eq!(plain.hdr, shown.hdr);
    assert_eq!(plain.vectors("albedo"), shown.vectors("albedo"));
    // The displayed picture is not completely black or white.
    let codes = shown.displayed.expect("requested");
    assert!(codes.iter().any(|code| code[1] > 20) && codes.iter().any(|code| code[1] < 255));
}

#[test]
fn an_exposure_out_of_range_is_refused() {
    let mut renderer = renderer();
    for stops in [17.0, f64::NAN, f64::NEG_INFINITY] {
        let wrong = request(&renderer, "ground").with(|r| displayed(r, Exposure { exposure: stops, tone_curve: ToneCurve::Reinhard }));
        let error = renderer.render(&wrong).expect_err("no such exposure").to_string();
        assert!(error.contains("-16 to 16"), "{error}");
    }
}

/// Runs the display pass alone on these texels. Returns the displayed 8-bit values.
fn shown(texels: &[[f32; 4]], exposure: Exposure) -> Vec<[u8; 4]> {
    let gpu = gpu();
    let size = [u32::try_from(texels.len()).expect("few"), 1];
    let image = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("given"),
        size: wgpu::Extent3d { width: size[0], height: 1, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: lighting::FORMAT,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(16 * size[0]), rows_per_image: None };
    gpu.queue.write_texture(image.as_image_copy(), bytemuck::cast_slice(texels), layout, image.size());
    let codes = gpu.target("codes", size, FORMAT);
    let mut rec = Recording::new(gpu, &[]);
    Display::new(gpu).expect("compiles").encode(&mut rec, exposure, &image, &codes);
    rec.submit().expect("the device works");
    bytemuck::pod_collect_to_vec(&read_texture(gpu, &codes, wgpu::TextureAspect::All, 4).expect("the device works"))
}

#[test]
fn any_radiance_is_displayed_as_the_reference_says() {
    // The texels have radiances from 2^-14, which is in the linear part of the sRGB curve, to 2^6, which is far above white, in 24 steps per octave
    // and in three ratios of the channels. Further texels have channels that are zero, negative, NaN or infinite.
    let ramp = (-14 * 24..6 * 24).map(|step| (f64::from(step) / 24.0).exp2() as f32);
    let mut texels: Vec<[f32; 4]> = ramp.flat_map(|v| [[v, v, v, 1.0], [v, 0.3 * v, 0.0, 0.0], [0.1 * v, 0.5 * v, 2.0 * v, 0.5]]).collect();
    texels.extend([[0.0, 0.0, 0.0, 0.25], [-1.0, -1.0, -1.0, 1.0], [-0.5, 0.2, 4.0, 1.0], [-9.0, 1.0, 0.5, 1.0], [1e-30, 1e-38, 0.0, 1.0]]);
    texels.extend([[f32::NAN, 0.5, 0.5, 1.0], [f32::INFINITY, 0.5, 0.5, 1.0], [1e30, 1e30, 1e30, 1.0]]);
    for tone_curve in ToneCurve::ALL {
        for stops in [0.0, 1.0, -2.5] {
            let exposure = Exposure { exposure: stops, tone_curve };
            for (texel, code) in texels.iter().zip(shown(&texels, exposure)) {
                let value = reference::tone_map([texel[0], texel[1], texel[2]].map(f64::from), exposure);
                for k in 0..3 {
                    let off = (value[k] * 255.0 - f64::from(code[k])).abs();
                    assert!(off <= 0.5 + CODE, "{exposure:?}, {texel:?}: {code:?} instead of {:?}", value.map(|v| v * 255.0));
                }
                assert!((f32::from(code[3]) / 255.0 - texel[3]).abs() < 0.51 / 255.0, "alpha of {texel:?} is {}", code[3]);
            }
        }
    }
}
