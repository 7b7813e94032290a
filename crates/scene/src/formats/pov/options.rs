//! What the caller tells the reader of POV-Ray scenes.

use std::path::PathBuf;
use std::sync::Arc;

use super::Probe;
use super::stream::DEPTH_LIMIT;

/// Where a message of a scene goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stream {
    /// `#debug`.
    Debug,
    /// `#warning`; these are in the report as well.
    Warning,
    /// `#render`.
    Render,
    /// `#statistics`.
    Statistics,
}

/// Takes the messages of a scene.
pub type MessageSink = Arc<dyn Fn(Stream, &str) + Send + Sync>;

/// What a scene may ask about the picture, and what it may do.
#[derive(Clone)]
pub struct PovOptions {
    /// Identifiers that are declared before the scene begins (`Declare=name=value`): a number, or else a string.
    pub declares: Vec<(String, String)>,
    /// `clock`.
    pub clock: f64,
    /// `clock_on`: whether this is a frame of an animation.
    pub is_animation: bool,
    /// `frame_number`.
    pub frame: i32,
    /// `initial_frame`, `final_frame`.
    pub frames: [i32; 2],
    /// `initial_clock`, `final_clock`.
    pub clocks: [f64; 2],
    /// `image_width`, `image_height`, in pixels.
    pub size: [u32; 2],
    /// The version of the language before the first `#version`: 3.7 is 370. `None`: 3.62, as POV-Ray 3.7 has it.
    pub version: Option<u32>,
    /// Answers `trace`, `inside` and `min_extent`.
    pub probe: Option<Arc<dyn Probe>>,
    /// The only folder in which `#fopen … write` makes files; `None` keeps them in memory.
    pub output_folder: Option<PathBuf>,
    /// Takes what `#debug` and its like say; `None` throws it away.
    pub messages: Option<MessageSink>,
    /// Most tokens that are read, repeated ones counted each time: 500 million take some twenty seconds.
    pub work_limit: u64,
    /// Longest time for reading.
    pub time_limit: std::time::Duration,
    /// Most blocks `{ … }` that are read: each may become an object.
    pub block_limit: u64,
    /// Most directives, macros and expressions inside of one another.
    pub depth_limit: u32,
}

impl Default for PovOptions {
    fn default() -> Self {
        Self {
            declares: Vec::new(),
            clock: 0.0,
            is_animation: false,
            frame: 0,
            frames: [0, 0],
            clocks: [0.0, 0.0],
            size: [320, 240],
            version: None,
            probe: None,
            output_folder: None,
            messages: None,
            work_limit: 500_000_000,
            time_limit: std::time::Duration::from_secs(300),
            block_limit: 20_000_000,
            depth_limit: DEPTH_LIMIT,
        }
    }
}

impl PovOptions {
    /// Time between two frames.
    pub fn clock_delta(&self) -> f64 {
        let frames = f64::from(self.frames[1]) - f64::from(self.frames[0]);
        if frames > 0.0 { (self.clocks[1] - self.clocks[0]) / frames } else { 0.0 }
    }

    pub(super) fn tell(&self, stream: Stream, text: &str) {
        if let Some(sink) = &self.messages {
            sink(stream, text);
        }
    }
}

impl std::fmt::Debug for PovOptions {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.debug_struct("PovOptions")
            .field("declares", &self.declares)
            .field("clock", &self.clock)
            .field("frame", &self.frame)
            .field("size", &self.size)
            .field("probe", &self.probe.is_some())
            .field("output_folder", &self.output_folder)
            .finish_non_exhaustive()
    }
}
