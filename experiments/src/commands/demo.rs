//! `demo`: runs a small built-in definition in the same way as `run`. The options replace some keys of the definition.

use std::path::Path;

use anyhow::{Context, Result};
use kernels::scene;

use super::run::Session;
use crate::cli::DemoArgs;
use crate::definition;
use crate::store::{Existing, Place};

const TEXT: &str = include_str!("../../definitions/demo.toml");

/// Runs the demo and writes its report. A demo that was stopped continues if it has the same options. Otherwise the results of an earlier demo are
/// replaced, because users repeat the demo after they have changed something.
pub(crate) fn run(args: &DemoArgs) -> Result<()> {
    let mut definition = definition::parse(TEXT, "demo.toml (built in)", Path::new("."))?;
    let scene = scene::load(scene::DEFAULT)?;
    let cameras = || scene.cameras.iter().map(|camera| camera.name.as_str());
    cameras().find(|name| *name == args.camera).with_context(|| super::render::no_such("camera", &args.camera, &scene, cameras()))?;
    definition.moving_views.iter_mut().for_each(|view| view.camera.clone_from(&args.camera));
    definition.size = args.size;
    definition.seeds = args.seeds;
    let place = Place { out: &args.out, own: true, existing: Existing::Replace, shard: None, small: false };
    Session::begin()?.answer(&definition, &place)
}
