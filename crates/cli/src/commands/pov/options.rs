//! POV-Ray's switches and `.ini` settings (3.2 Command-Line and INI-File Options).

use std::path::{Path, PathBuf};

/// Most `.ini` files that name each other.
const INI_DEPTH: usize = 10;

/// What the command line and the `.ini` files say.
#[derive(Debug)]
pub struct Options {
    /// Scene file.
    pub input: Option<String>,
    /// Output file or folder.
    pub output: Option<String>,
    /// Ending of the output file by its type.
    pub extension: Option<&'static str>,
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Folders of include files.
    pub library: Vec<PathBuf>,
    /// Identifiers to declare.
    pub declares: Vec<(String, String)>,
    /// Version of the language, 370 for 3.7.
    pub version: Option<u32>,
    /// Clock without animation.
    pub clock: f64,
    /// First frame.
    pub initial_frame: i32,
    /// Whether the first frame is stated.
    pub initial_frame_is_given: bool,
    /// Last frame, where there is an animation.
    pub final_frame: Option<i32>,
    /// Clock of the first and of the last frame.
    pub clocks: [f64; 2],
    /// First and last frame to render; below 1 a share.
    pub subset: [Option<f64>; 2],
    /// Distance of frames to render.
    pub step: i32,
    /// Whether the frame after the last would be the first.
    pub is_cyclic: bool,
    /// Whether pixels are smoothed.
    pub antialias: bool,
    /// Difference of neighbors from which they are smoothed.
    pub antialias_threshold: f32,
    /// Samples in each direction of a smoothed pixel, or its levels of subdivision.
    pub antialias_depth: u32,
    /// Whether smoothed pixels are divided again and again.
    pub is_recursive: bool,
    /// Threads; 0 for all.
    pub threads: usize,
    /// First column, first row, last column, last row, from 1; below 1 a share.
    pub part: [Option<f64>; 4],
    /// Whether to say nothing but errors.
    pub is_quiet: bool,
    /// What was not understood.
    pub warnings: Vec<String>,
    ini_depth: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            input: None,
            output: None,
            extension: None,
            width: 320,
            height: 240,
            library: Vec::new(),
            declares: Vec::new(),
            version: None,
            clock: 0.0,
            initial_frame: 1,
            initial_frame_is_given: false,
            final_frame: None,
            clocks: [0.0, 1.0],
            subset: [None; 2],
            step: 1,
            is_cyclic: false,
            antialias: false,
            antialias_threshold: 0.3,
            antialias_depth: 3,
            is_recursive: false,
            threads: 0,
            part: [None; 4],
            is_quiet: false,
            warnings: Vec::new(),
            ini_depth: 0,
        }
    }
}

/// What `+A` asks for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Smoothing {
    /// One sample of each pixel.
    None,
    /// As many of each.
    All {
        /// Samples per pixel.
        spp: u32,
    },
    /// More where neighbors differ.
    Adaptive {
        /// By how much.
        threshold: f32,
        /// Samples in each direction.
        depth: u32,
    },
}

/// Switches and the settings that they stand for; a longer one comes before a shorter one that it begins with.
const SWITCHES: &[(&str, &str)] = &[
    ("KFI", "initial_frame"),
    ("KFF", "final_frame"),
    ("KI", "initial_clock"),
    ("KF", "final_clock"),
    ("KC", "cyclic_animation"),
    ("K", "clock"),
    ("SF", "subset_start_frame"),
    ("EF", "subset_end_frame"),
    ("STP", "frame_step"),
    ("SC", "start_column"),
    ("SR", "start_row"),
    ("EC", "end_column"),
    ("ER", "end_row"),
    ("SP", "preview_start_size"),
    ("EP", "preview_end_size"),
    ("AM", "sampling_method"),
    ("AG", "antialias_gamma"),
    ("A", "antialias"),
    ("R", "antialias_depth"),
    ("J", "jitter"),
    ("Q", "quality"),
    ("I", "input_file_name"),
    ("O", "output_file_name"),
    ("F", "output_file_type"),
    ("WT", "work_threads"),
    ("WL", "warning_level"),
    ("W", "width"),
    ("HI", "include_header"),
    ("HTX", "histogram"),
    ("H", "height"),
    ("L", "library_path"),
    ("MV", "version"),
    ("GI", "create_ini"),
    ("V", "verbose"),
];

