//! Shader modules from lists of WGSL files. No preprocessor: a module is its files, one after the other.

use crate::base::error::{Error, Result};
use crate::base::wgsl::{self, Piece, Wgsl};
use crate::gpu::{Gpu, Template};

/// A WGSL module.
pub struct Shader {
    /// The compiled module.
    pub module: wgpu::ShaderModule,
    source: String,
}

/// A shader module as a stage declares it: what it is called, and the files whose entry points it has.
#[derive(Debug)]
pub struct ShaderModule {
    /// Its name in messages.
    pub name: &'static str,
    /// The files that hold its entry points; what they need in turn comes with them.
    pub roots: &'static [&'static Wgsl],
}

impl ShaderModule {
    /// A module of these files.
    pub const fn new(name: &'static str, roots: &'static [&'static Wgsl]) -> ShaderModule {
        ShaderModule { name, roots }
    }

    /// Its pieces as compiled in, in order.
    pub fn pieces(&self) -> Vec<Piece> {
        wgsl::pieces(self.roots)
    }

    /// Every file in it, in order.
    pub fn files(&self) -> Vec<&'static Wgsl> {
        wgsl::closure(self.roots)
    }

    /// Compiles it. Where the device's [`Sources`](crate::gpu::Sources) have a text for a file, it is taken.
    ///
    /// # Errors
    /// With file, line and message of the compiler's complaint.
    pub fn compile(&self, gpu: &Gpu) -> Result<Shader> {
        Shader::new(gpu, self.name, self.pieces())
    }
}

impl Shader {
    /// Concatenates `pieces` and compiles them. Where the device's [`Sources`](crate::gpu::Sources) have a text for a file, it is taken.
    ///
    /// # Errors
    /// With file, line and message of the compiler's complaint.
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

    /// What modules of single pipelines are cut from.
    ///
    /// # Errors
    /// When naga, which the device asked, too, does not take it.
    pub(crate) fn template(&self) -> Result<Template> {
        Template::new(&self.source).map_err(Error::Gpu)
    }
}

impl Gpu {
    /// What `make` returns, and in one line the device's complaint about it, which then is nobody else's. Calls of other threads are not listened to,
    /// and neither a lost device nor want of memory is heard.
    pub(crate) fn caught<T>(&self, make: impl FnOnce() -> T) -> (T, Option<String>) {
        let validation = self.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let internal = self.device.push_error_scope(wgpu::ErrorFilter::Internal);
        let made = make();
        let internal = pollster::block_on(internal.pop());
        let validation = pollster::block_on(validation.pop());
        (made, validation.or(internal).map(|error| chain(&error.to_string())))
    }
}

/// A chain of causes, a line each below a title, in one line.
fn chain(text: &str) -> String {
    let causes = text.split_once("Caused by:").map_or(text, |(_, causes)| causes);
    causes.lines().map(str::trim).filter(|line| !line.is_empty()).collect::<Vec<_>>().join(": ")
}

/// A compiler's complaint in one line: what is wrong, what it says at the place, its notes. The drawing of the source is left out, since its line
/// numbers are those of the concatenation.
fn summary(complaint: &str) -> String {
    let lines = || complaint.lines().map(str::trim).filter(|line| !line.is_empty());
    let title = lines().take_while(|line| !line.starts_with('┌')).collect::<Vec<_>>().join(" ");
    let what = title.split_once("error: ").map_or(title.as_str(), |(_, what)| what);
    let at_place = lines().filter_map(|line| line.strip_prefix('│')?.rsplit_once("^ "));
    // naga names its own types where it has nothing to say about a place.
    let at_place = at_place.map(|(_, words)| words).filter(|words| !words.starts_with("naga::"));
    let notes = lines().filter_map(|line| line.strip_prefix("= "));
    let details: Vec<&str> = at_place.chain(notes).collect();
    if details.is_empty() { what.to_owned() } else { format!("{what} ({})", details.join("; ")) }
}

/// The file and line (from 1) that hold line `line` (from 1) of the concatenation; beyond it, the end of the last file.
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
        // A text that ends too early is complained about behind its end.
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
