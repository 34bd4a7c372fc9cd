//! Measures the errors of kernels, which are functions that shaders share, at extreme values. The results of the GPU and of the reference in f32 are
//! compared with the reference in f64.

use anyhow::Result;
use kernels::gpu::Gpu;
use kernels::probe::{Draw, EPS, Probe, Verdict};
use kernels::shared::hash::pcg;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::extremes::{Case, Extremes};

/// The result for one kernel, one value of one parameter, one measure of the error (such as an angle), and one device or the reference in f32.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Finding {
    /// Name of the probe, which evaluates the kernel for rows of inputs.
    pub kernel: String,
    /// The varied parameter.
    pub parameter: String,
    /// The value of the parameter.
    pub value: f64,
    /// Where the kernel was evaluated: `gpu`, or `f32` for the reference in single precision.
    pub on: String,
    /// Name of the device; empty for the reference. If several devices have the same name, all but the first are numbered.
    pub adapter: String,
    /// Number of tested rows.
    pub rows: usize,
    /// Number of rows with a result that is NaN or infinite.
    pub not_finite: usize,
    /// Number of rows whose result differs from the reference in f64 by more than the derived tolerance.
    pub differ: usize,
    /// Number of rows for which errors are measured. Three kinds of rows are left out: rows of cases that only
    /// require finite results, rows with an input or a result that is not finite, and rows that count as `other_side`.
    pub compared: usize,
    /// Number of rows for which result and reference lie on different sides of a threshold, and the threshold lies within the tolerance.
    pub other_side: usize,
    /// Largest ratio of a row's error to the derived tolerance, over the rows that count neither as `differ` nor as `other_side`.
    pub of_tolerance: f64,
    /// Largest error in units in the last place (ULP) of the largest reference result of its row.
    pub worst_ulp: f64,
    /// Median error over the rows, in the same unit as `worst_ulp`.
    pub typical_ulp: f64,
    /// Name of the measure of the error.
    pub measure: String,
    /// Largest error in the measure's unit.
    pub worst: f64,
    /// Median error in the measure's unit.
    pub typical: f64,
    /// The measure's unit.
    pub unit: String,
    /// Whether the result passes.
    pub pass: bool,
}

/// The comparison of the results of a row with the reference in f64.
struct Compared {
    finite: bool,
    verdict: Verdict,
    ulp: f64,
    errors: Vec<f64>,
}

/// Measures the kernels of `extremes` at their extreme values, on each device and with the reference in f32. `share` is the share of the rows of each
/// case that is measured, above 0 and at most 1. For each kernel, `progress` is called with its name, the number of finished kernels, and the number
/// of all kernels.
///
/// # Errors
/// A device fails, or `progress` returns an error.
pub fn measure(
    extremes: &Extremes,
    gpus: &[&Gpu],
    share: f64,
    progress: impl Fn(&str, usize, usize) -> Result<()>,
) -> Result<Vec<Finding>> {
    let mut kernels: Vec<&'static Probe> = Vec::new();
    for case in &extremes.cases {
        let probe = case.probe()?;
        if !kernels.iter().any(|known| known.name == probe.name) {
            kernels.push(probe);
        }
    }
    let mut findings = Vec::new();
    for (done, probe) in kernels.iter().enumerate() {
        progress(probe.name, done, kernels.len())?;
        findings.extend(of_kernel(extremes, gpus, share, probe)?);
    }
    Ok(findings)
}

/// Returns the names of the devices. If several devices have the same name, all but the first are numbered.
fn names(gpus: &[&Gpu]) -> Vec<String> {
    let before = |i: usize| gpus[..i].iter().filter(|gpu| gpu.info.name == gpus[i].info.name).count();
    let name = |i: usize| match before(i) {
        0 => gpus[i].info.name.clone(),
        n => format!("{} #{}", gpus[i].info.name, n + 1),
    };
    (0..gpus.len()).map(name).collect()
}

/// The rows of a case at one value. `rows` is a range of indices into the rows of all cases of the kernel.
struct Block<'a> {
    case: &'a Case,
    value: f64,
    rows: std::ops::Range<usize>,
}

