#![no_main]

use std::sync::Once;

static HOOK: Once = Once::new();

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    // The Parquet library panics over damaged files, and our reader catches that. The fuzzer's hook would end the process before; what is not
    // caught ends it all the same.
    HOOK.call_once(|| std::panic::set_hook(Box::new(|info| eprintln!("{info}"))));
    scree_fuzz::cache(bytes);
});
