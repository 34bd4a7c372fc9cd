//! Settings on the command line: options for settings of a frame ([`Home::Option`]), and `--set` for settings of a scene. Names, accepted values,
//! defaults and descriptions come from the tables of settings.

use anyhow::{Context, Result};
use clap::error::ErrorKind;
use clap::{Arg, ArgAction, ArgMatches, Args, Command, FromArgMatches};
use kernels::base::names::suggestion;
use kernels::frame::{self, FrameSettings};
use kernels::scene::{self, Scene};
use kernels::settings::{Home, Kind, Setting, shown};
use toml::Value;

/// An additional value of the option `--variant`. It means that variants are chosen automatically and shaded by the generic pipeline.
const GENERIC: &str = "generic";

/// The settings of a frame, read from options.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct FrameArgs(pub(crate) FrameSettings);

fn options() -> impl Iterator<Item = &'static Setting<FrameSettings>> {
    frame::settings().filter(|setting| setting.has_home(Home::Option))
}

/// Reads the value of an option. Returns a message if the value is not accepted.
fn read(setting: &Setting<FrameSettings>, text: &str) -> Result<Value, String> {
    let value = setting.kind.read(text);
    if setting.name() == "variant" && text == GENERIC {
        return Ok(value);
    }
    setting.set(&mut FrameSettings::default(), &value).map(|()| value)
}

fn argument(setting: &'static Setting<FrameSettings>) -> Arg {
    let argument = Arg::new(setting.option()).long(setting.option());
    let about = setting.about.trim_end_matches('.');
    if let Kind::Flag = setting.kind {
        return argument.action(ArgAction::SetTrue).help(about);
    }
    let unit = if setting.unit.is_empty() { String::new() } else { format!(" {}", setting.unit) };
    let more = if setting.name() == "variant" { ". `generic` is short for `auto` with --generic" } else { "" };
    let default = (setting.default)().map(|value| value.as_str().map_or_else(|| shown(&value), str::to_owned));
    argument
        .value_name(if let Kind::Name(_) | Kind::Text(_) = setting.kind { "NAME" } else { "N" })
        .help(format!("{about} ({}{unit}){more}", setting.kind))
        .default_values(default)
        .allow_hyphen_values(true)
        .value_parser(move |text: &str| read(setting, text))
}

impl Args for FrameArgs {
    fn augment_args(command: Command) -> Command {
        options().fold(command, |command, setting| command.arg(argument(setting)))
    }

    fn augment_args_for_update(command: Command) -> Command {
        FrameArgs::augment_args(command)
    }
}

impl FromArgMatches for FrameArgs {
    fn from_arg_matches(matches: &ArgMatches) -> Result<FrameArgs, clap::Error> {
        let mut frame = FrameArgs::default();
        frame.update_from_arg_matches(matches)?;
        Ok(frame)
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        for setting in options() {
            let option = setting.option();
            if let Kind::Flag = setting.kind {
                // If a flag is not given, its setting keeps its value, which `--variant generic` may have set.
                if matches.get_flag(&option) {
                    self.set(setting, &Value::Boolean(true))?;
                }
                continue;
            }
            match matches.get_one::<Value>(&option) {
                Some(Value::String(text)) if setting.name() == "variant" && text == GENERIC => self.0.generic = true,
                Some(value) => self.set(setting, value)?,
                None => {}
            }
        }
        Ok(())
    }
}

impl FrameArgs {
    fn set(&mut self, setting: &Setting<FrameSettings>, value: &Value) -> Result<(), clap::Error> {
        setting.set(&mut self.0, value).map_err(|what| clap::Error::raw(ErrorKind::ValueValidation, what))
    }
}

/// Settings that replace those of the scene file.
#[derive(Args, Clone, Debug, Default)]
pub(crate) struct SceneArgs {
    /// Replace a setting of the scene file, such as `blend.hash_scale=2`; may be given several times. docs/settings.md lists the settings
    #[arg(long = "set", value_name = "KEY=VALUE", value_parser = assignment)]
    settings: Vec<(&'static str, Value)>,
}

impl SceneArgs {
    /// Returns the settings that are replaced, with their new values.
    pub(crate) fn replaced(&self) -> impl Iterator<Item = (&'static str, &Value)> {
        self.settings.iter().map(|(key, value)| (*key, value))
    }

