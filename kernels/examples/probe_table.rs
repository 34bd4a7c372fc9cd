//! Runs one shared function over a table, on the device and by its reference in f64, and prints the largest difference:
//! `cargo run --release -p kernels --example probe_table`.

use kernels::probe::Probe;
use kernels::{Gpu, Result};

/// Rows of view directions, as unit vectors.
const DIRECTIONS: [[f64; 3]; 3] = [[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [-0.48, 0.64, 0.6]];

/// The largest difference between the device and f64 over the table, and the name of the probe.
pub(crate) fn largest_error() -> Result<(&'static str, f64)> {
    let probe = Probe::find("octahedral")?;
    let gpu = Gpu::new()?;
    let rows: Vec<f64> = DIRECTIONS.concat();
    let (device, truth) = (probe.on_gpu(&gpu, &rows)?, probe.on_f64(&rows));
    let differences = device.iter().zip(&truth).map(|(a, b)| (a - b).abs());
    Ok((probe.name, differences.fold(0.0, f64::max)))
}

#[allow(dead_code, reason = "a test calls the function above")]
fn main() -> Result<()> {
    let (name, error) = largest_error()?;
    println!("{name}: the device is at most {error:.2e} from f64");
    Ok(())
}
