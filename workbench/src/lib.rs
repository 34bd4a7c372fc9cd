//! The workbench: the terrain stack live. A thread draws ([`engine`]), the window asks and shows ([`window`]); panels show and change the [`model`], in
//! which what is on screen is one value ([`model::settings::Settings`]) that undo takes back. What is on screen can be saved and run as an experiment
//! ([`engine::experiment`]); what shading made of one pixel is taken apart ([`inspector`]); shaders that are edited are followed.

pub mod engine;
pub mod model;
pub mod script;
pub mod window;

mod panels;
#[cfg(test)]
mod test_folder;
