//! Writes the commands that apply video metrics of other authors to the frames of a run.
//!
//! The option names are those of gfxdisp/ColorVideoVDP 0.5.7 (`pycvvdp/run_cvvdp.py`: `--test`, `--ref`, `--fps`, `--display`, `--result`). This tool
//! reads the frames that a `%0Nd` pattern gives, from 0 to the frame before the first missing one. IntelLabs/cgvqm (commit 9872ccb) has no command
//! line, so its function `run_cgvqm(test_vid_path, ref_vid_path, cgvqm_type, device, patch_pool, patch_scale)` is called. The function reads videos
//! through PyAV. The commands therefore convert the frames to videos with the lossless codec FFV1, which preserves RGB values of 8 bits exactly.

/// Returns shell commands that compare the PNG frames `test_pattern` with the frames `reference_pattern`. Users should read the commands before they
/// run them. Comments in the commands say how the two metrics are installed. The second metric also needs `ffmpeg`.
///
/// The patterns are those of printf, such as `frames/step-%04d.png`, with frames numbered from 0. `size` is width and height in pixels. ColorVideoVDP
/// prints a quality in JOD; 10 = no difference. If two pictures differ by 1 JOD, 3 of 4 people prefer the better one. CGVQM prints a quality of
/// 0..=100.
pub fn commands(test_pattern: &str, reference_pattern: &str, fps: f64, size: [u32; 2]) -> String {
    let (test, reference) = (quoted(test_pattern), quoted(reference_pattern));
    let display = if size[0] <= 1920 && size[1] <= 1080 { "standard_fhd" } else { "standard_4k" };
    // CGVQM divides the picture into patches. All patches have equal size only if `patch_scale` divides both sides. The tool's default is 4.
    let patch_scale = [4, 3, 2].into_iter().find(|scale| size.iter().all(|side| side % scale == 0)).unwrap_or(1);
    format!(
        "\
# Frames of {width}x{height} pixels at {fps} per second, numbered from 0.

# ColorVideoVDP (https://github.com/gfxdisp/ColorVideoVDP): pip install cvvdp
cvvdp --test {test} --ref {reference} --fps {fps} --display {display} --result cvvdp.csv

# CGVQM (https://github.com/IntelLabs/cgvqm): clone it, set CGVQM to its folder,
# pip install torch==2.4.1 torchvision==0.19.1 numpy scipy av (later releases of torchvision cannot read videos).
# It judges clips of one second (at most 30 frames) and fills a shorter clip with copies of the last frame: give it frames for at least one second.
ffmpeg -framerate {fps} -start_number 0 -i {test} -c:v ffv1 -pix_fmt bgr0 test.mkv
ffmpeg -framerate {fps} -start_number 0 -i {reference} -c:v ffv1 -pix_fmt bgr0 reference.mkv
PYTHONPATH=\"$CGVQM\" python -c \"import torch; from cgvqm import run_cgvqm, CGVQM_TYPE; \
q, _ = run_cgvqm('test.mkv', 'reference.mkv', cgvqm_type=CGVQM_TYPE.CGVQM_2, \
device='cuda' if torch.cuda.is_available() else 'cpu', patch_pool='mean', patch_scale={patch_scale}); print(q.item())\"
",
        width = size[0],
        height = size[1],
    )
}

/// Returns the text quoted as one word of a POSIX shell.
fn quoted(text: &str) -> String {
    format!("'{}'", text.replace('\'', r"'\''"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_name_frames_rate_and_size() {
        let text = commands("a b/test-%04d.png", "it's/ref-%04d.png", 30.0, [480, 270]);
        let line = |start: &str| text.lines().filter(|l| l.starts_with(start)).collect::<Vec<_>>();
        let test = "--test 'a b/test-%04d.png' --ref 'it'\\''s/ref-%04d.png' --fps 30 --display standard_fhd --result cvvdp.csv";
        assert_eq!(line("cvvdp "), [format!("cvvdp {test}")]);
        assert_eq!(line("ffmpeg ").len(), 2);
        assert!(line("ffmpeg ")[0].contains("-i 'a b/test-%04d.png'") && line("ffmpeg ")[1].contains("'it'\\''s/ref-%04d.png'"));
        // 480 and 270 are divisible by 3, but not both by 4.
        assert!(text.contains("patch_scale=3"));
        assert!(commands("a", "b", 60.0, [3840, 2160]).contains("standard_4k"));
        assert!(commands("a", "b", 23.976, [481, 270]).contains("--fps 23.976"));
        assert!(commands("a", "b", 60.0, [481, 270]).contains("patch_scale=1"));
    }
}
