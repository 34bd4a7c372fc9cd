//! Checks that a JPEG file is complete. If the end of a file is missing, decoders fill the missing part of the picture with invented
//! pixels.

use super::fault::Fault;

/// Checks that a JPEG file contains its picture up to the end.
///
/// The function goes from marker to marker (ITU-T T.81, B.1.1). A search for the last marker of the picture, EOI (end of image,
/// B.1.1.3), is not enough: segments for applications (B.2.4.6) often contain a small JPEG file as a preview, which has an EOI, too. Bytes
/// after the end of the picture are ignored.
///
/// # Errors
/// [`Fault::Damaged`]: the file ends before EOI, or there is no scan (SOS, B.2.3) before EOI.
pub(super) fn check_end(bytes: &[u8]) -> Result<(), Fault> {
    let mut rest = bytes;
    let mut has_scan = false;
    // The search skips pairs of bytes that begin no segment. In the data of a scan, FF is followed by 00 or by a marker RST (FFD0 to FFD7;
    // B.1.1.2, B.1.1.5). FF may also be repeated before a marker. SOI (FFD8) and TEM (FF01) have no segment.
    while let Some(at) = rest.windows(2).position(|pair| pair[0] == 0xff && !matches!(pair[1], 0x00 | 0x01 | 0xd0..=0xd8 | 0xff)) {
        match rest[at + 1] {
            0xd9 if has_scan => return Ok(()),
            0xd9 => break,
            marker => has_scan |= marker == 0xda,
        }
        // The length of a segment includes its own two bytes, but not the marker (B.1.1.4).
        let segment = &rest[at + 2..];
        let Some(&[high, low]) = segment.first_chunk::<2>() else { break };
        let Some(after) = segment.get(usize::from(u16::from_be_bytes([high, low])).max(2)..) else { break };
        rest = after;
    }
    Err(Fault::Damaged("JPEG: the end of the picture is missing".to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A whole file: SOI, a segment for applications that contains `preview`, a scan with a stuffed FF (FF 00) and a restart marker, EOI.
    fn file(preview: &[u8]) -> Vec<u8> {
        let length = u16::try_from(preview.len() + 2).expect("a short segment").to_be_bytes();
        [b"\xff\xd8\xff\xe1".as_slice(), &length, preview, b"\xff\xda\0\x04\x01\0\x12\xff\0\x34\xff\xd0\x56\xff\xd9"].concat()
    }

    #[test]
    fn the_end_of_a_preview_is_not_the_end_of_the_picture() {
        for whole in [file(b"Exif"), file(&file(b"Exif"))] {
            assert!(check_end(&whole).is_ok(), "{whole:x?}");
            let followed = [whole.as_slice(), b"\xff\xd8\xff\xda\0\x02"].concat();
            assert!(check_end(&followed).is_ok(), "what follows the picture does not count: {followed:x?}");
            for length in 0..whole.len() {
                let error = check_end(&whole[..length]).expect_err("it is truncated");
                assert!(error.to_string().contains("truncated"), "{length}: {error}");
            }
        }
        assert!(check_end(b"\xff\xd8\xff\xd9").is_err(), "there is no picture");
        assert!(check_end(b"\xff\xd8\xff\xe1\0\0\xff\xe1\xff\xff").is_err(), "lengths that cannot be");
    }
}
