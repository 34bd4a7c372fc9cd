//! What the window is made of. A panel is a function of the application and a place.

pub(crate) mod frame;
pub(crate) mod help;
pub(crate) mod parameters;
pub(crate) mod variants;
pub(crate) mod viewport;
