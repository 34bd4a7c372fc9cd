//! `adapters`: lists the graphics adapters and whether they are usable.

use std::fmt::Write as _;

use anyhow::{Result, bail};
use kernels::gpu::{self, AdapterReport};
use serde::Serialize;

use super::{print, print_json};
use crate::cli::AdaptersArgs;

#[derive(Serialize)]
struct Row<'a> {
    name: &'a str,
    backend: &'a str,
    device_type: &'a str,
    driver: &'a str,
    usable: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    reason: Option<&'a str>,
    features: serde_json::Map<String, serde_json::Value>,
}

impl<'a> From<&'a AdapterReport> for Row<'a> {
    fn from(report: &'a AdapterReport) -> Row<'a> {
        Row {
            name: &report.name,
            backend: &report.backend,
            device_type: &report.device_type,
            driver: &report.driver,
            usable: report.usable.is_ok(),
            reason: report.usable.as_ref().err().map(String::as_str),
            features: report.features.iter().map(|(name, has)| (name.clone(), (*has).into())).collect(),
        }
    }
}

/// Prints the list of adapters. Fails after printing if no adapter is usable.
pub(crate) fn run(args: &AdaptersArgs) -> Result<()> {
    let reports = gpu::adapters();
    if args.json {
        print_json(&reports.iter().map(Row::from).collect::<Vec<_>>())?;
    } else {
        print(&table(&reports))?;
    }
    if reports.is_empty() {
        bail!("no graphics adapter: install a Vulkan driver (Debian, Ubuntu: `apt-get install mesa-vulkan-drivers`, a software driver)");
    }
    if reports.iter().all(|report| report.usable.is_err()) {
        bail!("none of the {} adapter(s) is usable: update the drivers (the list above says what each adapter lacks)", reports.len());
    }
    Ok(())
}

fn table(reports: &[AdapterReport]) -> String {
    let mut text = String::new();
    for report in reports {
        let verdict = match &report.usable {
            Ok(()) => "usable".to_owned(),
            Err(reason) => format!("not usable: {reason}"),
        };
        // Writing into a String cannot fail.
        let _ = writeln!(text, "{} ({}, {}, {}): {verdict}", report.name, report.backend, report.device_type, report.driver);
        for (name, has) in &report.features {
            let _ = writeln!(text, "  {} {name}", if *has { "yes" } else { "no " });
        }
    }
    text
}
