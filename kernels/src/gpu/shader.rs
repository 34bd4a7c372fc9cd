//! Shader modules from lists of WGSL files. No preprocessor: a module is its files, one after the other.

use crate::error::{Error, Result};
use crate::gpu::Gpu;

/// A WGSL module and the files it was made of, so that an error names file and line.
pub struct Shader {
    /// The compiled module.
    pub module: wgpu::ShaderModule,
}

impl Shader {
    /// Concatenates `files` (name, text) and compiles them.
    ///
    /// # Errors
    /// With file, line and message of the compiler's complaint.
    pub fn new(gpu: &Gpu, label: &str, files: &[(&str, &str)]) -> Result<Shader> {
        let source: String = files.iter().flat_map(|(_, text)| [*text, "\n"]).collect();
        let scope = gpu.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let module = gpu
            .device
            .create_shader_module(wgpu::ShaderModuleDescriptor { label: Some(label), source: wgpu::ShaderSource::Wgsl(source.into()) });
        let info = pollster::block_on(module.get_compilation_info());
        let complaint = pollster::block_on(scope.pop());
        if let Some(message) = info.messages.iter().find(|m| m.message_type == wgpu::CompilationMessageType::Error) {
            let line = message.location.map_or(0, |l| l.line_number as usize);
            let (file, line) = locate(files, line);
            return Err(Error::Gpu(format!("shader {label}: {file}:{line}: {}", message.message.replace('\n', " "))));
        }
        match complaint {
            Some(error) => Err(Error::Gpu(format!("shader {label}: {}", error.to_string().replace('\n', " ")))),
            None => Ok(Shader { module }),
        }
    }
}

/// The file and line (from 1) that hold line `line` (from 1) of the concatenation.
fn locate<'a>(files: &[(&'a str, &str)], line: usize) -> (&'a str, usize) {
    let mut left = line;
    for (name, text) in files {
        let lines = text.matches('\n').count() + 1;
        if left <= lines {
            return (name, left);
        }
        left -= lines;
    }
    ("?", line)
}

/// Compilation options with these override constants.
pub fn constants<'a>(values: &'a [(&'a str, f64)]) -> wgpu::PipelineCompilationOptions<'a> {
    wgpu::PipelineCompilationOptions { constants: values, ..Default::default() }
}

#[cfg(test)]
mod tests {
    use super::locate;

    #[test]
    fn lines_of_a_concatenation_map_back_to_their_files() {
        let files = [("a.wgsl", "1\n2\n"), ("b.wgsl", "1\n2")];
        // "1\n2\n" + "\n" makes three lines, the third one empty.
        assert_eq!(locate(&files, 2), ("a.wgsl", 2));
        assert_eq!(locate(&files, 4), ("b.wgsl", 1));
        assert_eq!(locate(&files, 5), ("b.wgsl", 2));
        assert_eq!(locate(&files, 99), ("?", 99));
    }
}
