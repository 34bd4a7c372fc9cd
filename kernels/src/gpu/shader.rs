//! Builds shader modules from lists of WGSL files. There is no preprocessor: a module is the concatenation of its files.

use crate::base::error::{Error, Result};
use crate::base::wgsl::{self, Piece, Wgsl};
use crate::gpu::{Gpu, Template};

/// A compiled WGSL module, with its source text.
pub struct Shader {
    /// The compiled module.
    pub module: wgpu::ShaderModule,
    source: String,
}

/// A shader module as a stage declares it: its name, and the files with its entry points.
#[derive(Debug)]
pub struct ShaderModule {
    /// The module's name in error messages.
    pub name: &'static str,
    /// The files that hold the module's entry points. Their dependencies are added automatically.
    pub roots: &'static [&'static Wgsl],
}

impl ShaderModule {
    /// A module of these files.
    pub const fn new(name: &'static str, roots: &'static [&'static Wgsl]) -> ShaderModule {
        ShaderModule { name, roots }
    }

    /// The pieces of the module in order, with their embedded texts.
    pub fn pieces(&self) -> Vec<Piece> {
        wgsl::pieces(self.roots)
    }

    /// All files of the module, in order.
    pub fn files(&self) -> Vec<&'static Wgsl> {
        wgsl::closure(self.roots)
    }

    /// Compiles the module. Texts in the device's [`Sources`](crate::gpu::Sources) replace the embedded texts of their files.
    ///
    /// # Errors
    /// The compiler rejects the module. The error has the message and, if the compiler gives a position, file and line.
    pub fn compile(&self, gpu: &Gpu) -> Result<Shader> {
        Shader::new(gpu, self.name, self.pieces())
    }
}

impl Shader {
    /// Concatenates `pieces` and compiles them. Texts in the device's [`Sources`](crate::gpu::Sources) replace the texts of pieces from the same
    /// file.
    ///
    /// # Errors
    /// The compiler rejects the module. The error has the message and, if the compiler gives a position, file and line.
    pub fn new(gpu: &Gpu, label: &str, mut pieces: Vec<Piece>) -> Result<Shader> {
        let sources = gpu.sources();
        for piece in &mut pieces {
            sources.replace(piece);
        }
        let source = wgsl::joined(&pieces);
        let (module, complaint) = gpu.caught(|| {
            let source = wgpu::ShaderSource::Wgsl(source.as_str().into());
            gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor { label: Some(label), source })
        });
        let info = pollster::block_on(module.get_compilation_info());
        if let Some(message) = info.messages.iter().find(|m| m.message_type == wgpu::CompilationMessageType::Error) {
            let place = message.location.map_or_else(String::new, |location| {
                let (file, line) = locate(&pieces, location.line_number as usize);
                format!("{file}:{line}: ")
            });
            return Err(Error::Gpu(format!("shader {label}: {place}{}", summary(&message.message))));
        }
        match complaint {
            Some(what) => Err(Error::Gpu(format!("shader {label}: {what}"))),
            None => Ok(Shader { module, source }),
        }
    }

    /// Parses the module as a [`Template`], from which the reduced module of each pipeline is derived.
    ///
    /// # Errors
    /// When naga rejects the module. The device compiled it with naga, too, so this is not expected.
    pub(crate) fn template(&self) -> Result<Template> {
        Template::new(&self.source).map_err(Error::Gpu)
    }
}

impl Gpu {
    /// Runs `make` and captures a validation or internal error that it causes. Returns the result of `make`, and the error in one line, if any.
    /// [`Gpu::check`] does not report captured errors. Errors of other threads, out-of-memory errors and the loss of the device are not captured.
    pub(crate) fn caught<T>(&self, make: impl FnOnce() -> T) -> (T, Option<String>) {
        let validation = self.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let internal = self.device.push_error_scope(wgpu::ErrorFilter::Internal);
        let made = make();
        let internal = pollster::block_on(internal.pop());
        let validation = pollster::block_on(validation.pop());
        (made, validation.or(internal).map(|error| chain(&error.to_string())))
    }
}

