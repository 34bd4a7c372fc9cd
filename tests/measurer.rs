//! A stand-in for the renderer, which invents the measurements of a run. Tests of runs use it, so that nothing has to be rendered.

use std::cell::Cell;
use std::fs;
use std::path::Path;
use std::time::Duration;

use ::experiments::definition::Definition;
use ::experiments::row::Row;
use ::experiments::store::Provenance;
use ::experiments::unit::{Measure, Outcome, Unit, Work, plan};

/// A stand-in for the renderer. Its values of `rmse` and `ssim` depend on the part, on the settings of the definition, and on the bytes of the files
/// of the reference, as measured errors do. The stand-in does not notice damaged references.
pub(crate) struct Fake {
    pub(crate) definition: Definition,
    /// Mixed into every pseudo-random number; 0, except in negative controls.
    pub(crate) salt: u64,
    /// Time that each variant takes.
    pub(crate) pause: Duration,
    /// Whether times are the same in every run, so that tables of times can be compared. If not, times differ from run to run, as measured times do.
    pub(crate) times_repeat: bool,
    /// Number of parts that were measured.
    pub(crate) calls: Cell<u64>,
}

impl Fake {
    pub(crate) fn of(definition: &Definition) -> Fake {
        Fake { definition: definition.clone(), salt: 0, pause: Duration::ZERO, times_repeat: false, calls: Cell::new(0) }
    }

    /// A pseudo-random number from 0 to 1 for a text, the salt and the settings of the definition.
    fn number(&self, text: &str) -> f64 {
        number(&format!("{text}/{}/{:?}", self.salt, self.definition.settings))
    }

    /// The file names of the reference that a part needs or renders.
    fn reference_of(&self, unit: &Unit) -> anyhow::Result<[String; 2]> {
        let is_own = |other: &Unit| other.work == Work::Reference && other.view == unit.view && other.setting == unit.setting;
        let reference = plan(&self.definition).into_iter().find(is_own);
        let reference = reference.ok_or_else(|| anyhow::anyhow!("{} has no reference", unit.id))?;
        Ok(["exr", "json"].map(|extension| format!("{}.{extension}", reference.id)))
    }
}

/// Pseudo-random number from 0 to 1, computed from a text. It has the full precision of an f64.
pub(crate) fn number(text: &str) -> f64 {
    let mixed = text.bytes().fold(0xcbf2_9ce4_8422_2325, |hash: u64, byte| (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3));
    ((mixed ^ mixed >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 11) as f64 / (1u64 << 53) as f64
}

fn row(variant: &str, metric: &str, value: f64) -> Row {
    Row { scene: "default".to_owned(), variant: variant.to_owned(), metric: metric.to_owned(), value, ..Row::default() }
}

impl Measure for Fake {
    fn measure(&mut self, unit: &Unit, folder: &Path, step: &dyn Fn(u64, u64)) -> anyhow::Result<Outcome> {
        self.calls.set(self.calls.get() + 1);
        let own = folder.join("reference");
        let names = self.reference_of(unit)?;
        let mut outcome = Outcome::default();
        if unit.work == Work::Reference {
            fs::create_dir_all(&own)?;
            for name in &names {
                fs::write(own.join(name), format!("{}\n{name}\n", self.number(name)))?;
            }
            outcome.rows.push(row("reference", "reference_se", self.number(&unit.id)));
            return Ok(outcome);
        }
        for (i, (variant, _)) in self.definition.variant_choices()?.iter().enumerate() {
            step(i as u64, 2);
            std::thread::sleep(self.pause);
            if let Work::Timing { .. } = unit.work {
                let unique = 1.0 + self.calls.get() as f64 + f64::from(std::process::id());
                let time = if self.times_repeat { self.number(&format!("{}/{variant}", unit.id)) } else { unique };
                // The unit of the time is wrong on purpose: the store must replace it.
                outcome.times.push(Row { unit: "wrong".to_owned(), standard_error: Some(0.0), ..row(variant, "gpu_ms:shading", time) });
                continue;
            }
            let reference = [fs::read(own.join(&names[0]))?, fs::read(own.join(&names[1]))?].concat();
            for frame in (0..self.definition.frames).rev() {
                let value = self.number(&format!("{}/{variant}/{frame}/{reference:?}", unit.id));
                // NaN and infinity must be stored, too.
                let psnr = if frame == 0 { f64::NAN } else { f64::INFINITY };
                outcome.rows.push(Row { frame: Some(frame), ..row(variant, "rmse", value) });
                outcome.rows.push(Row { frame: Some(frame), ..row(variant, "psnr", psnr) });
                // The definitions do not list this metric, so the store must leave it out.
                outcome.rows.push(Row { frame: Some(frame), ..row(variant, "ssim", value) });
            }
            for lag in 1..self.definition.frames {
                let value = 0.1 / f64::from(lag);
                outcome.rows.push(Row { lag: Some(lag), standard_error: Some(value), ..row(variant, "flip_rate", value) });
            }
        }
        Ok(outcome)
    }
}

/// The adapter and the driver that the runs of tests record.
pub(crate) fn machine() -> Provenance {
    Provenance {
        adapter: "none".to_owned(),
        driver: "0".to_owned(),
        software: true,
        without_anisotropy: None,
        command: "experiments run trial.toml".to_owned(),
    }
}
