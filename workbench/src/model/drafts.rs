//! Text that is being typed, selections, and open dialogs of the panels. Most of this state belongs to a scene, and is cleared when another scene is
//! opened.

use std::path::{self, Path, PathBuf};
use std::sync::mpsc::Receiver;

use kernels::scene;

use super::kept::MOST_RECENT;
use super::picture::Shown;
use super::places::{Places, Recorded, Recording};

/// The places and paths of the scene, and the text fields and recording of their panel.
#[derive(Default)]
pub(crate) struct PlacesDraft {
    /// The stored places and paths.
    pub(crate) all: Places,
    pub(crate) recording: Option<Recording>,
    pub(crate) name: String,
    pub(crate) file: String,
    /// The result of the last action on a place or a path, or the error of that action.
    pub(crate) said: Option<Result<String, String>>,
}

impl PlacesDraft {
    /// If a path is being recorded, adds the pose of the picture on screen to the recording.
    pub(crate) fn watch(&mut self, shown: &Shown) {
        let Some(recording) = &mut self.recording else { return };
        if let Err(end) = recording.see(shown.wish.frame, shown.pose) {
            self.stop();
            self.said = Some(Err(end.to_string()));
        }
    }

    /// Ends the recording and stores the path.
    pub(crate) fn stop(&mut self) {
        let Some(recording) = self.recording.take() else { return };
        let name = std::mem::take(&mut self.name);
        self.said = Some(recording.finish(&name).map(|path| {
            let frames = path.frames();
            format!("recorded `{}`; number of frames: {frames}", self.all.add(path))
        }));
    }

    /// Reads a path from the file in the text field.
    pub(crate) fn read(&mut self) -> Result<String, String> {
        let path = Recorded::read(self.typed_file()?)?;
        let frames = path.frames();
        Ok(format!("read `{}`; number of frames: {frames}", self.all.add(path)))
    }

    /// Writes a path to the file in the text field.
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

/// The selection and the text fields of the panel of materials.
#[derive(Default)]
pub(crate) struct MaterialsDraft {
    pub(crate) selected: usize,
    /// The name in the text field, and the current name of the material. They differ while the typed name is not valid.
    pub(crate) name: [String; 2],
    /// Why the typed name is not valid.
    pub(crate) misnamed: Option<String>,
    /// The folder in the text field.
    pub(crate) folder: String,
    /// The folder that was last copied from a material into the text field.
    pub(crate) foldered: Option<PathBuf>,
    /// The result of the last action on a material.
    pub(crate) said: Option<Result<String, String>>,
    /// The open dialog in which the user chooses a folder.
    pub(crate) dialog: Option<Dialog>,
    /// The scene file in the text field.
    pub(crate) file: String,
    pub(crate) overwrites: bool,
    /// The result of the last attempt to save the scene.
    pub(crate) saved: Option<Result<String, String>>,
    /// The files of this scene: the file from which it was opened, and the files to which it was saved.
    pub(crate) own: Vec<PathBuf>,
}

/// A system dialog in which the user chooses a folder. It runs on a separate thread.
pub(crate) struct Dialog {
    /// Name of the material for which the folder is chosen.
    pub(crate) material: String,
    pub(crate) chosen: Receiver<Option<PathBuf>>,
}

impl MaterialsDraft {
    /// Records the file from which the scene was opened, or to which it was saved. `given` is an argument of [`scene::load`]. Saving overwrites such
    /// a file only if the user asks for it.
    pub(crate) fn opened(&mut self, given: &str) {
        if given == scene::DEFAULT {
            return;
        }
        let given = Path::new(given);
        let file = if given.is_dir() { given.join(scene::FILE) } else { given.to_owned() };
        // If the path cannot be made absolute, it cannot be compared with other paths. The file then never counts as the scene's own file.
        self.own.extend(path::absolute(file).ok().filter(|file| !self.own.contains(file)));
    }
}

/// The result of the last action that could fail in the panel *Rules*.
#[derive(Default)]
pub(crate) struct RulesDraft {
    pub(crate) said: Option<Result<String, String>>,
}

/// The recent scenes, and the state of opening another scene.
#[derive(Default)]
pub(crate) struct Scenes {
    /// Recent scenes in the form that [`scene::load`] accepts, the newest first.
    pub(crate) recent: Vec<String>,
    /// The action that waits for the user to confirm that edits may be lost.
    pub(crate) waits: Option<Waiting>,
    /// The open system dialog in which the user chooses a scene file.
    pub(crate) dialog: Option<Receiver<Option<PathBuf>>>,
}

/// An action that would lose edits.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Waiting {
    /// Opening the scene with this name.
    Open(String),
    /// Closing the window.
    Close,
}

impl Scenes {
    /// Moves the scene that was opened to the top of the list of recent scenes.
    pub(crate) fn opened(&mut self, name: &str) {
        self.recent.retain(|other| other != name);
        self.recent.insert(0, name.to_owned());
        self.recent.truncate(MOST_RECENT);
    }
}
