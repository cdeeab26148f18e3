//! The window under a virtual display.

use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use super::baked;

/// Ends a process that the test started.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A virtual display; none, with the reason, where there cannot be one.
fn display() -> Result<(Running, String), String> {
    for tool in ["Xvfb", "import"] {
        if Command::new(tool).arg("-version").stdout(Stdio::null()).stderr(Stdio::null()).status().is_err() {
            return Err(format!("{tool} is not installed"));
        }
    }
    let mut server = Command::new("Xvfb")
        .args(["-displayfd", "1", "-screen", "0", "800x600x24", "-nolisten", "tcp"])
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .map_err(|e| format!("Xvfb: {e}"))?;
    let mut line = String::new();
    let stdout = server.stdout.take().unwrap();
    let server = Running(server);
    std::io::BufRead::read_line(&mut std::io::BufReader::new(stdout), &mut line).map_err(|e| format!("Xvfb: {e}"))?;
    match line.trim() {
        "" => Err("Xvfb does not start".to_owned()),
        number => Ok((server, format!(":{number}"))),
    }
}

#[test]
fn the_window_draws_while_the_light_turns() {
    let (_server, display) = match display() {
        Ok(display) => display,
        Err(reason) => return println!("SKIPPED: {reason}"),
    };
    let folder = baked();
    let runtime = folder.path("runtime");
    std::fs::create_dir(&runtime).unwrap();
    #[cfg(unix)]
    std::fs::set_permissions(&runtime, std::os::unix::fs::PermissionsExt::from_mode(0o700)).unwrap();
    let line = "relight ball.tlux --light directional:from=1,0.5,1:irradiance=3 --light constant:radiance=0.2 \
                --texture marble --highlights blinn-phong:40 --turn --quit-after 4 --resolution 800x600 --json";
    let mut window = Command::new(env!("CARGO_BIN_EXE_translux"))
        .current_dir(folder.path(""))
        .args(line.split_whitespace())
        .env("DISPLAY", &display)
        .env("XDG_RUNTIME_DIR", &runtime)
        .env_remove("WAYLAND_DISPLAY")
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let started = Instant::now();
    let mut seen = 0;
    // The window takes its time to appear.
    while window.try_wait().unwrap().is_none() && started.elapsed() < Duration::from_secs(60) {
        std::thread::sleep(Duration::from_millis(700));
        let shot = Command::new("import").args(["-display", &display, "-window", "root", "png:-"]).output().unwrap();
        if let Ok(picture) = translux::io::png::decode_png(&shot.stdout) {
            let mut colours: Vec<[u32; 3]> = picture.rgb.iter().map(|c| c.map(f32::to_bits)).collect();
            colours.sort_unstable();
            colours.dedup();
            seen = seen.max(colours.len());
        }
    }
    let mut window = Running(window);
    let ended = window.0.try_wait().unwrap().expect("the window did not close");
    let (mut stdout, mut stderr) = (String::new(), String::new());
    std::io::Read::read_to_string(window.0.stdout.as_mut().unwrap(), &mut stdout).unwrap();
    std::io::Read::read_to_string(window.0.stderr.as_mut().unwrap(), &mut stderr).unwrap();
    if ended.code() == Some(5) && stderr.contains("adapter") {
        return println!("SKIPPED: {}", stderr.trim());
    }
    assert_eq!(ended.code(), Some(0), "{stderr}");
    let report: serde_json::Value = serde_json::from_str(&stdout).unwrap();
    let window = &report["window"];
    let rate = |key: &str| window[key].as_f64().unwrap();
    println!("{} fps, {} light updates/s", rate("frames_per_second"), rate("light_updates_per_second"));
    assert!(rate("frames_per_second") > 1.0 && rate("light_updates_per_second") > 1.0, "{window}");
    // A ball in shades of grey, a panel with text: a blank screen has a handful of colours.
    assert!(seen > 100, "{seen} colours on the screen");
}
