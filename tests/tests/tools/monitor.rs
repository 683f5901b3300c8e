//! The page of `monitor --web` in a real browser: Debian's chromium, headless.
//!
//! A trial without it is reported as ignored, by name; with `GANTRY_TAU_REQUIRE_CHROMIUM=1` it fails instead.
#![allow(
    clippy::arithmetic_side_effects,
    clippy::indexing_slicing,
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests fail by panicking"
)]

#[path = "../../../host/tests/it/monitor/double.rs"]
#[allow(dead_code, reason = "the tests of the host need all of it")]
mod double;

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::path::Path;
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use double::{Double, HOME_NM, Scene};
use gantry_tau::monitor::run_page;
use gantry_tau::monitor::web::{Web, figures};
use gantry_tau::robot_file::RobotFile;
use gantry_tau::server::connections::Allowed;
use gantry_tau_core::control::message::{Cause, Phase};
use libtest_mimic::{Failed, Trial};

use crate::capi::tools::has;

/// Longest wait for a page with a picture; the browser is asked again and again.
const PATIENCE: Duration = Duration::from_secs(120);

/// All trials, by name.
pub(crate) fn trials() -> Vec<Trial> {
    let trial = |name: &str, run: fn() -> Result<(), Failed>| {
        let name = format!("monitor::{name}");
        if has("chromium") {
            return Trial::test(name, run);
        }
        let kind = "chromium missing";
        if std::env::var_os("GANTRY_TAU_REQUIRE_CHROMIUM").is_some_and(|value| value == "1") {
            return Trial::test(name, move || Err(Failed::from(kind))).with_kind(kind);
        }
        Trial::test(name, run).with_kind(kind).with_ignored_flag(true)
    };
    vec![
        trial("the_page_shows_what_the_server_sends", shows),
        trial("the_page_forgets_what_the_server_no_longer_sends", forgets),
        trial("the_page_is_painted", is_painted),
    ]
}

const SCENE: Scene = Scene { offset_nm: -189_000, ..Scene::of(Phase::Obtain, Cause::HandshakeTimeout) };

/// Serves the page of an L2 for as long as `look` lasts.
fn with_page(look: impl FnOnce(SocketAddr)) {
    let double = Double::of(SCENE);
    let robot = RobotFile::builtin_l2().unwrap();
    let any = "127.0.0.1:0".parse().unwrap();
    let mut page = Web::bind(any, Allowed::all(), figures(robot).unwrap()).unwrap();
    let address = page.address().unwrap();
    let quit = AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| run_page(double.address.into(), &mut page, None, None, &quit));
        let looked = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| look(address)));
        quit.store(true, Ordering::Relaxed);
        looked.unwrap_or_else(|panic| std::panic::resume_unwind(panic));
    });
}

/// Runs the browser on the page; returns what it prints.
fn browser(profile: &Path, page: &str, option: &str) -> String {
    let output = Command::new("chromium")
        .args([
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--hide-scrollbars",
            "--window-size=1440,900",
            "--timeout=5000",
        ])
        .arg(format!("--user-data-dir={}", profile.display()))
        .args([option, page])
        .output()
        .unwrap();
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// The document once it contains these words: it may be printed before.
fn document(page: &str, words: &str) -> String {
    let folder = tempfile::tempdir().unwrap();
    let began = Instant::now();
    loop {
        let document = browser(folder.path(), page, "--dump-dom");
        if document.contains(words) {
            return document;
        }
        assert!(began.elapsed() < PATIENCE, "{document}");
    }
}

/// Text of the element with an identifier, without elements inside it.
fn text_of<'a>(document: &'a str, id: &str) -> &'a str {
    let (_, rest) = document.split_once(&format!("id=\"{id}\"")).unwrap();
    rest.split_once('>').unwrap().1.split_once('<').unwrap().0
}

