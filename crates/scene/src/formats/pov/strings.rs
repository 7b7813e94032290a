//! String expressions (Strings).

use std::fmt::Write as _;
use std::sync::Arc;

use super::parser::{Parse, Parser, Token};
use super::value::Value;
use crate::span::Span;

/// Most bytes of a string.
const STRING_LIMIT: usize = 1 << 20;
/// Most bytes of all strings that a scene makes.
const STRINGS_LIMIT: u64 = 1 << 32;

const STRING_WORDS: &[&str] = &["chr", "concat", "datetime", "input_file_name", "str", "strlwr", "strupr", "substr", "vstr"];

impl Parser {
    /// Whether the next token begins a string.
    pub(super) fn at_string(&mut self) -> Parse<bool> {
        Ok(match self.peek()? {
            Token::Text(_) | Token::Identifier(_, Value::String(_)) => true,
            Token::Word(w) => STRING_WORDS.contains(w),
            _ => false,
        })
    }

    /// A string literal, identifier or function.
    pub(super) fn string_value(&mut self) -> Parse<Arc<str>> {
        self.deeper(|p| {
            if !p.at_string()? {
                return Err(p.unexpected("a string"));
            }
            let span = p.span();
            match p.next()? {
                Token::Text(t) | Token::Identifier(_, Value::String(t)) => Ok(t),
                Token::Word("input_file_name") => {
                    let name = p.files.paths.first().and_then(|f| f.file_name()).map(|n| n.to_string_lossy().into_owned());
                    Ok(name.unwrap_or_default().into())
                }
                Token::Word(word) => {
                    p.expect("(")?;
                    let text = p.string_function(word, span)?;
                    p.expect(")")?;
                    p.count_string(&text, span)?;
                    Ok(text.into())
                }
                _ => Err(p.error(span, "this is no string")),
            }
        })
    }

    fn count_string(&mut self, text: &str, span: Span) -> Parse<()> {
        self.string_bytes += text.len() as u64;
        if text.len() > STRING_LIMIT || self.string_bytes > STRINGS_LIMIT {
            return Err(self.error(span, format!("a string longer than {STRING_LIMIT} bytes, or too many strings")));
        }
        Ok(())
    }

    fn string_function(&mut self, word: &str, span: Span) -> Parse<String> {
        Ok(match word {
            "chr" => {
                let code = self.full_float()?;
                char::from_u32(code as u32).unwrap_or(char::REPLACEMENT_CHARACTER).to_string()
            }
            "concat" => {
                let mut text = self.string_value()?.to_string();
                while self.accept(",")? || self.at_string()? {
                    text.push_str(&self.string_value()?);
                    if text.len() > STRING_LIMIT {
                        self.count_string(&text, span)?;
                    }
                }
                text
            }
            "str" => {
                let x = self.full_float()?;
                self.comma()?;
                let length = self.full_float()?;
                self.comma()?;
                let precision = self.full_float()?;
                format_float(x, length, precision)
            }
            "vstr" => {
                let count = self.full_float()?.clamp(2.0, 5.0) as u8;
                self.comma()?;
                let n = self.full()?;
                self.comma()?;
                let between = self.string_value()?;
                self.comma()?;
                let length = self.full_float()?;
                self.comma()?;
                let precision = self.full_float()?;
                let v = n.promoted(count).v;
                let parts: Vec<String> = v[..usize::from(count)].iter().map(|x| format_float(*x, length, precision)).collect();
                parts.join(&between)
            }
            "strlwr" => self.string_value()?.to_ascii_lowercase(),
            "strupr" => self.string_value()?.to_ascii_uppercase(),
            "substr" => {
                let text = self.string_value()?;
                self.comma()?;
                let at = self.full_float()?;
                self.comma()?;
                let length = self.full_float()?;
                let count = text.chars().count() as f64;
                if !(at >= 1.0 && length >= 0.0 && at.trunc() + length.trunc() - 1.0 <= count) {
                    return Err(self.error(span, format!("substr asks for more than the {count} characters that there are")));
                }
                text.chars().skip(at as usize - 1).take(length as usize).collect()
            }
            _ => {
                let days = self.full_float()?;
                let format = if self.accept(",")? { self.string_value()? } else { "%Y-%m-%d %H:%M:%SZ".into() };
                date_text(days, &format)
            }
        })
    }
}

/// The float at the start of a text, 0 where there is none, as C's `atof` reads it.
pub(super) fn number(text: &str) -> f64 {
    let text = text.trim_start();
    let b = text.as_bytes();
    let mut end = usize::from(matches!(b.first(), Some(b'+' | b'-')));
    let digits = |mut i: usize| {
        while b.get(i).is_some_and(u8::is_ascii_digit) {
            i += 1;
        }
        i
    };
    end = digits(end);
    if b.get(end) == Some(&b'.') {
        end = digits(end + 1);
    }
    if matches!(b.get(end), Some(b'e' | b'E')) {
        let sign = end + 1 + usize::from(matches!(b.get(end + 1), Some(b'+' | b'-')));
        if b.get(sign).is_some_and(u8::is_ascii_digit) {
            end = digits(sign);
        }
    }
    text[..end].parse().unwrap_or(0.0)
}