fn of_kernel(extremes: &Extremes, gpus: &[&Gpu], share: f64, probe: &'static Probe) -> Result<Vec<Finding>> {
    let (mut blocks, mut inputs) = (Vec::new(), Vec::new());
    for case in extremes.cases.iter().filter(|case| case.kernel == probe.name) {
        // The random numbers depend only on the name of the parameter and the number of the row. A new case therefore does not change the rows of
        // other cases.
        let table = case.parameter.bytes().fold(0, |hash, byte| pcg(hash ^ u32::from(byte)));
        let count = ((f64::from(case.rows()) * share).ceil() as u32).max(1);
        for value in extremes.values(case)? {
            let begin = inputs.len() / probe.inputs.len();
            // The same random rows are used for every value.
            let rows = (0..count).filter_map(|row| probe.row(&case.parameter, value, &mut Draw { row, column: 0, table }));
            inputs.extend(rows.flatten());
            blocks.push(Block { case, value, rows: begin..inputs.len() / probe.inputs.len() });
        }
    }
    // All rows of a kernel are evaluated by one call, because each call compiles the kernel again.
    let mut results = Vec::new();
    for (gpu, name) in gpus.iter().zip(names(gpus)) {
        results.push(("gpu", name, probe.on_gpu(gpu, &inputs)?));
    }
    results.push(("f32", String::new(), probe.on_f32(&inputs)));
    let truth = probe.on_f64(&inputs);
    let found = |block: &Block<'_>| {
        results.iter().flat_map(|(on, adapter, got)| findings(probe, block, [on, adapter], &inputs, got, &truth)).collect::<Vec<_>>()
    };
    Ok(blocks.par_iter().flat_map_iter(found).collect())
}

fn findings(probe: &Probe, block: &Block<'_>, [on, adapter]: [&str; 2], inputs: &[f64], got: &[f64], truth: &[f64]) -> Vec<Finding> {
    let (columns, outputs) = (probe.inputs.len(), probe.outputs.len());
    let compare = |row: usize| {
        let input = &inputs[row * columns..(row + 1) * columns];
        let want = &truth[row * outputs..(row + 1) * outputs];
        compared(probe, block.case, input, &got[row * outputs..(row + 1) * outputs], want)
    };
    let rows: Vec<Compared> = block.rows.clone().map(compare).collect();
    let count = |holds: fn(&Compared) -> bool| rows.iter().filter(|row| holds(row)).count();
    let not_finite = count(|row| !row.finite);
    let differ = count(|row| row.verdict == Verdict::Differs);
    let shares = rows.iter().filter_map(|row| if let Verdict::Agrees(share) = row.verdict { Some(share) } else { None });
    let of_tolerance = shares.fold(0.0, f64::max);
    let [worst_ulp, typical_ulp] = worst_and_median(rows.iter().filter(|row| !row.errors.is_empty()).map(|row| row.ulp).collect());
    let of_measure = |(i, measure): (usize, &kernels::probe::Measure)| {
        let [worst, typical] = worst_and_median(rows.iter().filter_map(|row| row.errors.get(i).copied()).collect());
        let allowed = i > 0 || block.case.allow.is_none_or(|most| worst <= most);
        Finding {
            kernel: probe.name.to_owned(),
            parameter: block.case.parameter.clone(),
            value: block.value,
            on: on.to_owned(),
            adapter: adapter.to_owned(),
            rows: rows.len(),
            not_finite,
            differ,
            compared: count(|row| !row.errors.is_empty()),
            other_side: count(|row| row.verdict == Verdict::OtherSide),
            of_tolerance,
            worst_ulp,
            typical_ulp,
            measure: measure.name.to_owned(),
            worst,
            typical,
            unit: measure.unit.to_owned(),
            pass: !rows.is_empty() && not_finite == 0 && differ == 0 && allowed,
        }
    };
    probe.measures.iter().enumerate().map(of_measure).collect()
}

fn compared(probe: &Probe, case: &Case, input: &[f64], got: &[f64], want: &[f64]) -> Compared {
    let finite = got.iter().all(|x| x.is_finite());
    if case.only_finite || !finite || input.iter().any(|x| !x.is_finite()) {
        return Compared { finite, verdict: Verdict::Agrees(0.0), ulp: 0.0, errors: Vec::new() };
    }
    let verdict = (probe.judge)(input, got, want);
    let scale = want.iter().fold(f64::from(f32::MIN_POSITIVE), |most, x| most.max(x.abs()));
    let farthest = got.iter().zip(want).map(|(got, want)| (got - want).abs()).fold(0.0, f64::max);
    // If result and reference lie on different sides of a threshold, their difference is the jump at the threshold. It is not a numerical error, so
    // no error is measured for this row.
    let (ulp, errors) = if verdict == Verdict::OtherSide {
        (0.0, Vec::new())
    } else {
        (farthest / (EPS * scale), probe.measures.iter().map(|measure| (measure.error)(input, got, want)).collect())
    };
    Compared { finite, verdict, ulp, errors }
}

/// Returns the largest value and the median, which is the larger of the two middle values if their number is even. Both are 0 if there are no values.
fn worst_and_median(mut values: Vec<f64>) -> [f64; 2] {
    values.sort_by(f64::total_cmp);
    let median = values.get(values.len() / 2).copied().unwrap_or(0.0);
    [values.last().copied().unwrap_or(0.0), median]
}
