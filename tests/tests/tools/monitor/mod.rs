//! The page of `monitor --web` in a real browser: Debian's chromium, headless.
//!
//! A trial without it is reported as ignored, by name; with `GANTRY_TAU_REQUIRE_CHROMIUM=1` it
//! fails instead.
#![allow(
    clippy::arithmetic_side_effects,
    clippy::indexing_slicing,
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests fail by panicking"
)]

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::path::Path;
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use gantry_tau::monitor::run_page;
use gantry_tau::monitor::web::Web;
use gantry_tau_core::control::message::{Cause, Phase};
use gantry_tau_server::links::Allowed;
use gantry_tau_test_support::labcomm_port::{Double, HOME_NM, Named, Scene};
use libtest_mimic::{Failed, Trial};

use crate::capi::tools::has;
use crate::needing;

/// Longest wait for a page with a picture; the browser is asked again and again.
const PATIENCE: Duration = Duration::from_secs(120);

/// All trials, by name.
pub(crate) fn trials() -> Vec<Trial> {
    vec![
        trial("the_page_shows_what_the_server_sends", shows),
        trial("the_page_forgets_what_the_server_no_longer_sends", forgets),
        trial("the_page_is_painted", is_painted),
        trial(
            "the_page_is_readable_at_every_width_in_light_and_in_dark",
            is_readable,
        ),
        trial(
            "a_machine_that_is_unknown_is_named_and_not_drawn",
            says_unknown,
        ),
    ]
}

/// A trial, if there is a browser.
fn trial(name: &str, run: fn() -> Result<(), Failed>) -> Trial {
    let missing = (!has("chromium")).then(|| "chromium missing".to_owned());
    needing::trial(
        format!("monitor::{name}"),
        missing,
        "GANTRY_TAU_REQUIRE_CHROMIUM",
        run,
    )
}

const SCENE: Scene = Scene {
    offset_nm: -189_000,
    ..Scene::of(Phase::Obtain, Cause::HandshakeTimeout)
};