fn shows() -> Result<(), Failed> {
    with_page(|page| {
        let document = document(&format!("http://{page}/"), "class=\"live\"");
        // What `--status` prints for this scene is compared with the same numbers in `host/tests/it/monitor`.
        let texts = [
            ("phase", "obtain"),
            ("epoch", "7"),
            ("cause", "handshake timeout"),
            ("ramp", "1.9 s"),
            ("on_time", "99 %"),
            ("force_text", "300.3  −0.5  −18.0 N · 0.05  −0.10  0.02 N m"),
            ("displacement", "100.0  −50.0  20.0 µm"),
            ("turn", "turn 10.0  20.0  0.0 µrad"),
            ("gauges", "190.0  36.0  24.0 µm"),
        ];
        for (id, text) in texts {
            assert_eq!(text_of(&document, id), text, "{id}");
        }
        let axes = SCENE.axes(0, HOME_NM);
        let minus = |text: String| text.replace('-', "−");
        for axis in axes.axis {
            // Outside Submit no shadow is shown.
            let offset = minus(format!("<td>{:.3}</td><td>–</td>", f64::from(axis.position_offset_nm) * 1e-3));
            // Home is a multiple of 100 nm.
            let (sign, nm) = (if axis.nominal_nm < 0 { "-" } else { "" }, axis.nominal_nm.abs());
            let nominal = minus(format!("<td>{sign}{}.{:04}</td>", nm / 1_000_000, nm / 100 % 10_000));
            assert!(document.contains(&format!("{nominal}{offset}")), "{nominal}{offset}");
        }
        assert_eq!(document.matches("position limited").count(), 1);
        let state = SCENE.state(0);
        let counters = document.split_once("id=\"counters\"").unwrap().1;
        let names = [
            "received",
            "missed",
            "late",
            "duplicate",
            "stale",
            "malformed",
            "out of range",
            "limited",
            "clamped",
            "strangers",
        ];
        for (name, count) in names.into_iter().zip(state.counters) {
            let count = if name == "received" { "41 234".to_owned() } else { count.to_string() };
            assert!(counters.contains(&format!("<b>{count}</b><span>{name}</span>")), "{name} {count}");
        }
        assert!(counters.contains("<b>1</b><span>longest run</span>"), "{counters}");
        for event in ["session granted (epoch 7)", "connected to"] {
            assert!(document.contains(event), "{event}");
        }
    });
    Ok(())
}

/// Body of the answer to GET.
fn get(page: SocketAddr, resource: &str) -> String {
    let mut stream = TcpStream::connect(page).unwrap();
    write!(stream, "GET {resource} HTTP/1.1\r\nHost: {page}\r\n\r\n").unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    answer.split_once("\r\n\r\n").unwrap().1.to_owned()
}

/// The page from a file, its stream replaced by two pictures: a server of six axes, then one of three that measures no force.
fn forgets() -> Result<(), Failed> {
    with_page(|page| {
        let began = Instant::now();
        let status = loop {
            let status = get(page, "/status");
            if status.contains("\"axes\"") {
                break status;
            }
            assert!(began.elapsed() < PATIENCE, "{status}");
        };
        let take = "const picture_of = (status) => ({ live: true, server: '', figure: null, point: [0, status.phase, []], status });
            take(picture_of({ ...three, axes: [...three.axes, ...three.axes] }));
            document.body.dataset.rows = element('axes').tBodies[0].rows.length + ': ' + element('force_text').textContent;
            take(picture_of({ ...three, force: null }));
            document.body.dataset.taken = 'true';";
        let text = get(page, "/").replace("\nlisten();\n", &format!("\nconst three = {status};\n{take}\n"));
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("page.html");
        std::fs::write(&file, text).unwrap();
        let document = document(&format!("file://{}", file.display()), "data-taken=\"true\"");
        assert!(document.contains("data-rows=\"6: 300.3  −0.5"), "{document}");
        assert_eq!(document.matches("class=\"swatch\"").count(), 3);
        assert_eq!(text_of(&document, "force_text"), "not measured");
    });
    Ok(())
}

/// The picture is larger than an empty page compresses to: the machine is on it. How it looks is judged by people.
fn is_painted() -> Result<(), Failed> {
    with_page(|page| {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("page.png");
        let began = Instant::now();
        let painted = || std::fs::metadata(&file).map_or(0, |file| file.len());
        while painted() < 60_000 {
            assert!(began.elapsed() < PATIENCE, "{} bytes", painted());
            browser(folder.path(), &format!("http://{page}/"), &format!("--screenshot={}", file.display()));
        }
    });
    Ok(())
}
