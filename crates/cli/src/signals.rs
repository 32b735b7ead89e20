//! A signal that asks the program to end: what was begun outside a workspace is removed, a word
//! says what happened, and the exit code is the conventional one, 128 and the number of the signal.

/// Watches for signals in a thread of its own, until the program ends. Where that is not possible,
/// the system ends the program without a word, and what is left is removed at the next start.
#[cfg(unix)]
pub fn watch() {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
    let asked = [SIGINT, SIGTERM, SIGHUP].into_iter().filter(|s| !is_ignored(*s));
    // none: without a handler the system ends the process
    let Ok(mut signals) = signal_hook::iterator::Signals::new(asked) else { return };
    let ended = move || {
        if let Some(signal) = signals.forever().next() {
            end(signal, signal_hook::low_level::signal_name(signal).unwrap_or("a signal"));
        }
    };
    // without a thread for it, signals have to keep their usual meaning
    if let Err(e) = std::thread::Builder::new().name("signals".to_owned()).spawn(ended) {
        crate::render::note(format!("signals cannot be watched ({e}): Ctrl-C may not end this command"));
    }
}

/// True for a signal that whoever started the program told it to ignore, as `nohup` does.
#[cfg(unix)]
fn is_ignored(signal: i32) -> bool {
    // none: a system without this file ignores no signal here
    let status = std::fs::read_to_string("/proc/self/status").ok().unwrap_or_default();
    let mask = status.lines().find_map(|l| u64::from_str_radix(l.strip_prefix("SigIgn:")?.trim(), 16).ok());
    mask.is_some_and(|mask| mask >> (signal - 1) & 1 == 1)
}

/// Elsewhere the system ends the program.
#[cfg(not(unix))]
pub fn watch() {}

#[cfg(unix)]
fn end(signal: i32, name: &str) -> ! {
    let left = aloft_workspace::unfinished::remove_all();
    crate::render::note(format!("stopped by {name}: what was finished is kept; run the same command again to go on"));
    for path in left {
        crate::render::note(format!("left behind: {} (the next run removes it)", path.display()));
    }
    std::process::exit(128 + signal)
}
