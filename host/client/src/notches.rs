//! Notches of the force sensor's filter, which follow the machine.
//!
//! The natural frequencies of a machine change with its place. The notches for another place are
//! found in the cycle that needs them, or in a thread of their own: a cycle in real time has no time for
//! it.

use std::io;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread;

use gantry_tau_core::model::kinematics::Pose;
use gantry_tau_machine::stability::{NotchFinder, Notches};

/// Translation after which the notches are found again, m.
const MOVED_M: f64 = 0.01;
/// Largest change of an entry of the rotation matrix after which they are found again.
const TURNED_RAD: f64 = 0.01;

/// A place of a machine: pose of the platform, and axes, q-units.
type Place<const N: usize> = (Pose, [f64; N]);

/// Notches that follow a machine.
#[derive(Debug)]
pub(crate) struct FollowingNotches<const N: usize> {
    finder: NotchFinder<N>,
    /// Place of the notches in use, or, with a thread, of those that it was asked for last.
    last: Pose,
    /// The thread that finds them; absent where they are found in the cycle that asks.
    thread: Option<Thread<N>>,
}

/// Both ends of the thread, which ends with them.
#[derive(Debug)]
struct Thread<const N: usize> {
    places: SyncSender<Place<N>>,
    found: Receiver<Notches>,
}

/// A copy has no thread; notches that the first one's thread still looks for do not come to it.
impl<const N: usize> Clone for FollowingNotches<N> {
    fn clone(&self) -> Self {
        Self {
            finder: self.finder,
            last: self.last,
            thread: None,
        }
    }
}

impl<const N: usize> FollowingNotches<N> {
    /// Creates notches that are found in the cycle that asks for them. Those in use are those of `home`.
    pub(crate) const fn new(finder: NotchFinder<N>, home: Pose) -> Self {
        Self {
            finder,
            last: home,
            thread: None,
        }
    }

    /// Starts the thread.
    ///
    /// # Errors
    /// The system has no thread.
    pub(crate) fn in_background(self) -> io::Result<Self> {
        let thread = Some(Thread::start(self.finder)?);
        Ok(Self { thread, ..self })
    }

    /// Tells the place of the machine. Returns notches that were found since.
    pub(crate) fn follow(&mut self, pose: &Pose, axes: &[f64; N]) -> Option<Notches> {
        let has_moved = has_moved(&self.last, pose);
        let Some(Thread { places, found }) = &self.thread else {
            if !has_moved {
                return None;
            }
            self.last = *pose;
            return self.finder.at(pose, axes);
        };
        // If the thread is busy, it is asked again in the next cycle.
        if has_moved && places.try_send((*pose, *axes)).is_ok() {
            self.last = *pose;
        }
        found.try_recv().ok()
    }
}

impl<const N: usize> Thread<N> {
    fn start(finder: NotchFinder<N>) -> io::Result<Self> {
        let (places, asked) = sync_channel::<Place<N>>(1);
        let (answers, found) = sync_channel(1);
        let find = move || {
            for (pose, axes) in asked {
                // Where the machine has no natural frequencies the notches stay as they are.
                let Some(notches) = finder.at(&pose, &axes) else {
                    continue;
                };
                if answers.send(notches).is_err() {
                    return;
                }
            }
        };
        thread::Builder::new()
            .name("notches".to_owned())
            .spawn(find)?;
        Ok(Self { places, found })
    }
}

fn has_moved(last: &Pose, now: &Pose) -> bool {
    let moved_m = (now.position_m - last.position_m).norm();
    let turned = (now.rotation - last.rotation).amax();
    moved_m >= MOVED_M || turned >= TURNED_RAD
}