/// A float with `precision` digits after the point, padded to |`length`|: with blanks, or with zeros where `length` is negative.
pub(super) fn format_float(x: f64, length: f64, precision: f64) -> String {
    let digits = if precision < 0.0 { 6 } else { precision.min(300.0) as usize };
    let width = length.abs().min(1000.0) as usize;
    if !x.is_finite() {
        return format!(
            "{:>width$}",
            if x.is_nan() {
                "nan"
            } else if x > 0.0 {
                "inf"
            } else {
                "-inf"
            }
        );
    }
    if length < 0.0 { format!("{x:0width$.digits$}") } else { format!("{x:width$.digits$}") }
}

/// Days since the beginning of 2000, by the system's clock.
pub(super) fn days_since_2000() -> f64 {
    let since_1970 = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).map_or(0.0, |d| d.as_secs_f64());
    since_1970 / 86400.0 - 10957.0
}

/// A date as C's `strftime` writes it (the common fields), from days since the beginning of 2000.
fn date_text(days: f64, format: &str) -> String {
    let seconds = (days.clamp(-1e7, 1e7) * 86400.0).round() as i64;
    let (day, second) = (seconds.div_euclid(86400), seconds.rem_euclid(86400));
    let (year, month, date) = civil(day);
    let weekday = (day + 6).rem_euclid(7) as usize;
    const DAYS: [&str; 7] = ["Sunday", "Monday", "Tuesday", "Wednesday", "Thursday", "Friday", "Saturday"];
    const MONTHS: [&str; 12] =
        ["January", "February", "March", "April", "May", "June", "July", "August", "September", "October", "November", "December"];
    let (h, m, s) = (second / 3600, second / 60 % 60, second % 60);
    let mut out = String::new();
    let mut chars = format.chars();
    while let Some(c) = chars.next() {
        if c != '%' {
            out.push(c);
            continue;
        }
        let month_name = MONTHS[month as usize - 1];
        // Writing to a string does not fail.
        let _ = match chars.next() {
            Some('Y') => write!(out, "{year}"),
            Some('y') => write!(out, "{:02}", year.rem_euclid(100)),
            Some('m') => write!(out, "{month:02}"),
            Some('d') => write!(out, "{date:02}"),
            Some('e') => write!(out, "{date:2}"),
            Some('H') => write!(out, "{h:02}"),
            Some('I') => write!(out, "{:02}", (h + 11) % 12 + 1),
            Some('M') => write!(out, "{m:02}"),
            Some('S') => write!(out, "{s:02}"),
            Some('p') => write!(out, "{}", if h < 12 { "AM" } else { "PM" }),
            Some('A') => write!(out, "{}", DAYS[weekday]),
            Some('a') => write!(out, "{}", &DAYS[weekday][..3]),
            Some('B') => write!(out, "{month_name}"),
            Some('b' | 'h') => write!(out, "{}", &month_name[..3]),
            Some('w') => write!(out, "{weekday}"),
            Some('F') => write!(out, "{year}-{month:02}-{date:02}"),
            Some('T') => write!(out, "{h:02}:{m:02}:{s:02}"),
            Some('D') => write!(out, "{month:02}/{date:02}/{:02}", year.rem_euclid(100)),
            Some('j') => write!(out, "{:03}", day - day_of(year, 1, 1) + 1),
            Some('n') => writeln!(out),
            Some('t') => write!(out, "\t"),
            Some('Z') => write!(out, "UTC"),
            Some('%') => write!(out, "%"),
            Some(other) => write!(out, "%{other}"),
            None => write!(out, "%"),
        };
    }
    out
}

/// Days from the beginning of 2000 to a date of the Gregorian calendar.
fn day_of(year: i64, month: i64, date: i64) -> i64 {
    // Years begin with March, so that the leap day is the last.
    let (y, m) = if month > 2 { (year, month - 3) } else { (year - 1, month + 9) };
    365 * y + y.div_euclid(4) - y.div_euclid(100) + y.div_euclid(400) + (153 * m + 2) / 5 + date - 1 - 730_425
}

/// Year, month and date of a day counted from the beginning of 2000.
fn civil(day: i64) -> (i64, i64, i64) {
    let mut year = 2000 + day.div_euclid(366);
    while day_of(year + 1, 1, 1) <= day {
        year += 1;
    }
    let mut month = 1;
    while month < 12 && day_of(year, month + 1, 1) <= day {
        month += 1;
    }
    (year, month, day - day_of(year, month, 1) + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates() {
        assert_eq!(date_text(0.0, "%Y-%m-%d %H:%M:%SZ %A"), "2000-01-01 00:00:00Z Saturday");
        assert_eq!(date_text(8766.5, "%F %T %j"), "2024-01-01 12:00:00 001");
        assert_eq!(date_text(59.0, "%d %b"), "29 Feb");
    }

    #[test]
    fn floats_as_documented() {
        for (x, l, p, text) in [
            (123.456, 0.0, 3.0, "123.456"),
            (123.456, 9.0, 3.0, "  123.456"),
            (123.456, -9.0, 3.0, "00123.456"),
            (123.456, 0.0, 0.0, "123"),
            (123.456, 5.0, 0.0, "  123"),
            (123.0, 7.0, 2.0, " 123.00"),
            (123.456, 0.0, -1.0, "123.456000"),
        ] {
            assert_eq!(format_float(x, l, p), text);
        }
        assert_eq!((number(" -12.5e1x"), number("abc"), number("3.")), (-125.0, 0.0, 3.0));
    }
}
