//! Long work beside Python: on a thread of its own, without Python's lock, while the calling thread handles signals.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::Duration;

use etendue_render::session::Cancel;
use pyo3::prelude::*;

use crate::errors;

/// How often signals are looked at and progress is told.
const TICK: Duration = Duration::from_millis(50);

/// Runs `work` and returns its result. Every 50 ms the calling thread handles signals and calls `tick`.
///
/// # Errors
/// What a signal handler (KeyboardInterrupt) or `tick` raises. Then the work is told to stop by `cancel` and waited for; without
/// one it is left to end by itself, and its result is dropped.
pub fn run<T: Send + 'static>(
    py: Python<'_>,
    cancel: Option<&Cancel>,
    work: impl FnOnce() -> T + Send + 'static,
    mut tick: impl FnMut(Python<'_>) -> PyResult<()>,
) -> PyResult<T> {
    let (sender, mut receiver) = mpsc::sync_channel(1);
    let thread = std::thread::Builder::new().name("etendue".to_owned());
    // The receiver is gone after an interrupt; then nobody wants the result.
    let spawned = thread.spawn(move || drop(sender.send(catch_unwind(AssertUnwindSafe(work)))));
    spawned?;
    loop {
        let from = &mut receiver;
        match py.detach(move || from.recv_timeout(TICK)) {
            Ok(Ok(result)) => return Ok(result),
            Ok(Err(_)) | Err(RecvTimeoutError::Disconnected) => {
                return Err(errors::error(py, "Error", "internal error: the renderer panicked; please report it".to_owned()));
            }
            Err(RecvTimeoutError::Timeout) => {}
        }
        if let Err(e) = py.check_signals().and_then(|()| tick(py)) {
            if let Some(cancel) = cancel {
                cancel.cancel();
                let from = &mut receiver;
                // Whatever it has done is dropped with it.
                let _ = py.detach(move || from.recv().is_ok());
            }
            return Err(e);
        }
    }
}

/// A pool of so many threads; 0 takes one for each core.
pub fn pool(py: Python<'_>, threads: usize) -> PyResult<Arc<rayon::ThreadPool>> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).stack_size(32 << 20).build();
    pool.map(Arc::new).map_err(|e| errors::error(py, "SettingError", format!("{threads} threads could not be started: {e}")))
}

/// What [`run`] calls at each tick: asks whether to stop.
pub fn stopper(should_stop: Option<&Bound<'_, PyAny>>, cancel: &Cancel) -> impl FnMut(Python<'_>) -> PyResult<()> {
    let should_stop = should_stop.map(|f| f.clone().unbind());
    let cancel = cancel.clone();
    move |py| {
        if let Some(should_stop) = &should_stop
            && should_stop.bind(py).call0()?.is_truthy()?
        {
            cancel.cancel();
        }
        Ok(())
    }
}
