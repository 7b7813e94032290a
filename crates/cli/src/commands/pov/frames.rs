//! The frames of an animation and their clocks (3.2.1 Animation Options).

use super::options::Options;

/// One picture to render.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// `frame_number`; 0 without animation.
    pub number: i32,
    /// `clock`.
    pub clock: f64,
    /// First and last frame of the animation.
    pub range: [i32; 2],
    /// First and last clock of the animation.
    pub clocks: [f64; 2],
    /// Digits for the name of the output file; `None` without animation.
    pub suffix: Option<String>,
}

/// Most frames of an animation.
const FRAME_LIMIT: usize = 1_000_000;

/// All pictures that the options ask for.
pub fn frames(options: &Options) -> Vec<Frame> {
    let first = options.initial_frame;
    let Some(last) = options.final_frame.filter(|last| *last > first || options.initial_frame_is_given && *last == first) else {
        let clock = options.clock;
        return vec![Frame { number: 0, clock, range: [0, 0], clocks: [0.0, 0.0], suffix: None }];
    };
    let count = f64::from(last) - f64::from(first);
    let [low, mut high] = options.clocks;
    if options.is_cyclic {
        // The frame after the last would be the first again.
        high = low + (high - low) * count / (count + 1.0);
    }
    let digits = last.to_string().len();
    let bound = |v: Option<f64>, otherwise: i32| match v {
        // A number below 1 is a share of the whole animation.
        Some(v) if (0.0..1.0).contains(&v) => first + (v * count).round() as i32,
        Some(v) => v as i32,
        None => otherwise,
    };
    let (from, to) = (bound(options.subset[0], first).max(first), bound(options.subset[1], last).min(last));
    (from..=to)
        .step_by(options.step.max(1) as usize)
        .take(FRAME_LIMIT)
        .map(|number| {
            let share = if count > 0.0 { (f64::from(number) - f64::from(first)) / count } else { 0.0 };
            Frame {
                number,
                clock: low + (high - low) * share,
                range: [first, last],
                clocks: [low, high],
                suffix: Some(format!("{number:0digits$}")),
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(arguments: &[&str]) -> Vec<Frame> {
        let mut options = Options::default();
        arguments.iter().for_each(|a| options.argument(a).unwrap());
        frames(&options)
    }

    #[test]
    fn clocks_and_names() {
        let all = of(&["+KFI1", "+KFF3"]);
        let short: Vec<(i32, f64, &str)> = all.iter().map(|f| (f.number, f.clock, f.suffix.as_deref().unwrap())).collect();
        assert_eq!(short, [(1, 0.0, "1"), (2, 0.5, "2"), (3, 1.0, "3")]);
        let all = of(&["+KFF10", "+KC", "+KI2", "+KF12"]);
        assert_eq!((all.len(), all[9].clock, all[0].suffix.as_deref()), (10, 11.0, Some("01")));
        let all = of(&["Final_Frame=100", "+SF30", "+EF0.4", "+STP5"]);
        assert_eq!(all.iter().map(|f| f.number).collect::<Vec<_>>(), [30, 35, 40]);
        assert_eq!(of(&["+K0.25"]), [Frame { number: 0, clock: 0.25, range: [0, 0], clocks: [0.0, 0.0], suffix: None }]);
    }
}
