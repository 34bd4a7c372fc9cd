//! `explain`: prints what a scene requires and what it does not require, and lists its settings.

use anyhow::Result;
use kernels::frame::requirements::Requirements;
use kernels::scene;
use kernels::settings::{self, Row};
use serde::Serialize;

use super::{print, print_json};
use crate::cli::ExplainArgs;

#[derive(Serialize)]
struct Answer {
    #[serde(flatten)]
    requirements: Requirements,
    texture_bytes: u64,
    bytes_per_px: u32,
    settings: Vec<Row>,
}

/// Prints the requirements and the settings.
pub(crate) fn run(args: &ExplainArgs) -> Result<()> {
    let scene = scene::load(&args.scene)?;
    let requirements = Requirements::of(&scene);
    let rows = scene::settings().map(|setting| setting.row(Some(&scene)));
    let settings: Vec<Row> = rows.filter(|row| row.value.is_some()).collect();
    if !args.json {
        return print(&format!("{requirements}\nsettings (docs/settings.md describes them)\n{}", settings::values(&settings)));
    }
    let (texture_bytes, bytes_per_px) = (requirements.bytes(), requirements.bytes_per_px());
    print_json(&Answer { requirements, texture_bytes, bytes_per_px, settings })
}
