#![no_main]

use std::sync::Once;

static HOOK: Once = Once::new();

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    // The Parquet library panics if a file is damaged, and the reader catches this panic. The panic hook of the fuzzer would end the process before
    // the panic is caught, so it is replaced. A panic that is not caught still ends the process.
    HOOK.call_once(|| std::panic::set_hook(Box::new(|info| eprintln!("{info}"))));
    scree_fuzz::cache(bytes);
});