/// Joins the causes of an error into one line. `text` lists the causes below a title, one per line. If it lists no causes, all its lines are joined.
fn chain(text: &str) -> String {
    let causes = text.split_once("Caused by:").map_or(text, |(_, causes)| causes);
    causes.lines().map(str::trim).filter(|line| !line.is_empty()).collect::<Vec<_>>().join(": ")
}

/// A compiler error in one line: the message, the labels at its position, and its notes. The excerpt of the source is left out, because its line
/// numbers refer to the concatenation.
fn summary(complaint: &str) -> String {
    let lines = || complaint.lines().map(str::trim).filter(|line| !line.is_empty());
    let title = lines().take_while(|line| !line.starts_with('┌')).collect::<Vec<_>>().join(" ");
    let what = title.split_once("error: ").map_or(title.as_str(), |(_, what)| what);
    let at_place = lines().filter_map(|line| line.strip_prefix('│')?.rsplit_once("^ "));
    // Labels that only name an internal item of naga are left out.
    let at_place = at_place.map(|(_, words)| words).filter(|words| !words.starts_with("naga::"));
    let notes = lines().filter_map(|line| line.strip_prefix("= "));
    let details: Vec<&str> = at_place.chain(notes).collect();
    if details.is_empty() { what.to_owned() } else { format!("{what} ({})", details.join("; ")) }
}

/// Converts line `line` of the concatenation to a file and a line in that file. Lines count from 1. For a line beyond the end, returns the last line
/// of the last file.
fn locate(pieces: &[Piece], line: usize) -> (&str, usize) {
    let mut left = line;
    let mut end: (&str, usize) = ("?", line);
    for Piece { path, text } in pieces {
        let lines = text.matches('\n').count() + 1;
        if left <= lines {
            return (path.as_str(), left);
        }
        left -= lines;
        end = (path.as_str(), lines);
    }
    end
}

/// Compilation options with these override constants.
pub fn constants<'a>(values: &'a [(&'a str, f64)]) -> wgpu::PipelineCompilationOptions<'a> {
    wgpu::PipelineCompilationOptions { constants: values, ..Default::default() }
}

#[cfg(test)]
mod tests {
    use super::{Piece, chain, locate, summary};

    #[test]
    fn lines_of_a_concatenation_map_back_to_their_files() {
        let files = [Piece::new("a.wgsl", "1\n2\n"), Piece::new("b.wgsl", "1\n2")];
        // "1\n2\n" + "\n" makes three lines, the third one empty.
        assert_eq!(locate(&files, 2), ("a.wgsl", 2));
        assert_eq!(locate(&files, 4), ("b.wgsl", 1));
        assert_eq!(locate(&files, 5), ("b.wgsl", 2));
        // If a text ends too early, the compiler reports a position after its end.
        assert_eq!(locate(&files, 6), ("b.wgsl", 2));
        assert_eq!(locate(&[], 6), ("?", 6));
    }

    #[test]
    fn complaints_become_one_line_without_foreign_line_numbers() {
        let parsing = "\nShader 'lighting' parsing error: no definition in scope for identifier: `nn`\n     ┌─ wgsl:1440:13\n     │\n1440 \
                       │     let a = nn ^ 1u;\n     │             ^^ unknown identifier\n     │\n     = note: a note\n\n";
        assert_eq!(summary(parsing), "no definition in scope for identifier: `nn` (unknown identifier; note: a note)");
        let validation = "\nShader validation error: Function [5] 'f' is invalid\n   ┌─ lighting:3:1\n   │\n 3 │ ╭ fn f() {\n 4 │ │     1;\n   │ \
                          │     ^ naga::ir::Expression [0]\n   │ ╰──^ naga::ir::Function [5]\n   │\n   = Expression [0] is invalid\n\n";
        assert_eq!(summary(validation), "Function [5] 'f' is invalid (Expression [0] is invalid)");
        assert_eq!(summary("out of luck"), "out of luck");
        let causes =
            "Validation Error\n\nCaused by:\n  In Device::create_render_pipeline, label = 'a'\n    Unable to find entry point 'b'\n";
        assert_eq!(chain(causes), "In Device::create_render_pipeline, label = 'a': Unable to find entry point 'b'");
        assert_eq!(chain("Out of Memory"), "Out of Memory");
    }
}