/// Settings that change nothing here: display, memory, bounding, messages and the like.
const WITHOUT_EFFECT: &[&str] = &[
    "all_console",
    "all_file",
    "antialias_gamma",
    "bits_per_color",
    "bounding",
    "bounding_method",
    "bounding_threshold",
    "bsp_basemaxdepth",
    "bsp_isectcost",
    "bsp_maxdepth",
    "bsp_misscost",
    "bsp_objectisectcost",
    "buffer_output",
    "buffer_size",
    "continue_trace",
    "create_continue_trace_log",
    "create_histogram",
    "create_ini",
    "debug_console",
    "debug_file",
    "display",
    "display_gamma",
    "dither",
    "dither_method",
    "draw_vistas",
    "fatal_console",
    "fatal_error_command",
    "fatal_error_return",
    "fatal_file",
    "file_gamma",
    "grayscale_output",
    "high_reproducibility",
    "histogram",
    "jitter",
    "jitter_amount",
    "light_buffer",
    "max_image_buffer_memory",
    "odd_field",
    "output_alpha",
    "palette",
    "pause_when_done",
    "post_frame_command",
    "post_frame_return",
    "post_scene_command",
    "post_scene_return",
    "pre_frame_command",
    "pre_frame_return",
    "pre_scene_command",
    "pre_scene_return",
    "preview_end_size",
    "preview_start_size",
    "quality",
    "radiosity_file_name",
    "radiosity_from_file",
    "radiosity_to_file",
    "radiosity_vain_pretrace",
    "real_time_raytracing",
    "remove_bounds",
    "render_block_size",
    "render_block_step",
    "render_console",
    "render_file",
    "render_pattern",
    "split_unions",
    "statistic_console",
    "statistic_file",
    "stochastic_seed",
    "test_abort",
    "test_abort_count",
    "user_abort_command",
    "user_abort_return",
    "vista_buffer",
    "warning_console",
    "warning_file",
    "warning_level",
];

fn flag(value: &str) -> bool {
    matches!(value.to_ascii_lowercase().as_str(), "true" | "yes" | "on" | "1")
}

