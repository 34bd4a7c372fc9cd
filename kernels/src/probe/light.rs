//! Probe of the reflection of light.

use super::judge::{FEW, Verdict, close};
use super::{Measure, Probe, real};
use crate::shared::brdf;
use crate::shared::real::Real;

pub(super) const REFLECTION: Probe = Probe {
    name: "reflection",
    about: "The three factors of specular reflection (normal distribution, visibility, Fresnel), and the directional albedo under uniform light",
    inputs: &[
        real("n_dot_h", "0..1"),
        real("roughness", "perceptual, 0..1"),
        real("n_dot_v", "0..1"),
        real("n_dot_l", "0..1"),
        real("f0", "reflectance at normal incidence, 0..1"),
        real("alpha", "roughness of the distribution, 0.002..1"),
    ],
    outputs: &[
        real("alpha_of", "alpha computed from the perceptual roughness"),
        real("d", "GGX, 1/sr"),
        real("v", "height-correlated Smith"),
        real("f", "Schlick, 0..1"),
        real("environment", "directional albedo, 0..1"),
    ],
    blocks: None,
    wgsl: "\
fn probe(row: array<f32, 6>) -> array<f32, 5> {
    let alpha = brdf_alpha(row[1]);
    let f0 = vec3<f32>(row[4]);
    return array<f32, 5>(
        alpha,
        brdf_d_ggx(row[0], row[5]),
        brdf_v_smith_ggx_correlated(row[2], row[3], row[5]),
        brdf_f_schlick(f0, row[2]).x,
        brdf_env_approx(f0, row[1], row[2]).x,
    );
}",
    single: reflection_row,
    double: reflection_row,
    random: |d| {
        let near_one = 1.0 - d.between(-20.0, 0.0).exp2();
        vec![near_one, d.unit(), d.between(-0.1, 1.0), d.unit(), d.unit(), d.between(-8.0, 0.0).exp2()]
    },
    judge: reflection_judge,
    measures: &[Measure {
        name: "radiance",
        unit: "%",
        error: |_, got, want| {
            let off = |i: usize| 100.0 * (got[i] - want[i]).abs() / want[i].abs().max(1e-6);
            (1..5).map(off).fold(0.0, f64::max)
        },
    }],
    parameters: &[],
};

fn reflection_row<T: Real>(row: &[T], out: &mut Vec<T>) {
    let f0 = [row[4]; 3];
    out.push(brdf::alpha(row[1]));
    out.push(brdf::d_ggx(row[0], row[5]));
    out.push(brdf::v_smith_ggx_correlated(row[2], row[3], row[5]));
    out.push(brdf::f_schlick(f0, row[2])[0]);
    out.push(brdf::env_approx(f0, row[1], row[2])[0]);
}

fn reflection_judge(_: &[f64], got: &[f64], want: &[f64]) -> Verdict {
    // Distribution and visibility are computed by divisions and by sums of positive terms, in which nothing cancels. So their errors are relative to
    // the results. The distribution is the square of a quotient, and the visibility has two square roots of 4.5 ULP each, so both get twice the
    // tolerance `FEW`. The directional albedo uses exp2 with an argument of at least -9.28, so the error of exp2 is at most 3 + 2 x 9.28 = 21.6 ULP.
    // Its tolerance is three times `FEW`, which is 48 ULP.
    let tolerances = [FEW, 2.0 * FEW * want[1], 2.0 * FEW * want[2], FEW, 3.0 * FEW];
    let scaled = |v: &[f64]| v.iter().zip(tolerances).map(|(x, t)| x / t.max(f64::from(f32::MIN_POSITIVE))).collect::<Vec<_>>();
    close(&scaled(got), &scaled(want), 1.0)
}
