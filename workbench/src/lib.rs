//! The workbench: an interactive window for the terrain renderer. A thread draws the pictures ([`engine`]); the window requests and shows them
//! ([`window`]). Panels show and change the [`model`]. The part of the model that decides how the terrain looks is a single value
//! ([`model::settings::Settings`]), so that undo can restore it. The current settings and view can be saved and run as an experiment
//! ([`engine::experiment`]). The inspector panel shows how one pixel was shaded ([`kernels::oracle`]). If the program draws with the shaders in a
//! folder, edited shaders are reloaded while the window is open ([`engine::reload`]).

pub mod engine;
pub mod model;
pub mod script;
pub mod window;

mod panels;
#[cfg(test)]
mod test_folder;