/// Serves the page of a scene for as long as `look` lasts.
fn with_page(scene: Scene, look: impl FnOnce(SocketAddr)) {
    let double = Double::of(scene);
    let any = "127.0.0.1:0".parse().unwrap();
    let mut page = Web::bind(any, Allowed::all(), None).unwrap();
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
fn browser(profile: &Path, page: &str, options: &[&str]) -> String {
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
        .args(options)
        .arg(page)
        .output()
        .unwrap();
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// The document once it contains these words: it may be printed before.
fn document(page: &str, words: &str) -> String {
    document_with(page, words, &[])
}

fn document_with(page: &str, words: &str, options: &[&str]) -> String {
    let folder = tempfile::tempdir().unwrap();
    let began = Instant::now();
    loop {
        let document = browser(folder.path(), page, &[&["--dump-dom"], options].concat());
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

fn with_minus(text: &str) -> String {
    text.replace('-', "−")
}

fn shows() -> Result<(), Failed> {
    with_page(SCENE, |page| {
        let document = document(&format!("http://{page}/"), "class=\"live\"");
        // What `--status` prints for this scene is compared with the same numbers in
        // `host/cli/tests/it/monitor`.
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
        for axis in axes.axis {
            // Outside Submit no shadow is shown.
            let offset = format!("{:.3}", f64::from(axis.position_offset_nm) * 1e-3);
            let offset = format!(
                "<td data-label=\"offset µm\">{}</td><td data-label=\"shadow µm\">–</td>",
                with_minus(&offset)
            );
            // Home is a multiple of 100 nm.
            let sign = if axis.nominal_nm < 0 { "−" } else { "" };
            let nm = axis.nominal_nm.abs();
            let nominal = format!(
                "<td data-label=\"nominal mm\">{sign}{}.{:04}</td>",
                nm / 1_000_000,
                nm / 100 % 10_000
            );
            assert!(
                document.contains(&format!("{nominal}{offset}")),
                "{nominal}{offset}"
            );
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
            let count = if name == "received" {
                "41 234".to_owned()
            } else {
                count.to_string()
            };
            assert!(
                counters.contains(&format!("<b>{count}</b><span>{name}</span>")),
                "{name} {count}"
            );
        }
        assert!(
            counters.contains("<b>1</b><span>longest run</span>"),
            "{counters}"
        );
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

/// The status of the page, once there is one.
fn status(page: SocketAddr) -> String {
    let began = Instant::now();
    loop {
        let status = get(page, "/status");
        if status.contains("\"axes\"") {
            return status;
        }
        assert!(began.elapsed() < PATIENCE, "{status}");
    }
}

/// The page as a document that runs a script instead of listening to the monitor.
fn page_with(page: SocketAddr, script: &str) -> String {
    let document = get(page, "/");
    let replaced = document.replace("\nlisten();\n", &format!("\n{script}\n"));
    assert_ne!(replaced, document);
    replaced
}

/// The page from a file, its stream replaced by two pictures: a server of six axes, then one of
/// three that measures no force.
fn forgets() -> Result<(), Failed> {
    with_page(SCENE, |page| {
        let show = "const picture_of = (status) => ({ live: true, server: '', figure: null, point: [0, status.phase, []], status });
            showPicture(picture_of({ ...three, axes: [...three.axes, ...three.axes] }));
            document.body.dataset.rows = element('axes').tBodies[0].rows.length + ': ' + element('force_text').textContent;
            showPicture(picture_of({ ...three, force: null }));
            document.body.dataset.taken = 'true';";
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("page.html");
        let status = status(page);
        let script = format!("const three = {status};\n{show}");
        std::fs::write(&file, page_with(page, &script)).unwrap();
        let document = document(&format!("file://{}", file.display()), "data-taken=\"true\"");
        assert!(
            document.contains("data-rows=\"6: 300.3  −0.5"),
            "{document}"
        );
        assert_eq!(document.matches("class=\"swatch\"").count(), 3);
        assert_eq!(text_of(&document, "force_text"), "not measured");
    });
    Ok(())
}

/// Size of a file, bytes; 0 if it is not there.
fn size_of(file: &Path) -> u64 {
    std::fs::metadata(file).map_or(0, |file| file.len())
}

/// The picture is larger than an empty page compresses to: the machine is on it. How it looks is
/// judged by people.
fn is_painted() -> Result<(), Failed> {
    with_page(SCENE, |page| {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("page.png");
        let began = Instant::now();
        while size_of(&file) < 60_000 {
            assert!(began.elapsed() < PATIENCE, "{} bytes", size_of(&file));
            browser(
                folder.path(),
                &format!("http://{page}/"),
                &[&format!("--screenshot={}", file.display())],
            );
        }
    });
    Ok(())
}

/// Data of the last event of a kind that the page is sent.
fn live(page: SocketAddr, kind: &str) -> String {
    let mut stream = TcpStream::connect(page).unwrap();
    write!(stream, "GET /live HTTP/1.1\r\nHost: {page}\r\n\r\n").unwrap();
    let mut lines = BufReader::new(stream).lines();
    let head = format!("event: {kind}");
    lines
        .find(|line| *line.as_ref().unwrap() == head)
        .unwrap()
        .unwrap();
    let data = lines.next().unwrap().unwrap();
    data.strip_prefix("data: ").unwrap().to_owned()
}

/// Checks of the page, and the picture that they are made with.
const CHECKS: &str = include_str!("checks.js");
/// Widths of a telephone, a small and a large screen, and their heights.
const SIZES: [(u32, u32); 3] = [(390, 844), (1280, 800), (1920, 1080)];

/// The page with the longest numbers that it can have, in a frame of each size: nothing is cut,
/// every text is readable, and the badges stay in sight.
fn is_readable() -> Result<(), Failed> {
    with_page(SCENE, |page| {
        let status = status(page);
        let machine = live(page, "machine");
        for (width, height) in SIZES {
            for dark in [false, true] {
                let script = format!("{CHECKS}\nreport({machine}, {status}, {width}, {dark});");
                let document = page_with(page, &script);
                let failures = failures(&document, width, height, dark);
                assert_eq!(failures, "[]", "{width} px, dark: {dark}");
            }
        }
    });
    Ok(())
}

/// What a document that reports to the page around it says, in a frame of a size.
fn failures(document: &str, width: u32, height: u32, dark: bool) -> String {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("page.html"), document).unwrap();
    let frame = format!(
        "<body><script>onmessage = (event) => {{ document.body.dataset.failures = event.data; }};</script>
        <iframe src=\"page.html\" style=\"border: 0; width: {width}px; height: {height}px\"></iframe>"
    );
    let framed = folder.path().join("frame.html");
    std::fs::write(&framed, frame).unwrap();
    let scheme = format!("--blink-settings=preferredColorScheme={}", u8::from(!dark));
    let document = document_with(
        &format!("file://{}", framed.display()),
        "data-failures=",
        &[
            &scheme,
            "--allow-file-access-from-files",
            "--virtual-time-budget=5000",
        ],
    );
    let (_, said) = document.split_once("data-failures=\"").unwrap();
    said.split_once('"').unwrap().0.to_owned()
}

fn says_unknown() -> Result<(), Failed> {
    let scene = Scene {
        machine: Named::Other,
        ..SCENE
    };
    with_page(scene, |page| {
        let document = document(&format!("http://{page}/"), "class=\"live\"");
        assert_eq!(text_of(&document, "name"), "small.toml, 3 axes");
        assert_eq!(text_of(&document, "not_drawn"), "machine not drawn");
        assert_eq!(
            text_of(&document, "stranger"),
            "Unknown machine small.toml (kinematics 0badcafe): name its robot file with --robot."
        );
        for id in ["not_drawn", "stranger"] {
            let tag = document.split_once(&format!("id=\"{id}\"")).unwrap().1;
            let tag = tag.split_once('>').unwrap().0;
            assert!(!tag.contains("hidden"), "{id}: {tag}");
        }
    });
    Ok(())
}
