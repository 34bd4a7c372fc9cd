//! Computes a shared function for each row of a table, on the device and by its f64 reference in Rust, and prints the largest difference:
//! `cargo run --release -p kernels --example probe_table`.

use kernels::probe::Probe;
use kernels::{Gpu, Result};

/// The rows of the table: directions as unit vectors.
const DIRECTIONS: [[f64; 3]; 3] = [[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [-0.48, 0.64, 0.6]];

/// Returns the name of the probe, and the largest difference between the results of the device and of the f64 reference.
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
    println!("{name}: the results of the device and of the f64 reference differ by at most {error:.2e}");
    Ok(())
}
