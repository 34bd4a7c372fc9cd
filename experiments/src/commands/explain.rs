//! `explain`: what a scene requires, and what it does not.

use anyhow::Result;
use kernels::frame::requirements::Requirements;
use kernels::scene;
use serde::Serialize;

use super::{print, print_json};
use crate::cli::ExplainArgs;

#[derive(Serialize)]
struct Answer {
    #[serde(flatten)]
    requirements: Requirements,
    texture_bytes: u64,
    bytes_per_px: u32,
}

/// Prints both lists.
pub(crate) fn run(args: &ExplainArgs) -> Result<()> {
    let requirements = Requirements::of(&scene::load(&args.scene)?);
    if !args.json {
        return print(&requirements.to_string());
    }
    let (texture_bytes, bytes_per_px) = (requirements.bytes(), requirements.bytes_per_px());
    print_json(&Answer { requirements, texture_bytes, bytes_per_px })
}
