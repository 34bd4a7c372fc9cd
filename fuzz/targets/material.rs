#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    scree_fuzz::material(bytes);
});