impl Options {
    /// Takes a word of the command line: a switch, a setting, an `.ini` file or the scene.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn argument(&mut self, text: &str) -> Result<(), String> {
        if let Some(rest) = text.strip_prefix(['+', '-']) {
            return self.switch(rest, text.starts_with('+'));
        }
        if let Some((key, value)) = text.split_once('=') {
            return self.set(key, value);
        }
        let path = text.split('[').next().unwrap_or(text);
        match Path::new(path).extension().map(|e| e.to_ascii_lowercase()) {
            Some(e) if e == "ini" => self.ini_file(text),
            Some(_) => {
                self.input = Some(text.to_owned());
                Ok(())
            }
            None if Path::new(&format!("{path}.ini")).is_file() => self.ini_file(text),
            None => {
                self.input = Some(text.to_owned());
                Ok(())
            }
        }
    }

    fn switch(&mut self, text: &str, is_on: bool) -> Result<(), String> {
        let upper = text.to_ascii_uppercase();
        let Some((switch, key)) = SWITCHES.iter().find(|(s, _)| upper.starts_with(s)) else {
            // Display, pause, bounding, streams and so on change no picture.
            let known = ["B", "C", "D", "G", "M", "N", "P", "RF", "RS", "RP", "T", "U", "X"].iter().any(|s| upper.starts_with(s));
            if !known {
                self.warnings.push(format!("the switch {}{text} is not known", if is_on { '+' } else { '-' }));
            }
            return Ok(());
        };
        let value = &text[switch.len()..];
        match *key {
            "antialias" => {
                self.antialias = is_on;
                if value.is_empty() { Ok(()) } else { self.set("antialias_threshold", value) }
            }
            "antialias_depth" if !value.starts_with(|c: char| c.is_ascii_digit()) => Ok(()),
            "cyclic_animation" | "verbose" if value.is_empty() || *key == "verbose" => self.set(key, if is_on { "on" } else { "off" }),
            "output_file_type" if value.is_empty() => Ok(()),
            "jitter" | "quality" | "create_ini" | "histogram" => Ok(()),
            _ if value.is_empty() => Err(format!("the switch {text} needs a value")),
            _ => self.set(key, value),
        }
    }

    /// Sets what `key=value` says.
    ///
    /// # Errors
    /// A value that does not fit.
    pub fn set(&mut self, key: &str, value: &str) -> Result<(), String> {
        let value = value.trim().trim_matches('"');
        let number = || value.parse::<f64>().map_err(|_| format!("{key}={value}: a number is expected"));
        let size = || match value.parse::<u32>() {
            Ok(n) if (1..=65_536).contains(&n) => Ok(n),
            _ => Err(format!("{key}={value}: a size between 1 and 65536 is expected")),
        };
        let lower = key.trim().to_ascii_lowercase();
        match lower.as_str() {
            "width" => self.width = size()?,
            "height" => self.height = size()?,
            "input_file_name" => self.input = Some(value.to_owned()),
            "output_file_name" => self.output = Some(value.to_owned()),
            "output_to_file" => {
                if !flag(value) {
                    self.warnings.push("the picture is written to a file all the same".to_owned());
                }
            }
            "output_file_type" => self.output_type(value),
            "library_path" => self.library.push(value.into()),
            "include_header" => self.warnings.push(format!("the header {value} is not included")),
            "include_ini" => self.ini_file(value)?,
            "declare" => match value.split_once('=') {
                Some((name, v)) => self.declares.push((name.trim().to_owned(), v.trim().to_owned())),
                None => return Err(format!("Declare={value}: NAME=VALUE is expected")),
            },
            "clock" => self.clock = number()?,
            "initial_frame" => {
                self.initial_frame = number()? as i32;
                self.initial_frame_is_given = true;
            }
            "final_frame" => self.final_frame = Some(number()? as i32).filter(|n| *n != -1),
            "initial_clock" => self.clocks[0] = number()?,
            "final_clock" => self.clocks[1] = number()?,
            "subset_start_frame" => self.subset[0] = Some(number()?),
            "subset_end_frame" => self.subset[1] = Some(number()?),
            "frame_step" => self.step = number()? as i32,
            "cyclic_animation" => self.is_cyclic = flag(value),
            "antialias" => self.antialias = flag(value),
            "antialias_depth" => self.antialias_depth = (number()? as u32).clamp(1, 9),
            "work_threads" => self.threads = number()?.clamp(0.0, 4096.0) as usize,
            "start_column" => self.part[0] = Some(number()?),
            "start_row" => self.part[1] = Some(number()?),
            "end_column" => self.part[2] = Some(number()?),
            "end_row" => self.part[3] = Some(number()?),
            "version" => self.version = Some((number()? * 100.0).round().clamp(100.0, 370.0) as u32),
            "verbose" => self.is_quiet = !flag(value),
            "field_render" if flag(value) => self.warnings.push("fields are rendered as whole frames".to_owned()),
            "field_render" => {}
            "antialias_threshold" => self.antialias_threshold = number()? as f32,
            "sampling_method" => self.is_recursive = number()? == 2.0,
            _ if WITHOUT_EFFECT.contains(&lower.as_str()) => {}
            _ => self.warnings.push(format!("the setting {key}={value} is not known")),
        }
        Ok(())
    }

    fn output_type(&mut self, value: &str) {
        self.extension = match value.chars().next().map(|c| c.to_ascii_uppercase()) {
            Some('N') => Some("png"),
            Some('J') => Some("jpg"),
            Some('E') => Some("exr"),
            Some('H') => Some("hdr"),
            _ => {
                self.warnings.push(format!("pictures of the type {value} are not written; PNG is"));
                Some("png")
            }
        };
    }

    /// Reads `name.ini` or `name.ini[Section]`: what stands before the first section and, if one is named, that section.
    fn ini_file(&mut self, text: &str) -> Result<(), String> {
        let (name, wanted) = match text.split_once('[') {
            Some((name, section)) => (name, Some(section.trim_end_matches(']').to_ascii_lowercase())),
            None => (text, None),
        };
        let candidates: Vec<PathBuf> = std::iter::once(PathBuf::new())
            .chain(self.library.iter().cloned())
            .flat_map(|f| [f.join(name), f.join(format!("{name}.ini"))])
            .collect();
        let Some(path) = candidates.iter().find(|p| p.is_file()) else { return Err(format!("{name}: there is no such file")) };
        if self.ini_depth >= INI_DEPTH {
            return Err(format!("{name}: .ini files are nested more than {INI_DEPTH} deep"));
        }
        let bytes = std::fs::read(path).map_err(|e| format!("{}: {e}", path.display()))?;
        self.ini_depth += 1;
        let result = self.ini_text(&String::from_utf8_lossy(&bytes), wanted.as_deref()).map_err(|e| format!("{}: {e}", path.display()));
        self.ini_depth -= 1;
        result
    }

    /// Obeys the text of an `.ini` file.
    ///
    /// # Errors
    /// A setting that is wrong, or that there is no such section.
    pub fn ini_text(&mut self, text: &str, wanted: Option<&str>) -> Result<(), String> {
        let mut is_read = true;
        let mut is_found = wanted.is_none();
        for line in text.lines() {
            let line = without_comment(line).trim();
            if let Some(section) = line.strip_prefix('[').and_then(|l| l.strip_suffix(']')) {
                is_read = wanted.is_some_and(|w| section.trim().eq_ignore_ascii_case(w));
                is_found |= is_read;
            } else if is_read && !line.is_empty() {
                match line.split_once('=') {
                    Some((key, value)) if !line.starts_with(['+', '-']) => self.set(key, value)?,
                    // Switches and names of files may stand in a line.
                    _ => line.split_whitespace().try_for_each(|word| self.argument(word))?,
                }
            }
        }
        if is_found { Ok(()) } else { Err(format!("there is no section [{}]", wanted.unwrap_or_default())) }
    }

    /// Which pixels get more than one sample.
    pub fn antialias(&self) -> Smoothing {
        // The recursive method has up to 2ⁿ samples in a direction; it is stood in for by as many everywhere in the pixel.
        let depth = if self.is_recursive { 1 << self.antialias_depth.min(3) } else { self.antialias_depth };
        match self.antialias_threshold {
            _ if !self.antialias => Smoothing::None,
            t if !(t > 0.0) => Smoothing::All { spp: depth * depth },
            threshold => Smoothing::Adaptive { threshold, depth },
        }
    }

    /// The part of the picture to render, as the first pixel and the one after the last.
    pub fn crop(&self) -> Option<[u32; 4]> {
        if self.part.iter().all(Option::is_none) {
            return None;
        }
        let place = |v: Option<f64>, size: u32, otherwise: u32| match v {
            Some(v) if v > 0.0 && v < 1.0 => (v * f64::from(size)) as u32,
            Some(v) => v as u32,
            None => otherwise,
        };
        let (w, h) = (self.width, self.height);
        let [x0, y0] = [place(self.part[0], w, 1).saturating_sub(1), place(self.part[1], h, 1).saturating_sub(1)];
        Some([x0, y0, place(self.part[2], w, w).min(w), place(self.part[3], h, h).min(h)])
    }

    /// The output file of a scene, with the digits of a frame.
    pub fn output_path(&self, input: &Path, suffix: Option<&str>) -> PathBuf {
        let stem = input.file_stem().map_or_else(|| "picture".into(), |s| s.to_string_lossy().into_owned());
        let named = match &self.output {
            None => PathBuf::from(stem),
            Some(o) if o.ends_with('/') || Path::new(o).is_dir() => Path::new(o).join(stem),
            Some(o) => PathBuf::from(o),
        };
        let written = ["png", "jpg", "jpeg", "exr", "hdr", "pfm", "film"];
        let own = named.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).filter(|_| self.output.is_some());
        let (base, extension) = match own {
            Some(e) if written.contains(&e.as_str()) => (named.with_extension(""), self.extension.map_or(e, str::to_owned)),
            Some(e) if ["tga", "bmp", "ppm", "gif", "iff", "tif"].contains(&e.as_str()) => {
                (named.with_extension(""), self.extension.unwrap_or("png").to_owned())
            }
            _ => (named, self.extension.unwrap_or("png").to_owned()),
        };
        let mut name = base.into_os_string();
        name.push(suffix.unwrap_or_default());
        name.push(".");
        name.push(extension);
        name.into()
    }
}

