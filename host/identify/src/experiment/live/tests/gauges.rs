//! Gauges that break their format, or fall silent.

use std::io::Write;
use std::net::TcpListener;

use super::*;

/// Runs a campaign whose gauges say what `talk` makes of the number of a record and of the rows
/// that are taken, and hang up where that is nothing. Ends a pause once the machine has pulled all
/// its levels, or has been called five times. Returns the error and the rows.
fn with_gauges(
    name: &str,
    talk: impl Fn(u64, usize) -> Vec<u8> + Send + 'static,
) -> (Result<LiveReport, String>, usize) {
    let folder = Folder::new(name);
    let text = first_series(&campaign_a("", &[0, 60, 0]), 1);
    let robot = robot();
    let plan = plan_in(&folder, &text);
    let bench = TestBench::start(&robot, &plan);
    let listener = TcpListener::bind(loopback()).unwrap();
    let mut options = bench.options(&robot, &plan, &folder.path("springs.csv"));
    options.gauges = Some(listener.local_addr().unwrap().into());
    let quit = Arc::new(AtomicBool::new(false));
    let stop = Arc::clone(&quit);
    let ticks = Arc::clone(&bench.ticks);
    let output = options.output.clone();
    let liar = std::thread::spawn(move || {
        for (call, stream) in listener.incoming().enumerate() {
            let Ok(mut stream) = stream else { return };
            for record in 0.. {
                let bytes = talk(record, rows_of(&output));
                let is_over = ticks.load(Ordering::Relaxed) > 45_000 || call >= 5;
                stop.fetch_or(is_over, Ordering::Relaxed);
                if stop.load(Ordering::Relaxed) {
                    return;
                }
                if bytes.is_empty() || stream.write_all(&bytes).is_err() {
                    break;
                }
                // So that records do not pile up before the client, which reads them once in a
                // tick.
                std::thread::sleep(REST);
            }
        }
    });
    let (_silent, keys) = no_keys();
    let ended = run(options.clone(), &quit, &keys);
    quit.store(true, Ordering::Relaxed);
    // A last call, so that the liar sees the end.
    drop(GaugeReader::connect(
        options.gauges.clone().unwrap(),
        &gantry_tau_system::dial::NEVER,
    ));
    liar.join().unwrap();
    bench.server.quit().unwrap();
    (
        ended.map_err(|error| error.to_string()),
        rows_of(&options.output),
    )
}

/// Number of rows of a table that may not be there yet.
fn rows_of(path: &Path) -> usize {
    let text = std::fs::read_to_string(path).unwrap_or_default();
    text.lines().count().saturating_sub(1)
}

fn record(tick: u64, lengths: &[f64]) -> Vec<u8> {
    let head = [tick.to_le_bytes(), (lengths.len() as u64).to_le_bytes()];
    head.into_iter()
        .chain(lengths.iter().map(|length| length.to_le_bytes()))
        .flatten()
        .collect()
}

const PAUSED: (Result<LiveReport, String>, usize) = (
    Ok(LiveReport {
        taken: 0,
        missing: 3,
    }),
    0,
);

#[test]
fn gauges_that_break_the_format_are_an_error() {
    let seventeen = with_gauges("seventeen", |tick, _| record(tick, &[0.0; 17]));
    assert_eq!(
        seventeen,
        (
            Err("gauges: a record has 17 gauges; at most 16 are possible".to_owned()),
            0
        )
    );
    let eight = with_gauges("eight", |tick, _| record(tick, &[0.0; 8]));
    assert_eq!(
        eight,
        (
            Err("gauges: a record has 8 lengths; the plan has 9 gauges".to_owned()),
            0
        )
    );
}

#[test]
fn gauges_that_show_nothing_are_a_pause() {
    let nan = with_gauges("nan", |tick, _| {
        record(tick, &[0.0, 0.0, f64::NAN, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    });
    assert_eq!(nan, PAUSED);
    let stalled = with_gauges("stalled", |tick, _| record(tick.min(20), &[0.0; 9]));
    assert_eq!(stalled, PAUSED);
    // Half a record, and the end: the session is taken up again and again.
    let truncated = with_gauges("truncated", |tick, _| {
        if tick == 0 { vec![1; 12] } else { Vec::new() }
    });
    assert_eq!(truncated, PAUSED);
}

/// Gauges that fall silent in the middle of a series: what was taken stays, nothing is added, and
/// with no operator to ask the series is over.
#[test]
fn gauges_that_fall_silent_end_the_series() {
    let silent = with_gauges("silent", |tick, rows| match rows {
        0 if tick < 300 => record(tick, &[f64::NAN; 9]),
        0 => record(tick, &[0.0; 9]),
        _ => record(u64::MAX, &[0.0; 9]),
    });
    assert_eq!(
        silent,
        (
            Ok(LiveReport {
                taken: 1,
                missing: 2
            }),
            1
        )
    );
}
