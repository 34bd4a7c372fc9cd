//! Checks that a JPEG file contains the end of its picture. If the end is missing, decoders may fill the missing part of the picture with
//! invented pixels.

use super::fault::Fault;

/// Checks that a JPEG file contains the end of its picture.
///
/// The function goes from marker to marker (ITU-T T.81, B.1.1). A picture ends with the marker EOI (end of image, B.1.1.3). A plain search for
/// EOI is not enough: a segment for applications (B.2.4.6) may contain a small JPEG file as a preview, and the preview has an EOI, too. Bytes
/// after the end of the picture are ignored.
///
/// # Errors
/// [`Fault::Damaged`]: the file ends before EOI, or there is no scan (SOS, B.2.3) before EOI.
pub(super) fn check_end(bytes: &[u8]) -> Result<(), Fault> {
    let mut rest = bytes;
    let mut has_scan = false;
    // The search skips these pairs of bytes: FF 00 and the markers RST (FFD0 to FFD7), which occur in the data of a scan (B.1.1.2, B.1.1.5);
    // FF FF, because FF may be repeated before a marker; and the markers SOI (FFD8) and TEM (FF01), which have no segment.
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