/// A line of an `.ini` file up to its comment.
fn without_comment(line: &str) -> &str {
    let mut in_quotes = false;
    for (i, c) in line.char_indices() {
        match c {
            '"' => in_quotes = !in_quotes,
            ';' | '#' if !in_quotes => return &line[..i],
            _ => {}
        }
    }
    line
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(arguments: &[&str]) -> Options {
        let mut options = Options::default();
        arguments.iter().for_each(|a| options.argument(a).unwrap());
        options
    }

    #[test]
    fn switches() {
        let o = of(&[
            "scene.pov",
            "+W640",
            "+h480",
            "+A0.3",
            "+R2",
            "+Oout.png",
            "+L/lib",
            "+K0.5",
            "-D",
            "-P",
            "+WT2",
            "+FN8",
            "+MV3.1",
            "-GA",
        ]);
        assert_eq!((o.width, o.height, o.clock, o.threads, o.version), (640, 480, 0.5, 2, Some(310)));
        assert_eq!(o.antialias(), Smoothing::Adaptive { threshold: 0.3, depth: 2 });
        assert_eq!(of(&["+A", "+AM2", "+R2"]).antialias(), Smoothing::Adaptive { threshold: 0.3, depth: 4 });
        assert_eq!(of(&["+A0.0"]).antialias(), Smoothing::All { spp: 9 });
        assert_eq!(of(&["+A0.1", "-A"]).antialias(), Smoothing::None);
        assert_eq!(o.input.as_deref(), Some("scene.pov"));
        assert!(o.warnings.is_empty(), "{:?}", o.warnings);
        assert_eq!(o.output_path(Path::new("scene.pov"), None), Path::new("out.png"));
        assert_eq!(o.output_path(Path::new("scene.pov"), Some("07")), Path::new("out07.png"));
        assert_eq!(of(&["+Oa.tga"]).output_path(Path::new("s.pov"), Some("1")), Path::new("a1.png"));
        assert_eq!(of(&["a.b.pov", "-A"]).output_path(Path::new("d/a.b.pov"), None), Path::new("a.b.png"));
        assert_eq!(of(&["+W100", "+H50", "+SC11", "+ER0.5"]).crop(), Some([10, 0, 100, 25]));
        let mut o = Options::default();
        assert!(o.argument("+Wx").is_err());
        assert!(o.argument("+W").is_err());
    }

    #[test]
    fn ini_files() {
        let text = "; comment\nWidth=100\nAntialias=On ; more\n+K2 +A\nDeclare=Size=3\nNonsense=1\n[Low]\nWidth=10\n[High]\nWidth=1000\n";
        let mut o = Options::default();
        o.ini_text(text, None).unwrap();
        assert_eq!((o.width, o.antialias, o.clock, o.declares.len(), o.warnings.len()), (100, true, 2.0, 1, 1));
        o.ini_text(text, Some("high")).unwrap();
        assert_eq!(o.width, 1000);
        assert!(o.ini_text(text, Some("none")).is_err());
    }
}