    /// Returns the scene named `name` with these settings applied.
    ///
    /// # Errors
    /// The scene cannot be read, one of the settings does not apply to it, or it is invalid with the new values.
    pub(crate) fn scene(&self, name: &str) -> Result<Scene> {
        let mut scene = scene::load(name)?;
        for (key, value) in &self.settings {
            let setting = scene::setting(key).with_context(|| unknown(key))?;
            setting.set(&mut scene, value).map_err(|what| anyhow::anyhow!("scene `{}`: {what}", scene.name))?;
        }
        scene::validate(&scene)?;
        Ok(scene)
    }
}

fn unknown(key: &str) -> String {
    if let Some(setting) = frame::setting(key).filter(|setting| setting.has_home(Home::Option)) {
        return format!("`{key}` is a setting of the frame, not of the scene: give --{} instead", setting.option());
    }
    let known: Vec<&str> = scene::settings().map(|setting| setting.key).collect();
    format!("`{key}` is not a setting of a scene: {}", suggestion(key, &known))
}

fn assignment(text: &str) -> Result<(&'static str, Value), String> {
    let (key, value) = text.split_once('=').ok_or("give KEY=VALUE, such as blend.hash_scale=2")?;
    let setting = scene::setting(key.trim()).ok_or_else(|| unknown(key.trim()))?;
    let value = setting.kind.read(value.trim());
    setting.accept(&value).map(|()| (setting.key, value))
}

/// Returns `number` if the setting `key` of a scene accepts it.
///
/// # Errors
/// Returns a message if there is no such setting, or if it does not accept the number.
pub(crate) fn scene_number(key: &str, number: f64) -> Result<f64, String> {
    scene::setting(key).ok_or_else(|| unknown(key))?.accept(&Value::Float(number)).map(|()| number)
}

#[cfg(test)]
mod tests {
    use kernels::frame::VariantChoice;
    use kernels::shading::Estimator;
    use kernels::variant::Variant;

    use super::*;

    fn frame(arguments: &[&str]) -> Result<FrameSettings, String> {
        let command = FrameArgs::augment_args(Command::new("render").no_binary_name(true));
        let matches = command.try_get_matches_from(arguments).map_err(|error| error.to_string())?;
        FrameArgs::from_arg_matches(&matches).map(|frame| frame.0).map_err(|error| error.to_string())
    }

    #[test]
    fn without_options_every_setting_has_its_default() {
        assert_eq!(frame(&[]), Ok(FrameSettings::default()));
    }

    #[test]
    fn every_option_is_read_into_its_setting() {
        let all = "--variant vt+splat --generic --estimator stf --noise blue --seed 7 --reseeds --two-tilings --normals exact --lod-bias -1.5 \
                   --vertex-stride 4 --geometry-error 0.5 --residency scheduled --nodes-per-frame 3 --latency 5 --exposure 1.5 --tone-curve clip --tile 16";
        let arguments: Vec<&str> = all.split_whitespace().collect();
        let read = frame(&arguments).expect("accepted");
        let usual = FrameSettings::default();
        for setting in options() {
            assert!(arguments.contains(&format!("--{}", setting.option()).as_str()), "{} is not among the arguments", setting.key);
            assert_ne!(setting.get(&read), setting.get(&usual), "{}", setting.key);
        }
        assert_eq!((read.seed, read.lod_bias, read.tile), (7, -1.5, 16));
    }

    #[test]
    fn variants() {
        let choice = |text: &str| frame(&["--variant", text]).map(|frame| frame.choice());
        assert_eq!(choice("auto"), Ok(VariantChoice::Auto));
        assert_eq!(choice("generic"), Ok(VariantChoice::GenericAuto));
        assert_eq!(choice("near-cliff+vt"), Ok(VariantChoice::Forced(Variant::new(5).expect("a set"))));
        for wrong in ["0", "32", "-1", "vt+vt2", "", "all", "4294967297"] {
            assert!(choice(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn estimators() {
        for e in Estimator::ALL {
            assert_eq!(frame(&["--estimator", e.name()]).map(|frame| frame.estimator), Ok(e));
        }
        let wrong = frame(&["--estimator", "snaped"]).expect_err("there is no such estimator");
        assert!(wrong.contains("did you mean `snapped`?") && wrong.contains("laplacian"), "{wrong}");
        // Internal estimators, such as the one that computes the theoretical variance, are not accepted.
        assert!(frame(&["--estimator", "variance"]).is_err() && frame(&["--estimator", ""]).is_err());
    }

    #[test]
    fn assignments_name_a_setting_and_an_accepted_value() {
        assert_eq!(assignment("blend.hash_scale=2"), Ok(("blend.hash_scale", Value::Float(2.0))));
        let zenith = Value::Array([0.0, 0.5, 1.0].map(Value::Float).to_vec());
        assert_eq!(assignment("sky.zenith = 0, 0.5, 1"), Ok(("sky.zenith", zenith)));
        assert_eq!(assignment("blend.hash_scale=0"), Err("`blend.hash_scale` is 0, must be 0.01 to 100".to_owned()));
        assert!(assignment("blend.hash_scal=1").is_err_and(|what| what.contains("did you mean `blend.hash_scale`?")));
        assert!(assignment("frame.exposure=1").is_err_and(|what| what.contains("give --exposure instead")));
        assert!(assignment("blend.hash_scale").is_err_and(|what| what.contains("KEY=VALUE")));
        let args = SceneArgs { settings: vec![("world.detail_m", Value::Float(1.0))] };
        assert!(args.scene("default").is_err_and(|error| error.to_string().contains("`world.detail_m` does not apply to")));
        let args = SceneArgs { settings: vec![("blend.hash_scale", Value::Float(2.0))] };
        assert_eq!(args.scene("default").map(|scene| scene.blend.hash_scale).ok(), Some(2.0));
    }
}
