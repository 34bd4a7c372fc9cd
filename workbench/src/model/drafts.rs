//! What is typed, selected and waited for in panels that belong to a scene: another scene begins with none of it.

use std::path::{self, Path, PathBuf};
use std::sync::mpsc::Receiver;

use kernels::scene;

use super::kept::MOST_RECENT;
use super::picture::Shown;
use super::places::{Places, Recorded, Recording};

/// The places and paths of the scene, and what is being typed and recorded.
#[derive(Default)]
pub(crate) struct PlacesDraft {
    /// What is kept.
    pub(crate) all: Places,
    pub(crate) recording: Option<Recording>,
    pub(crate) name: String,
    pub(crate) file: String,
    /// What became of the last click, or why it could not be done.
    pub(crate) said: Option<Result<String, String>>,
}

impl PlacesDraft {
    /// Takes note of the picture on screen, if a path is recorded.
    pub(crate) fn watch(&mut self, shown: &Shown) {
        let Some(recording) = &mut self.recording else { return };
        if let Err(end) = recording.see(shown.wish.frame, shown.pose) {
            self.stop();
            self.said = Some(Err(end.to_string()));
        }
    }

    /// Ends the recording and keeps the path.
    pub(crate) fn stop(&mut self) {
        let Some(recording) = self.recording.take() else { return };
        let name = std::mem::take(&mut self.name);
        self.said = Some(recording.finish(&name).map(|path| {
            let frames = path.frames();
            format!("recorded `{}`, {frames} frames", self.all.add(path))
        }));
    }

    /// Reads a path from the file that is typed.
    pub(crate) fn read(&mut self) -> Result<String, String> {
        let path = Recorded::read(self.typed_file()?)?;
        let frames = path.frames();
        Ok(format!("read `{}`, {frames} frames", self.all.add(path)))
    }

    /// Writes a path to the file that is typed.
    pub(crate) fn write(&self, path: &Recorded) -> Result<String, String> {
        let file = self.typed_file()?;
        path.write(file)?;
        Ok(format!("wrote {}", file.display()))
    }

    fn typed_file(&self) -> Result<&Path, String> {
        match self.file.trim() {
            "" => Err("type the name of a .csv file under `Path file` first".to_owned()),
            name => Ok(Path::new(name)),
        }
    }
}

/// What is selected and typed.
#[derive(Default)]
pub(crate) struct MaterialsDraft {
    pub(crate) selected: usize,
    /// The name in its field, and the one that it stands for: they differ while a name is typed that cannot be given.
    pub(crate) name: [String; 2],
    /// Why it cannot.
    pub(crate) misnamed: Option<String>,
    /// The folder in its field.
    pub(crate) folder: String,
    /// Whose folder was put there last.
    pub(crate) foldered: Option<PathBuf>,
    /// What came of the last click on a material.
    pub(crate) said: Option<Result<String, String>>,
    /// The folder that is being chosen.
    pub(crate) dialog: Option<Dialog>,
    /// The scene file in its field.
    pub(crate) file: String,
    pub(crate) overwrites: bool,
    /// What came of saving.
    pub(crate) saved: Option<Result<String, String>>,
    /// Files that are this scene's: the one that was opened, and those that it was saved into.
    pub(crate) own: Vec<PathBuf>,
}

/// A choice of a folder, in a window of the system's on a thread of its own.
pub(crate) struct Dialog {
    /// Name of the material that it is for.
    pub(crate) material: String,
    pub(crate) chosen: Receiver<Option<PathBuf>>,
}

impl MaterialsDraft {
    /// Takes note of what the scene was opened from, as [`scene::load`] takes it; nothing of it is written over unless asked for.
    pub(crate) fn opened(&mut self, given: &str) {
        if given == scene::DEFAULT {
            return;
        }
        let given = Path::new(given);
        let file = if given.is_dir() { given.join(scene::FILE) } else { given.to_owned() };
        // Without an absolute path it is not told from another file, and not written over.
        self.own.extend(path::absolute(file).ok().filter(|file| !self.own.contains(file)));
    }
}

/// What came of the last click that could fail.
#[derive(Default)]
pub(crate) struct RulesDraft {
    pub(crate) said: Option<Result<String, String>>,
}

/// Scenes to choose from, and what is being chosen.
#[derive(Default)]
pub(crate) struct Scenes {
    /// Scenes that were open, the newest first, as [`scene::load`] takes them.
    pub(crate) recent: Vec<String>,
    /// What is done if somebody says that edits may be lost.
    pub(crate) waits: Option<Waiting>,
    /// The file that is being chosen in a window of the system's.
    pub(crate) dialog: Option<Receiver<Option<PathBuf>>>,
}

/// What would lose edits.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Waiting {
    /// Opening the scene of this name.
    Open(String),
    /// Closing the window.
    Close,
}

impl Scenes {
    /// Takes note of the scene that is open.
    pub(crate) fn opened(&mut self, name: &str) {
        self.recent.retain(|other| other != name);
        self.recent.insert(0, name.to_owned());
        self.recent.truncate(MOST_RECENT);
    }
}
