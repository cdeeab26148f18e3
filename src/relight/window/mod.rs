//! The window: turn lights and environments, edit materials, view errors, save pictures, drop files.

mod answering;
mod app;
mod colours;
mod desk;
mod editing;
mod jobs;
mod panel;
mod placing;
mod screen;
mod session;
mod worker;

use winit::event_loop::EventLoop;

use self::app::App;
use crate::error::{Error, Result};
use crate::relight::timings::WindowReport;

pub use self::session::{OpenModel, Session, Settings};

/// The cause in a message of winit, without the position in its source, "os error at FILE:LINE: ".
fn cause(message: &str) -> &str {
    match message.strip_prefix("os error at ").and_then(|rest| rest.split_once(": ")) {
        Some((_, cause)) => cause.trim_end_matches('.'),
        None => message,
    }
}

/// Shows a window until it is closed. Must run on the main thread.
///
/// # Errors
/// No display, no adapter (exit 5), a lost device (exit 4).
pub fn run(session: Session) -> Result<WindowReport> {
    let advice = "use --headless --frames N --out DIR, or `translux render`";
    let event_loop = EventLoop::<()>::with_user_event()
        .build()
        .map_err(|e| Error::unsupported(format!("no window can be opened ({}); {advice}", cause(&e.to_string()))))?;
    let mut app = App::new(session, event_loop.create_proxy());
    event_loop.run_app(&mut app).map_err(|e| Error::unsupported(format!("the window failed ({e}); {advice}")))?;
    app.report()
}

#[cfg(test)]
mod tests {
    #[test]
    fn causes_are_told_without_places_in_a_source() {
        assert_eq!(super::cause("os error at a/b.rs:765: no DISPLAY is set."), "no DISPLAY is set");
        assert_eq!(super::cause("not supported"), "not supported");
    }
}
