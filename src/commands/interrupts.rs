//! Signals that end the program, and those that must not: unfinished files are removed before it ends.

use crate::error::Result;

/// From now on an interrupt (Ctrl-C), SIGTERM and SIGHUP remove unfinished files and end the process with 128 plus their number; a limit
/// on the size of files makes writing fail, where it would end the process.
///
/// Called before there are threads, which inherit what is blocked here.
///
/// # Errors
/// Run time: the system refuses.
#[cfg(unix)]
pub(super) fn watch() -> Result<()> {
    use std::sync::Once;

    use nix::sys::signal::{SigHandler, SigSet, Signal, signal};

    use crate::error::Error;

    static WATCHED: Once = Once::new();
    let refused = |e: nix::Error| Error::runtime(format!("interrupts cannot be watched: {e}"));
    let put = |which: Signal, handler: SigHandler| {
        // SAFETY: neither of the two that are put here is code of ours, which a signal could call at a bad moment.
        unsafe { signal(which, handler) }.map_err(refused)
    };
    put(Signal::SIGXFSZ, SigHandler::SigIgn)?;
    let mut ending = SigSet::empty();
    for which in [Signal::SIGINT, Signal::SIGTERM, Signal::SIGHUP] {
        // What whoever started us has ignored, as nohup does, stays ignored.
        match put(which, SigHandler::SigDfl)? {
            SigHandler::SigIgn => drop(put(which, SigHandler::SigIgn)?),
            _ => ending.add(which),
        }
    }
    ending.thread_block().map_err(refused)?;
    WATCHED.call_once(|| {
        std::thread::spawn(move || {
            if let Ok(signal) = ending.wait() {
                end(128 + signal as i32);
            }
        });
    });
    Ok(())
}

/// From now on an interrupt removes unfinished files and ends the process with 130.
///
/// # Errors
/// Run time: the system refuses.
#[cfg(not(unix))]
pub(super) fn watch() -> Result<()> {
    use crate::error::Error;

    match ctrlc::set_handler(|| end(130)) {
        Ok(()) | Err(ctrlc::Error::MultipleHandlers) => Ok(()),
        Err(e) => Err(Error::runtime(format!("interrupts cannot be watched: {e}"))),
    }
}

#[expect(clippy::exit, reason = "an interrupt ends the process from a thread of its own")]
fn end(code: i32) {
    use std::io::Write;

    crate::io::atomic::remove_unfinished();
    let _ = writeln!(std::io::stderr(), "\ntranslux: interrupted; no file was left unfinished");
    std::process::exit(code);
}
